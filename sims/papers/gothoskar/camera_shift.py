"""Table 7: the norm of the gradients as a buffer of 50 fills with observations made after a camera was shifted.

Gradients of the loss, Gothoskar (6), by all parameters; their size is a matter of units and of the shift, which the
paper does not give, so compare how they grow. Before the shift the buffer holds samples that were not learned from:
those that were give no gradient at the minimum. Beyond the table: after how many samples the camera is named, and false
alarms.
"""

import argparse

import numpy as np

from dense_vs.checks import check_whole
from dense_vs.sims.papers.gothoskar.arm_trials import add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

PAPER = (40.618, 945.384, 1788.127, 2666.490, 3404.664, 4287.491, 5127.693, 5930.182, 6762.114, 7630.604, 8403.353)
BUFFER = 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument(
        "--meters", type=float, default=0.02, metavar="M", help="shift of the camera [m] (default: 0.02)"
    )
    parser.add_argument(
        "--radians", type=float, default=0.02, metavar="R", help="turn of the camera [rad] (default: 0.02)"
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dataclasses import replace

    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.evidence import draw_joints, observe

    check_whole("--cameras", arguments.cameras, least=2)  # so that one can stay
    runs = trials(arguments)
    norms = np.zeros((len(runs), len(PAPER)))
    named = np.full(len(runs), np.inf)
    false_alarms = wrong = 0
    with progress("models", len(runs), "model") as bar:
        for r, trial in enumerate(runs):
            arm, rng = trial.observed_arm(), trial.rng(7)
            before = trial.evidence(BUFFER).observations
            model = GenerativeModel.fit(before, seed=trial.seed)
            shifted = int(rng.integers(len(arm.cameras)))
            cameras = list(arm.cameras)
            cameras[shifted] = cameras[shifted].shifted(rng, arguments.meters, arguments.radians)
            moved = replace(arm, cameras=tuple(cameras))
            steady = observe(arm, draw_joints(arm, BUFFER, rng, trial.postures), rng).observations
            after = observe(moved, draw_joints(moved, len(PAPER) - 1, rng, trial.postures), rng).observations
            online = model.online(capacity=BUFFER)
            for joints, pixels in zip(steady.joints, steady.pixels, strict=True):
                change = online.add(joints, pixels)
                false_alarms += bool(change.moved_cameras) or change.everything_moved
            norms[r, 0] = change.gradient_norm
            for s, (joints, pixels) in enumerate(zip(after.joints, after.pixels, strict=True)):
                change = online.add(joints, pixels)
                norms[r, s + 1] = change.gradient_norm
                wrong += any(camera != shifted for camera in change.moved_cameras)
                if shifted in change.moved_cameras:
                    named[r] = min(named[r], s + 1)
            bar.update()
    seeds = tuple(arguments.seeds)
    rows = []
    for s, paper in enumerate(PAPER):
        rows.append(Row(f"{BUFFER - s}/{s}: gradient norm", paper, float(np.mean(norms[:, s])), "", seeds))
    rows += [
        Row("samples until the shifted camera is named, median", None, float(np.median(named)), "", seeds),
        Row("samples until the shifted camera is named, worst", None, float(np.max(named)), "", seeds),
        Row(f"alarms in {len(runs) * BUFFER} samples before any shift", None, float(false_alarms), "", seeds),
        Row(f"other cameras named in {len(runs) * (len(PAPER) - 1)} samples after it", None, float(wrong), "", seeds),
    ]
    draw_lines(
        arguments.out / "camera_shift.png",
        {"ours": (range(len(PAPER)), norms)},
        title=f"A camera shifted by {arguments.meters:g} m and {arguments.radians:g} rad (Table 7)",
        x_label=f"samples after the shift, of {BUFFER} in the buffer",
        y_label="norm of the gradients",
        paper={"paper": (range(len(PAPER)), PAPER)},
    )
    return rows
