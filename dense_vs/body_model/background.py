"""What a camera that stands still sees where no body is, from images that the body has left each pixel in."""

from collections.abc import Sequence

import numpy as np

LEAST_SEEN = 4  # images in which a pixel has to be uncovered
MOST_IMAGES = 40  # that are looked at
OTHERWISE, TIMES_USUAL = 8.0, 4.0  # gray levels, and times a usual difference, from which one is no noise
DARK = 8.0  # gray levels, above which a pixel tells of exposure


def background_of(images: Sequence[np.ndarray], covered: Sequence[np.ndarray]) -> np.ndarray:
    """The usual look of every pixel where it is uncovered, float32 ``(H, W)`` [gray levels].

    Args:
        images: gray ``(H, W)``, of the same brightness.
        covered: bool ``(H, W)`` of each, where a body is.

    Returns:
        NaN where a pixel is uncovered in less than :data:`LEAST_SEEN` images.
    """
    seen = np.stack([np.where(hidden, np.nan, image) for image, hidden in zip(images, covered, strict=True)])
    often = np.isfinite(seen).sum(axis=0) >= LEAST_SEEN
    found = np.full(seen.shape[1:], np.nan, np.float32)
    found[often] = np.nanmedian(seen[:, often], axis=0)
    return found


def as_bright(image: np.ndarray, like: np.ndarray) -> np.ndarray:
    """An image ``(H, W)`` [gray levels] with the exposure of another, by what most pixels say; NaN says nothing."""
    told = np.isfinite(like) & (image > DARK)
    return image * np.float32(np.median(like[told] / image[told])) if told.any() else image


def bare_cost(image: np.ndarray, background: np.ndarray, still: np.ndarray) -> np.ndarray:
    """How badly the background explains an image, ``(H, W)`` [gray levels], where it is known, and else ``still``.

    What looks as the background does is explained by it, though others may have been in front of it in other images;
    what clearly looks otherwise is not, though it is as plain as what was there in other images.

    Args:
        image: gray ``(H, W)``.
        background: of :func:`background_of`.
        still: mean difference of the image from others at the same pixels [gray levels].
    """
    known = np.isfinite(background)
    cost = still.copy()
    if not known.any():
        return cost
    off, before = np.abs(image[known] - background[known]), still[known]
    usual = float(np.median(off))
    calm = off <= usual
    noise = max(0.0, float(np.median(before[calm] - off[calm])))  # two images differ by the noise of both
    other = off > max(OTHERWISE, TIMES_USUAL * usual)
    cost[known] = np.where(other, np.maximum(before, off), np.minimum(before, off + noise))
    return cost
