"""VOS-VS Figs. 14 to 17: the segmentations that depth is estimated from, of the plate, drill, marker and padlock.

Each object stands where it stands in its trial of Table 2, at the same difficulty, and is found, centered and
approached as there. Shown are the masks of the first and of the closest view of the approach, with what they miss and
what they take beyond the object, by the simulator's ids.
"""

import argparse
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.depth.mask_fit import METHODS, Method
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.difficulty import DIFFICULTIES, Difficulty
from dense_vs.sims.papers.vosvs.image_tiles import outlined, write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import require_cpu
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT, PLACES, TRIALS, ObjectTrial, drive_to, locate, place_objects
from dense_vs.sims.papers.vosvs.trial_scores import intersection_over_union
from dense_vs.sims.papers.vosvs.trial_setup import TrialSetup
from dense_vs.view.progress import progress

# Figs. 14 to 17, and whether the paper's depth was good enough for a grasp.
SHOWN = {"Plate": True, "Power Drill": True, "Marker": False, "Padlock": False}
MISSED, BEYOND = (0, 255, 255), (40, 60, 255)  # RGB, of pixels that a mask leaves out and that it should not have


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--method", default="robust", choices=METHODS, help="of the depth (default: robust)")
    parser.add_argument(
        "--difficulty", default="hard", choices=tuple(DIFFICULTIES), help="as for the trial (default: hard)"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes that learn masks (default: 1)")


@dataclass(frozen=True)
class View:
    """One view of an approach: the image (H, W, 3), its mask and the true one (H, W)."""

    image: np.ndarray
    mask: np.ndarray
    true: np.ndarray

    @property
    def iou(self) -> float:
        """Of the mask with the true one."""
        return intersection_over_union(self.mask, self.true)


@dataclass(frozen=True)
class Approached:
    """One object: its trial, and the first and the last view of its approach; None where there was none."""

    name: str
    trial: ObjectTrial
    higher: View | None
    closer: View | None


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    results: dict[int, list[Approached]] = {}
    with progress("segmentations", len(SHOWN) * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}, learning")
            names = trial_names()
            difficulty = DIFFICULTIES[arguments.difficulty]
            ready = TrialSetup(names, seed, difficulty, arguments.threads, arguments.jobs)
            results[seed] = approach_all(ready, difficulty, arguments.method, bar)
            path = arguments.out / f"segmentations_{difficulty.name}_{seed}.png"
            write_tiles(picture_tiles(results[seed]), path)
    return table_rows(results)


def trial_names() -> list[str]:
    """Names of the objects of all trials that have one of the four."""
    return [name for names in TRIALS if set(names) & set(SHOWN) for name in names]


def approach_all(ready: TrialSetup, difficulty: Difficulty, method: Method, bar) -> list[Approached]:
    """The four objects, each among those of its trial."""
    pinv = ready.pinv("base")
    world, rng = ready.world, np.random.default_rng([ready.seed, 72])
    world.set_posture(above(1.0, 0.0, HEIGHT))
    results = []
    for name in SHOWN:
        bar.set_description(f"seed {ready.seed}, {name}")
        names = next(names for names in TRIALS if name in names)
        place = PLACES[names.index(name)]
        place_objects(world, names, rng)
        ready.add_clutter(names, rng)
        drive_to(ManipulatorRobot(world), place, rng)
        witness = Witness(world, name, ready.segmenter(name))
        witness.reset()
        results.append(approach_one(world, witness, place[2], pinv, method, difficulty.settle_frames))
        bar.update()
    return results


class Witness:
    """A segmenter that also keeps the true mask of the image that it is given, for scores.

    Args:
        world: that the image is of, as it is when the image is given.
        name: of the object.
        segmenter: that finds the object.
    """

    def __init__(self, world: MobileWorld, name: str, segmenter: Segmenter):
        self.name = name
        self._world, self._segmenter = world, segmenter
        self.true = np.zeros((0, 0), bool)

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask by the segmenter, bool ``(H, W)``."""
        self.true = self._world.true_mask("grasp", self.name)
        return self._segmenter.segment(image)

    def reset(self) -> None:
        """Forget earlier images."""
        forget_images(self._segmenter)


def approach_one(
    world: MobileWorld, witness: Witness, support: float, pinv: np.ndarray, method: Method, settle_frames: int
) -> Approached:
    """Find, center and approach an object; keep the first and the last view of the approach."""
    views: list[View] = []

    def keep(_, image: np.ndarray, mask: np.ndarray) -> None:
        views[1:] = [View(image, mask, witness.true)]

    trial = locate(
        world, witness.name, support, witness, pinv, method=method, settle_frames=settle_frames, on_view=keep
    )
    return Approached(witness.name, trial, views[0] if views else None, views[-1] if views else None)


def errors_shown(view: View) -> np.ndarray:
    """The image with the mask's outline, pixels that it leaves out in cyan and those beyond the object in blue."""
    image = view.image.copy()
    for wrong, color in ((view.true & ~view.mask, MISSED), (view.mask & ~view.true, BEYOND)):
        image[wrong] = (0.35 * image[wrong] + 0.65 * np.array(color)).astype(np.uint8)
    return outlined(image, view.mask)


def picture_tiles(ones: list[Approached]) -> list[tuple[str, np.ndarray]]:
    """Labeled images: the higher views in one row, the closer ones below them."""
    blank = np.full((480, 640, 3), 255, np.uint8)
    tiles = []
    for which in ("higher", "closer"):
        for one in ones:
            view = getattr(one, which)
            label = f"{one.name}, {which}: IoU " + (f"{view.iou:.3f}" if view is not None else "none")
            tiles.append((label, blank if view is None else errors_shown(enlarged(view))))
    return tiles


def enlarged(view: View) -> View:
    """The part of a view around the object and its mask, as large as the view."""
    y, x = np.nonzero(view.true | view.mask)
    if not x.size:
        return view
    height, width = view.mask.shape
    half = min(max(0.75 * np.ptp(x) * height / width, 0.75 * np.ptp(y), 30.0), height / 2)
    half_width = half * width / height
    top = round(float(np.clip((y.min() + y.max()) / 2 - half, 0, height - 2 * half)))
    left = round(float(np.clip((x.min() + x.max()) / 2 - half_width, 0, width - 2 * half_width)))

    def part(image: np.ndarray) -> np.ndarray:
        cut = image[top : top + round(2 * half), left : left + round(2 * half_width)]
        return cv2.resize(cut, (width, height), interpolation=cv2.INTER_NEAREST)

    return View(part(view.image), *(part(one.astype(np.uint8)).astype(bool) for one in (view.mask, view.true)))


def table_rows(results: dict[int, list[Approached]]) -> list[Row]:
    """Overlap of the masks of both views, and whether the depth was good enough for a grasp."""
    rows = []
    for name, graspable in SHOWN.items():
        for seed, ones in results.items():
            one = next(one for one in ones if one.name == name)
            for which in ("higher", "closer"):
                view = getattr(one, which)
                iou = float("nan") if view is None else view.iou
                rows.append(Row(f"{name}: mask IoU at the {which} view", None, iou, "", (seed,)))
            rows.append(Row(f"{name}: centered (1) or not (0)", 1, int(one.trial.servo.centered), "", (seed,)))
            good = int(one.trial.depth.graspable)
            rows.append(Row(f"{name}: depth good (1) or not (0)", int(graspable), good, "", (seed,)))
    return rows
