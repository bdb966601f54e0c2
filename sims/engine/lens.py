"""A camera's lens: which direction each pixel looks in, and where a direction is seen.

Directions are (X/Z, Y/Z) in camera axes x right, y down, z forward. A radial distortion shows them

    fx nx (1 + k1 r^2 + k2 r^4) + cx,    fy ny (1 + k1 r^2 + k2 r^4) + cy,    r^2 = nx^2 + ny^2,

the first two terms of Brown's model, which OpenCV calls k1 and k2.
"""

import cv2
import numpy as np

from dense_vs.errors import DenseVSError

LEAST_SLOPE = 0.2  # of the seen radius over the true one: below, the outer image is squeezed to nothing or folded
_FOLLOWED = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)


class Lens:
    """Pixels from directions and back.

    Args:
        intrinsics: (3, 3) camera matrix [px], pixel centers at integer coordinates.
        size: height and width [px].
        distortion: k1, k2.

    Raises:
        DenseVSError: a distortion that folds the image.
    """

    def __init__(self, intrinsics: np.ndarray, size: tuple[int, int], distortion: tuple[float, float] = (0.0, 0.0)):
        self.intrinsics = np.asarray(intrinsics, dtype=np.float64)
        self.distortion = distortion
        self._focal = np.diag(self.intrinsics)[:2]
        self._center = self.intrinsics[:2, 2]
        self._size = size
        height, width = size
        corners = [[x, y] for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)]
        seen = np.hypot(*((np.array(corners) - self._center) / self._focal).T).max()
        self._farthest = _farthest(seen, distortion)

    @property
    def distorts(self) -> bool:
        """Whether it is more than a pinhole."""
        return any(self.distortion)

    def pixels(self, directions: np.ndarray) -> np.ndarray:
        """Where directions (..., 2) are seen [px]; nan where a distorting lens does not show them any more."""
        n = np.asarray(directions, dtype=np.float64)
        if self.distorts:
            k1, k2 = self.distortion
            square = np.sum(n**2, axis=-1, keepdims=True)
            # Beyond, the polynomial may turn back into the image.
            n = np.where(square <= self._farthest**2, n * (1 + square * (k1 + square * k2)), np.nan)
        return n * self._focal + self._center

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Directions (..., 2) that pixels (..., 2) look in."""
        pixels = np.asarray(pixels, dtype=np.float64)
        if not self.distorts:
            return (pixels - self._center) / self._focal
        coefficients = np.array([*self.distortion, 0.0, 0.0])
        found = cv2.undistortPoints(
            np.ascontiguousarray(pixels.reshape(-1, 1, 2)), self.intrinsics, coefficients, criteria=_FOLLOWED
        )
        return np.asarray(found).reshape(pixels.shape)

    def grid(self, samples: int = 1) -> np.ndarray:
        """Directions (samples H, samples W, 2) of the middles of all pixels, or of the squares each is cut into."""
        height, width = self._size
        y, x = ((np.arange(side * samples) + 0.5) / samples - 0.5 for side in (height, width))
        return self.directions(np.stack(np.meshgrid(x, y), axis=-1))

    def rays(self, samples: int = 1) -> np.ndarray:
        """The same as unit vectors (samples^2 H W, 3), in MuJoCo's camera axes: x right, y up, z backward."""
        n = self.grid(samples).reshape(-1, 2)
        rays = np.concatenate([n[:, :1], -n[:, 1:], -np.ones((len(n), 1))], axis=1)
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _farthest(seen: float, distortion: tuple[float, float]) -> float:
    """Radius whose distorted one is a little beyond ``seen``, that of the image's corner."""
    k1, k2 = distortion
    radii = np.linspace(0.0, 4.0 * seen + 1.0, 4001)
    square = radii**2
    slopes = 1 + square * (3 * k1 + square * 5 * k2)
    shown = radii * (1 + square * (k1 + square * k2))
    beyond = np.flatnonzero(shown > 1.1 * seen)
    last = beyond[0] if len(beyond) else len(radii) - 1
    if not len(beyond) or slopes[: last + 1].min() < LEAST_SLOPE:
        raise DenseVSError(
            f"distortion is {distortion}; expected k1, k2 that show the whole image without folding it "
            f"(its corner is {seen:.2f} focal lengths from the middle)"
        )
    return float(radii[last])
