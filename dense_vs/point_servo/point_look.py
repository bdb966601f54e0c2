"""How the surface around a point looked when the point was defined, and where that look is seen in other images.

The body's chain says how the surface has turned since, so the look is compared as it has to appear by now, and only its
place is sought: near where the chain expects it, mostly along the line that the point's unknown depth leaves open.
Known so, a look is found again at postures at which a patch compared as it was no longer is.
"""

import cv2
import numpy as np

MOST_RADIUS, LEAST_RADIUS = 12, 2  # px of the look about the expected place, in which it is sought
STANDARD_DEVIATIONS = 3.0  # that the search spans
CORRELATION_NOISE = 0.03  # by which correlations differ without reason, against distances from the expected place
BLUR = 0.8  # px, before looks are compared
WIDTH = 0.35  # of the window: standard deviation of the weight of the look's pixels
LEAST_PIXELS = 60  # of the same surface, for others to be left out
LEAST_SCALE, MOST_SCALE = 0.4, 2.5  # by which the look may have shrunk or grown in any direction


class PointLook:
    """The look around one point.

    Args:
        gray: uint8 ``(H, W)``, the image in which the point is defined.
        point: ``(2,)`` [px].
        same: bool ``(H, W)``, pixels that move as the point does; others do not count.
        window: side of the look [px], odd.
    """

    def __init__(self, gray: np.ndarray, point: np.ndarray, same: np.ndarray | None, window: int):
        half = window // 2
        self._half = half
        x, y = np.meshgrid(np.arange(-half, half + 1.0), np.arange(-half, half + 1.0))
        weights = np.exp(-(x**2 + y**2) / (2 * (WIDTH * window) ** 2))
        if same is not None:
            own = _sampled(same.astype(np.float32), point, np.eye(2), half) > 0.5
            if own.sum() >= LEAST_PIXELS:
                weights = weights * own
        self._weights = (weights / weights.sum()).ravel()
        look = _blurred(_sampled(gray, point, np.eye(2), half)).ravel()
        self._look = look - self._weights @ look
        self._contrast = float(np.sqrt(self._weights @ self._look**2))

    def found(
        self, gray: np.ndarray, expected: np.ndarray, affine: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Where the look is seen ``(2,)`` [px], and its correlation there; -1 where it cannot be seen.

        Args:
            gray: uint8 ``(H, W)``.
            expected: ``(2,)`` [px], where the point should be.
            affine: ``(2, 2)``, from px about the point in the first image to px here.
            covariance: ``(2, 2)`` of the expected place [px^2].
        """
        scales = np.linalg.svd(affine, compute_uv=False) if np.isfinite(affine).all() else np.zeros(2)
        inside = np.isfinite(expected).all() and (expected >= 0).all() and (expected < gray.shape[::-1]).all()
        if not inside or scales[1] < LEAST_SCALE or scales[0] > MOST_SCALE or self._contrast < 1e-3:
            return np.array(expected), -1.0
        spread = STANDARD_DEVIATIONS * np.sqrt(np.linalg.eigvalsh(covariance)[1]) / scales[1]
        radius = int(np.clip(np.ceil(spread), LEAST_RADIUS, MOST_RADIUS))
        whole = _blurred(_sampled(gray, expected, affine, self._half + radius))
        side = 2 * radius + 1
        seen = np.lib.stride_tricks.sliding_window_view(whole, (2 * self._half + 1,) * 2).reshape(side * side, -1)
        mean = seen @ self._weights
        contrast = np.sqrt(np.maximum((seen**2) @ self._weights - mean**2, 0))
        both = seen @ (self._weights * self._look)  # the look's weighted mean is 0
        correlation = both / (self._contrast * np.maximum(contrast, 1e-3))
        y, x = np.divmod(np.arange(side * side), side)
        moved = np.column_stack([x - radius, y - radius]) @ affine.T
        score = correlation / CORRELATION_NOISE - 0.5 * np.sum(moved @ np.linalg.inv(covariance) * moved, axis=1)
        best = int(score.argmax())
        between = _peak(score.reshape(side, side), y[best], x[best])
        return expected + moved[best] + affine @ between, float(correlation[best])


def _sampled(gray: np.ndarray, place: np.ndarray, affine: np.ndarray, half: int) -> np.ndarray:
    """The image about a place, drawn as the look lies, float32 ``(2 half + 1, 2 half + 1)``."""
    matrix = np.column_stack([affine, np.asarray(place) - affine @ np.array([half, half])])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (2 * half + 1, 2 * half + 1)
    return cv2.warpAffine(gray, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


def _blurred(look: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(look, (0, 0), BLUR)


def _peak(score: np.ndarray, y: int, x: int) -> np.ndarray:
    """Where between the steps the score is greatest, ``(2,)`` of x and y from the best step, each within 0.5."""
    place = []
    for line, at in ((score[y], x), (score[:, x], y)):
        if not 0 < at < len(line) - 1:
            place.append(0.0)
            continue
        before, here, after = line[at - 1 : at + 2]
        curvature = before - 2 * here + after
        place.append(float(np.clip((before - after) / (2 * curvature), -0.5, 0.5)) if curvature < 0 else 0.0)
    return np.array(place)
