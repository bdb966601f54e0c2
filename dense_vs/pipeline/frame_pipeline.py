"""One camera frame through the estimator: grey, flow, joint step, J. The same for a live robot and a recording."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.body.self_body import SelfBody
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator, to_gray
from dense_vs.jacobian.estimator import DenseJacobian


@dataclass(frozen=True)
class Frame:
    """What one frame brought.

    Attributes:
        time: stamp of the image [s].
        image: the image as used, RGB uint8 ``(H, W, 3)`` or grey ``(H, W)``.
        gray: uint8 ``(H, W)``.
        positions: ``(N,)`` joint positions at ``time`` [rad].
        flow: float32 ``(H, W, 2)`` since the frame before [px]; None for the first frame.
        dq: ``(N,)`` joint step since the frame before [rad]; None for the first frame.
    """

    time: float
    image: np.ndarray
    gray: np.ndarray
    positions: np.ndarray
    flow: np.ndarray | None
    dq: np.ndarray | None


class FramePipeline:
    """Feeds an estimator from images and joint positions.

    Args:
        estimator: for one world; its size is the size of the images once scaled.
        flow: of the same size; the default method unless given.
        scale: factor on the image size, 0.5 in the paper.
        body: is fed with every frame's motion and J, where one is given; see :meth:`labels`.

    Raises:
        DenseVSError: sizes that differ, several worlds, a scale out of (0, 1].
    """

    def __init__(
        self,
        estimator: DenseJacobian,
        flow: FlowEstimator | None = None,
        *,
        scale: float = 1.0,
        body: SelfBody | None = None,
    ):
        size = estimator.options.height, estimator.options.width
        if estimator.options.worlds != 1:
            raise DenseVSError(f"estimator has {estimator.options.worlds} worlds; a pipeline takes one")
        if not 0 < scale <= 1:
            raise DenseVSError(f"scale is {scale!r}; expected a number above 0 and at most 1")
        self.estimator = estimator
        self.flow = flow or FlowEstimator(height=size[0], width=size[1])
        if (self.flow.height, self.flow.width) != size:
            raise DenseVSError(f"flow is for images of {self.flow.height, self.flow.width}; the estimator has {size}")
        if body is not None:
            body.fix_size(*size, estimator.options.joints)
        self.scale = scale
        self.body = body
        self.frame: Frame | None = None

    def process(self, image: Any, time: float, positions: Any) -> Frame:
        """Take the next image; from the second on the estimator is updated.

        Args:
            image: RGB uint8 ``(H, W, 3)`` or grey ``(H, W)``, before scaling.
            time: its stamp [s], later than the last one's.
            positions: ``(N,)`` joint positions at that time [rad].

        Raises:
            DenseVSError: another image size than before, a time that does not increase, bad positions; nothing has
                changed then.
        """
        last = self.frame
        if not np.isfinite(time) or (last is not None and time <= last.time):
            before = "" if last is None else f" after {last.time}"
            raise DenseVSError(f"image time stamp is {time} s{before}; expected increasing finite seconds")
        q = real_vector(positions, "positions", (self.estimator.options.joints,))
        scaled = self._scaled(np.asarray(image))
        gray = to_gray(scaled)
        expected = self.estimator.options.height, self.estimator.options.width
        if gray.shape != expected:
            raise DenseVSError(
                f"image of {gray.shape[1]} x {gray.shape[0]} pixels once scaled by {self.scale}; "
                f"expected {expected[1]} x {expected[0]}"
            )
        if last is None:
            self.frame = Frame(time, scaled, gray, q, None, None)
        else:
            flow = self.flow(last.gray, gray)
            dq = q - last.positions
            self.estimator.update(flow, dq)
            if self.body is not None:
                self.body.observe(flow, dq)
                self.body.submit(self.estimator.jacobian)
            self.frame = Frame(time, scaled, gray, q, flow, dq)
        return self.frame

    def labels(self) -> np.ndarray:
        """Whether each pixel of the last frame is the robot's own body, bool ``(H, W)``.

        Raises:
            DenseVSError: the pipeline has no ``body``.
        """
        if self.body is None:
            raise DenseVSError("the pipeline has no body to label; expected FramePipeline(..., body=SelfBody())")
        return self.body.labels(self.estimator.jacobian)

    def _scaled(self, image: np.ndarray) -> np.ndarray:
        """The image at the estimator's scale, never the camera's own buffer, which may hold the next frame soon."""
        image_like = image.dtype == np.uint8 and image.ndim >= 2 and image.shape[2:] in ((), (3,)) and image.size
        if self.scale == 1.0 or not image_like:  # what is no image is refused by its grey conversion
            return image.copy()
        height, width = scaled_size(image.shape[:2], self.scale)
        return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def scaled_size(shape: tuple[int, ...], scale: float) -> tuple[int, int]:
    """(height, width) of an image of ``shape`` scaled by ``scale``."""
    return round(shape[0] * scale), round(shape[1] * scale)
