"""How well the few-shot segmenter finds an object in images that it has not learned from, and how long it takes.

    python profiling/segmentation.py --json profiling/results/segmentation.json

Real images are those that VOS-VS annotated by hand, ten of each object: learned from every second one and asked about
the others, then the other way round. Simulated ones are the objects of the mobile manipulator: learned from ten
annotated images, asked about ten of other poses, distances and supports. The figure is intersection over union.
Every image is looked at anew, as a whole; ``tracking.py`` follows objects from image to image.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from metrics import Metric, add_report_arguments, report

from dense_vs.segmentation import AnnotatedFolder, FewShotSegmenter
from dense_vs.sims.mobile_manipulator.annotations import annotate
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.view.progress import progress

DATA = Path(__file__).parents[2] / "shared" / "data"


@dataclass
class Measured:
    """Of one kind of images."""

    overlaps: dict[str, list[float]] = field(default_factory=dict)  # IoU of every image asked about, by name
    fit_seconds: list[float] = field(default_factory=list)
    segment_seconds: list[float] = field(default_factory=list)

    def ask(
        self,
        name: str,
        learned: tuple[Sequence[np.ndarray], Sequence[np.ndarray]],
        asked: tuple[Sequence[np.ndarray], Sequence[np.ndarray]],
        seed: int,
    ) -> None:
        """Learn from images and masks, then segment others."""
        begun = time.perf_counter()
        segmenter = FewShotSegmenter(seed=seed).fit(*learned)
        self.fit_seconds.append(time.perf_counter() - begun)
        for image, mask in zip(*asked, strict=True):
            segmenter.reset()
            begun = time.perf_counter()
            found = segmenter.segment(image)
            self.segment_seconds.append(time.perf_counter() - begun)
            self.overlaps.setdefault(name, []).append(intersection_over_union(found, mask))

    def metrics(self, kind: str) -> list[Metric]:
        """Mean IoU of every name and of all, and times."""
        found = [Metric(f"{kind}, {name}: IoU", float(np.mean(v)), "1", "higher") for name, v in self.overlaps.items()]
        everything = np.concatenate(list(self.overlaps.values()))
        return [
            *found,
            Metric(f"{kind}: mean IoU", float(everything.mean()), "1", "higher", 0.03),
            Metric(f"{kind}: least mean IoU of an object", min(metric.value for metric in found), "1", "higher"),
            Metric(f"{kind}: images with IoU below 0.5", float(np.mean(everything < 0.5)), "1", "lower"),
            Metric(f"{kind}: fit [s]", float(np.median(self.fit_seconds)), "s", "lower"),
            Metric(f"{kind}: segment [ms]", 1e3 * float(np.median(self.segment_seconds)), "ms", "lower"),
        ]


def main() -> int:
    """Measure and report."""
    known = list(household_objects())
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument(
        "--data", type=Path, default=DATA, help="folder that holds ycb_annotated (default: %(default)s)"
    )
    parser.add_argument("--objects", nargs="*", default=known, metavar="NAME", help="simulated ones (default: all)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], metavar="SEED")
    parser.add_argument("--threads", type=int)
    add_report_arguments(parser)
    arguments = parser.parse_args()
    metrics = real(arguments.data / "ycb_annotated", arguments.seeds)
    if arguments.objects:
        metrics += simulated(arguments.objects, arguments.seeds, arguments.threads)
    return report(metrics, arguments)


def real(folder: Path, seeds: Sequence[int]) -> list[Metric]:
    """Both halves of every annotated object."""
    if not folder.is_dir():
        print(f"real images: skipped, {folder} is not there")
        return []
    objects = sorted(path for path in folder.iterdir() if path.is_dir())
    measured = {"even": Measured(), "odd": Measured()}
    with progress("real images", len(objects) * len(seeds), "object") as bar:
        for path in objects:
            seen = AnnotatedFolder.read(path)
            half = {name: (seen.images[first::2], seen.masks[first::2]) for first, name in enumerate(measured)}
            for seed in seeds:
                measured["even"].ask(path.name, half["even"], half["odd"], seed)
                measured["odd"].ask(path.name, half["odd"], half["even"], seed)
                bar.update()
    return [metric for name, one in measured.items() for metric in one.metrics(f"real, learned from {name}")]


def simulated(names: Sequence[str], seeds: Sequence[int], threads: int | None) -> list[Metric]:
    """Ten images of every object, then ten others."""
    measured = Measured()
    known = list(household_objects())
    with progress("simulated images", len(names) * len(seeds), "object") as bar:
        for seed in seeds:
            world = MobileWorld(names, seed=seed, threads=threads)
            for name in names:
                learned, asked = (
                    annotate(world, name, np.random.default_rng([seed, part, known.index(name)])) for part in (80, 81)
                )
                measured.ask(name, (learned.images, learned.masks), (asked.images, asked.masks), seed)
                bar.update()
    return measured.metrics("simulated")


def intersection_over_union(found: np.ndarray, true: np.ndarray) -> float:
    """Of two masks (H, W); 1 where both are empty."""
    union = np.count_nonzero(found | true)
    return float(np.count_nonzero(found & true) / union) if union else 1.0


if __name__ == "__main__":
    raise SystemExit(main())
