"""VOS-VS Fig. 5: find an object, center it, estimate its depth, grasp, check, and place it in a bin.

All objects of Table 2 that fit the gripper, each from the height of its trial. Masks come from few-shot segmenters
that learned from ten images each, annotated by the simulator's ids; H_base and H_base grasp are learned at the start.
"""

import argparse

import numpy as np

from dense_vs.depth.mask_fit import METHODS, Method
from dense_vs.grasp import GraspOutcome, check_grasp
from dense_vs.segmentation.segmenter import forget_images
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.image_tiles import write_tiles
from dense_vs.sims.papers.vosvs.learned_setup import LearnedSetup, require_cpu
from dense_vs.sims.papers.vosvs.object_pick import FITS, Pick, pick_and_place
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT, PLACES, TRIALS, place_objects
from dense_vs.view.progress import progress
from dense_vs.view.tables import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--method", default="robust", choices=METHODS, help="of the depth (default: robust)")


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    results: dict[int, list[Pick]] = {}
    with progress("pick", 22 * len(arguments.seeds), "object") as bar:
        for seed in arguments.seeds:
            tiles: list[tuple[str, np.ndarray]] = []
            results[seed] = run_picks(seed, arguments.method, arguments.threads, bar, tiles)
            write_tiles(tiles, arguments.out / f"pick_place_{seed}.png", columns=6)
    lines = [_line(seed, one) for seed, ones in results.items() for one in ones]
    print(table(["seed", "object", "depth error [%]", "attempts", "checks right", "in bin", "cause of failure"], lines))
    return table_rows(results)


def run_picks(seed: int, method: Method, threads: int | None, bar, tiles: list[tuple[str, np.ndarray]]) -> list[Pick]:
    """All objects that fit, one after the other."""
    ready = LearnedSetup(None, seed, threads)
    world, rng = ready.world, np.random.default_rng([seed, 70])
    bar.set_description(f"seed {seed}, learning")
    high, low = ready.pinv("base"), ready.pinv("base grasp")
    segmenters = {n: ready.segmenter(n) for names in TRIALS for n in names if world.objects[n].grip <= FITS}
    results = []
    for names in TRIALS:
        world.set_posture(above(1.0, 0.0, HEIGHT))
        place_objects(world, names, rng)
        for name, place in zip(names, PLACES, strict=True):
            if name not in segmenters:
                continue
            bar.set_description(f"seed {seed}, {name}")
            x, y = np.array(place[:2]) + rng.uniform(-0.12, 0.12, 2)
            world.set_posture(above(x, y, HEIGHT))
            forget_images(segmenters[name])
            pick = pick_and_place(world, name, place[2], segmenters[name], high, low, method=method)
            tiles.append((f"{name}: {'in the bin' if pick.placed else 'not in the bin'}", world.image("grasp")))
            if pick.placed:
                world.store([name])  # the bin is emptied
            results.append(pick)
            bar.update()
    return results


def table_rows(results: dict[int, list[Pick]]) -> list[Row]:
    """Objects in the bin, and how often the grasp check was right."""
    rows = []
    for seed, picks in results.items():
        placed = sum(one.placed for one in picks)
        rows.append(Row(f"in the bin, of {len(picks)} that fit the gripper", None, placed, "", (seed,)))
    seeds = tuple(results)
    right = [answer for picks in results.values() for one in picks for answer in checks_right(one)]
    rows.append(Row("grasp check right", None, 100 * float(np.mean(right)) if right else np.nan, "%", seeds))
    alone = [answer for picks in results.values() for one in picks for answer in checks_right(one, areas_alone=True)]
    rows.append(Row("(23) alone right", None, 100 * float(np.mean(alone)) if alone else np.nan, "%", seeds))
    rows.append(Row("grasp checks", None, len(right), "", seeds))
    errors = [abs(one.trial.depth.error) for picks in results.values() for one in picks]
    rows.append(Row("depth error, median", None, 100 * finite_percentile(errors), "%", seeds))
    return rows


def checks_right(pick: Pick, *, areas_alone: bool = False) -> list[bool]:
    """For each attempt that closed the gripper: whether the check, or VOS-VS (23) alone, agrees with the simulator."""
    if pick.grasp is None:
        return []
    judged = [one for one in pick.grasp.attempts if one.check.outcome is not GraspOutcome.JAMMED]
    answers = []
    for attempt, held in zip(judged, pick.truly_held, strict=True):
        if np.isfinite(attempt.opening):  # else the object was lost before the gripper closed
            said = check_grasp(*attempt.areas).held if areas_alone else attempt.check.held
            answers.append(said == held)
    return answers


def _line(seed: int, one: Pick) -> list[str]:
    right = checks_right(one)
    return [
        str(seed),
        one.trial.name,
        f"{100 * one.trial.depth.error:+.1f}",
        str(len(right)),
        str(sum(right)),
        "X" if one.placed else "",
        one.cause,
    ]
