"""Variance and covariance of J's columns as users see them: in the joints' own units, with or without a shared form."""

import numpy as np

from dense_vs.jacobian.filter import JacobianFilter


def own_variance(rows: JacobianFilter) -> np.ndarray:
    """Variances (B, H, W, N) [px^2/rad^2]; infinite for a joint that is not learned."""
    options, stored = rows.options, rows.stored_covariance()
    if options.covariance == "diagonal":
        return stored
    if options.covariance == "full":
        return np.diagonal(stored, axis1=-2, axis2=-1)
    factors = np.array(options.step_factors)
    own = np.diagonal(stored, axis1=1, axis2=2)[:, : options.joints] * np.square(factors)
    shared = np.where(factors > 0, own, np.inf)[:, None, None].astype(np.float32)
    return np.broadcast_to(shared, (*rows.shape, options.joints))


def own_covariance(rows: JacobianFilter) -> np.ndarray:
    """Covariance of a row of J, (B, N, N), or (B, H, W, N, N) where each pixel has its own [px^2/rad^2]."""
    options, stored = rows.options, rows.stored_covariance()
    if options.covariance == "diagonal":
        stored = stored[..., None] * np.eye(options.joints, dtype=np.float32)
    kept = stored[..., : options.joints, : options.joints]
    if options.joint_scale is None:
        return kept.copy()
    factors = np.array(options.step_factors)
    scaled = kept * np.outer(factors, factors)  # 0 for a joint that is not learned
    return np.where(np.diag(factors == 0), np.inf, scaled)


def motion_variance(rows: JacobianFilter, span: np.ndarray) -> float:
    """Variance of a component of J s for a joint displacement s ``(N,)`` [rad], by what is not known of J [px^2].

    Of one world, with a covariance that all pixels share; joints that are not learned say nothing.
    """
    options = rows.options
    step = np.asarray(span, dtype=np.float64) * np.array(options.step_factors)
    return float(step @ rows.stored_covariance()[0, : options.joints, : options.joints] @ step)
