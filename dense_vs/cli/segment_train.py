"""``dense-vs segment-train``: learn an object from a folder of annotated images, NAME.jpg beside NAME_mask.png."""

import argparse
import time
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.view.tables import table

HELP = "learn to segment an object from about ten annotated images"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folder", type=Path, help="folder with images NAME.jpg or .png and masks NAME_mask.png")
    parser.add_argument("--out", type=Path, required=True, metavar="NPZ", help="file for what was learnt")
    parser.add_argument(
        "--negatives",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="folders of images without the object; helps to tell when it is not there",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random choices (default: 0)")
    parser.add_argument(
        "--folds",
        type=int,
        default=0,
        metavar="N",
        help="also print how well it does on images left out, in N folds (default: 0, not)",
    )


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.segmentation import AnnotatedFolder, FewShotSegmenter, read_images

    annotated = AnnotatedFolder.read(arguments.folder)
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
    learnt = f"learnt from {len(annotated.names)} images"
    if others:
        learnt += f" and {len(others)} without the object"
    print(f"{learnt} in {time.perf_counter() - started:.1f} s; written to {arguments.out}")


def _left_out(annotated, others, nothing, folds: int, seed: int) -> list[list[str]]:
    """A row an image: what a segmenter makes of it that learnt from the other folds."""
    from dense_vs.segmentation import FewShotSegmenter
    from dense_vs.view.progress import progress

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
