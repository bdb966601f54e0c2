"""The paper's optimizer: L-BFGS for a number of iterations, on minibatches of the samples first where asked for."""

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from dense_vs.generative.report import Stage

ITERATIONS = 200
BATCHES = 10  # minibatches before the final period
BATCH_SHARE = 0.5  # of the samples

Loss = Callable[[np.ndarray], tuple[float, np.ndarray]]  # the unknowns to the loss and its gradient


def minimize_by_minibatches(
    name: str,
    loss_of: Callable[[np.ndarray], Loss],
    x: np.ndarray,
    samples: int,
    rng: np.random.Generator,
    clock: float,
    residuals: int,
) -> tuple[np.ndarray, Stage]:
    """Half of the iterations on random parts of the samples, the other half on all."""
    full = loss_of(np.arange(samples))
    initial = full(x)[0]
    size = max(int(BATCH_SHARE * samples), min(samples, 8))
    for _ in range(BATCHES):
        batch = np.sort(rng.choice(samples, size, replace=False))
        x = minimize(loss_of(batch), x, jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS // (2 * BATCHES)}).x
    x, stage = minimize_loss(name, full, x, ITERATIONS // 2, clock, residuals)
    iterations = stage.iterations + ITERATIONS // 2
    return x, Stage(name, initial, stage.loss, stage.rms, iterations, stage.converged, stage.seconds)


def minimize_loss(
    name: str,
    loss: Loss,
    x: np.ndarray,
    iterations: int,
    clock: float,
    residuals: int,
) -> tuple[np.ndarray, Stage]:
    """Up to ``iterations`` from ``x``, reported as a stage that began at ``clock`` with so many ``residuals``."""
    initial = loss(x)[0]
    result = minimize(loss, x, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxfun": 4 * iterations})
    seconds = time.perf_counter() - clock
    rms = float(np.sqrt(result.fun / max(residuals, 1)))
    return result.x, Stage(name, initial, float(result.fun), rms, int(result.nit), bool(result.success), seconds)
