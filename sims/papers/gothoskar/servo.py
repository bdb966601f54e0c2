"""Fig. 8 and 9: pixel error against servo moves, the learned model against classical IBVS with the true Jacobian.

Classical IBVS is given the true kinematics, cameras and depths, and is shown at every gain asked for, as its speed is a
matter of gain. The model is given 50 samples. In Fig. 9 joint readings and actions have noise of --sigma, under both
laws of ``sims/marked_arm/noise.py``: independent on every move, as the paper, and proportional to the move.
"""

import argparse

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

LAWS = ("exact", "independent", "proportional")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="training samples (default: 50)")
    parser.add_argument("--targets", type=int, default=100, metavar="N", help="targets a seed and arm (default: 100)")
    parser.add_argument("--moves", type=int, default=30, metavar="N", help="servo moves (default: 30)")
    parser.add_argument(
        "--gains",
        type=float,
        nargs="+",
        default=[0.1, 0.2, 0.5, 0.8, 1.0],
        metavar="K",
        help="of IBVS (default: 0.1 0.2 0.5 0.8 1)",
    )
    parser.add_argument(
        "--sigma",
        type=float,
        default=0.02,
        metavar="RAD",
        help="noise of joint readings and actions in Fig. 9 [rad] (default: 0.02)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    runs = trials(arguments)
    errors: dict[str, dict[str, list[np.ndarray]]] = {law: {} for law in LAWS}
    with progress("servo runs", len(runs) * len(LAWS) * (1 + len(arguments.gains)), "run") as bar:
        for trial in runs:
            for law in LAWS:
                for label, curve in _curves(trial, law, arguments, bar):
                    errors[law].setdefault(label, []).append(curve)
    rows = []
    for law in LAWS:
        tables = {label: np.concatenate(curves) for label, curves in errors[law].items()}
        rows += _rows(law, tables, arguments)
        figure = "Fig. 8" if law == "exact" else "Fig. 9"
        noise = "exact joints" if law == "exact" else f"noise of {arguments.sigma:g} rad, {law}"
        draw_lines(
            arguments.out / f"servo_{law}.png",
            {label: (range(arguments.moves + 1), np.median(table, axis=0)[None]) for label, table in tables.items()},
            title=f"Median over {len(next(iter(tables.values())))} targets, {noise} ({figure})",
            x_label="servo moves",
            y_label="true pixel error [px]",
        )
    return rows


def _curves(trial: Trial, law: str, arguments: argparse.Namespace, bar) -> list[tuple[str, np.ndarray]]:
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.noise import NoisyController
    from dense_vs.sims.papers.gothoskar.servo_runs import joint_tasks, servo_ibvs, servo_model

    sigma = 0.0 if law == "exact" else arguments.sigma
    arm, rng = trial.observed_arm(), trial.rng(40 + LAWS.index(law))
    controller = NoisyController(sigma, "independent" if law == "exact" else law, rng)

    def read(joints: np.ndarray) -> np.ndarray:
        return joints + rng.normal(0.0, sigma, joints.shape)

    observations = trial.evidence(arguments.samples, 0, joint_noise=sigma).observations
    model = GenerativeModel.fit(observations, state="noisy" if sigma else "observed", seed=trial.seed)
    tasks = joint_tasks(arm, arguments.targets, rng, trial.postures)
    curves = [("model", servo_model(model, arm, tasks, arguments.moves, rng, controller, read))]
    bar.update()
    for gain in arguments.gains:
        curves.append((f"IBVS, gain {gain:g}", servo_ibvs(arm, tasks, arguments.moves, gain, rng, controller, read)))
        bar.update()
    return curves


def _rows(law: str, tables: dict[str, np.ndarray], arguments: argparse.Namespace) -> list[Row]:
    from dense_vs.sims.papers.gothoskar.servo_runs import moves_needed

    noise = law if law == "exact" else f"{law} noise {arguments.sigma:g}"
    seeds, rows = tuple(arguments.seeds), []
    for label, table in tables.items():
        needed = moves_needed(table)
        start = f"{noise}: {label}:"
        rows += [
            Row(f"{start} moves to below 1 px, median", None, float(np.median(needed)), "", seeds),
            Row(f"{start} share ever below 1 px", None, float(np.mean(np.isfinite(needed))), "", seeds),
            Row(f"{start} final error, median", None, float(np.median(table[:, -1])), "px", seeds),
        ]
    return rows
