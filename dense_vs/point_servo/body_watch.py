"""Whether a body still looks as its model has it, asked now and then while the robot moves.

Motion hardly tells: with a joint's zero off by 0.1 rad an arm moves much as before, a few pixels beside where its model
has it (beyond the papers).
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from dense_vs.body_model import BodyModel
from dense_vs.body_model.drawn_patches import agreement
from dense_vs.body_model.spread import spread

EVERY = 30  # images with motion from one look to the next: a look takes 10 to 20 ms
LOOKS = 2  # that have to agree: a hand in front covers the body for a moment
COMPARED = 8  # images that tell how much a body usually looks like its model
UNTOLD = 0.85  # of it, where there are none: by noisy, compressed images
LEAST_SHARE = 0.85  # of the usual likeness


class BodyWatch:
    """Watches one body.

    Args:
        model: of the body.
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad] in which the model is right.

    Attributes:
        usual: how much these look like it, see :func:`.agreement`.
        latest: the same of the images looked at last.
    """

    def __init__(self, model: BodyModel, history: Sequence[tuple[np.ndarray, np.ndarray]]):
        self._model = model
        some = [history[k] for k in spread(len(history), COMPARED)] if len(history) else []
        self.usual = float(np.mean([agreement(model, q, gray) for gray, q in some])) if some else UNTOLD
        self.latest: deque[float] = deque(maxlen=LOOKS)
        self._until_next = EVERY

    @property
    def doubts(self) -> str:
        """What the body does not look like, in words; empty where it looks as usual."""
        if len(self.latest) < LOOKS or max(self.latest) >= LEAST_SHARE * self.usual:
            return ""
        return f"it looks like its model by {self.latest[-1]:.2f}, usually by {self.usual:.2f}"

    def see(self, gray: np.ndarray, positions: np.ndarray) -> None:
        """Take the next image with motion, uint8 ``(H, W)``, at joint positions ``(N,)`` [rad]."""
        self._until_next -= 1
        if self._until_next <= 0:
            self._until_next = EVERY
            self.latest.append(agreement(self._model, positions, gray))
