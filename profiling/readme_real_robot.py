"""Lines of the tables about the real humanoid, from ``profiling/results/real_robot.json``."""

from results_file import Result

SETS = ("tuned", "confirmed")
SHARES = (
    ("arm", "motion explained one frame ahead, E (goal: 0.85)"),
    ("arm, its own pixels", "E on the arm's own pixels, by our labels"),
    ("arm, without sway", "E without the camera's sway"),
    ("sway taken out of J, without sway", "the same with `--sway`"),
    ("sway taken out of J", "E of the whole motion with `--sway`"),
    ("arm and hand", "E with the hand's 6 joints too"),
    ("all 26 joints", "E with all 26 joints"),
    ("flow dis", "E with flow `dis`"),
    ("joints not smoothed", "E without smoothing of the joints"),
    ("log as stamped", "E with the clocks as stamped"),
    ("arm, from the first image", "E of the whole episode, from nothing"),
    ("arm, its own pixels, from the first image", "the same on the arm's own pixels"),
    (
        "arm, model of the other five, no update",
        "E of the whole episode, J remembered by posture from the other five, no update (goal: 0.7)",
    ),
    ("arm, its own pixels, model of the other five, no update", "the same on the arm's own pixels"),
    ("arm, model of the other five, with updates", "E of the whole episode, that with updates (goal: 0.85)"),
    ("arm, its own pixels, model of the other five, with updates", "the same on the arm's own pixels"),
    ("first quarter, from nothing", "E, first quarter, from nothing"),
    ("first quarter, from the other five", "E, first quarter, from the other five (goal: 0.6)"),
    (
        "first quarter, model of the other five, with updates",
        "E, first quarter, J remembered from the other five, with updates",
    ),
)


def real_robot_lines() -> list[str]:
    """The table of the page on performance."""
    result = Result("real_robot")
    lines = [
        "A real humanoid's right arm before its own camera, six episodes of a public data set; settings were tuned on "
        "three (labels on four) and confirmed on the others. E is judged by a flow of its own; goals "
        "are what was aimed at beforehand "
        "(`profiling/real_robot.py`; "
        f"{result.origin()}):",
        "",
        "| | tuned | confirmed |",
        "|---|---|---|",
    ]
    for name, text in SHARES:
        if result.has(f"E, {name}, {SETS[0]}"):
            lines.append(f"| {text} | " + " | ".join(f"{result[f'E, {name}, {kind}']:.3f}" for kind in SETS) + " |")
    for score, text in (("IoU", "IoU of the labels with masks drawn by hand (goal: 0.75)"), ("recall", "recall")):
        lines.append(f"| {text} | " + " | ".join(_labels(result, score, kind) for kind in SETS) + " |")
    points = [name for name in result.values if name.startswith("point of the hand")]
    medians = [result[name] for name in points if name.endswith("median error")]
    worst = [result[name] for name in points if name.endswith("worst error not flagged")]
    return [
        *lines,
        "",
        f"A log shifted by 200 ms is found within {result['offset, worst miss of a shift by 200 ms']:.0f} ms. "
        f"{len(medians)} points of the hand are followed for about 100 frames with a median error of "
        f"{', '.join(f'{value:.1f}' for value in medians)} px at 640x480 against marks by hand; worst where not "
        f"flagged as lost {max(worst):.1f} px.",
    ]


def few_real_robot_lines() -> list[str]:
    """Rows for the README."""
    result = Result("real_robot")
    shares = (result[f"E, {name}, confirmed"] for name in ("arm", "arm, its own pixels"))
    return [
        "| a real humanoid's arm, episodes that J was not tuned on: motion explained a frame ahead, all of the "
        f"image / the arm's pixels | {' / '.join(f'{share:.2f}' for share in shares)} |",
        f"| its labels, IoU with masks drawn by hand | {_labels(result, 'IoU', 'confirmed')} |",
    ]


def _labels(result: Result, score: str, kind: str) -> str:
    value, frames = next(
        (value, name.split(", ")[2])
        for name, value in result.values.items()
        if name.startswith(f"labels, {score}, ") and name.endswith(kind)
    )
    return f"{value:.2f} ({frames})"
