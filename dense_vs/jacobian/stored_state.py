"""Whether a stored state of the filter is one that the filter can have come to, asked before it goes on from it."""

from collections.abc import Mapping

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.jacobian.options import JacobianOptions
from dense_vs.kernels.jacobian.covariance import state_columns
from dense_vs.kernels.jacobian.depth_state import depth_columns

STATE = ("state", "covariance", "displacement")
DEPTH = ("depth_state", "depth_covariance")  # of an estimate with depth
LARGEST = 1e9  # px/rad, and rad of the displacement; far beyond any camera and arm, far below float32's range
ROUNDING = 1e-5  # of a covariance, relative to its largest element


def check_stored(content: Mapping[str, np.ndarray], options: JacobianOptions) -> None:
    """Check the arrays :data:`STATE` of a file, with depth :data:`DEPTH` too.

    Raises:
        DenseVSError: an array is missing, or of another shape or dtype; a value that is not finite or beyond anything
            that a filter learns; a covariance that is none: not symmetric, or negative along some direction.
    """
    worlds, height, width, joints = options.worlds, options.height, options.width, options.joints
    columns = state_columns(joints, options.order or 1)
    per_pixel = {"diagonal": (joints,), "full": (joints, joints)}.get(options.covariance)
    shapes = {
        "state": ((worlds, height, width, 2, columns), np.float32),
        "covariance": ((worlds, columns, columns), np.float64)
        if per_pixel is None
        else ((worlds, height, width, *per_pixel), np.float32),
        "displacement": ((worlds, joints), np.float64),
    }
    if options.depth:
        size = depth_columns(joints, options.order or 1)
        shapes["depth_state"] = (worlds, height, width, size), np.float32
        shapes["depth_covariance"] = (worlds, size, size), np.float64
    for name, (shape, dtype) in shapes.items():
        if name not in content:
            raise DenseVSError(f"{name} is missing")
        found = content[name]
        if found.shape != shape or found.dtype != dtype or not np.isfinite(found).all():
            raise DenseVSError(
                f"{name} has shape {found.shape} and dtype {found.dtype}; "
                f"expected finite values of shape {shape} and dtype {np.dtype(dtype)}"
            )
    for name in shapes.keys() & {"state", "displacement", "depth_state"}:
        largest = float(np.abs(content[name]).max(initial=0.0))
        if largest > LARGEST:
            raise DenseVSError(f"{name} holds {largest:g}; expected at most {LARGEST:g}")
    _check_covariance(content["covariance"], options.covariance == "diagonal")
    if options.depth:
        _check_covariance(content["depth_covariance"], False)


def _check_covariance(covariance: np.ndarray, diagonal: bool) -> None:
    if diagonal:
        least = float(covariance.min(initial=0.0))
    else:
        margin = ROUNDING * float(np.abs(covariance).max(initial=0.0))
        if np.abs(covariance - covariance.swapaxes(-1, -2)).max(initial=0.0) > margin:
            raise DenseVSError("covariance is not symmetric")
        least = float(np.linalg.eigvalsh(covariance).min(initial=0.0)) + margin
    if least < 0:
        raise DenseVSError(f"covariance has a variance of {least:g}; expected none below 0")
