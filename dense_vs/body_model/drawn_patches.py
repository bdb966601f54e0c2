"""Patches of a body as its surface looked while it was learned, drawn at a posture, and where an image shows them.

A patch counts only where it shows the body: what is behind it is another thing in every image. It is compared by
normalized cross-correlation with that mask, so exposure and shade do not matter (beyond the papers).
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dense_vs.body_model.model import BodyImage, BodyModel

WINDOW = 17  # px, side of a patch
HALF = WINDOW // 2
BLUR = 0.8  # px, of both images: what is drawn has a point a pixel, without what a camera smooths
LEAST_BODY = 0.35  # share of a patch that is body
LEAST_CONTRAST = 2.0  # gray levels, root mean square gradient of a patch by the pixel
LEAST_SPREAD = 2.0  # gray levels, standard deviation of a patch
APART, PATCHES = 6, 60  # px between patches, and how many of an image at most


@dataclass(frozen=True)
class DrawnBody:
    """A body at a posture, as its surface looked while it was learned.

    Attributes:
        gray: float32 ``(H, W)`` [gray levels], 0 off the body.
        there: what is at every pixel.
    """

    gray: np.ndarray
    there: BodyImage


@dataclass(frozen=True)
class SeenPatches:
    """Patches that were sought in an image.

    Attributes:
        pixels: whole numbers ``(K, 2)``, where the body is drawn [px].
        places: ``(K, 2)``, where the image looks most like it [px].
        correlations: ``(K,)``.
    """

    pixels: np.ndarray
    places: np.ndarray
    correlations: np.ndarray


def draw(model: BodyModel, q: np.ndarray) -> DrawnBody:
    """The body at a posture ``(N,)`` [rad]."""
    there = model.image(q)
    body = there.body
    gray = np.zeros(body.shape, np.float32)
    gray[body] = model.surface.gray[there.points[body]]
    share = smooth(body.astype(np.float32))
    return DrawnBody(np.where(body, smooth(gray) / np.maximum(share, 1e-6), 0), there)


def smooth(image: np.ndarray) -> np.ndarray:
    """As images are compared, float32 ``(H, W)``."""
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR)


def distinct_pixels(drawn: DrawnBody) -> np.ndarray:
    """Middles of the patches that show most, whole numbers ``(K, 2)`` x, y [px]."""
    body = drawn.there.body
    inner = cv2.erode(body.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    squares = sum(cv2.Scharr(drawn.gray, cv2.CV_32F, *order, scale=1 / 32) ** 2 for order in ((1, 0), (0, 1)))
    shows = cv2.blur(np.where(inner, squares, 0).astype(np.float32), (WINDOW, WINDOW))
    shows[~body | (cv2.blur(body.astype(np.float32), (WINDOW, WINDOW)) < LEAST_BODY)] = 0
    for border in (np.s_[:HALF], np.s_[-HALF:], np.s_[:, :HALF], np.s_[:, -HALF:]):
        shows[border] = 0
    enough = np.flatnonzero(shows > LEAST_CONTRAST**2)
    order = enough[np.argsort(-shows.ravel()[enough], kind="stable")]
    chosen: list[tuple[int, int]] = []
    near = bytearray(body.size)  # asked pixel by pixel, ten times as fast as an array
    marked = np.frombuffer(near, np.uint8).reshape(body.shape)
    for at in order.tolist():
        if near[at]:
            continue
        y, x = divmod(at, body.shape[1])
        chosen.append((x, y))
        marked[max(0, y - APART) : y + APART + 1, max(0, x - APART) : x + APART + 1] = 1
        if len(chosen) == PATCHES:
            break
    return np.array(chosen, int).reshape(-1, 2)


def seek(drawn: DrawnBody, pixels: np.ndarray, image: np.ndarray, reach: int) -> SeenPatches:
    """Where an image shows patches of a body; those that are plain are left out.

    Args:
        drawn: the body.
        pixels: middles of the patches, whole numbers ``(K, 2)`` [px].
        image: float32 ``(H, W)`` of :func:`smooth`.
        reach: how far from where it is drawn each is sought [px], 1 or more.
    """
    patches, found = _patches(drawn, pixels), []
    for k, (x, y) in enumerate(patches.pixels):
        left, top = max(0, x - HALF - reach), max(0, y - HALF - reach)
        around = image[top : y + HALF + reach + 1, left : x + HALF + reach + 1]
        correlation = _sought(patches, k, around)
        best = np.unravel_index(correlation.argmax(), correlation.shape)
        v, u = (
            _peak(line, int(at)) for line, at in ((correlation[:, best[1]], best[0]), (correlation[best[0]], best[1]))
        )
        found.append((left + HALF + u, top + HALF + v, correlation[best]))
    rows = np.array(found).reshape(-1, 3)
    return SeenPatches(patches.pixels, rows[:, :2], rows[:, 2])


def agreement(model: BodyModel, q: np.ndarray, gray: np.ndarray) -> float:
    """How much a gray image looks like the body at a posture: 1 where exactly, 0 where not at all.

    Args:
        model: the body.
        q: ``(N,)`` [rad].
        gray: uint8 ``(H, W)``.
    """
    found = correlations(model, q, smooth(gray))
    return float(found.mean()) if len(found) else 0.0


def correlations(model: BodyModel, q: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Correlations ``(K,)`` of the body's patches where it should have them, 0 to 1.

    Args:
        model: the body.
        q: ``(N,)`` [rad].
        image: float32 ``(H, W)`` of :func:`smooth`.
    """
    drawn = draw(model, q)
    return np.maximum(_where_drawn(_patches(drawn, distinct_pixels(drawn)), image), 0)


@dataclass(frozen=True)
class _Patches:
    """K patches that are not plain.

    Attributes:
        pixels: middles, whole numbers ``(K, 2)`` [px].
        off: ``(K, 17, 17)``, what their gray levels are off the mean of what is body, 0 elsewhere.
        weights: ``(K, 17, 17)``, 1 on the body, else 0.
        totals: ``(K,)`` sums of the weights.
        squares: ``(K,)`` sums of what is off, squared.
    """

    pixels: np.ndarray
    off: np.ndarray
    weights: np.ndarray
    totals: np.ndarray
    squares: np.ndarray


def _patches(drawn: DrawnBody, pixels: np.ndarray) -> _Patches:
    """Those at pixels ``(K, 2)`` that are not plain."""
    gray, weights = _windows(drawn.gray, pixels), _windows(drawn.there.body.astype(np.float32), pixels)
    totals = weights.sum(axis=(1, 2), dtype=np.float64)
    means = (gray * weights).sum(axis=(1, 2)) / totals
    off = (gray - means[:, None, None].astype(np.float32)) * weights
    squares = (off**2).sum(axis=(1, 2), dtype=np.float64)
    kept = squares >= LEAST_SPREAD**2 * totals
    return _Patches(pixels[kept], off[kept], weights[kept], totals[kept], squares[kept])


def _windows(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Squares ``(K, 17, 17)`` of an image about pixels ``(K, 2)`` that are as far off its border."""
    if not len(pixels):  # as of every image that is smaller than a patch
        return np.zeros((0, WINDOW, WINDOW), image.dtype)
    x, y = pixels.T
    return sliding_window_view(image, (WINDOW, WINDOW))[y - HALF, x - HALF]


def _sought(patches: _Patches, k: int, around: np.ndarray) -> np.ndarray:
    """Correlations of the k-th patch wherever it lies in an image."""
    one = patches.off[k], patches.weights[k], patches.totals[k], patches.squares[k]
    return _correlation(lambda image, weights: cv2.matchTemplate(image, weights, cv2.TM_CCORR), around, *one)


def _where_drawn(patches: _Patches, image: np.ndarray) -> np.ndarray:
    """Correlations ``(K,)`` of all patches where they are drawn."""
    there = _windows(image, patches.pixels)
    every = patches.off, patches.weights, patches.totals, patches.squares
    return _correlation(lambda ones, weights: np.einsum("kji,kji->k", ones, weights, dtype=np.float64), there, *every)


def _correlation(
    summed: Callable[[np.ndarray, np.ndarray], np.ndarray],
    there: np.ndarray,
    off: np.ndarray,
    weights: np.ndarray,
    totals: np.ndarray,
    squares: np.ndarray,
) -> np.ndarray:
    """Normalized cross-correlation of weighted patches with what an image shows, 0 where that is plain.

    Args:
        summed: gives the sum over a patch of products of what an image shows with weights.
        there: what the image shows.
        off, weights, totals, squares: of one of :class:`_Patches`, or of all.
    """
    products, sums, square_sums = summed(there, off), summed(there, weights), summed(there**2, weights)
    spread = np.maximum(square_sums - sums**2 / totals, 0)
    plain = spread < 0.5 * LEAST_SPREAD**2 * totals
    return np.where(plain, 0, products / np.sqrt(np.where(plain, 1, squares * spread)))


def _peak(values: np.ndarray, at: int) -> float:
    """Where a parabola through a largest value and its neighbors is highest."""
    if not 0 < at < len(values) - 1:
        return float(at)
    before, most, after = (float(value) for value in values[at - 1 : at + 2])
    bend = before - 2 * most + after
    return at + (float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0)
