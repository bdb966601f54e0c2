"""Lines on arms and objects, from the committed results of experiments and profiling scripts."""

from typing import Any

from results_file import Result, present, runs

NORMAL, UNIFORM = {"postures": "normal"}, {"postures": "uniform"}
GIVEN, NOT_GIVEN = ", lens tolerances given", ", lens tolerances not given"
REPEATABLE = {"independent": 0.0}  # errors that vanish by repeating
HARD, CLEAN = ({"method": "robust", "difficulty": difficulty} for difficulty in ("hard", "clean"))
VS, DE = "VS of 24 (ClickBot 2023: 24), J+ feature by feature", "DE of 24 (ClickBot 2023: 16), depth by robust"
VS_PRINTED, DE_PRINTED = "VS of 24, J+ by (11) as printed", "DE of 24, depth by (20) as printed"
DONE = "DE done: closed on it, of 24, depth by robust"
DONE_PRINTED = "DE done: closed on it, of 24, depth by (20) as printed"
DEPTH = "depth error by robust, median, against the outline's depth"
DEPTH_PRINTED = "depth error by (20) as printed, median"
BOUND = "Cramer-Rao bound of an unbiased fit to those images"

# Text, experiment, name of its row, and what it was told.
EXPERIMENTS = (
    (
        "arm learned from 50 images, lens tolerances given, error on other postures [px]",
        "few-samples",
        f"50 samples{GIVEN}: mean",
        NORMAL,
    ),
    ("the same, worst of 24 arms and seeds", "few-samples", f"50 samples{GIVEN}: worst", NORMAL),
    ("50 images without tolerances", "few-samples", f"50 samples{NOT_GIVEN}: mean", NORMAL),
    ("20 images, tolerances given", "few-samples", f"20 samples{GIVEN}: mean", NORMAL),
    ("the same without tolerances", "few-samples", f"20 samples{NOT_GIVEN}: mean", NORMAL),
    ("15 images, joints anywhere within 1 rad, tolerances given", "few-samples", f"15 samples{GIVEN}: mean", UNIFORM),
    ("the same without tolerances", "few-samples", f"15 samples{NOT_GIVEN}: mean", UNIFORM),
    ("10 images, joints anywhere within 1 rad, tolerances given", "few-samples", f"10 samples{GIVEN}: mean", UNIFORM),
    (BOUND, "few-samples", f"10 samples{GIVEN}: bound (Cramer-Rao), mean", UNIFORM),
    ("the same without tolerances", "few-samples", f"10 samples{NOT_GIVEN}: mean", UNIFORM),
    (BOUND, "few-samples", f"10 samples{NOT_GIVEN}: bound (Cramer-Rao), mean", UNIFORM),
    ("50 images, joint readings off by 0.02 rad", "noisy-states", "0.02 rad, noise modeled: mean", {}),
    (BOUND, "noisy-states", "0.02 rad, noise modeled: bound (Cramer-Rao), mean", {}),
    ("grasps with an inaccurate arm, of 20", "grasp", "baxter: grasped of 20", REPEATABLE),
    (
        "the same, every motion of a joint off by N(0, 0.01 rad)",
        "grasp",
        "baxter: grasped of 20",
        {"independent": 0.01},
    ),
    ("pegs inserted with 1 mm clearance, of 20", "insertion", "baxter: inserted of 20", REPEATABLE),
    (
        "the same, every motion of a joint off by N(0, 0.002 rad)",
        "insertion",
        "baxter: inserted of 20",
        {"independent": 0.002},
    ),
    (
        "J+ of 7 configurations learned by VOS-VS (11) as printed",
        "learn",
        "converged of 7, (11) as printed",
        {},
    ),
    (
        "the same with the denominator held away from zero",
        "learn",
        "converged of 7, (11), denominator guarded",
        {},
    ),
    (
        "the same by VOS-VS (11) a feature at a time, beyond the paper",
        "learn",
        "converged of 7, (11) a feature at a time",
        {},
    ),
    ("the same by Broyden's original update", "learn", "converged of 7, original Broyden", {}),
    ("hard trial: objects centered (VS), J+ of VOS-VS (11) a feature at a time, of 24", "trial", VS, HARD),
    ("the same with J+ of VOS-VS (11) as printed", "trial", VS_PRINTED, HARD),
    ("depth good enough to grasp (DE) by the robust fit, beyond the paper, of 24", "trial", DE, HARD),
    ("the same by VOS-VS (20) as printed", "trial", DE_PRINTED, HARD),
    ("DE done: the gripper closed on the object at that depth, of 24", "trial", DONE, HARD),
    ("the same by VOS-VS (20) as printed", "trial", DONE_PRINTED, HARD),
    ("depth error of the robust fit, median [%]", "trial", DEPTH, HARD),
    ("depth error of VOS-VS (20) as printed, median [%]", "trial", DEPTH_PRINTED, HARD),
    ("clean trial: objects centered (VS), J+ of VOS-VS (11) a feature at a time, of 24", "trial", VS, CLEAN),
    ("the same with J+ of VOS-VS (11) as printed", "trial", VS_PRINTED, CLEAN),
    ("depth good enough to grasp (DE) by the robust fit, beyond the paper, of 24", "trial", DE, CLEAN),
    ("the same by VOS-VS (20) as printed", "trial", DE_PRINTED, CLEAN),
    ("DE done: the gripper closed on the object at that depth, of 24", "trial", DONE, CLEAN),
    ("the same by VOS-VS (20) as printed", "trial", DONE_PRINTED, CLEAN),
    ("depth error of the robust fit, median [%]", "trial", DEPTH, CLEAN),
    ("depth error of VOS-VS (20) as printed, median [%]", "trial", DEPTH_PRINTED, CLEAN),
    ("objects in the bin, of 22 that fit the gripper", "pick-place", "in the bin, of 22 that fit the gripper", {}),
    ("grasp check right [%]", "pick-place", "grasp check right", {}),
    ("own pixels with a person walking behind the arm: IoU", "leak", "default: IoU, median over time", {}),
    (
        "the same by DIJE's Algorithms 1 and 2 with DIJE (14)",
        "leak",
        "paper's algorithms, (14): IoU, median over time",
        {},
    ),
    ("share of the person taken for the robot", "leak", "default: leak, share of the walker", {}),
    ("the same by DIJE's algorithms", "leak", "paper's algorithms, (14): leak, share of the walker", {}),
)
# Few enough for the README, by their text above.
FEW = ("arm learned from 50 images, lens tolerances given, error on other postures [px]",)
PREFIX = {"few-samples": "validation error, ", "noisy-states": "test error, "}


def experiment_lines() -> list[str]:
    """The table: the paper's figure, ours (one a seed, or over all seeds of a run), date and commit."""
    lines = ["| | paper | ours | seeds | measured |", "|---|---|---|---|---|"]
    for text, experiment, name, told in EXPERIMENTS:
        found = _rows(experiment, name, told)
        if not present(f"{experiment}: {text}", bool(found)):
            continue
        rows = [row for _, row in found]
        paper = "" if rows[0]["paper"] is None else f"{rows[0]['paper']:.3g}"
        ours = ", ".join(_three_digits(row["ours"]) for row in rows)
        lines.append(f"| {text} | {paper} | {ours} | {_seeds(rows)} | {_measured(found[0][0])} |")
    return lines


def few_experiment_lines() -> list[str]:
    """Rows for the README: ours, and the paper's in parentheses."""
    lines = []
    for text, experiment, name, told in EXPERIMENTS:
        if text in FEW:
            row = _rows(experiment, name, told)[0][1]
            lines.append(f"| {text} (the paper's) | {_three_digits(row['ours'])} ({row['paper']:.3g}) |")
    return lines


def _rows(experiment: str, name: str, told: dict[str, Any]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Runs of an experiment that were told so, each with the row of that name."""
    whole = PREFIX.get(experiment, "") + name
    return [
        (run, row) for run in runs() if _is_of(run, experiment, told) for row in run["rows"] if row["name"] == whole
    ]


def _seeds(rows: list[dict[str, Any]]) -> str:
    seeds = sorted({seed for row in rows for seed in row["seeds"]})
    return str(seeds[0]) if len(seeds) == 1 else f"{seeds[0]}-{seeds[-1]}"


def _measured(run: dict[str, Any]) -> str:
    return f"{run['date'][:10]}, {(run['commit'] or 'no commit')[:10]}" if "date" in run else "not noted"


def summary_lines(masks: Result, reducers: Result, arms: Result) -> list[str]:
    """A paragraph on masks and times, from three results."""
    halves = [f"real, learned from {half}" for half in ("even", "odd")]
    real = sum(masks[f"{half}: mean IoU"] for half in halves) / 2
    least = min(masks[f"{half}: least mean IoU of an object"] for half in halves)
    calls, steps = (arms[f"times as fast as PyTorch's 3 x 200 {unit}"] for unit in ("calls", "steps"))
    return [
        f"Few-shot masks have IoU {real:.2f} on the hand-drawn masks of VOS-VS, learned from 5 images and asked about "
        f"5 others (worst object {least:.2f}), and {masks['simulated: mean IoU']:.2f} on simulated images "
        f"(`profiling/segmentation.py`; {masks.when()}). The figures of a 640x480 mask take "
        f"{reducers['mask, object [ms]']:.2f} ms (`profiling/reducers.py`; {reducers.when()}). "
        f"An arm is learned from 50 images in {arms['learn T = 50']:.2f} s, {calls:.0f} times as fast as three stages "
        "of 200 calls of PyTorch's L-BFGS, "
        f"which reach the same error, and {steps:.0f} times as fast as 200 of its steps, which do not; the joints of "
        f"an image take {arms['joints of an image']:.1f} ms (`profiling/generative.py`; {arms.when()}).",
    ]


def _is_of(run: dict[str, Any], experiment: str, told: dict[str, Any]) -> bool:
    arguments = {"difficulty": "clean", **(run.get("arguments") or {})}  # trials were no harder before
    return run["experiment"] == experiment and all(arguments.get(key) == value for key, value in told.items())


def _three_digits(value: float) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:.3g}"
