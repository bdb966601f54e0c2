"""What a known body has left: J stays behind there, on a background that stands still (beyond DIJE).

DIJE (13) takes J along with what moves, and what the body uncovers keeps J as it was until motion has unlearned it,
joint by joint, which takes seconds. A model knows where the body was a moment ago and is no longer. Its outline is some
pixels off, and parts of the robot that it does not know may have come there, so the image has the last word: only where
J says that a pixel moved by now, and it did not, has J no business there.
"""

import cv2
import numpy as np

LATELY = 300  # measured motions since the body was there
BESIDE = 4  # px about the body, which its outline may be off
MOVING = 0.3  # px by J, below which a motion says nothing
STILL = 0.5  # of the motion by J, below which nothing moves


class Vacated:
    """Pixels that the body has left, in the images of one camera."""

    def __init__(self, size: tuple[int, int]):
        self._ago = np.full(size, LATELY + 1, np.int16)  # motions since the body was there

    def observe(self, body: np.ndarray, flow: np.ndarray, by_estimate: np.ndarray) -> np.ndarray:
        """Take a measured motion; bool ``(H, W)``, pixels that the body has left and on which J stays behind.

        Args:
            body: bool ``(H, W)``, where the model has the body by now.
            flow: ``(H, W, 2)`` measured [px]; what is not finite says nothing.
            by_estimate: ``(H, W, 2)`` what the joints cause by J as it is [px].
        """
        self._ago += self._ago <= LATELY
        np.putmask(self._ago, body, 0)
        left = (self._ago <= LATELY) & (cv2.dilate(body.astype(np.uint8), _AROUND) == 0)
        at = np.flatnonzero(left)
        expected = np.hypot(*by_estimate.reshape(-1, 2)[at].T)
        still = np.hypot(*flow.reshape(-1, 2)[at].T) < STILL * expected  # False where it is not a number
        left.flat[at] = still & (expected > MOVING)
        return left


_AROUND = np.ones((2 * BESIDE + 1, 2 * BESIDE + 1), np.uint8)
