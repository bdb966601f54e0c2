"""J that is only moved with the image, by (13) or (14), and never corrected: what Fig. 4 of DIJE shows.

With the correction (10) on, both transports leak alike, as a wrong J is put right as fast as it is carried off. Alone,
(13) carries the body's J off with whatever moves past it; (14) carries it by its own prediction only.
"""

import numpy as np

from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.sims.papers.dije.labeling import View

NO_CORRECTION = 1e12  # variance of a flow component [px^2] that leaves a gain of nothing
LEAST_JACOBIAN = 15.0  # px/rad; where J is larger it counts as the body's


class Transport:
    """The J of labelled pixels, zero elsewhere, under one transport.

    Args:
        jacobian: ``(H, W, 2, N)`` at the start [px/rad].
        own: ``(H, W)`` bool, the body's pixels then.
        prediction: ``"flow"`` (13) or ``"model"`` (14).
        device, threads: as of :class:`DenseJacobian`.
    """

    def __init__(self, jacobian: np.ndarray, own: np.ndarray, prediction: str, device: str, threads: int | None):
        height, width, _, joints = jacobian.shape
        self._estimator = DenseJacobian(
            height=height,
            width=width,
            joints=joints,
            order=1,
            prediction=prediction,
            prediction_iterations=1,
            process_noise=0.0,
            initial_variance=1.0,
            measurement_noise=NO_CORRECTION,
            on_bad_flow="skip",
            device=device,
            threads=threads,
        )
        self._leak: list[float] = []
        masked = np.where(own[..., None, None], jacobian, np.float32(0.0))
        self._estimator.filter.restore({**self._estimator.filter.stored(), "state": masked[None]})

    def take(self, view: View, least_pixels: int = 100) -> None:
        """Move J by a frame."""
        self._estimator.update(view.flow, view.dq)
        seen = int(view.walker.sum())
        if seen >= least_pixels:
            self._leak.append(float((self.own() & view.walker).sum() / seen))

    def leak(self) -> float:
        """Share of the walker's pixels that had the body's J, mean over the frames; NaN where hardly any were seen."""
        return float(np.mean(self._leak)) if self._leak else float("nan")

    def own(self) -> np.ndarray:
        """Where the body's J has got to, ``(H, W)`` bool."""
        return np.linalg.norm(self._estimator.to_numpy(), axis=(2, 3)) > LEAST_JACOBIAN
