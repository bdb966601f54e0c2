"""How the surface around a point looked when the point was defined, and where that look is seen in other images.

The body's chain says how the surface has turned since, so the look is compared as it has to appear by now, and only its
place is sought: near where the chain expects it, mostly along the line that the point's unknown depth leaves open.
Known so, a look is found again at postures at which a patch compared as it was no longer is. What is around a point
need not be one plane: where the whole look is not seen, its middle may be.
"""

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from dense_vs.body_model.surface_patches import SurfacePatches

MOST_RADIUS, LEAST_RADIUS = 12, 2  # px of the look about the expected place, in which it is sought
STANDARD_DEVIATIONS = 3.0  # that the search spans
NOISE_SHARE, LEAST_NOISE = 0.25, 0.005  # of what the best correlation lacks of 1: by which others are worse by chance
SURE = 0.93  # correlation of the look with every turn and shear allowed
ALIGNED, TURNED = 1.0, 3.0  # px that it may move by then: where the chain says how it is turned, and where it does not
BLUR = 0.8  # px, before looks are compared
WIDTH = 0.35  # of the window: standard deviation of the weight of the look's pixels
LEAST_PIXELS = 60  # of the same surface, for others to be left out
LEAST_TURNED = 200  # of them, to be seen with any turn and shear: with 140 one in four other surfaces looked the same
LEAST_ALIGNED = 0.85  # correlation from which the chain is right about that
SHIFT = 2  # px, by which a look is compared with itself
LEAST_CONTRAST = 1.0  # of gray values; with less there is nothing to be seen but rounding, which looks like anything
LIKE = 0.8  # correlation from which the look is seen turned as the chain says
LEAST_DISTINCTNESS = 1e-3  # of correlation, that counts as lost by a shift where less is
LEAST_SCALE, MOST_SCALE = 0.4, 2.5  # by which the look may have shrunk or grown in any direction
MIDDLE = 11  # px, side of the look's middle; of 65 ends 5 more are known by it than by 25 px alone
LEAST_MIDDLE = 0.85  # correlation from which that is seen: it is less distinct


@dataclass(frozen=True)
class Sighting:
    """Where a look is seen.

    Attributes:
        place: ``(2,)`` [px].
        correlation: with the look; -1 where it cannot be seen.
        drift: standard deviation of the place [px], see :meth:`PointLook.drift`.
        as_expected: whether it is turned as the chain says.
    """

    place: np.ndarray
    correlation: float
    drift: float
    as_expected: bool


class PointLook:
    """The look around one point.

    Args:
        gray: uint8 ``(H, W)``, the image in which the point is defined.
        point: ``(2,)`` [px].
        same: bool ``(H, W)``, pixels that move as the point does; others do not count.
        window: side of the look [px], odd.

    Attributes:
        pixels: number of those that count in an alignment.
        middle: look of :data:`MIDDLE` px around the same point; None where this one is no larger.
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
        self._patches = SurfacePatches(window)
        self._pixels = self._patches.taken(gray, np.asarray(point)[None], same)
        self.pixels = np.count_nonzero(self._pixels[0, :, 1])
        weights /= weights.sum()
        look = _blurred(_sampled(gray, point, np.eye(2), half))
        around = _blurred(_sampled(gray, point, np.eye(2), half + SHIFT))
        look = look - np.sum(weights * look)
        self._weights, self._weighted = weights.astype(np.float32), (weights * look).astype(np.float32)
        self._contrast = float(np.sqrt(np.sum(weights * look**2)))
        self.distinctness = self._distinctness(around)
        self._looser = max(1.0, self.distinctness / max(self._turned_distinctness(around), LEAST_DISTINCTNESS))
        self.middle = PointLook(gray, point, same, MIDDLE) if window > MIDDLE else None

    def _distinctness(self, whole: np.ndarray) -> float:
        """What correlation loses by a shift of :data:`SHIFT` px in the direction in which it loses least.

        Args:
            whole: gray values of the look and as far about it.
        """
        if self._contrast < LEAST_CONTRAST:
            return 0.0
        side = 2 * SHIFT + 1
        correlation = self._correlations(whole)
        y, x = np.divmod(np.arange(side * side), side)
        around = np.hypot(x - SHIFT, y - SHIFT).round() == SHIFT
        return max(0.0, 1 - float(correlation[around].max()))

    def _turned_distinctness(self, whole: np.ndarray) -> float:
        """The same by its gradients, once whatever turn and shear the shift is most like has been taken back.

        The shade of a round surface is the same after a shift and a little turn and shear.
        """
        inside = np.s_[SHIFT:-SHIFT, SHIFT:-SHIFT]
        down, across = (part[inside] for part in np.gradient(whole))
        look, steps = whole[inside], np.arange(-self._half, self._half + 1) / self._half
        y, x = steps[:, None], steps
        weights = (self._weights > 0).astype(np.float64).ravel()[:, None]  # all alike, as in an alignment
        told = np.stack([part.ravel() for part in (across, down)], axis=1) * weights
        other = (np.ones_like(look), look, across * x, across * y, down * x, down * y)
        free = np.stack([part.ravel() for part in other], axis=1) * weights
        left = told - free @ np.linalg.lstsq(free, told, rcond=1e-9)[0]
        spread = free[:, 1] - weights[:, 0] * (free[:, 1].sum() / weights.sum())
        lost = np.linalg.eigvalsh(left.T @ left)[0] / max(float(spread @ spread), 1e-12)
        return 0.5 * SHIFT**2 * float(lost)

    def _correlations(self, whole: np.ndarray) -> np.ndarray:
        """Correlation of the look with each of the ``S * S`` patches of its size in a larger one, row by row."""
        seen = whole - whole.mean()
        mean, square, both = (
            cv2.matchTemplate(image, kernel, cv2.TM_CCORR)
            for image, kernel in ((seen, self._weights), (seen * seen, self._weights), (seen, self._weighted))
        )
        contrast = np.sqrt(np.maximum(square - mean**2, 0))
        largest = self._contrast * np.maximum(contrast, LEAST_CONTRAST)  # of a look that is not plain
        return np.clip(both / largest, -1.0, 1.0).ravel()  # the look's weighted mean is 0

    def drift(self, correlation: float) -> float:
        """Standard deviation [px] of a place that is seen with such a correlation.

        Near its peak correlation falls with the square of the shift, so what it lacks of 1 tells how far away the peak
        may be; more where the look hardly changes along some direction, as along an edge.
        """
        return SHIFT * float(np.sqrt(max(1 - correlation, 0.0) / max(self.distinctness, LEAST_DISTINCTNESS)))

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
        largest, smallest = _scales(affine)
        inside = np.isfinite(expected).all() and (expected >= 0).all() and (expected < gray.shape[::-1]).all()
        if not inside or not smallest >= LEAST_SCALE or largest > MOST_SCALE or self._contrast < LEAST_CONTRAST:
            return np.array(expected), -1.0
        (xx, xy), (_, yy) = covariance.tolist()
        spread = STANDARD_DEVIATIONS * np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)) / smallest
        radius = int(np.clip(np.ceil(spread), LEAST_RADIUS, MOST_RADIUS))
        whole = _blurred(_sampled(gray, expected, affine, self._half + radius))
        side = 2 * radius + 1
        correlation = self._correlations(whole)
        moved = _steps(radius) @ affine.T
        information = np.array([[yy, -xy], [-xy, xx]]) / (xx * yy - xy**2)
        noise = max(LEAST_NOISE, NOISE_SHARE * (1 - float(correlation.max())))
        score = correlation / noise - 0.5 * np.sum(moved @ information * moved, axis=1)
        best = int(score.argmax())
        between = _peak(score.reshape(side, side), *divmod(best, side))
        place = expected + moved[best] + affine @ between
        if correlation[best] < LEAST_ALIGNED:
            return place, float(correlation[best])
        found, alike = self.turned(gray, place, affine, ALIGNED)
        return (found, alike) if alike > correlation[best] else (place, float(correlation[best]))

    def seen(self, gray: np.ndarray, expected: np.ndarray, affine: np.ndarray, covariance: np.ndarray) -> Sighting:
        """As :meth:`found`, or else turned otherwise, or else its middle alone.

        A surface that was seen aslant is turned otherwise than one that faced the camera.
        """
        found, correlation = self.found(gray, expected, affine, covariance)
        if correlation >= LIKE:
            return Sighting(found, correlation, self.drift(correlation), True)
        if self.pixels >= LEAST_TURNED:
            other, alike = self.turned(gray, expected, affine)
            if alike > max(correlation, 0.0):
                return Sighting(other, alike, self.drift(alike), False)
        if self.middle is not None:
            place, alike = self.middle.found(gray, expected, affine, covariance)
            if alike >= LEAST_MIDDLE:
                return Sighting(place, alike, self.middle.drift(alike), True)
        return Sighting(found, correlation, self.drift(correlation), False)

    def turned(
        self, gray: np.ndarray, place: np.ndarray, affine: np.ndarray, most: float = TURNED
    ) -> tuple[np.ndarray, float]:
        """Where the look is seen with every turn and shear allowed, and its correlation; -1 unless that is sure.

        The correlation is that by a shift alone that would tell its place as well.

        Args:
            gray: uint8 ``(H, W)``.
            place: ``(2,)`` [px] and affine ``(2, 2)``: what to begin with.
            affine: as in :meth:`found`.
            most: px that it may be away from there.
        """
        found, _, alike = self._patches.align(self._pixels, gray, place[None], affine[None])
        sure = alike[0] > SURE and np.linalg.norm(found[0] - place) < most and self._contrast >= LEAST_CONTRAST
        return (found[0], max(1 - self._looser * (1 - float(alike[0])), 0.0)) if sure else (place, -1.0)


def _sampled(gray: np.ndarray, place: np.ndarray, affine: np.ndarray, half: int) -> np.ndarray:
    """The image about a place, drawn as the look lies, float32 ``(2 half + 1, 2 half + 1)``."""
    matrix = np.column_stack([affine, np.asarray(place) - affine @ np.array([half, half])])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (2 * half + 1, 2 * half + 1)
    return cv2.warpAffine(gray, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


@cache
def _steps(radius: int) -> np.ndarray:
    """Whole steps of x and y up to a radius, row by row, ``((2 radius + 1)^2, 2)``; not to be changed."""
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.column_stack([x.ravel(), y.ravel()])


def _scales(affine: np.ndarray) -> tuple[float, float]:
    """Singular values of a map ``(2, 2)``, the larger first; not a number where the map is none."""
    (a, b), (c, d) = affine.tolist()
    half, product = (a * a + b * b + c * c + d * d) / 2, a * d - b * c
    largest = (
        math.sqrt(half + math.sqrt(max(half * half - product * product, 0.0))) if math.isfinite(half) else math.nan
    )
    return largest, abs(product) / largest if largest else 0.0


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
