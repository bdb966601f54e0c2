"""``dense-vs segment-train``: learn an object from a folder of annotated images, NAME.jpg beside NAME_mask.png."""

import argparse
import time
from pathlib import Path

import numpy as np

from dense_vs.checks import check_seed
from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable
from dense_vs.segmentation import AnnotatedFolder, FewShotSegmenter, read_images
from dense_vs.view.progress import progress
from dense_vs.view.tables import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folder", type=Path, help="folder with images NAME.jpg or .png and masks NAME_mask.png")
    parser.add_argument("--out", type=Path, required=True, metavar="NPZ", help="file for the segmenter")
    parser.add_argument(
        "--negatives",
        type=Path,
        nargs="+",
        default=[],
        metavar="DIR",
        help="folders of images without the object, which teach when it is not there",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random choices (default: 0)")
    parser.add_argument(
        "--folds",
        type=int,
        default=0,
        metavar="N",
        help="first print the overlap on images left out, in N folds (default: 0, no such test)",
    )


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    annotated = AnnotatedFolder.read(arguments.folder)
    check_seed(arguments.seed)
    check_writable(arguments.out)  # wrong here, not after the learning
    if arguments.folds and not 2 <= arguments.folds <= len(annotated.names):
        raise DenseVSError(f"--folds is {arguments.folds}; expected 0 or 2 to {len(annotated.names)}, one an image")
    others = [image for folder in arguments.negatives for image in read_images(folder)]
    nothing = [np.zeros(image.shape[:2], dtype=bool) for image in others]
    if arguments.folds:
        rows = _left_out(annotated, others, nothing, arguments.folds, arguments.seed)
        print(table(["image left out", "overlap (IoU)", "score"], rows))
        print(f"mean overlap {np.mean([float(row[1]) for row in rows]):.3f}")
    started = time.perf_counter()
    segmenter = FewShotSegmenter(seed=arguments.seed)
    segmenter.fit([*annotated.images, *others], [*annotated.masks, *nothing])
    segmenter.save(arguments.out)
    learned = f"learned from {len(annotated.names)} images"
    if others:
        learned += f" and {len(others)} without the object"
    print(f"{learned} in {time.perf_counter() - started:.1f} s; written to {arguments.out}")


def _left_out(annotated, others, nothing, folds: int, seed: int) -> list[list[str]]:
    """A row an image: what a segmenter makes of it that learned from the other folds."""
    fold = np.random.default_rng(seed).permutation(len(annotated.names)) % folds
    rows = {}
    with progress("folds", folds, unit="fold") as bar:
        for left_out in range(folds):
            kept = np.flatnonzero(fold != left_out)
            segmenter = FewShotSegmenter(seed=seed)
            segmenter.fit([annotated.images[k] for k in kept] + others, [annotated.masks[k] for k in kept] + nothing)
            for k in np.flatnonzero(fold == left_out):
                segmenter.reset()
                mask, truth = segmenter.segment(annotated.images[k]), annotated.masks[k]
                overlap = np.count_nonzero(mask & truth) / max(np.count_nonzero(mask | truth), 1)
                rows[k] = [annotated.names[k], f"{overlap:.3f}", f"{segmenter.score:.2f}"]
            bar.update()
    return [rows[k] for k in sorted(rows)]
