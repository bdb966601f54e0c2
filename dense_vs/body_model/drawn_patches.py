"""Patches of a body as its surface looked while it was learned, drawn at a posture, and where an image shows them.

A patch counts only where it shows the body: what is behind it is another thing in every image. It is compared by
normalized cross-correlation with that mask, so exposure and shade do not matter (beyond the papers).
"""

from dataclasses import dataclass

import cv2
import numpy as np

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
    y, x = np.nonzero(shows > LEAST_CONTRAST**2)
    chosen: list[tuple[int, int]] = []
    near = np.zeros(body.shape, bool)
    for k in np.argsort(-shows[y, x], kind="stable"):
        if near[y[k], x[k]]:
            continue
        chosen.append((int(x[k]), int(y[k])))
        near[max(0, y[k] - APART) : y[k] + APART + 1, max(0, x[k] - APART) : x[k] + APART + 1] = True
        if len(chosen) == PATCHES:
            break
    return np.array(chosen, int).reshape(-1, 2)


def seek(drawn: DrawnBody, pixels: np.ndarray, image: np.ndarray, reach: int) -> SeenPatches:
    """Where an image shows patches of a body; those that are plain are left out.

    Args:
        drawn: the body.
        pixels: middles of the patches, whole numbers ``(K, 2)`` [px].
        image: float32 ``(H, W)`` of :func:`smooth`.
        reach: how far from where it is drawn each is sought [px].
    """
    weights, found = drawn.there.body.astype(np.float32), []
    for x, y in pixels:
        patch = np.s_[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1]
        left, top = max(0, x - HALF - reach), max(0, y - HALF - reach)
        around = image[top : y + HALF + reach + 1, left : x + HALF + reach + 1]
        correlation = _correlation(drawn.gray[patch], weights[patch], around)
        if correlation is not None:
            best = np.unravel_index(correlation.argmax(), correlation.shape)
            v, u = (
                _peak(line, int(at))
                for line, at in ((correlation[:, best[1]], best[0]), (correlation[best[0]], best[1]))
            )
            found.append((x, y, left + HALF + u, top + HALF + v, correlation[best]))
    rows = np.array(found).reshape(-1, 5)
    return SeenPatches(rows[:, :2].astype(int), rows[:, 2:4], rows[:, 4])


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
    return np.maximum(seek(drawn, distinct_pixels(drawn), image, 0).correlations, 0)


def _correlation(patch: np.ndarray, weights: np.ndarray, around: np.ndarray) -> np.ndarray | None:
    """Normalized cross-correlation of a weighted patch wherever it lies in an image; None of a plain one."""
    total = float(weights.sum())
    off = (patch - np.float32((patch * weights).sum() / total)) * weights
    squares = float((off**2).sum())
    if squares < LEAST_SPREAD**2 * total:
        return None
    products, sums, square_sums = (
        cv2.matchTemplate(*pair, cv2.TM_CCORR) for pair in ((around, off), (around, weights), (around**2, weights))
    )
    spread = np.maximum(square_sums - sums**2 / total, 0)
    plain = spread < 0.5 * LEAST_SPREAD**2 * total
    return np.where(plain, 0, products / np.sqrt(np.where(plain, 1, squares * spread)))


def _peak(values: np.ndarray, at: int) -> float:
    """Where a parabola through a largest value and its neighbors is highest."""
    if not 0 < at < len(values) - 1:
        return float(at)
    before, most, after = (float(value) for value in values[at - 1 : at + 2])
    bend = before - 2 * most + after
    return at + (float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0)
