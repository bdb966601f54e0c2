"""VOS-VS Fig. 13: follow a person who walks about the room, by an article of clothing, with the head and with the base.

Masks of the shirt come from a few-shot segmenter that learned from ten images, annotated by the simulator's ids, of the
same person in the same room, whose curtain and poster have the shirt's colors. The world goes on while a mask is
computed.
"""

import argparse

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.robot.command_gate import MAX_AGE
from dense_vs.segmentation import Segmenter
from dense_vs.segmentation.mask_features import mask_sums
from dense_vs.sims.mobile_manipulator.person import Person, add_person
from dense_vs.sims.mobile_manipulator.person_annotations import learn_clothing
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.room import add_room
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.image_tiles import write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import TEACHER, LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.tracking import Track, follow, table_rows
from dense_vs.sims.papers.vosvs.walking_person import Stroll, WalkingPerson
from dense_vs.view.progress import progress

BASE = (-1.5, 2.5)  # m, where the robot begins, looking ahead
FLOOR = ((0.2, 2.4), (1.2, 4.0))  # m, where the person walks: before the robot, clear of bins and furniture
START = (0.6, 2.5)
SPEEDS = {"head": (0.4, 0.9), "base head": (0.15, 0.35)}  # m/s, of the person; the base does 0.3 m/s
MAX_STEP = {"head": 0.3, "base head": 0.15}  # rad, m a command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--looks", type=int, default=80, metavar="N", help="images a configuration (default: 80)")
    parser.add_argument(
        "--mask-seconds", type=float, default=0.2, metavar="S", help="world time of a mask (default: 0.2)"
    )


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    looks = check_whole("--looks", arguments.looks, least=1)
    seconds = check_number("--mask-seconds", arguments.mask_seconds, least=0.0, below=MAX_AGE)
    tracks: list[Track] = []
    with progress("track person", len(arguments.seeds) * len(SPEEDS) * looks) as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}, learning")
            ready = LearnedSetup([TEACHER], seed, arguments.threads, additions=(add_person, add_room))
            pinvs = {config: ready.pinv(config) for config in SPEEDS}
            person = Person(ready.world)
            ready.world.store()
            segmenter = learn_clothing(ready.world, person, BASE, seed)
            for config, pinv in pinvs.items():
                bar.set_description(f"seed {seed}, {config}")
                tracks.append(follow_person(ready, person, config, segmenter, pinv, looks, seconds, bar))
    shown = [tile for one in tracks if one.seed == arguments.seeds[0] for tile in one.tiles]
    write_tiles(shown, arguments.out / "track_person.png", columns=6)
    return table_rows(tracks, "person", tuple(arguments.seeds))


def follow_person(
    ready: LearnedSetup,
    person: Person,
    config: str,
    segmenter: Segmenter,
    pinv: np.ndarray,
    looks: int,
    mask_seconds: float,
    bar,
) -> Track:
    """Servo without end while the person walks from place to place."""
    one, world = configuration(config), ready.world
    walker = WalkingPerson(person, START, np.pi / 2)
    world.set_posture(posture(one.posture, forward=BASE[0], lateral=BASE[1], head_tilt=-0.1))
    world.before_frame = Stroll(walker, draw_place, np.random.default_rng([ready.seed, 66]), SPEEDS[config])
    shirt = person.geoms("shirt")
    try:
        centroids, lost, tiles = follow(
            world,
            one,
            segmenter,
            pinv,
            looks,
            max_step=MAX_STEP[config],
            true_place=lambda: mask_sums(world.pixels_of(one.camera, shirt)).centroid,
            mask_seconds=mask_seconds,
            on_look=bar.update,
        )
    finally:
        world.before_frame = None
    return Track(config, ready.seed, centroids, np.array(one.target), lost, walker.traveled, tiles)


def draw_place(rng: np.random.Generator) -> np.ndarray:
    """A place (x, y) [m] of the floor where the person walks."""
    return np.array([rng.uniform(*along) for along in FLOOR])
