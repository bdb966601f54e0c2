"""J's prior from a body that is known: where the model has the body, J is drawn to the model's, as long as they agree.

A model that was learned before knows J on plain surfaces, on what has just been uncovered and at the first image, where
flow tells little or nothing (beyond DIJE, which starts from zero). A bumped camera or a tool in the hand makes it
wrong: the share of the image motion that it explains is watched, and below a bound it has no say.
"""

from collections.abc import Callable

import numpy as np

from dense_vs.checks import check_number
from dense_vs.jacobian.estimator import DenseJacobian

MEMORY = 0.9  # of the agreement, from one measured motion to the next
MOVING = 0.5  # px by the model: pixels that move less say nothing
LEAST_PIXELS = 50


class BodyPrior:
    """Draws an estimator's J to that of a model.

    Args:
        known: gives J ``(H, W, 2, N)`` [px/rad] and a mask of the body ``(H, W)`` at a posture ``(N,)``, as
            ``BodyModel.known`` does.
        share: by which J is drawn at every measured motion; with 1 it is the model's wherever that has the body.
        least_agreement: below it the model has no say.
        told: gives ``(N, N)`` at a posture ``(N,)``, which joint steps the model's J speaks of, as
            ``PostureMemory.told`` does; of all unless given. In other directions J stays as it is.

    Attributes:
        agreement: share of the image motion on the body that the model explained lately; 1 is all, below 0 is worse
            than no model.

    Raises:
        DenseVSError: a share out of (0, 1], or an agreement above 1.
    """

    def __init__(
        self,
        known: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
        *,
        share: float = 1.0,
        least_agreement: float = 0.5,
        told: Callable[[np.ndarray], np.ndarray] | None = None,
    ):
        self.known, self.told = known, told
        self.share = check_number("share", share, above=0, most=1)
        self.least_agreement = check_number("least_agreement", least_agreement, most=1)
        self.agreement = 1.0

    @property
    def agrees(self) -> bool:
        """Whether the model has a say."""
        return self.agreement >= self.least_agreement

    def begin(self, estimator: DenseJacobian, positions: np.ndarray, share: float = 1.0) -> None:
        """Start from the model's J at a posture ``(N,)`` [rad], or draw what is there to it by a share."""
        J, body = self.known(positions)
        estimator.blend(self._completed(J, estimator, positions), np.float32(share) * body.astype(np.float32))

    def correct(self, estimator: DenseJacobian, positions: np.ndarray, flow: np.ndarray, span: np.ndarray) -> None:
        """After a measured motion: judge the model by it, and draw J to the model's if it agrees.

        Args:
            estimator: after its update.
            positions: ``(N,)`` [rad].
            flow: ``(H, W, 2)`` [px] that was measured.
            span: ``(N,)`` joint displacement of that flow [rad].
        """
        J, body = self.known(positions)
        predicted = J[body] @ np.asarray(span, dtype=np.float32)
        measured = flow[body]
        counted = (np.linalg.norm(predicted, axis=1) > MOVING) & np.isfinite(measured).all(axis=1)
        if counted.sum() >= LEAST_PIXELS:
            # Absolute values, not squares: where the flow fails it fails grossly.
            off = np.linalg.norm(measured[counted] - predicted[counted], axis=1).sum()
            moved = np.maximum(np.linalg.norm(measured[counted], axis=1), MOVING).sum()
            self.agreement = MEMORY * self.agreement + (1 - MEMORY) * (1 - float(off / moved))
        if self.agrees:
            estimator.blend(self._completed(J, estimator, positions), self.share * body.astype(np.float32))

    def _completed(self, J: np.ndarray, estimator: DenseJacobian, positions: np.ndarray) -> np.ndarray:
        """The model's J, with the estimator's in the directions that the model does not speak of."""
        if self.told is None:
            return J
        told = np.asarray(self.told(positions), dtype=np.float32)
        return J + estimator.to_numpy() @ (np.eye(len(told), dtype=np.float32) - told)
