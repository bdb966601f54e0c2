"""VOS-VS Table 1, Figs. 8, 9, 18: learn J+ of seven configurations from 0.001 H by VOS-VS (11) and by Broyden.

The rows say whether VOS-VS (11) is as printed, has its denominator held away from zero, or is applied a feature at a
time; the two changes are beyond the paper, and so is the trust region that bounds the motions of all. Masks come from
few-shot segmenters that learned from ten images each, annotated by the simulator's ids.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from dense_vs.robot.joint_group import JointGroup
from dense_vs.sims.mobile_manipulator.adapters import ManipulatorRobot
from dense_vs.sims.mobile_manipulator.annotations import learn_segmenter
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.rows import Row
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS, Configuration
from dense_vs.sims.papers.vosvs.jacobian_learning import Learning, Update, learn_configuration
from dense_vs.sims.papers.vosvs.learned_setup import TEACHER, TEACHERS, require_cpu
from dense_vs.sims.papers.vosvs.learning_figures import draw_learning
from dense_vs.view.progress import progress

CHOSEN = (Update.PRINTED, Update.GUARDED, Update.FEATUREWISE)  # all that use H


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument(
        "--responses", type=int, default=5, metavar="N", help="step responses that each learns from (default: 5)"
    )
    parser.add_argument(
        "--looks", type=int, default=150, metavar="N", help="images a configuration may take (default: 150)"
    )


@dataclass
class Learned:
    """All updates' outcomes for one configuration and seed, beside the truth of J+ where they ended, its median.

    ``units`` are those of the configuration's joints, ``"rad"`` or ``"m"``.
    """

    one: Configuration
    seed: int
    outcomes: dict[Update, Learning]
    true: np.ndarray
    units: tuple[str, ...]


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    require_cpu(arguments.device)
    learned: list[Learned] = []
    with progress("learn", len(arguments.seeds) * len(CONFIGURATIONS) * len(Update), "run") as bar:
        for seed in arguments.seeds:
            learned += learn_all(seed, arguments.responses, arguments.looks, arguments.threads, bar)
    draw_learning([one for one in learned if one.seed == arguments.seeds[0]], arguments.out)
    return table_rows(learned, tuple(arguments.seeds))


def learn_all(seed: int, responses: int, looks: int, threads: int | None, bar) -> list[Learned]:
    """The seven configurations with every update."""
    names = [*dict.fromkeys([*TEACHERS.values(), TEACHER])]
    world = MobileWorld(names, seed=seed, threads=threads)
    segmenters = {name: learn_segmenter(world, name, seed) for name in names}
    learned = []
    for number, one in enumerate(CONFIGURATIONS):
        name = TEACHERS.get(one.name, TEACHER)
        outcomes = {}
        for update in Update:
            bar.set_description(f"seed {seed}, {one.name}, {update}")
            world.store()
            outcomes[update] = learn_configuration(
                world,
                one,
                name,
                segmenters[name],
                np.random.default_rng([seed, 50, number]),
                update=update,
                responses=responses,
                looks=looks,
                keep_images=one.name == "base" and update is Update.GUARDED,
            )
            bar.update()
        truths = [true for outcome in outcomes.values() for true in outcome.true]
        true = np.median(truths, axis=0) if truths else np.full(one.coupling.shape, np.nan)
        units = JointGroup.of_robot(ManipulatorRobot(world), one.joints).units
        learned.append(Learned(one, seed, outcomes, true, units))
    return learned


def table_rows(learned: list[Learned], seeds: tuple[int, ...]) -> list[Row]:
    """Table 1: every learned element beside the paper's and the truth; how many of the seven converged."""
    rows = []
    for seed in seeds:
        mine = [one for one in learned if one.seed == seed]
        for update in Update:
            count = sum(one.outcomes[update].converged for one in mine)
            rows.append(
                Row(
                    f"converged of 7, {update}",
                    7 if update in (Update.PRINTED, Update.GUARDED) else None,
                    count,
                    "",
                    (seed,),
                )
            )
        for update in Update:
            lost = sum(one.outcomes[update].restarts for one in mine)
            back = sum(one.outcomes[update].retreats for one in mine)
            seen = sum(one.outcomes[update].looks for one in mine)
            rows.append(Row(f"times put back, {update}", None, lost, "", (seed,)))
            rows.append(Row(f"steps taken back, {update}", None, back, "", (seed,)))
            rows.append(Row(f"looks until s*, all seven, {update}", None, seen, "", (seed,)))
    for one in learned[:7]:
        same = [other for other in learned if other.one.name == one.one.name]
        for update in CHOSEN:
            known = [count for other in same if (count := other.outcomes[update].updates) is not None]
            paper = 14 if (one.one.name, update) == ("base", Update.GUARDED) else None
            count = float(np.median(known)) if known else float("nan")
            rows.append(Row(f"{one.one.name}: updates until s*, {update}", paper, count, "", seeds))
        for update in CHOSEN:
            parts = np.median([removed(other, update) for other in same], axis=0)
            for feature, part in zip("xy", parts, strict=True):
                name = f"{one.one.name}: part of the error in s_{feature} that a step by (10) removes, {update}"
                rows.append(Row(name, None, float(part), "", seeds))
        for row, joint in enumerate(one.one.joints):
            feature = int(np.argmax(one.one.coupling[row]))
            by = {u: np.median([other.outcomes[u].pinv[row, feature] for other in same]) for u in Update}
            true = np.median([other.true[row, feature] for other in same])
            unit = f"{one.units[row]}/px"
            element = f"{one.one.name}: d{joint}/ds_{'xy'[feature]}"
            rows.append(Row(f"{element}, {Update.GUARDED}", one.one.learned[row], by[Update.GUARDED], unit, seeds))
            rows.append(Row(f"  {Update.FEATUREWISE}", None, by[Update.FEATUREWISE], unit, seeds))
            rows.append(Row("  by the simulator, the joint alone", None, true, unit, seeds))
    return rows


def removed(one: Learned, update: Update) -> np.ndarray:
    """Part ``(2,)`` of the error in s_x and s_y that a step by VOS-VS (10) of gain 1 truly removes; 1 for the true J+.

    That of a feature's joints together: which share each of several takes is free.
    """
    coupled = one.one.coupling > 0
    shares = np.divide(one.outcomes[update].pinv, one.true, out=np.zeros_like(one.true), where=coupled)
    return shares.sum(axis=0)
