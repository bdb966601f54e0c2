"""Speed of the generative model on one core: learning against the paper's three stages in PyTorch, inference, Jacobian.

    python profiling/generative.py [--rounds 3] [--json FILE]

T = 50 samples of a 6-joint arm, 2 cameras, 12 features, as in the paper's Table 3; each round has an arm of its own.
Learning is timed in seconds of the one core (CPU time), which other work on the machine hardly changes. PyTorch gets
the published 200 iterations a stage in both readings, as quasi-Newton steps and as calls of its optimizer's ``step``;
after the former it goes on until it is as good as ours or its time is up.
"""

import argparse
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

# Before NumPy loads its library: one core means one core.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import numpy as np
from metrics import Metric, add_report_arguments, report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "reference"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from arm_recordings import record

from dense_vs.generative import GenerativeModel
from dense_vs.generative.learning.end_to_end import all_shared
from dense_vs.generative.least_squares.pixel_problem import PixelProblem, PixelState
from dense_vs.generative.reconstruction.initialization import guessed_intrinsics
from dense_vs.generative.reconstruction.stereo import reconstruct

SAME = 1.02  # times our error that counts as the same


def median_ms(function, calls: int) -> float:
    """Median wall time of a call [ms]."""
    times = []
    for call in range(calls + 3):
        start = time.perf_counter()
        function(call)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times[3:]))


def _median(peers: list, name: str) -> float:
    return float(np.median([getattr(peer, name) for peer in peers]))


def _ratio(peers: list, name: str, ours: list[float]) -> float:
    """Median over rounds of their time over ours."""
    return float(np.median([getattr(peer, name) / own for peer, own in zip(peers, ours, strict=True)]))


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="arms learned by both (default: 3)")
    parser.add_argument("--patience", type=float, default=20.0, help="CPU seconds of PyTorch an arm (default: 20)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    import torch
    from peer_torch_generative import CALLS, STEPS
    from peer_torch_generative import fit as fit_with_torch

    torch.set_num_threads(1)
    GenerativeModel.fit(record("ur5", 99).observations())  # loads the kernels
    ours, errors = [], []
    peers, patient = [], []
    for seed in range(arguments.rounds):
        case = record("ur5", seed)
        obs = case.observations()
        start = time.process_time()
        model = GenerativeModel.fit(obs)
        ours.append(time.process_time() - start)
        errors.append(model.report.mean_error_px)
        start = time.process_time()
        intrinsics = guessed_intrinsics(obs)
        found = next(reconstruct(obs.pixels, intrinsics, np.random.default_rng(seed)))
        before = time.process_time() - start
        goal = SAME * errors[-1]
        for budget, done in ((STEPS, peers), (CALLS, patient)):
            patience = arguments.patience if budget is STEPS else 0.0
            peer = fit_with_torch(case.joints, case.pixels, intrinsics, found, seed, budget, goal, patience)
            done.append(replace(peer, seconds=peer.seconds + before, seconds_to_goal=peer.seconds_to_goal + before))
        steps, calls = peers[-1], patient[-1]
        reached = "reached" if steps.reached_goal else "not reached"
        print(
            f"arm {seed}: ours {ours[-1]:.3f} s, {errors[-1]:.3f} px; PyTorch, 200 steps each {steps.seconds:.2f} s, "
            f"{steps.error_px:.3f} px, {goal:.3f} px {reached} after {steps.seconds_to_goal:.1f} s; 200 calls each "
            f"{calls.seconds:.1f} s, {calls.error_px:.3f} px",
            flush=True,
        )
    problem = PixelProblem(case.pixels, model.parameters.links, 6, all_shared(np.ones(2, dtype=bool)))
    state = PixelState(model.parameters, case.joints)
    problem.linearize(state)
    images, near = case.unseen_pixels, case.unseen_joints + 0.1
    count = len(images)
    metrics = [
        Metric("learn T = 50", float(np.median(ours)), "s", "lower", 0.3),
        Metric("learn T = 50, PyTorch, 3 x 200 steps", _median(peers, "seconds"), "s", "lower", 0.3),
        Metric("learn T = 50, PyTorch, 3 x 200 calls", _median(patient, "seconds"), "s", "lower", 0.3),
        Metric(
            "learn T = 50, PyTorch to the same error or as long as allowed",
            _median(peers, "seconds_to_goal"),
            "s",
            "lower",
            0.5,
        ),
        Metric("times as fast as PyTorch's 3 x 200 steps", _ratio(peers, "seconds", ours), "x", "higher", 0.3),
        Metric("times as fast as PyTorch's 3 x 200 calls", _ratio(patient, "seconds", ours), "x", "higher", 0.3),
        Metric(
            "times as fast as PyTorch to the same error, at least",
            _ratio(peers, "seconds_to_goal", ours),
            "x",
            "higher",
            0.5,
        ),
        Metric("training error, ours", float(np.mean(errors)), "px", "lower", 0.05),
        Metric("training error, PyTorch, 3 x 200 steps", _median(peers, "error_px"), "px", "lower", 0.5),
        Metric("training error, PyTorch, 3 x 200 calls", _median(patient, "error_px"), "px", "lower", 0.5),
        Metric("residual and Jacobian, T = 50", median_ms(lambda _: problem.kernel.evaluate(), 100), "ms", "lower"),
        Metric("normal equations, T = 50", median_ms(lambda _: problem.linearize(state), 100), "ms", "lower"),
        Metric("joints of an image", median_ms(lambda k: model.infer_joints(images[k % count]), 60), "ms", "lower"),
        Metric(
            "joints of an image, near known",
            median_ms(lambda k: model.infer_joints(images[k % count], near=near[k % count]), 60),
            "ms",
            "lower",
        ),
        Metric("joints of 30 images, each", median_ms(lambda _: model.infer_joints(images), 10) / count, "ms", "lower"),
        Metric("pose of an image", median_ms(lambda k: model.infer_poses(images[k % count]), 30), "ms", "lower"),
    ]
    raise SystemExit(report(metrics, arguments))


if __name__ == "__main__":
    main()
