"""What a known body has left: J stays behind there, on a background that stands still (beyond DIJE).

DIJE (13) takes J along with what moves, and what the body uncovers keeps J as it was until motion has unlearned it,
joint by joint, which takes seconds. A model knows where the body was a moment ago and is no longer. Its outline is some
pixels off, and parts of the robot that it does not know may have come there, so the image has the last word: only where
J says that a pixel moved by now, and it did not, has J no business there.
"""

import cv2
import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.body.vacated import vacated
from dense_vs.kernels.launch import PixelLaunch

LATELY = 300  # measured motions since the body was there
BESIDE = 4  # px about the body, which its outline may be off
MOVING = 0.3  # px by J, below which a motion says nothing
STILL = 0.5  # of the motion by J, below which nothing moves


class Vacated:
    """Pixels that the body has left, in the images of one camera."""

    def __init__(self, size: tuple[int, int]):
        shape = (1, *size)
        masks = tuple(wp.zeros(shape, dtype=wp.uint8, device="cpu") for _ in range(3))
        flows = tuple(wp.zeros(shape, dtype=wp.vec2, device="cpu") for _ in range(2))
        ago = wp.full(shape, LATELY + 1, dtype=wp.int16, device="cpu")  # motions since the body was there
        arguments = [*masks[:2], *flows, LATELY, STILL, MOVING, ago, masks[2]]
        self._launch = PixelLaunch(vacated, shape, arguments, "cpu", resolve_threads())
        self._given = tuple(array.numpy()[0] for array in (*masks[:2], *flows))
        self._left = masks[2].numpy()[0]

    def observe(self, body: np.ndarray, flow: np.ndarray, by_estimate: np.ndarray) -> np.ndarray:
        """Take a measured motion; bool ``(H, W)``, pixels that the body has left and on which J stays behind.

        Args:
            body: bool ``(H, W)``, where the model has the body by now.
            flow: ``(H, W, 2)`` measured [px]; what is not finite says nothing.
            by_estimate: ``(H, W, 2)`` what the joints cause by J as it is [px].
        """
        near = cv2.dilate(body.astype(np.uint8), _AROUND)
        for array, image in zip(self._given, (body, near, flow, by_estimate), strict=True):
            array[...] = image
        self._launch()
        return self._left > 0


_AROUND = np.ones((2 * BESIDE + 1, 2 * BESIDE + 1), np.uint8)
