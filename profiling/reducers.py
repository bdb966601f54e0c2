"""How fast masks are reduced: one pass over a 640x480 mask or labeled image, against NumPy and OpenCV in one run.

    python profiling/reducers.py --json profiling/results/reducers.json

NumPy computes the same from the coordinates of the set pixels, its fastest form; for the labeled image region by
region with ``bincount``; for overlaps by whole-array logic. OpenCV has moments and box of a mask as two calls.
"""

import argparse

import cv2
import numpy as np
from interleaved import interleaved, median_ratio
from metrics import Metric, add_report_arguments, report

from dense_vs.device import resolve_threads
from dense_vs.kernels.masks.label_reducer import LabelReducer
from dense_vs.kernels.masks.mask_overlap import OverlapReducer
from dense_vs.kernels.masks.mask_reducer import MaskReducer

HEIGHT, WIDTH = 480, 640
CANDIDATES = 36


def main() -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--threads", type=int)
    add_report_arguments(parser)
    arguments = parser.parse_args()
    threads = resolve_threads(arguments.threads)
    metrics = []
    for name, mask in masks().items():
        reduce = MaskReducer(1, HEIGHT, WIDTH, threads=threads)
        seconds = interleaved(
            {
                "ours": lambda _, reduce=reduce, mask=mask: reduce(mask[None]),
                "NumPy": lambda _, mask=mask: numpy_moments(mask),
                "OpenCV": lambda _, mask=mask: (cv2.moments(mask, binaryImage=True), cv2.boundingRect(mask)),
            },
            arguments.rounds,
            calls=3,
        )
        metrics += compared(f"mask, {name}", seconds)
    labels_count, labels, *_ = cv2.connectedComponentsWithStats(masks()["clutter"])
    of_labels = LabelReducer(1, HEIGHT, WIDTH, labels_count, threads=threads)
    pixels = [axis.ravel() for axis in np.indices(labels.shape)]
    seconds = interleaved(
        {
            "ours": lambda _: of_labels(labels[None]),
            "NumPy": lambda _: numpy_labels(labels, labels_count, *pixels),
        },
        arguments.rounds // 2,
        calls=3,
    )
    metrics += compared(f"labeled image, {labels_count} labels", seconds)
    mask = masks()["object"]
    candidates = np.stack([np.roll(mask, 5 * k, axis=1) for k in range(CANDIDATES)])
    overlap = OverlapReducer(1, HEIGHT, WIDTH, CANDIDATES, threads=threads)
    overlap.set_candidates(candidates)
    seconds = interleaved(
        {
            "ours": lambda _: overlap(mask[None]),
            "NumPy": lambda _: ((mask & candidates).sum(axis=(1, 2)), (mask | candidates).sum(axis=(1, 2))),
        },
        arguments.rounds // 4,
        calls=3,
    )
    metrics += compared(f"overlap with {CANDIDATES} candidates", seconds)
    return report(metrics, arguments)


def masks() -> dict[str, np.ndarray]:
    """Masks by name: a centered object, the same with specks of clutter, and every other pixel at random."""
    rng = np.random.default_rng(0)
    disc = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    cv2.ellipse(disc, (310, 250), (150, 90), 20, 0, 360, 1, -1)
    clutter = disc.copy()
    for x, y, size in zip(
        rng.integers(0, WIDTH, 40), rng.integers(0, HEIGHT, 40), rng.integers(1, 20, 40), strict=True
    ):
        cv2.circle(clutter, (int(x), int(y)), int(size), 1, -1)
    return {"object": disc, "clutter": clutter, "noise": (rng.random((HEIGHT, WIDTH)) < 0.5).astype(np.uint8)}


def numpy_moments(mask: np.ndarray) -> tuple:
    """Area, centroid, box, second moments and border contact."""
    y, x = np.nonzero(mask)
    center_x, center_y = x.mean(), y.mean()
    box = x.min(), y.min(), x.max(), y.max()
    dx, dy = x - center_x, y - center_y
    moments = (dx * dx).mean(), (dy * dy).mean(), (dx * dy).mean()
    border = box[0] == 0, box[2] == WIDTH - 1, box[1] == 0, box[3] == HEIGHT - 1
    return len(x), center_x, center_y, box, moments, border


def numpy_labels(labels: np.ndarray, count: int, y: np.ndarray, x: np.ndarray) -> tuple:
    """The same of every label, boxes left out, which NumPy has no fast form for."""
    flat = labels.ravel()
    area = np.bincount(flat, minlength=count)
    sums = [np.bincount(flat, weights=weights, minlength=count) for weights in (x, y, x * x, y * y, x * y)]
    return area, sums


def compared(name: str, seconds: dict[str, np.ndarray]) -> list[Metric]:
    """Time and ratios of one case."""
    found = [Metric(f"{name} [ms]", 1e3 * float(np.median(seconds["ours"])), "ms", "lower")]
    for other, theirs in seconds.items():
        if other != "ours":
            ratio = median_ratio(theirs, seconds["ours"])
            found.append(Metric(f"{name}: times as fast as {other}", ratio, "x", "higher", 0.2))
    return found


if __name__ == "__main__":
    raise SystemExit(main())
