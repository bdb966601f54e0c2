"""Scores of a segmenter that follows an object through a row of images: its masks, and the time that each takes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from metrics import Metric

LEAST_SHOWN = 30  # px of the object in an image that counts as showing it
GOOD = 0.5  # least overlap of a mask that is not wrong


@dataclass(frozen=True)
class ImageScore:
    """Of one image.

    Attributes:
        shown: pixels of the object in it.
        masked: pixels of the mask.
        overlap: intersection over union of the two, 1 where both are empty.
        cpu_s: time of all threads [s].
        wall_s: time until the mask is there [s].
        everywhere: whether the whole image was looked at.
        doubted: whether it was because what was found in the window was doubted.
    """

    shown: int
    masked: int
    overlap: float
    cpu_s: float
    wall_s: float
    everywhere: bool
    doubted: bool


def image_score(
    found: np.ndarray, true: np.ndarray, cpu_s: float, wall_s: float, *, everywhere: bool, doubted: bool
) -> ImageScore:
    """Compare a mask with the true one, bool ``(H, W)``."""
    union = np.count_nonzero(found | true)
    overlap = np.count_nonzero(found & true) / union if union else 1.0
    return ImageScore(int(true.sum()), int(found.sum()), overlap, cpu_s, wall_s, everywhere, everywhere and doubted)


def mask_metrics(kind: str, images: Sequence[ImageScore]) -> list[Metric]:
    """How good masks are: of images that show the object, and of those that show nothing of it.

    An image that shows less than ``LEAST_SHOWN`` pixels, but one, is in neither.
    """
    overlaps = [image.overlap for image in images if image.shown >= LEAST_SHOWN]
    false = [image.masked > 0 for image in images if not image.shown]
    metrics = [
        Metric(f"{kind}: mean IoU", float(np.mean(overlaps)), "1", "higher", 0.03),
        Metric(f"{kind}: images with IoU below {GOOD}", float(np.mean(np.less(overlaps, GOOD))), "1", "lower"),
    ]
    if false:
        name = f"{kind}: images without the object that have a mask"
        metrics.append(Metric(name, float(np.mean(false)), "1", "lower"))
    return metrics


def time_metrics(kind: str, images: Sequence[ImageScore]) -> list[Metric]:
    """Median and 99th percentile of the times of some images; nothing of none."""
    times = {"CPU": [image.cpu_s for image in images], "until the mask": [image.wall_s for image in images]}
    return [
        Metric(f"{kind}: {clock}, {word} [ms]", 1e3 * float(np.percentile(seconds, share)), "ms", "lower", 0.2)
        for clock, seconds in times.items()
        for word, share in (("median", 50), ("99th percentile", 99))
        if seconds
    ]


def track_metrics(tracked: Sequence[ImageScore], anew: Sequence[ImageScore]) -> list[Metric]:
    """Figures of a segmenter that tracks, beside those of one that looks for the object anew in the same images."""
    doubted, whole = [image.doubted for image in tracked], [image.everywhere for image in tracked]
    return [
        *mask_metrics("tracking", tracked),
        *mask_metrics("anew", anew),
        Metric("tracking: images whose window was doubted", float(np.mean(doubted)), "1", "lower"),
        Metric("tracking: images looked at as a whole", float(np.mean(whole)), "1", "lower"),
        *time_metrics("tracking, all images", tracked),
        *time_metrics("tracking, window", [image for image in tracked if not image.everywhere]),
        *time_metrics("tracking, doubted", [image for image in tracked if image.doubted]),
        *time_metrics("anew", anew),
    ]
