"""VOS-VS Fig. 19: pick what is asked for out of a heap that was poured onto a metal tray, and place it in a bin.

Seven objects fall into the tray and lie as physics leaves them, some under others, some of like colors. The robot is
asked for four of them by name, one after the other, the banana first. It finds and centers each, estimates its depth,
grasps with the fingers clear of what else it sees, checks the grasp beside the tray, puts aside there what it was not
asked for, and places the rest in the bin. Masks come from few-shot segmenters that learned from ten images of each
object alone; they have seen neither the tray nor the heap. The world waits while a mask is computed.
"""

import argparse
from dataclasses import dataclass, field

import numpy as np

from dense_vs.grasp import GraspOutcome
from dense_vs.grasp.loop import GraspAttempt
from dense_vs.grasp.regrasp import RegraspPolicy
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.poured_objects import ASIDE, FLOOR, TRAY, add_tray, pour
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.image_tiles import outlined, write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import TEACHERS, LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_pick import Pick, lies_in_bin, pick_and_place
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT, drive_to
from dense_vs.sims.papers.vosvs.pick_place import checks_right
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

OBJECTS = ("Plastic Banana", "Tuna", "Gelatin", "Foam Brick", "Marker", "Potted Meat", "Spring Clamp")
ASKED = 4
ATTEMPTS = 5  # at an object; what hinders costs one


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


@dataclass
class Request:
    """Result of one object that was asked for.

    Attributes:
        name: which.
        picks: from above the tray and, where that failed, from where things are put aside, and from the tray again.
        wrong: names of objects in the bin that were not asked for, by the simulator.
    """

    name: str
    picks: list[Pick] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    @property
    def placed(self) -> bool:
        """Whether it lies in the bin at the end."""
        return bool(self.picks) and self.picks[-1].placed

    @property
    def attempts(self) -> list[GraspAttempt]:
        """All attempts to grasp it."""
        return [one for pick in self.picks if pick.grasp is not None for one in pick.grasp.attempts]


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    results: dict[int, list[Request]] = {}
    with progress("clutter", ASKED * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            tiles: list[tuple[str, np.ndarray]] = []
            results[seed] = clear_tray(seed, arguments.threads, bar, tiles)
            write_tiles(tiles, arguments.out / f"clutter_{seed}.png")
    lines = [_line(seed, one) for seed, ones in results.items() for one in ones]
    print(table(["seed", "object", "attempts", "put aside", "in bin", "wrong in bin", "cause of failure"], lines))
    return table_rows(results)


def clear_tray(seed: int, threads: int | None, bar, tiles: list[tuple[str, np.ndarray]]) -> list[Request]:
    """Pour the heap and pick what is asked for out of it."""
    ready = LearnedSetup([*dict.fromkeys([*OBJECTS, *TEACHERS.values()])], seed, threads, additions=(add_tray,))
    world, rng = ready.world, np.random.default_rng([seed, 71])
    bar.set_description(f"seed {seed}, learning")
    pinvs = ready.pinv("base"), ready.pinv("base grasp")
    segmenters = {name: ready.segmenter(name) for name in OBJECTS}
    world.store()
    world.set_posture(above(*TRAY, HEIGHT))
    pour(world, OBJECTS, rng)
    tiles.append((f"seed {seed}: what the robot finds in the heap", _all_masks(world, segmenters)))
    results: list[Request] = []
    for name in asked_for(rng):
        bar.set_description(f"seed {seed}, {name}")
        results.append(fulfil(world, name, segmenters, pinvs, rng, tiles))
        world.store([name for name in OBJECTS if lies_in_bin(world.object_center(name))])  # the bin is emptied
        bar.update()
    return results


def asked_for(rng: np.random.Generator) -> list[str]:
    """Names of what the robot is asked for, in order: the first object, then others at random."""
    return [OBJECTS[0], *[str(name) for name in rng.permutation(OBJECTS[1:])[: ASKED - 1]]]


def fulfil(
    world: MobileWorld,
    name: str,
    segmenters: dict[str, Segmenter],
    pinvs: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    tiles: list[tuple[str, np.ndarray]],
) -> Request:
    """Pick one object from the tray; where that fails, from where things are put aside, then from the tray again."""
    request = Request(name)
    others = [one for other, one in segmenters.items() if other != name]
    last: list[np.ndarray] = []

    def keep(_, image: np.ndarray, mask: np.ndarray) -> None:
        last[:] = [outlined(image, mask)]

    def show(attempt: GraspAttempt) -> None:
        if last:
            tiles.append((f"{name}: centered", last.pop()))
        tiles.append((f"{name}: {attempt.check.outcome.value}", world.image("grasp")))

    for place in (TRAY, (TRAY[0] + ASIDE[0], TRAY[1] + ASIDE[1]), TRAY):
        drive_to(ManipulatorRobot(world), (*place, FLOOR), rng)
        forget_images(segmenters[name])
        pick = pick_and_place(
            world,
            name,
            FLOOR,
            segmenters[name],
            *pinvs,
            others=others,
            aside=ASIDE,
            policy=RegraspPolicy(attempts=ATTEMPTS),
            on_look=keep,
            on_attempt=show,
        )
        request.picks.append(pick)
        if pick.placed:
            break
    request.wrong = [other for other in OBJECTS if other != name and lies_in_bin(world.object_center(other))]
    return request


def table_rows(results: dict[int, list[Request]]) -> list[Row]:
    """Objects in the bin, wrong ones among them, and how often the grasp check was right."""
    rows = []
    for seed, requests in results.items():
        placed = sum(one.placed for one in requests)
        rows.append(Row(f"in the bin, of {len(requests)} asked for", None, placed, "", (seed,)))
    seeds = tuple(results)
    everything = [one for requests in results.values() for one in requests]
    rows.append(Row("wrong objects in the bin", None, sum(len(one.wrong) for one in everything), "", seeds))
    rows.append(Row("attempts", None, sum(len(one.attempts) for one in everything), "", seeds))
    rows.append(Row("grasps of another object, put aside", None, sum(map(_put_aside, everything)), "", seeds))
    right = [answer for one in everything for pick in one.picks for answer in checks_right(pick)]
    rows.append(Row("grasp check right", None, 100 * float(np.mean(right)) if right else np.nan, "%", seeds))
    rows.append(Row("grasp checks", None, len(right), "", seeds))
    return rows


def _put_aside(one: Request) -> int:
    return sum(attempt.check.outcome is GraspOutcome.WRONG for attempt in one.attempts)


def _all_masks(world: MobileWorld, segmenters: dict[str, Segmenter]) -> np.ndarray:
    image = world.image("grasp")
    view = image
    for segmenter in segmenters.values():
        forget_images(segmenter)
        view = outlined(view, segmenter.segment(image))
    return view


def _line(seed: int, one: Request) -> list[str]:
    return [
        str(seed),
        one.name,
        str(len(one.attempts)),
        str(_put_aside(one)),
        "X" if one.placed else "",
        ", ".join(one.wrong),
        "" if one.placed else "; ".join(pick.cause for pick in one.picks),
    ]
