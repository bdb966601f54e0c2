"""Table 8: joint readings with noise of 0.01 to 0.03 rad, learnt with and without a model of that noise.

Noise law: every reading is off by N(0, sigma) in every joint, independently. Training on noisy readings; test postures
are exact, as in the paper. Lambda is the variance of the pixels over that of the joints, both estimated by the fit.
How large an arm is in its images decides how many pixels a radian is: so the error that the readings alone would make
with a perfect model stands beside, and the Cramer-Rao bound, the error of a perfect fit to the same samples.
"""

import argparse

import numpy as np

from dense_vs.cli.output import progress
from dense_vs.sims.experiments.generative.chart import draw_lines
from dense_vs.sims.experiments.generative.protocol import (
    TEST_SAMPLES,
    add_protocol_arguments,
    bound_rows,
    held_out_error,
    reading_error,
    spread_rows,
    trials,
)
from dense_vs.sims.experiments.rows import Row

HELP = "Table 8: noisy joint readings, with and without a model of the noise"
PAPER = {
    (0.01, "observed"): (1.715, 0.086),
    (0.01, "noisy"): (1.394, 0.109),
    (0.02, "observed"): (3.393, 0.211),
    (0.02, "noisy"): (2.298, 0.274),
    (0.03, "observed"): (6.077, 0.453),
    (0.03, "noisy"): (4.434, 0.635),
}
NAMES = {"observed": "noise not modelled", "noisy": "noise modelled"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, help="training samples (default: 50)")
    parser.add_argument(
        "--sigma", type=float, nargs="+", default=[0.01, 0.02, 0.03], metavar="RAD", help="default: 0.01 0.02 0.03"
    )
    add_protocol_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.generative.cramer_rao import cramer_rao

    runs = trials(arguments)
    errors = np.zeros((len(NAMES), len(runs), len(arguments.sigma)))
    raw = np.zeros((len(runs), len(arguments.sigma)))
    perfect: list[list[np.ndarray]] = [[] for _ in arguments.sigma]
    with progress("fits", errors.size, "fit") as bar:
        for r, trial in enumerate(runs):
            held_out = trial.evidence(TEST_SAMPLES, 1)
            for s, sigma in enumerate(arguments.sigma):
                noisy = trial.evidence(arguments.samples, 0, joint_noise=sigma)
                raw[r, s] = reading_error(held_out.truth, sigma, trial.rng(5))
                perfect[s].append(cramer_rao(noisy, held_out, trial.rng(4), state="noisy", sigma=sigma).noisy)
                for n, state in enumerate(NAMES):
                    model = GenerativeModel.fit(noisy.observations, state=state, seed=trial.seed)
                    errors[n, r, s] = held_out_error(model, held_out.observations)
                    bar.update()
    rows = []
    for s, sigma in enumerate(arguments.sigma):
        for n, (state, name) in enumerate(NAMES.items()):
            paper = PAPER.get((sigma, state), (None, None))
            rows += spread_rows(f"test error, {sigma:g} rad, {name}", paper, errors[n, :, s], "px", arguments.seeds)
        rows += bound_rows(f"test error, {sigma:g} rad, {NAMES['noisy']}", perfect[s], arguments.seeds)
        name = f"what readings {sigma:g} rad off are in pixels, mean"
        rows.append(Row(name, None, float(np.mean(raw[:, s])), "px", tuple(arguments.seeds)))
    draw_lines(
        arguments.out / "noisy_states.png",
        {name: (arguments.sigma, errors[n]) for n, name in enumerate(NAMES.values())}
        | {"perfect fit": (arguments.sigma, np.mean(perfect, axis=2).T)},
        title=f"{arguments.samples} samples with noisy joint readings (Table 8), {len(runs)} models",
        x_label="standard deviation of the readings [rad]",
        y_label="test error [px]",
        paper={f"paper, {name}": _published(state) for state, name in NAMES.items()},
        logarithmic=False,
    )
    return rows


def _published(state: str) -> tuple[list[float], list[float]]:
    cells = [(sigma, value[0]) for (sigma, of), value in PAPER.items() if of == state]
    return [sigma for sigma, _ in cells], [value for _, value in cells]
