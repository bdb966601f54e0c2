"""VOS-VS Fig. 20: a person shows the robot where a thing is; the robot finds it, picks it up and places it in the bin.

The robot is asked for a thing of which it does not know where it is. Its head follows the person, by the shirt, who
carries the thing across the room, puts it down and steps back; then the head looks around for the thing and centers it.
From its own joints the robot knows where on the floor it then looks. It drives there and does what it does with any
object: centers it, estimates the depth, grasps, checks, and places it in the bin. Masks come from few-shot segmenters
that learned from ten images each, annotated by the simulator's ids, of the thing alone and of the person in the same
room. The world goes on while the mask of the shirt is computed, and waits for the others.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from dense_vs.grasp.loop import GraspAttempt
from dense_vs.mask_servo.loop import MaskServo, ServoEnd
from dense_vs.mask_servo.object_search import search_object
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.mask_features import mask_sums
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
from dense_vs.sims.mobile_manipulator.head_gaze import gaze_on_floor
from dense_vs.sims.mobile_manipulator.person import Person, add_person
from dense_vs.sims.mobile_manipulator.person_annotations import learn_clothing
from dense_vs.sims.mobile_manipulator.postures import above, posture
from dense_vs.sims.mobile_manipulator.room import add_room
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.bringing_person import BringingPerson
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.image_tiles import outlined, write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import TEACHER, TEACHERS, LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_pick import Pick, pick_and_place
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT
from dense_vs.sims.papers.vosvs.tracking import Track, follow
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

OBJECTS = ("Softscrub", "Box of Sugar")  # about as large as the paper's roll of towels
BASE = (-1.5, 2.5)  # m, where the robot waits, looking ahead
FLOOR = ((0.3, 0.9), (1.7, 3.3))  # m, where things are put down: before the robot, clear of bins and furniture
START = (1.9, 3.6)  # m, where the person begins
LOOKS = 8  # at the shirt, until the robot asks whether the person is done
MOST = 12  # times that
AROUND = (0.45, 0.35)  # rad, from one look to the next where the head looks around
MIDDLE = 0.06  # m over the floor, where the middle of a thing is taken to be
FOUND = 0.35  # m; from farther away the hand's camera does not see it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


@dataclass
class Errand:
    """Result of one thing.

    Attributes:
        track: how the person was followed.
        off: of the place that the robot drove to from where the thing is [m]; nan where the head did not find it.
        pick: what followed; None where the head did not find it.
    """

    track: Track
    off: float = float("nan")
    pick: Pick | None = None

    @property
    def found(self) -> bool:
        """Whether the head told where the thing is, by the simulator."""
        return self.off < FOUND

    @property
    def placed(self) -> bool:
        """Whether it lies in the bin."""
        return self.pick is not None and self.pick.placed


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    results: dict[int, list[Errand]] = {}
    with progress("collaboration", len(OBJECTS) * len(arguments.seeds), "thing") as bar:
        for seed in arguments.seeds:
            tiles: list[tuple[str, np.ndarray]] = []
            results[seed] = collaborate(seed, arguments.threads, bar, tiles)
            write_tiles(tiles, arguments.out / f"collaboration_{seed}.png", columns=6)
    print(table(["seed", "object", "off [m]", "in bin", "cause of failure"], _lines(results)))
    return table_rows(results)


def collaborate(seed: int, threads: int | None, bar, tiles: list[tuple[str, np.ndarray]]) -> list[Errand]:
    """Both things of one seed, one after the other."""
    names = [*dict.fromkeys([*OBJECTS, *TEACHERS.values(), TEACHER])]
    ready = LearnedSetup(names, seed, threads, additions=(add_person, add_room))
    bar.set_description(f"seed {seed}, learning")
    pinvs = {config: ready.pinv(config) for config in ("head", "base", "base grasp")}
    segmenters = {name: ready.segmenter(name) for name in OBJECTS}
    world, person = ready.world, Person(ready.world)
    world.store()
    shirt = learn_clothing(world, person, BASE, seed)
    rng = np.random.default_rng([seed, 73])
    errands = []
    for name in OBJECTS:
        bar.set_description(f"seed {seed}, {name}")
        errands.append(run_errand(world, person, name, shirt, segmenters[name], pinvs, rng, tiles))
        world.store([name])
        bar.update()
    return errands


def run_errand(
    world: MobileWorld,
    person: Person,
    name: str,
    shirt: Segmenter,
    segmenter: Segmenter,
    pinvs: dict[str, np.ndarray],
    rng: np.random.Generator,
    tiles: list[tuple[str, np.ndarray]],
) -> Errand:
    """Be shown a thing, find it, pick it up and place it in the bin."""
    world.set_posture(posture("gaze", forward=BASE[0], lateral=BASE[1], head_tilt=-0.1))
    goal = np.array([rng.uniform(*along) for along in FLOOR])
    walk = BringingPerson(world, person, name, START, goal, BASE)
    errand = Errand(watch_person(world, person, walk, shirt, pinvs["head"], tiles))
    place = find_thing(world, name, segmenter, pinvs["head"], tiles)
    if place is None:
        return errand
    errand.off = float(np.hypot(*(place - world.object_center(name)[:2])))
    robot = ManipulatorRobot(world)
    robot.command(above(float(place[0]), float(place[1]), HEIGHT) - robot.joints()[0])
    forget_images(segmenter)
    last: list[np.ndarray] = []

    def keep(_, image: np.ndarray, mask: np.ndarray) -> None:
        last[:] = [outlined(image, mask)]

    def show(attempt: GraspAttempt) -> None:
        if last:
            tiles.append((f"{name}: centered by the base", last.pop()))
        tiles.append((f"{name}: {attempt.check.outcome.value}", world.image("grasp")))

    errand.pick = pick_and_place(
        world, name, 0.0, segmenter, pinvs["base"], pinvs["base grasp"], on_look=keep, on_attempt=show
    )
    tiles += [(f"{name}: last seen by the base", image) for image in last]
    tiles.append((f"{name}: {'in the bin' if errand.placed else 'not in the bin'}", world.image("grasp")))
    return errand


def watch_person(
    world: MobileWorld,
    person: Person,
    walk: BringingPerson,
    shirt: Segmenter,
    pinv: np.ndarray,
    tiles: list[tuple[str, np.ndarray]],
) -> Track:
    """Follow the person with the head until the thing is there and the person has stepped back."""
    one, geoms = configuration("head"), person.geoms("shirt")
    centroids, lost = [], 0
    world.before_frame = walk
    try:
        for number in range(MOST):
            seen, times, shown = follow(
                world,
                one,
                shirt,
                pinv,
                LOOKS,
                max_step=0.3,
                true_place=lambda: mask_sums(world.pixels_of("head", geoms)).centroid,
                mask_seconds=0.2,
            )
            centroids.append(seen)
            lost += times
            tiles += [(f"{walk.name}, shown, look {LOOKS * number + 1}", shown[0][1])] if number % 2 == 0 else []
            if walk.done:
                break
    finally:
        world.before_frame = None
    return Track("head", 0, np.concatenate(centroids), np.array(one.target), lost, walk.walker.traveled, [])


def find_thing(
    world: MobileWorld, name: str, segmenter: Segmenter, pinv: np.ndarray, tiles: list[tuple[str, np.ndarray]]
) -> np.ndarray | None:
    """Look around with the head and center the thing; where it is on the floor (2,) [m] by the robot's own joints."""
    one = configuration("head")
    camera, robot = ManipulatorCamera(world, "head"), ManipulatorRobot(world)
    if not search_object(camera, robot, segmenter, joints=one.joints, reach=AROUND).found:
        return None
    last: list[np.ndarray] = []

    def keep(_, image: np.ndarray, mask: np.ndarray) -> None:
        last[:] = [outlined(image, mask, one.target)]

    servo = MaskServo(camera, robot, segmenter, joints=one.joints, pinv=pinv, target=one.target, gain=0.8, on_look=keep)
    end = servo.run(20).end
    tiles += [(f"{name}: found with the head", image) for image in last]
    return gaze_on_floor(robot.joints()[0], MIDDLE) if end is ServoEnd.CONVERGED else None


def table_rows(results: dict[int, list[Errand]]) -> list[Row]:
    """Things found where the person put them, things in the bin, and how the person was followed."""
    rows = []
    for seed, errands in results.items():
        count = len(errands)
        rows.append(Row(f"found where the person put it, of {count}", None, sum(e.found for e in errands), "", (seed,)))
        rows.append(Row(f"in the bin, of {count}", None, sum(e.placed for e in errands), "", (seed,)))
    seeds = tuple(results)
    everything = [one for errands in results.values() for one in errands]
    off = [one.off for one in everything]
    rows.append(Row("place by the head's gaze, off by, median", None, finite_percentile(off), "m", seeds))
    errors = np.concatenate([np.abs(one.track.centroids - one.track.target).max(axis=1) for one in everything])
    seen = 100 * float(np.mean(np.isfinite(errors)))
    rows.append(Row("looks with the person in view", None, seen, "%", seeds))
    rows.append(Row("person: true error, median", None, finite_percentile(errors), "px", seeds))
    rows.append(Row("times the person was lost", None, sum(one.track.lost for one in everything), "", seeds))
    return rows


def _lines(results: dict[int, list[Errand]]) -> list[list[str]]:
    return [
        [
            str(seed),
            name,
            f"{one.off:.2f}",
            "X" if one.placed else "",
            "the head did not find it" if one.pick is None else one.pick.cause,
        ]
        for seed, errands in results.items()
        for name, one in zip(OBJECTS, errands, strict=True)
    ]
