"""How far an estimated dense image Jacobian is from the true one."""

from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.arrays import number_array, plain_array
from dense_vs.errors import DenseVSError

INNER_MARGIN = 3  # px


@dataclass(frozen=True)
class JacobianError:
    """Relative error ||J - J*|| / ||J*|| (Frobenius) over the robot's pixels.

    Attributes:
        median, p90: over all of them.
        inner_median: over those at least 3 px inside the outline.
        pixels: how many there are.
    """

    median: float
    p90: float
    inner_median: float
    pixels: int


def jacobian_error(estimated: np.ndarray, true: np.ndarray, robot_mask: np.ndarray) -> JacobianError:
    """Compare two dense Jacobians ``(H, W, 2, N)`` over a bool mask ``(H, W)``.

    Pixels that no joint moves (||J*|| = 0) have no relative error and are left out. NaN where none is left.

    Raises:
        DenseVSError: shapes that differ or do not fit, or a truth that is not finite.
    """
    estimated, true = number_array(estimated, "the estimate", finite=False), number_array(true, "the truth")
    mask = plain_array(robot_mask, "robot_mask", "bool of shape (H, W)")
    if estimated.shape != true.shape:
        raise DenseVSError(f"the estimate has shape {estimated.shape}; the truth has {true.shape}")
    if true.ndim != 4 or mask.shape != true.shape[:2] or mask.dtype != bool:
        raise DenseVSError(
            f"the truth has shape {true.shape}, robot_mask {mask.shape} and dtype {mask.dtype}; expected (H, W, 2, N) "
            "and bool (H, W)"
        )
    robot_mask = mask
    size = np.linalg.norm(true, axis=(2, 3))
    error = np.linalg.norm(estimated - true, axis=(2, 3))
    counted = robot_mask & (size > 0)
    relative = np.divide(error, size, out=np.zeros_like(error), where=size > 0)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * INNER_MARGIN + 1,) * 2)
    # The image border is no outline: the body goes on beyond it.
    inner = counted & cv2.erode(robot_mask.astype(np.uint8), disc, borderValue=1).astype(bool)

    def quantile(values: np.ndarray, q: float) -> float:
        return float(np.quantile(values, q)) if values.size else float("nan")

    of_robot = relative[counted]
    return JacobianError(
        quantile(of_robot, 0.5), quantile(of_robot, 0.9), quantile(relative[inner], 0.5), int(counted.sum())
    )
