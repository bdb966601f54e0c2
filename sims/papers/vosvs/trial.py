"""VOS-VS Table 2: 24 objects in eight consecutive trials at three heights: found and centred (VS), depth good (DE).

One run without resets but for the objects, which are exchanged between trials. Masks come from few-shot segmenters
that learnt from ten images each, annotated by the simulator's ids; H_base is learnt at the start.
"""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from dense_vs.depth.mask_fit import Method
    from dense_vs.sims.papers.rows import Row
    from dense_vs.sims.papers.vosvs.trials import ObjectTrial

HELP = "Table 2: eight consecutive trials of three objects at three heights, servoing and depth"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument(
        "--method", default="robust", choices=("vos-de", "robust", "learned"), help="of the depth (default: robust)"
    )


def run(arguments: argparse.Namespace) -> "list[Row]":
    """Run the experiment."""
    from dense_vs.sims.papers.vosvs.pictures import write_tiles
    from dense_vs.sims.papers.vosvs.preparation import require_cpu
    from dense_vs.view.progress import progress
    from dense_vs.view.tables import table

    require_cpu(arguments.device)
    results: dict[int, list[ObjectTrial]] = {}
    with progress("trial", 24 * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            tiles: list[tuple[str, np.ndarray]] = []
            results[seed] = run_trials(seed, arguments.method, arguments.threads, bar, tiles)
            write_tiles(tiles, arguments.out / f"trial_{seed}.png", columns=6)
    lines = [_line(seed, one) for seed, ones in results.items() for one in ones]
    print(table(["seed", "object", "height [m]", "VS", "DE", "depth error [%]", "IoU", "cause of failure"], lines))
    return table_rows(results)


def run_trials(
    seed: int, method: "Method", threads: int | None, bar, tiles: "list[tuple[str, np.ndarray]]"
) -> "list[ObjectTrial]":
    """The eight trials of one seed, in one run."""
    import numpy as np

    from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
    from dense_vs.sims.mobile_manipulator.postures import above
    from dense_vs.sims.papers.vosvs.pictures import outlined
    from dense_vs.sims.papers.vosvs.preparation import Preparation
    from dense_vs.sims.papers.vosvs.trials import HEIGHT, PLACES, TRIALS, drive_to, locate, place_objects

    ready = Preparation(None, seed, threads)
    bar.set_description(f"seed {seed}, learning")
    pinv = ready.pinv("base")
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

            result = locate(world, name, place[2], segmenters[name], pinv, method=method, on_look=keep, on_view=keep)
            if last:
                label = f"{name}: VS {'yes' if result.servo else 'no'}, DE {'yes' if result.depth else 'no'}"
                tiles.append((label, last[0]))
            results.append(result)
            bar.update()
    return results


def table_rows(results: "dict[int, list[ObjectTrial]]") -> "list[Row]":
    """Successes and depth errors beside the paper's."""
    import numpy as np

    from dense_vs.sims.papers.rows import Row
    from dense_vs.sims.papers.vosvs.summary import finite_percentile

    rows = []
    for seed, ones in results.items():
        rows.append(Row("VS of 24 (ClickBot 2023: 24)", 20, sum(one.servo for one in ones), "", (seed,)))
        rows.append(Row("DE of 24 (ClickBot 2023: 16)", 10, sum(one.depth for one in ones), "", (seed,)))
    seeds = tuple(results)
    errors = 100 * np.abs([one.depth_error for ones in results.values() for one in ones])
    surface = 100 * np.abs([one.surface_error for ones in results.values() for one in ones])
    rows.append(Row("depth error, median, against the outline's depth", None, finite_percentile(errors), "%", seeds))
    rows.append(Row("depth error, 90th percentile", None, finite_percentile(errors, 90), "%", seeds))
    rows.append(Row("the same against the mean surface depth", None, finite_percentile(surface), "%", seeds))
    iou = [one.iou[1] for ones in results.values() for one in ones]
    rows.append(Row("mask IoU at the nearest view, median", None, finite_percentile(iou), "", seeds))
    return rows


def _line(seed: int, one: "ObjectTrial") -> list[str]:
    yes = {True: "X", False: ""}
    error = f"{100 * one.depth_error:+.1f}"
    return [
        str(seed),
        one.name,
        f"{one.support:g}",
        yes[one.servo],
        yes[one.depth],
        error,
        f"{one.iou[0]:.2f} {one.iou[1]:.2f}",
        one.cause,
    ]
