"""A segmenter that takes time: the world runs on while it makes a mask, as it does for a robot."""

import numpy as np

from dense_vs.checks import check_number
from dense_vs.robot.command_gate import MAX_AGE
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.mobile_manipulator.world import MobileWorld


class TimedSegmenter:
    """Gives the masks of another segmenter, each after a time in which everything in the world goes on.

    The mask is of the image as it was taken: what moved since is elsewhere by then.

    Args:
        world: that runs on.
        segmenter: makes the masks.
        seconds: that one takes [s], rounded up to whole frames.

    Raises:
        DenseVSError: a time below 0, or one after which loops no longer act on an image.
    """

    def __init__(self, world: MobileWorld, segmenter: Segmenter, seconds: float):
        check_number("seconds", seconds, least=0.0, below=MAX_AGE)
        self._world, self._segmenter = world, segmenter
        self.frames = int(np.ceil(seconds / FRAME_SECONDS - 1e-9))

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask, bool ``(H, W)``; the world is :attr:`frames` frames on by then."""
        mask = self._segmenter.segment(image)
        self._world.wait(self.frames)
        return mask

    def reset(self) -> None:
        """Forget earlier images."""
        forget_images(self._segmenter)
