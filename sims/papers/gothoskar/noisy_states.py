"""Table 8: joint readings with noise of 0.01 to 0.03 rad, learned with and without a model of that noise.

Noise law: every reading is off by N(0, sigma) in every joint, independently. Training on noisy readings; test postures
are exact, as in the paper. Lambda is the variance of the pixels over that of the joints, both estimated by the fit.
How many pixels a radian moves a feature depends on the arm's size in the images. So two more errors are given: that of
the readings alone with a perfect model, and the Cramer-Rao bound, the error of a perfect fit to the same samples.

Beyond the table, as the paper has it in words: readings of the hand's pose, off by N(0, sigma) in m and in rad.
"""

import argparse
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.gothoskar.scores import bound_rows, pixel_error, reading_error, spread_rows
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.sims.marked_arm.evidence import Evidence

PAPER = {
    (0.01, "observed"): (1.715, 0.086),
    (0.01, "noisy"): (1.394, 0.109),
    (0.02, "observed"): (3.393, 0.211),
    (0.02, "noisy"): (2.298, 0.274),
    (0.03, "observed"): (6.077, 0.453),
    (0.03, "noisy"): (4.434, 0.635),
}
READINGS = {"joint": "rad", "cartesian": "m and rad"}  # what is read of the state, in which unit
NAMES = {"observed": "noise not modeled", "noisy": "noise modeled"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="training samples (default: 50)")
    parser.add_argument(
        "--sigma",
        type=float,
        nargs="+",
        default=[0.01, 0.02, 0.03],
        metavar="RAD",
        help="noise of a joint reading [rad], of a hand's pose [m, rad] (default: 0.01 0.02 0.03)",
    )
    parser.add_argument(
        "--controller",
        nargs="+",
        default=list(READINGS),
        choices=list(READINGS),
        help="whose readings are learned from: joints or the hand's pose (default: both)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    runs = trials(arguments)
    shape = (len(NAMES), len(runs), len(arguments.sigma))
    rows: list[Row] = []
    with progress("fits", len(arguments.controller) * int(np.prod(shape)), "fit") as bar:
        for controller in arguments.controller:
            errors = np.zeros(shape)
            for r, trial in enumerate(runs):
                held_out = trial.evidence(TEST_SAMPLES, 1)
                for s, sigma in enumerate(arguments.sigma):
                    for n, state in enumerate(NAMES):
                        errors[n, r, s] = _error(trial, controller, state, sigma, arguments.samples, held_out)
                        bar.update()
            for s, sigma in enumerate(arguments.sigma):
                for n, (state, name) in enumerate(NAMES.items()):
                    paper = PAPER.get((sigma, state), (None, None)) if controller == "joint" else (None, None)
                    figure = f"test error, {sigma:g} {READINGS[controller]}, {name}"
                    rows += spread_rows(figure, paper, errors[n, :, s], "px", arguments.seeds)
            curves = {name: (arguments.sigma, errors[n]) for n, name in enumerate(NAMES.values())}
            published = {}
            if controller == "joint":
                perfect = _bounds(runs, arguments, rows)
                curves["perfect fit"] = (arguments.sigma, perfect)
                published = {f"paper, {name}": _published(state) for state, name in NAMES.items()}
            draw_lines(
                arguments.out / f"noisy_{controller}_readings.png",
                curves,
                title=f"{arguments.samples} samples with noisy {controller} readings (Table 8), {len(runs)} models",
                x_label=f"standard deviation of the readings [{READINGS[controller]}]",
                y_label="test error [px]",
                paper=published,
                logarithmic=False,
            )
    return rows


def _error(trial: Trial, controller: str, state: str, sigma: float, samples: int, held_out: "Evidence") -> float:
    """Error [px] on exact postures of a model learned from noisy readings."""
    from dense_vs.generative import GenerativeModel

    if controller == "joint":
        observations = trial.evidence(samples, joint_noise=sigma).observations
    else:
        observations = trial.evidence(samples, pose_noise=sigma).observations
    model = GenerativeModel.fit(observations, state=state, controller=controller, seed=trial.seed)
    exact = held_out.truth.joints if controller == "joint" else held_out.truth.poses
    return pixel_error(model.pixels(exact), held_out.observations.pixels)


def _bounds(runs: list[Trial], arguments: argparse.Namespace, rows: list[Row]) -> np.ndarray:
    """Mean errors (runs, sigmas) [px] of perfect fits to the same samples; adds rows of them and of raw readings."""
    from dense_vs.sims.marked_arm.cramer_rao import cramer_rao

    errors = np.zeros((len(runs), len(arguments.sigma)))
    for s, sigma in enumerate(arguments.sigma):
        raw = []
        for r, trial in enumerate(runs):
            held_out = trial.evidence(TEST_SAMPLES, 1)
            noisy = trial.evidence(arguments.samples, 0, joint_noise=sigma)
            errors[r, s] = np.mean(cramer_rao(noisy, held_out, trial.rng(4), state="noisy", sigma=sigma).noisy)
            raw.append(reading_error(held_out.truth, sigma, trial.rng(5)))
        rows += bound_rows(f"test error, {sigma:g} rad, {NAMES['noisy']}", errors[:, s], arguments.seeds)
        name = f"what readings {sigma:g} rad off are in pixels, mean"
        rows.append(Row(name, None, float(np.mean(raw)), "px", tuple(arguments.seeds)))
    return errors


def _published(state: str) -> tuple[list[float], list[float]]:
    cells = [(sigma, value[0]) for (sigma, of), value in PAPER.items() if of == state]
    return [sigma for sigma, _ in cells], [value for _, value in cells]
