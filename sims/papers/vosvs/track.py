"""VOS-VS Fig. 13: follow a moving articulated object, a chain that is dragged and jerked, by the base and by the head.

Masks come from a few-shot segmenter that learned from ten images, annotated by the simulator's ids.
"""

import argparse

import numpy as np

from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.dragging_hand import DraggingHand
from dense_vs.sims.papers.vosvs.image_tiles import write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import TEACHER, LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_placement import floor_point, start_posture
from dense_vs.sims.papers.vosvs.tracking import Track, follow, table_rows
from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid
from dense_vs.view.progress import progress

NAME = "Plastic Chain"
SPEED = {"base": 0.2, "head": 0.25}  # m/s, of the hand that drags the chain


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--looks", type=int, default=80, metavar="N", help="images a configuration (default: 80)")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    tracks: list[Track] = []
    with progress("track", len(arguments.seeds) * len(SPEED) * arguments.looks) as bar:
        for seed in arguments.seeds:
            ready = LearnedSetup([NAME, TEACHER], seed, arguments.threads)
            tracks += [follow_chain(ready, config, arguments.looks, bar) for config in SPEED]
    shown = [tile for one in tracks if one.seed == arguments.seeds[0] for tile in one.tiles]
    write_tiles(shown, arguments.out / "track.png", columns=6)
    return table_rows(tracks, "object", tuple(arguments.seeds))


def follow_chain(ready: LearnedSetup, config: str, looks: int, bar) -> Track:
    """Servo without end while the chain is dragged about and jerked."""
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
    places = [world.object_position(NAME)[:2].copy()]

    def watch() -> None:
        places.append(world.object_position(NAME)[:2].copy())
        bar.update()

    world.before_frame = hand
    try:
        centroids, lost, tiles = follow(
            world,
            one,
            segmenter,
            pinv,
            looks,
            max_step=0.12,
            true_place=lambda: true_centroid(world, one.camera, NAME),
            search=config == "base",
            on_look=watch,
        )
    finally:
        world.before_frame = None
        hand.let_go()
    way = float(np.sum(np.hypot(*np.diff(np.array(places), axis=0).T)))
    return Track(config, ready.seed, centroids, np.array(one.target), lost, way, tiles)
