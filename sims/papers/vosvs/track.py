"""VOS-VS Fig. 13: follow a moving articulated object, a chain that is dragged and jerked, by the base and by the head.

Masks come from a few-shot segmenter that learnt from ten images, annotated by the simulator's ids.
"""

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from dense_vs.sims.papers.rows import Row
    from dense_vs.sims.papers.vosvs.preparation import Preparation

HELP = "Fig. 13: a moving articulated object followed by the base and by the head gimbal"
NAME = "Plastic Chain"
SPEED = {"base": 0.2, "head": 0.25}  # m/s, of the hand that drags the chain
SETTLE = 3  # frames from the end of a motion to the next image


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--looks", type=int, default=80, help="images a configuration (default: 80)")


@dataclass
class Track:
    """One run: true centroids ``(T, 2)`` [px], nan out of view; times lost; the object's way [m]; images."""

    config: str
    seed: int
    centroids: "np.ndarray"
    target: "np.ndarray"
    lost: int
    travelled: float
    tiles: "list[tuple[str, np.ndarray]]"


def run(arguments: argparse.Namespace) -> "list[Row]":
    """Run the experiment."""
    from dense_vs.sims.papers.vosvs.pictures import write_tiles
    from dense_vs.sims.papers.vosvs.preparation import TEACHER, Preparation, require_cpu
    from dense_vs.view.progress import progress

    require_cpu(arguments.device)
    tracks: list[Track] = []
    with progress("track", len(arguments.seeds) * len(SPEED) * arguments.looks) as bar:
        for seed in arguments.seeds:
            ready = Preparation([NAME, TEACHER], seed, arguments.threads)
            tracks += [follow(ready, config, arguments.looks, bar) for config in SPEED]
    shown = [tile for one in tracks if one.seed == arguments.seeds[0] for tile in one.tiles]
    write_tiles(shown, arguments.out / "track.png", columns=6)
    return table_rows(tracks, tuple(arguments.seeds))


def follow(ready: "Preparation", config: str, looks: int, bar) -> Track:
    """Servo without end while the chain is dragged about and jerked."""
    import numpy as np

    from dense_vs.mask_servo.loop import MaskServo, ServoEnd
    from dense_vs.mask_servo.object_search import search_object
    from dense_vs.sims.mobile_manipulator.adapters import ManipulatorCamera, ManipulatorRobot
    from dense_vs.sims.papers.vosvs.configurations import configuration
    from dense_vs.sims.papers.vosvs.dragging import DraggingHand
    from dense_vs.sims.papers.vosvs.pictures import outlined
    from dense_vs.sims.papers.vosvs.staging import floor_point, start_posture
    from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid

    one, world = configuration(config), ready.world
    bar.set_description(f"seed {ready.seed}, {config}")
    segmenter, pinv = ready.segmenter(NAME), ready.pinv(config)
    rng = np.random.default_rng([ready.seed, 65])
    world.store()
    world.set_posture(start_posture(one))
    ground = floor_point(world, one.camera, np.array([320.0, 340.0 if config == "head" else 240.0]))
    assert ground is not None
    world.lay_chain(NAME, ground, rng)
    hand = DraggingHand(world, NAME, SPEED[config], rng)
    centroids: list[np.ndarray] = []
    tiles: list[tuple[str, np.ndarray]] = []
    places = [world.object_position(NAME)[:2].copy()]

    def watch(_, image: np.ndarray, mask: np.ndarray) -> None:
        centroids.append(true_centroid(world, one.camera, NAME))
        places.append(world.object_position(NAME)[:2].copy())
        if (len(centroids) - 1) % max(1, looks // 6) == 0 and len(tiles) < 6:
            tiles.append((f"{config}, look {len(centroids)}", outlined(image, mask, one.target)))
        bar.update()

    camera, robot = ManipulatorCamera(world, one.camera), ManipulatorRobot(world, settle_frames=SETTLE)
    servo = MaskServo(
        camera,
        robot,
        segmenter,
        joints=one.joints,
        pinv=pinv,
        target=one.target,
        gain=0.8,
        max_step=0.12,
        tolerance=0.0,
        patience=4,
        on_look=watch,
    )
    lost = 0
    world.before_frame = hand
    try:
        while len(centroids) < looks:
            run = servo.run(looks - len(centroids))
            if run.end is ServoEnd.LOST:
                lost += 1
                found = config == "base" and search_object(camera, robot, segmenter).found
                if not found and lost > 3:
                    break
    finally:
        world.before_frame = None
        hand.let_go()
    way = float(np.sum(np.hypot(*np.diff(np.array(places), axis=0).T)))
    return Track(config, ready.seed, np.array(centroids), np.array(one.target), lost, way, tiles)


def table_rows(tracks: list[Track], seeds: tuple[int, ...]) -> "list[Row]":
    """How well the object was kept in view."""
    import numpy as np

    from dense_vs.sims.papers.rows import Row
    from dense_vs.sims.papers.vosvs.summary import finite_percentile

    rows = []
    for config in SPEED:
        mine = [one for one in tracks if one.config == config]
        centroids = np.concatenate([one.centroids for one in mine])
        errors = np.abs(centroids - mine[0].target).max(axis=1)
        seen = 100 * float(np.mean(np.isfinite(errors)))
        rows.append(Row(f"{config}: looks with the object in view", None, seen, "%", seeds))
        rows.append(Row(f"{config}: true error, median", None, finite_percentile(errors), "px", seeds))
        rows.append(Row(f"{config}: true error, 90th percentile", None, finite_percentile(errors, 90), "px", seeds))
        rows.append(Row(f"{config}: times lost", None, sum(one.lost for one in mine), "", seeds))
        way = float(np.mean([one.travelled for one in mine]))
        rows.append(Row(f"{config}: the object's way", None, way, "m", seeds))
    return rows
