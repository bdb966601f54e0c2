"""VOS-VS Table 2: 24 objects in eight consecutive trials at three heights: found and centered (VS), depth good (DE).

One run without resets, except that the objects are exchanged between trials. Masks come from few-shot segmenters that
learned from ten images each, annotated by the simulator's ids. J+ of H_base is learned at the start, once feature by
feature and once by VOS-VS (11) as printed; each object is centered by both. DE is scored by the method asked for and by
VOS-VS (20) as printed, from the same masks. What both share is beyond the paper: the trust region that bounds the
motions while J+ is learned, and the rule that ends an approach.
"""

import argparse

import numpy as np

from dense_vs.depth.mask_fit import METHODS, Method
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.image_tiles import outlined, write_tiles
from dense_vs.sims.papers.vosvs.jacobian_learning import Update
from dense_vs.sims.papers.vosvs.learned_setup import LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_trial import (
    HEIGHT,
    PLACES,
    TRIALS,
    ObjectTrial,
    drive_to,
    locate,
    place_objects,
)
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

COLUMNS = [
    "seed",
    "object",
    "height [m]",
    "VS",
    "VS (11)",
    "DE",
    "DE (20)",
    "depth error [%]",
    "IoU",
    "cause of failure",
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--method", default="robust", choices=METHODS, help="of the depth (default: robust)")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    results: dict[int, list[ObjectTrial]] = {}
    learned: dict[int, bool] = {}
    with progress("trial", 24 * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            tiles: list[tuple[str, np.ndarray]] = []
            results[seed], learned[seed] = run_trials(seed, arguments.method, arguments.threads, bar, tiles)
            write_tiles(tiles, arguments.out / f"trial_{seed}.png", columns=6)
    print(table(COLUMNS, [_line(seed, one) for seed, ones in results.items() for one in ones]))
    return table_rows(results, learned, arguments.method)


def run_trials(
    seed: int, method: Method, threads: int | None, bar, tiles: list[tuple[str, np.ndarray]]
) -> tuple[list[ObjectTrial], bool]:
    """The eight trials of one seed, in one run, and whether VOS-VS (11) as printed had learned J+ before."""
    ready = LearnedSetup(None, seed, threads)
    bar.set_description(f"seed {seed}, learning")
    pinv = ready.pinv("base")
    printed = ready.learning("base", Update.PRINTED)
    segmenters = {name: ready.segmenter(name) for names in TRIALS for name in names}
    world, rng = ready.world, np.random.default_rng([seed, 60])
    robot = ManipulatorRobot(world)
    world.set_posture(above(1.0, 0.0, HEIGHT))
    results = []
    for names in TRIALS:
        place_objects(world, names, rng)
        for name, place in zip(names, PLACES, strict=True):
            bar.set_description(f"seed {seed}, {name}")
            drive_to(robot, place, rng)
            last: list[np.ndarray] = []

            def keep(_, image: np.ndarray, mask: np.ndarray, last=last) -> None:
                last[:] = [outlined(image, mask)]

            result = locate(
                world,
                name,
                place[2],
                segmenters[name],
                pinv,
                printed_pinv=printed.pinv,
                method=method,
                on_look=keep,
                on_view=keep,
            )
            if last:
                yes = {True: "yes", False: "no"}
                label = f"{name}: VS {yes[result.servo.centered]}, DE {yes[result.depth.graspable]}"
                tiles.append((label, last[0]))
            results.append(result)
            bar.update()
    return results, printed.converged


def table_rows(results: dict[int, list[ObjectTrial]], learned: dict[int, bool], method: Method) -> list[Row]:
    """Successes and depth errors beside the paper's.

    Args:
        results: of every seed.
        learned: whether VOS-VS (11) as printed had learned J+, of every seed.
        method: of the depth.
    """
    rows = []
    for seed, ones in results.items():
        printed = [one.printed_servo.centered for one in ones if one.printed_servo is not None]
        centered, graspable = sum(one.servo.centered for one in ones), sum(one.depth.graspable for one in ones)
        by_areas = sum(one.printed_depth.graspable for one in ones)
        rows.append(Row("VS of 24 (ClickBot 2023: 24), J+ feature by feature", 20, centered, "", (seed,)))
        rows.append(Row("VS of 24, J+ by (11) as printed", 20, sum(printed), "", (seed,)))
        rows.append(Row("J+ by (11) as printed converged (1) or not (0)", None, int(learned[seed]), "", (seed,)))
        rows.append(Row(f"DE of 24 (ClickBot 2023: 16), depth by {method}", 10, graspable, "", (seed,)))
        rows.append(Row("DE of 24, depth by (20) as printed", 10, by_areas, "", (seed,)))
    seeds = tuple(results)
    everything = [one for ones in results.values() for one in ones]
    errors = [100 * abs(one.depth.error) for one in everything]
    surface = [100 * abs(one.depth.surface_error) for one in everything]
    of_areas = [100 * abs(one.printed_depth.error) for one in everything]
    name = f"depth error by {method}"
    rows.append(Row(f"{name}, median, against the outline's depth", None, finite_percentile(errors), "%", seeds))
    rows.append(Row(f"{name}, 90th percentile", None, finite_percentile(errors, 90), "%", seeds))
    rows.append(Row("  the same against the mean surface depth, median", None, finite_percentile(surface), "%", seeds))
    rows.append(Row("depth error by (20) as printed, median", None, finite_percentile(of_areas), "%", seeds))
    rows.append(
        Row("depth error by (20) as printed, 90th percentile", None, finite_percentile(of_areas, 90), "%", seeds)
    )
    iou = finite_percentile([one.iou[1] for one in everything])
    rows.append(Row("mask IoU at the nearest view, median", None, iou, "", seeds))
    return rows


def _line(seed: int, one: ObjectTrial) -> list[str]:
    yes = {True: "X", False: ""}
    return [
        str(seed),
        one.name,
        f"{one.support:g}",
        yes[one.servo.centered],
        yes[one.printed_servo is not None and one.printed_servo.centered],
        yes[one.depth.graspable],
        yes[one.printed_depth.graspable],
        f"{100 * one.depth.error:+.1f} {100 * one.printed_depth.error:+.1f}",
        f"{one.iou[0]:.2f} {one.iou[1]:.2f}",
        one.cause,
    ]
