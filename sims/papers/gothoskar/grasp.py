"""Fig. 12: grasping a block anywhere on a table with an arm whose joint controller is inaccurate.

The arm is learned from 50 postures by encoders and rendered images, the block's structure from 5 postures with the
block in the gripper. Each try puts the block elsewhere. As in the paper: 4 motions to where the hand stands off the
block by a stretch factor of 1.4, one each to 1.3, 1.2, 1.1 and 1.0, then the gripper closes and the arm lifts. A try
succeeds when the block then hangs in the gripper, by the simulator's truth. Contact and friction are simulated.

The controller's errors: a command moves a joint by the commanded step times 1 + N(0, 0.1), the links hang on springs
of Baxter's stiffness with Coulomb friction and a fifth of their weight, and the encoders, off by N(0, 0.002 rad), do
not see the springs. --independent adds N(0, RAD) to every joint at every motion.
"""

import argparse
from typing import Any

import numpy as np

from dense_vs.checks import check_whole
from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

FACTORS = (1.3, 1.2, 1.1, 1.0)
FIRST_FACTOR, FIRST_ATTEMPTS = 1.4, 4
LIFTED = 0.03  # m


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--tries", type=int, default=20, metavar="N", help="block places a seed (default: 20)")
    add_cell_arguments(parser)


def add_cell_arguments(parser: argparse.ArgumentParser) -> None:
    """Which arm, how it was learned and how it errs."""
    parser.add_argument(
        "--arm", default="baxter", choices=("ur5", "baxter"), help="ur5 or baxter (default: baxter, as the paper)"
    )
    parser.add_argument(
        "--samples", type=int, default=50, metavar="N", help="postures to learn the arm from (default: 50)"
    )
    parser.add_argument(
        "--independent",
        type=float,
        default=0.0,
        metavar="RAD",
        help="standard deviation of an error added to every joint at every motion (default: 0)",
    )


def make_cell(arguments: argparse.Namespace, seed: int, *, peg: bool) -> Any:
    """The cell that the arguments describe."""
    from dense_vs.device import resolve_threads
    from dense_vs.sims.workcell.cell import Inaccuracy, Workcell

    check_whole("--tries", arguments.tries, least=1)
    check_whole("--samples", arguments.samples, least=1)
    errs = Inaccuracy(independent=arguments.independent)
    return Workcell(arguments.arm, peg=peg, seed=seed, inaccuracy=errs, threads=resolve_threads(arguments.threads))


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.sims.papers.gothoskar.figures import draw_images
    from dense_vs.sims.papers.gothoskar.guided_motion import learn_arm, learn_structure
    from dense_vs.sims.workcell.cell import PART_MARKERS

    rows, lifted, fit = [], [], []
    with progress("tries", arguments.tries * len(arguments.seeds), "try") as bar:
        for seed in arguments.seeds:
            rng = np.random.default_rng([seed, 31])
            bar.set_description(f"seed {seed}: learning")
            cell = make_cell(arguments, seed, peg=False)
            guide = learn_arm(cell, rng, arguments.samples)
            fit.append(guide.model.report.mean_error_px)
            cell.reset()
            cell.teach_grasp(np.zeros(3), 0.0)
            structure = learn_structure(guide, PART_MARKERS, rng, 5)
            bar.set_description(f"seed {seed}: grasping")
            successes = 0
            for number in range(arguments.tries):
                frames = [] if seed == arguments.seeds[0] and number == 0 else None
                successes += grasp(guide, structure, rng, frames)
                bar.set_description(f"seed {seed}: {successes} of {number + 1} grasped")
                bar.update()
                if frames:
                    titles = ["seen", *(f"{FIRST_FACTOR}", *(f"{factor}" for factor in FACTORS)), "closed", "lifted"]
                    draw_images(arguments.out / "grasp.png", list(zip(*frames, strict=True)), titles[: len(frames)])
            lifted.append(successes)
    for seed, successes in zip(arguments.seeds, lifted, strict=True):
        rows.append(Row(f"{arguments.arm}: grasped of {arguments.tries}", None, float(successes), "", (seed,)))
    share = float(np.mean(lifted)) / arguments.tries
    rows.append(Row(f"{arguments.arm}: share grasped", None, share, "", tuple(arguments.seeds)))
    rows.append(Row("error of the learned arm, worst", None, float(np.max(fit)), "px", tuple(arguments.seeds)))
    return rows


def grasp(guide: Any, structure: np.ndarray, rng: np.random.Generator, frames: list | None = None) -> bool:
    """One try with the block in a new place; whether it hangs in the gripper at the end, by the truth."""
    from dense_vs.sims.papers.gothoskar.figures import close_up
    from dense_vs.sims.papers.gothoskar.guided_motion import approach, average_sight, joints_for, stand_off
    from dense_vs.sims.workcell.cell import PART_MARKERS

    cell = guide.cell
    cell.reset()
    cell.place_part(np.array([0.5, 0.03]) + rng.uniform([-0.07, -0.1], [0.07, 0.1]), rng.uniform(-0.5, 0.5))
    before = cell.true_part_position()

    def shoot() -> None:
        if frames is not None:
            frames.append(close_up(cell.images(), pixels))

    try:
        pixels = average_sight(cell, PART_MARKERS, 3)
        shoot()
        hand = guide.model.parameters.features
        now = guide.joints_now()
        above = joints_for(guide, stand_off(hand, structure, FIRST_FACTOR), pixels, now)
        now = approach(guide, above, FIRST_ATTEMPTS, now=now)
        shoot()
        for factor in FACTORS:
            goal = joints_for(guide, stand_off(hand, structure, factor), pixels, now)
            now = approach(guide, goal, 1, now=now)
            shoot()
        cell.close_gripper()
        shoot()
        cell.command(above - now)
        shoot()
    except DenseVSError:  # something needed was not seen
        return False
    return is_grasped(cell.true_part_position() - before, cell.true_part_in_hand())


def is_grasped(raised: np.ndarray, in_hand: np.ndarray) -> bool:
    """Whether a block moved by ``raised`` (3,) [m], now ``in_hand`` (3,) [m] from the fingers' middle, hangs there."""
    return bool(raised[2] > LIFTED and np.linalg.norm(in_hand) < LIFTED)
