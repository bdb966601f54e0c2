"""How far a model's pixels may be off at postures like those it was learned from, from the samples alone.

Beyond the paper. A model can explain few samples to within their noise and still be wrong elsewhere. The covariance of
what was learned, the inverse of the normal matrix, shows this without holding samples out. To that comes what no
parameter explains at the samples either, as where joints are in another unit or belong to other images.
"""

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelProblem, PixelState
from dense_vs.generative.prediction import predict

POSTURES = 30
DRAWS = 50
BY_CHANCE = 1.5  # times the noise: residuals that may be noise
OPEN = 1e-11  # eigenvalue of the information with a unit diagonal: below, the direction is open, as the scale is


def expected_error(
    problem: PixelProblem, state: PixelState, pixels: np.ndarray, postures: np.ndarray, pixel_sigma: float
) -> float:
    """Mean distance [px] between the pixels of the model and the true ones, without measurement noise.

    Args:
        problem: that was solved; of joints that are read, exactly or with noise.
        state: its solution.
        pixels: ``(T, c, m, 2)`` measured; what counts later is where the cameras saw something then.
        postures: ``(K, n)`` [rad] whose spread other postures are to have.
        pixel_sigma: noise of a pixel coordinate [px].

    Infinite where the observations leave nothing but noise.
    """
    rng = np.random.default_rng(0)
    parameters = state.parameters
    count = postures.shape[1]
    spread = np.cov(postures.T).reshape(count, count)
    joints = rng.multivariate_normal(postures.mean(axis=0), spread, POSTURES, method="eigh")
    generated = predict(parameters, joints)
    # Where the cameras saw something; no place of a camera that saw nothing.
    low = np.where(np.isnan(pixels), np.inf, pixels).min(axis=(0, 2))[:, None]
    high = np.where(np.isnan(pixels), -np.inf, pixels).max(axis=(0, 2))[:, None]
    with np.errstate(invalid="ignore"):
        shown = ((generated >= low) & (generated <= high)).all(axis=-1) & problem.seen.any(axis=(0, 1))
    if not shown.any():
        return np.inf
    others = PixelProblem(np.where(shown[..., None], generated, np.nan), problem.links, count, problem.free)
    wrong = pixel_sigma * inverse_root(shared_information(problem.linearize(state)))
    wrong = wrong @ rng.normal(size=(wrong.shape[1], DRAWS))
    off = others.pixel_changes(PixelState(parameters, joints), wrong)
    return float(np.linalg.norm(off, axis=-2)[shown].mean())


def unexplained_distance(rms: float, pixel_sigma: float) -> float:
    """Mean distance [px] that residuals of ``rms`` a coordinate show beyond noise of ``pixel_sigma``.

    What no parameter explains at the samples is there at other postures too; 0 where chance may have made it.
    """
    if rms <= BY_CHANCE * pixel_sigma:
        return 0.0
    return float(np.sqrt(np.pi / 2 * (rms**2 - pixel_sigma**2)))


def shared_information(equations: NormalEquations) -> np.ndarray:
    """The normal matrix of the shared unknowns once every sample's own are eliminated; those must not be chained."""
    if equations.local is None:
        return equations.shared
    assert equations.coupling is not None
    solved = np.linalg.solve(equations.local, equations.coupling)
    return equations.shared - (equations.coupling.swapaxes(1, 2) @ solved).sum(axis=0)


def inverse_root(information: np.ndarray) -> np.ndarray:
    """R ``(k, r)`` with R R^T the inverse, over the directions that are not open."""
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    told = values > OPEN
    return scale[:, None] * vectors[:, told] / np.sqrt(values[told])
