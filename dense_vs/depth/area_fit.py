"""VOS-DE, VOS-VS (20): an object's depth from its mask areas at known camera positions, by least squares.

Over the views, sqrt(s_A) times the distance z_camera - z_object is constant, VOS-VS (18), so

    [sqrt(s_A,i)  1] [z_object, c_object]^T = z_camera,i sqrt(s_A,i)

Beyond the paper, the estimate tells its standard error, and where the camera did not move enough to tell a depth at
all, it is an error instead of a number.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_flag
from dense_vs.errors import DenseVSError


class DepthUnobservableError(DenseVSError):
    """The views do not determine a depth: the camera or the mask's size did not change by more than its noise."""


@dataclass(frozen=True)
class DepthEstimate:
    """An object's depth along the optical axis.

    Attributes:
        z_object: of the object [m], in the coordinate of ``camera_z``.
        c_object: VOS-VS (16) [m px], distance times square root of the area.
        distance: from the nearest used view to the object [m].
        distance_std: standard error of the distance [m] by the fit's residuals; infinite for two views, whose fit
            leaves none.
        residuals: ``(m,)`` [m px], z_object sqrt(s_A) + c_object - z_camera sqrt(s_A); NaN at views left out.
        used: ``(m,)`` bool, views that the fit stands on.
    """

    z_object: float
    c_object: float
    distance: float
    distance_std: float
    residuals: np.ndarray
    used: np.ndarray


def depth_from_areas(areas: Any, camera_z: Any, *, keep_empty: bool = False) -> DepthEstimate:
    """The least-squares solution of VOS-VS (20).

    Args:
        areas: ``(m,)`` [px], mask area s_A, VOS-VS (3), at each view.
        camera_z: ``(m,)`` [m], the camera's position along its optical axis, which points against z as in the paper:
            the distance is z_camera - z_object.
        keep_empty: whether a view without a mask (area 0), which knows nothing of the depth, stays a row of VOS-VS
            (20), as in the published scores; it pulls c_object toward 0.

    Raises:
        DepthUnobservableError: fewer than two views with a mask, a camera that does not move, sizes that do not change.
        DenseVSError: another shape, a value that is not finite, a negative area.
    """
    keep_empty = check_flag("keep_empty", keep_empty)
    areas, camera_z = checked_areas(areas), checked_positions(camera_z, "camera_z")
    if areas.shape != camera_z.shape:
        raise DenseVSError(f"areas have shape {areas.shape} and camera_z {camera_z.shape}; expected the same length")
    check_motion(camera_z[areas > 0])
    used = np.ones(len(areas), dtype=bool) if keep_empty else areas > 0
    size = np.sqrt(areas[used])
    if np.ptp(size) <= 1e-9 * size.max():
        raise DepthUnobservableError(
            f"the mask area is {areas[used][0]:g} px in all {len(size)} views while the camera moves "
            f"{np.ptp(camera_z[used]):g} m; expected it to change, else the object is infinitely far"
        )
    A = np.stack([size, np.ones_like(size)], axis=1)  # a row is VOS-VS (19)
    b = camera_z[used] * size
    solution = np.linalg.lstsq(A, b, rcond=None)[0]  # VOS-VS (20)
    z_object, c_object = float(solution[0]), float(solution[1])
    residuals = np.full(len(areas), np.nan)
    residuals[used] = A @ solution - b
    spread = np.inf
    if len(size) > 2:
        variance = np.sum(residuals[used] ** 2) / (len(size) - 2)
        spread = float(np.sqrt(variance / np.sum((size - size.mean()) ** 2)))
    seen = camera_z[areas > 0]
    nearest = float(seen[np.argmin(np.abs(seen - z_object))])
    return DepthEstimate(z_object, c_object, nearest - z_object, spread, residuals, used)


def checked_areas(areas: Any) -> np.ndarray:
    """Areas as float64 ``(m,)``; :class:`DenseVSError` where one is negative or not finite."""
    array = checked_positions(areas, "areas")
    if (array < 0).any():
        raise DenseVSError(f"areas are {array.tolist()}; expected none below 0")
    return array


def checked_positions(values: Any, name: str) -> np.ndarray:
    """A list of finite numbers as float64 ``(m,)``."""
    array = number_array(values, name, finite=False, expected="finite numbers (m,)")
    if array.ndim != 1 or not np.isfinite(array).all():
        raise DenseVSError(f"{name} have shape {array.shape} and values {array.tolist()}; expected finite numbers (m,)")
    return array


def check_motion(camera: np.ndarray) -> None:
    """Raise :class:`DepthUnobservableError` unless there are two views from different positions [m]."""
    if len(camera) < 2:
        raise DepthUnobservableError(f"{len(camera)} views show the object; expected at least 2")
    if np.ptp(camera) <= 1e-6:
        raise DepthUnobservableError(
            f"the camera moves {np.ptp(camera):g} m over {len(camera)} views; expected it to approach the object"
        )
