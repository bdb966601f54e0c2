"""VOS-VS Table 1, Figs. 8, 9, 18: learn J+ of seven configurations from 0.001 H by (11), beside Broyden's update.

Masks come from few-shot segmenters that learnt from ten images each, annotated by the simulator's ids.
"""

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from dense_vs.sims.papers.rows import Row
    from dense_vs.sims.papers.vosvs.configurations import Configuration
    from dense_vs.sims.papers.vosvs.learning import Learning

HELP = "Table 1, Figs. 8, 9, 18: seven configurations learnt from 0.001 H, with Broyden's original update beside"
LABELS = {"hadamard": "(11)", "featurewise": "(11) a feature at a time", "original": "original Broyden"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument("--responses", type=int, default=5, help="step responses that each learns from (default: 5)")
    parser.add_argument("--looks", type=int, default=150, help="images a configuration may take (default: 150)")


@dataclass
class Learnt:
    """All updates' outcomes for one configuration and seed, beside the truth of J+ where they ended, its median."""

    one: "Configuration"
    seed: int
    outcomes: "dict[str, Learning]"
    true: "np.ndarray"


def run(arguments: argparse.Namespace) -> "list[Row]":
    """Run the experiment."""
    from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
    from dense_vs.sims.papers.vosvs.learn_figure import draw_learning
    from dense_vs.sims.papers.vosvs.learning import UPDATES
    from dense_vs.sims.papers.vosvs.preparation import require_cpu
    from dense_vs.view.progress import progress

    require_cpu(arguments.device)
    learnt: list[Learnt] = []
    with progress("learn", len(arguments.seeds) * len(CONFIGURATIONS) * len(UPDATES), "run") as bar:
        for seed in arguments.seeds:
            learnt += learn_all(seed, arguments.responses, arguments.looks, arguments.threads, bar)
    draw_learning([one for one in learnt if one.seed == arguments.seeds[0]], arguments.out)
    return table_rows(learnt, tuple(arguments.seeds))


def learn_all(seed: int, responses: int, looks: int, threads: int | None, bar) -> list[Learnt]:
    """The seven configurations with all three updates."""
    import numpy as np

    from dense_vs.sims.mobile_manipulator.annotations import learn_segmenter
    from dense_vs.sims.mobile_manipulator.world import MobileWorld
    from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
    from dense_vs.sims.papers.vosvs.learning import UPDATES, learn
    from dense_vs.sims.papers.vosvs.preparation import TEACHER, TEACHERS

    names = [*dict.fromkeys([*TEACHERS.values(), TEACHER])]
    world = MobileWorld(names, seed=seed, threads=threads)
    segmenters = {name: learn_segmenter(world, name, seed) for name in names}
    learnt = []
    for number, one in enumerate(CONFIGURATIONS):
        name = TEACHERS.get(one.name, TEACHER)
        outcomes = {}
        for update in UPDATES:
            bar.set_description(f"seed {seed}, {one.name}, {update}")
            world.store()
            outcomes[update] = learn(
                world,
                one,
                name,
                segmenters[name],
                np.random.default_rng([seed, 50, number]),
                update=update,
                responses=responses,
                looks=looks,
                keep_images=one.name == "base" and update == "hadamard",
            )
            bar.update()
        truths = [true for outcome in outcomes.values() for true in outcome.true]
        true = np.median(truths, axis=0) if truths else np.full(one.coupling.shape, np.nan)
        learnt.append(Learnt(one, seed, outcomes, true))
    return learnt


def table_rows(learnt: list[Learnt], seeds: tuple[int, ...]) -> "list[Row]":
    """Table 1: every learnt element beside the paper's and the truth; how many of the seven converged."""
    import numpy as np

    from dense_vs.sims.papers.rows import Row

    rows = []
    for seed in seeds:
        mine = [one for one in learnt if one.seed == seed]
        for update, label in LABELS.items():
            count = sum(one.outcomes[update].converged for one in mine)
            rows.append(Row(f"converged of 7, {label}", 7 if update == "hadamard" else None, count, "", (seed,)))
        for update, label in LABELS.items():
            lost = sum(one.outcomes[update].restarts for one in mine)
            back = sum(one.outcomes[update].retreats for one in mine)
            seen = sum(one.outcomes[update].looks for one in mine)
            rows.append(Row(f"times put back, {label}", None, lost, "", (seed,)))
            rows.append(Row(f"steps taken back, {label}", None, back, "", (seed,)))
            rows.append(Row(f"looks until s*, all seven, {label}", None, seen, "", (seed,)))
    for one in learnt[:7]:
        same = [other for other in learnt if other.one.name == one.one.name]
        for update in ("hadamard", "featurewise"):
            known = [count for other in same if (count := other.outcomes[update].updates) is not None]
            paper = 14 if (one.one.name, update) == ("base", "hadamard") else None
            count = float(np.median(known)) if known else float("nan")
            rows.append(Row(f"{one.one.name}: updates until s*, {LABELS[update]}", paper, count, "", seeds))
        for update in ("hadamard", "featurewise"):
            parts = np.median([removed(other, update) for other in same], axis=0)
            for feature, part in zip("xy", parts, strict=True):
                name = f"{one.one.name}: part of the error in s_{feature} that a step (10) removes, {LABELS[update]}"
                rows.append(Row(name, None, float(part), "", seeds))
        for row, joint in enumerate(one.one.joints):
            feature = int(np.argmax(one.one.coupling[row]))
            by = {u: np.median([other.outcomes[u].pinv[row, feature] for other in same]) for u in LABELS}
            true = np.median([other.true[row, feature] for other in same])
            unit = "m/px" if joint in ("arm_lift", "base_forward", "base_lateral") else "rad/px"
            element = f"{one.one.name}: d{joint}/ds_{'xy'[feature]}"
            rows.append(Row(f"{element}, {LABELS['hadamard']}", one.one.learnt[row], by["hadamard"], unit, seeds))
            rows.append(Row(f"  {LABELS['featurewise']}", None, by["featurewise"], unit, seeds))
            rows.append(Row("  by the simulator, the joint alone", None, true, unit, seeds))
    return rows


def removed(one: Learnt, update: str) -> "np.ndarray":
    """Part ``(2,)`` of the error in s_x and s_y that a step (10) of gain 1 truly removes: 1 where J+ has its true size.

    That of a feature's joints together: which share each of several takes is free.
    """
    import numpy as np

    coupled = one.one.coupling > 0
    shares = np.divide(one.outcomes[update].pinv, one.true, out=np.zeros_like(one.true), where=coupled)
    return shares.sum(axis=0)
