"""VOS-VS Table 2: 24 objects in eight consecutive trials at three heights: found and centered (VS), depth good (DE).

One run without resets, except that the objects are exchanged between trials. Masks come from few-shot segmenters that
learned from ten images each, annotated by the simulator's ids: of other rooms among other clutter, or, at the
difficulty "clean", of the trials' own room. J+ of H_base is learned at the start, once feature by feature and once by
VOS-VS (11) as printed; each object is centered by both. DE is scored by the method asked for and by VOS-VS (20) as
printed, from the same masks, and done by both from the same place: the gripper goes there and closes. What both share
is beyond the paper: the trust region that bounds the motions while J+ is learned, and the rule that ends an approach.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from dense_vs.checks import check_number
from dense_vs.depth import DepthUnobservableError
from dense_vs.depth.mask_fit import METHODS, Method
from dense_vs.errors import DenseVSError
from dense_vs.robot.command_gate import MAX_AGE
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.depth_reach import ReachScore, reach_depth
from dense_vs.sims.papers.vosvs.difficulty import DIFFICULTIES, Difficulty
from dense_vs.sims.papers.vosvs.image_tiles import KeptImages, outlined, write_tiles
from dense_vs.sims.papers.vosvs.jacobian_learning import Learning, Update
from dense_vs.sims.papers.vosvs.learned_setup import require_cpu
from dense_vs.sims.papers.vosvs.object_trial import (
    HEIGHT,
    PLACES,
    TRIALS,
    ObjectTrial,
    drive_to,
    locate,
    place_objects,
    printed_depth,
)
from dense_vs.sims.papers.vosvs.trial_rows import COLUMNS, line, table_rows
from dense_vs.sims.papers.vosvs.trial_setup import TrialSetup
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

NAMES = tuple(name for names in TRIALS for name in names)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--method", default="robust", choices=METHODS, help="of the depth (default: robust)")
    parser.add_argument(
        "--difficulty",
        default="hard",
        choices=tuple(DIFFICULTIES),
        help="hard: masks learned in other rooms, clutter, shadows, time runs on while a mask is made (default: hard)",
    )
    parser.add_argument(
        "--mask-seconds", type=float, metavar="S", help="world time of a mask (default: 0.2 if hard, 0 if clean)"
    )
    parser.add_argument("--objects", nargs="+", metavar="NAME", help="some of the 24 (default: all)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes that learn masks (default: 1)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="write the images and masks that were decided on here")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    difficulty, names = chosen_difficulty(arguments), chosen_objects(arguments.objects)
    kept = KeptImages(arguments.keep)
    results: dict[int, list[ObjectTrial]] = {}
    learned: dict[int, tuple[Learning, Learning]] = {}
    with progress("trial", len(names) * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}, learning masks")
            ready = TrialSetup(names, seed, difficulty, arguments.threads, arguments.jobs)
            trials = ConsecutiveTrials(ready, names, arguments.method, kept)
            bar.set_description(f"seed {seed}, learning J+")
            learned[seed] = trials.learn()
            results[seed] = trials.run(bar)
            write_tiles(trials.tiles, arguments.out / f"trial_{difficulty.name}_{seed}.png", columns=6)
    print(table(COLUMNS, [line(seed, one) for seed, ones in results.items() for one in ones]))
    return table_rows(results, {s: ones[1].converged for s, ones in learned.items()}, arguments.method)


def chosen_difficulty(arguments: argparse.Namespace) -> Difficulty:
    """That of the name, with the time of a mask that was asked for.

    Raises:
        DenseVSError: a time below 0, or one after which loops no longer act on an image.
    """
    difficulty, seconds = DIFFICULTIES[arguments.difficulty], arguments.mask_seconds
    if seconds is None:
        return difficulty
    return replace(difficulty, mask_seconds=check_number("--mask-seconds", seconds, least=0.0, below=MAX_AGE))


def chosen_objects(names: list[str] | None) -> tuple[str, ...]:
    """The 24, or those asked for, in the order of the trials.

    Raises:
        DenseVSError: a name that is none of the 24.
    """
    if names is None:
        return NAMES
    for name in names:
        if name not in NAMES:
            raise DenseVSError(
                f"object {name!r} is not one of the trials'; expected some of {', '.join(map(repr, NAMES))}"
            )
    return tuple(name for name in NAMES if name in names)


class ConsecutiveTrials:
    """The eight trials of one seed, in one run.

    Args:
        ready: room, segmenters and J+.
        names: objects that are wanted; the others of a trial are not there.
        method: of the depth.
        kept: keeps images and masks.

    Attributes:
        tiles: the last image of each object with its mask's outline, labeled.
    """

    def __init__(self, ready: TrialSetup, names: tuple[str, ...], method: Method, kept: KeptImages):
        self._ready, self._names, self._kept = ready, names, kept
        self._method: Method = method
        self.tiles: list[tuple[str, np.ndarray]] = []

    def learn(self) -> tuple[Learning, Learning]:
        """J+ of H_base, feature by feature and by VOS-VS (11) as printed, and that of H_base grasp."""
        self._pinv, self._low = self._ready.pinv("base"), self._ready.pinv("base grasp")
        learned = self._ready.learning("base"), self._ready.learning("base", Update.PRINTED)
        self._printed = learned[1].pinv
        return learned

    def run(self, bar) -> list[ObjectTrial]:
        """Results of all objects, in order."""
        world, rng = self._ready.world, np.random.default_rng([self._ready.seed, 60])
        robot = ManipulatorRobot(world)
        world.set_posture(above(1.0, 0.0, HEIGHT))
        results = []
        for names in TRIALS:
            if not set(names) & set(self._names):
                continue
            place_objects(world, names, rng, self._names)
            self._ready.add_clutter([name for name in names if name in self._names], rng)
            for name, place in zip(names, PLACES, strict=True):
                if name not in self._names:
                    continue
                bar.set_description(f"seed {self._ready.seed}, {name}")
                drive_to(robot, place, rng)
                results.append(self._meet(name, place[2]))
                bar.update()
        return results

    def _meet(self, name: str, support: float) -> ObjectTrial:
        """Locate an object and do DE by both depths."""
        last: list[np.ndarray] = []
        seed, difficulty = self._ready.seed, self._ready.difficulty

        def keep(number, image: np.ndarray, mask: np.ndarray) -> None:
            last[:] = [outlined(image, mask)]
            self._kept.add(f"{difficulty.name}_{seed}_{name}", image, mask)

        result = locate(
            self._ready.world,
            name,
            support,
            self._ready.segmenter(name),
            self._pinv,
            printed_pinv=self._printed,
            method=self._method,
            settle_frames=difficulty.settle_frames,
            on_look=keep,
            on_view=keep,
        )
        self._reach(result)
        if last:
            yes = {True: "yes", False: "no"}
            label = f"{name}: VS {yes[result.servo.centered]}, DE {yes[result.reach.closed]}"
            self.tiles.append((label, last[0]))
        return result

    def _reach(self, result: ObjectTrial) -> None:
        """Do DE: first by VOS-VS (20) as printed, then, with everything put back, by the method."""
        approach, world = result.approach, self._ready.world
        if approach is None or approach.nearest < 0:
            return
        put_back = world.remember()
        try:
            result.printed_reach = self._go(result.name, printed_depth(approach))
        except DepthUnobservableError as error:
            result.printed_reach = ReachScore(False, False, f"depth: {error}")
        put_back()
        if approach.z_object is not None:
            result.reach = self._go(result.name, approach.z_object)

    def _go(self, name: str, z_object: float) -> ReachScore:
        return reach_depth(self._ready.world, name, self._ready.segmenter(name), self._low, z_object)
