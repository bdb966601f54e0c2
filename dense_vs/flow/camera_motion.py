"""How a camera that sways moves its image: one similarity for all of the background, fitted to optical flow.

A camera on a humanoid's head, a truss or a tripod turns and shifts a little, and with it everything in the image that
stands still: p -> s R p + t, four numbers, from the flow at hundreds of places. What moves by itself is an outlier, as
long as it is the smaller part. Beyond the papers, whose cameras stand still.
"""

from dataclasses import dataclass

import cv2
import numpy as np

STEPS = 12  # of the reweighted least squares
LEAST_ERROR = 0.03  # px, that flow is never better than
INLIER = 3.0  # times the usual error


@dataclass(frozen=True)
class CameraMotion:
    """Where everything that stands still has moved in the image.

    Attributes:
        matrix: ``(2, 3)``, old place (x, y, 1) to new place [px].
        inliers: share of the places whose flow agrees.
        error: usual distance of the flow from it at the places that agree [px].
    """

    matrix: np.ndarray
    inliers: float
    error: float

    @classmethod
    def none(cls) -> "CameraMotion":
        """No motion at all."""
        return cls(np.eye(2, 3), 1.0, 0.0)

    def after(self, before: "CameraMotion") -> "CameraMotion":
        """``before`` and then this one."""
        whole = np.vstack([self.matrix, [0, 0, 1]]) @ np.vstack([before.matrix, [0, 0, 1]])
        return CameraMotion(whole[:2], min(self.inliers, before.inliers), max(self.error, before.error))

    def largest(self, height: int, width: int) -> float:
        """How far it moves the corner of an image that it moves most [px]."""
        corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=np.float64)
        return float(np.linalg.norm(self.moved(corners) - corners, axis=1).max())

    def moved(self, places: np.ndarray) -> np.ndarray:
        """New places of old ones ``(..., 2)`` [px]."""
        return places @ self.matrix[:, :2].T + self.matrix[:, 2]

    def taken_out(self, flow: np.ndarray) -> np.ndarray:
        """The flow ``(H, W, 2)`` of an image as if its camera had stood where it is now, float32 [px].

        A flow u at x comes from x - u, which this motion has brought to A(x - u): what is left is x - A(x - u).
        """
        height, width = flow.shape[:2]
        y, x = np.mgrid[:height, :width].astype(np.float32)
        now = np.stack([x, y], axis=2)
        rest = (self.matrix[:, :2] - np.eye(2)).astype(np.float32)  # small numbers, which float32 keeps
        before = now - flow
        return flow - (before @ rest.T + self.matrix[:, 2].astype(np.float32))

    def carried(self, image: np.ndarray) -> np.ndarray:
        """An image ``(H, W, C)`` float32 moved with the camera; the border goes on outside."""
        height, width = image.shape[:2]
        flat = np.ascontiguousarray(image.reshape(height, width, -1))
        moved = np.empty_like(flat)
        for first in range(0, flat.shape[2], 4):  # OpenCV takes four channels
            part = np.ascontiguousarray(flat[..., first : first + 4])
            whole = cv2.warpAffine(
                part, self.matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            moved[..., first : first + 4] = whole.reshape(part.shape)
        return moved.reshape(image.shape)


def fit_camera_motion(places: np.ndarray, flow: np.ndarray) -> CameraMotion | None:
    """The similarity that most of the flow agrees with; None where too few places are left.

    Args:
        places: ``(K, 2)`` of the present image [px].
        flow: ``(K, 2)`` there [px]; what is not finite is left out.
    """
    usable = np.isfinite(flow).all(axis=1)
    now, u = places[usable].astype(np.float64), flow[usable].astype(np.float64)
    if len(now) < 20:
        return None
    before = now - u
    middle, size = before.mean(axis=0), max(float(before.std()), 1.0)
    x, y = ((before - middle) / size).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    basis = np.array([[one, zero], [zero, one], [-y, x], [x, y]]).transpose(2, 1, 0)  # (K, 2, 4)
    parameters = np.array([*np.median(u, axis=0), 0.0, 0.0])
    error = LEAST_ERROR
    for _ in range(STEPS):
        distance = np.linalg.norm(u - basis @ parameters, axis=1)
        error = max(1.4826 * float(np.median(distance)), LEAST_ERROR)
        weight = 1 / np.square(1 + np.square(distance / error))
        weighted = basis * weight[:, None, None]
        normal = np.einsum("kip,kiq->pq", weighted, basis)
        parameters = np.linalg.lstsq(normal, np.einsum("kip,ki->p", weighted, u), rcond=1e-9)[0]
    distance = np.linalg.norm(u - basis @ parameters, axis=1)
    shift, turn, growth = parameters[:2], parameters[2] / size, parameters[3] / size
    linear = np.array([[growth, -turn], [turn, growth]])
    matrix = np.column_stack([np.eye(2) + linear, shift - linear @ middle])
    return CameraMotion(matrix, float((distance < INLIER * error).mean()), error)
