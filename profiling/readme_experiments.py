"""The README's lines on arms and objects, from the committed results of experiments and profiling scripts."""

import json
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"
NORMAL, UNIFORM = {"postures": "normal"}, {"postures": "uniform"}
BOUND = "what a perfect fit to those would have (Cramer-Rao)"

# Text, experiment, name of its row, and what it was told.
EXPERIMENTS = (
    ("arm learnt from 50 images, error on other postures [px]", "few-samples", "50 samples: mean", NORMAL),
    ("worst of 24 arms and seeds", "few-samples", "50 samples: worst", NORMAL),
    ("20 images", "few-samples", "20 samples: mean", NORMAL),
    ("15 images, joints anywhere within 1 rad", "few-samples", "15 samples: mean", UNIFORM),
    ("10 images, the same", "few-samples", "10 samples: mean", UNIFORM),
    (BOUND, "few-samples", "10 samples: bound (Cramer-Rao), mean", UNIFORM),
    ("50 images, joint readings off by 0.02 rad", "noisy-states", "0.02 rad, noise modelled: mean", {}),
    (BOUND, "noisy-states", "0.02 rad, noise modelled: bound (Cramer-Rao), mean", {}),
    ("grasps with an inaccurate arm, of 20", "grasp", "baxter: grasped of 20", {}),
    ("pegs inserted with 1 mm clearance, of 20", "insertion", "baxter: inserted of 20", {}),
    ("J+ of 7 configurations learnt by (11)", "learn", "converged of 7, (11)", {}),
    ("by Broyden's original update", "learn", "converged of 7, original Broyden", {}),
    ("objects centred (VS), of 24", "trial", "VS of 24 (ClickBot 2023: 24)", {}),
    ("depth good enough to grasp (DE), of 24", "trial", "DE of 24 (ClickBot 2023: 16)", {}),
    ("depth error, median [%]", "trial", "depth error, median, against the outline's depth", {}),
    ("objects in the bin, of 22 that fit the gripper", "pick-place", "in the bin, of 22 that fit the gripper", {}),
    ("grasp check right [%]", "pick-place", "grasp check right", {}),
)
PREFIX = {"few-samples": "validation error, ", "noisy-states": "test error, "}


def experiment_lines() -> list[str]:
    """The table: the paper's figure, ours (one a seed, or over all seeds of a run)."""
    runs = json.loads((RESULTS / "experiments.json").read_text(encoding="utf-8"))["runs"]
    lines = ["| | paper | ours |", "|---|---|---|"]
    for text, experiment, name, told in EXPERIMENTS:
        whole = PREFIX.get(experiment, "") + name
        rows = [row for run in runs if _is_of(run, experiment, told) for row in run["rows"] if row["name"] == whole]
        paper = "" if rows[0]["paper"] is None else f"{rows[0]['paper']:.3g}"
        lines.append(f"| {text} | {paper} | {', '.join(_three_digits(row['ours']) for row in rows)} |")
    return lines


def summary_lines(masks: dict[str, float], reducers: dict[str, float], arms: dict[str, float]) -> list[str]:
    """A paragraph on masks and times, from the values by name of three result files."""
    halves = [f"real, learnt from {half}" for half in ("even", "odd")]
    real = sum(masks[f"{half}: mean IoU"] for half in halves) / 2
    least = min(masks[f"{half}: least mean IoU of an object"] for half in halves)
    calls, steps = (arms[f"times as fast as PyTorch's 3 x 200 {unit}"] for unit in ("calls", "steps"))
    return [
        f"Few-shot masks have IoU {real:.2f} on the hand-drawn masks of VOS-VS, learnt from 5 images and asked about 5 "
        f"others (worst object {least:.2f}), and {masks['simulated: mean IoU']:.2f} on simulated images "
        "(`profiling/segmentation.py`). The figures of a 640x480 mask take "
        f"{reducers['mask, object [ms]']:.2f} ms (`profiling/reducers.py`). An arm is learnt from 50 images in "
        f"{arms['learn T = 50']:.2f} s, {calls:.0f} times as fast as three stages of 200 calls of PyTorch's L-BFGS, "
        f"which reach the same error, and {steps:.0f} times as fast as 200 of its steps, which do not; the joints of "
        f"an image take {arms['joints of an image']:.1f} ms (`profiling/generative.py`).",
    ]


def _is_of(run: dict[str, Any], experiment: str, told: dict[str, str]) -> bool:
    return run["experiment"] == experiment and all(run["arguments"][key] == value for key, value in told.items())


def _three_digits(value: float) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:.3g}"
