"""Lines of the table about what is hidden, from the result of ``profiling/hidden_points.py``."""

import numpy as np
from hidden_scores import LEAST_OVERLAP, MOST_RATIO, THERE_PX, CoveredScore, HiddenReach
from results_file import Result, seeds_in_words


def hidden_lines() -> list[str]:
    """The table of the page on performance."""
    result = Result("hidden_points")
    arguments = result.content["arguments"]
    covered = [CoveredScore(**row) for row in result.content["covered"]]
    reaches = [HiddenReach(**row) for row in result.content["reaches"]]
    unseen, said = (sum(getattr(reach, name) for reach in reaches) for name in ("unseen_frames", "said_frames"))
    rows = [
        (
            f"a plate before the robot for 3 s: J error right after it has gone to that before (goal: {MOST_RATIO})",
            ", ".join(f"{row.ratio:.2f}" for row in covered),
        ),
        (
            "the same to that of a twin at that moment, before which nothing was: J's error goes with the posture",
            ", ".join(f"{row.ratio_without:.2f}" for row in covered),
        ),
        (
            f"least label IoU meanwhile / of what is hidden / right after (goal: {LEAST_OVERLAP})",
            " / ".join(
                f"{min(getattr(row, name) for row in covered):.2f}"
                for name in ("overlap_meanwhile", "covered_overlap", "overlap_after")
            ),
        ),
    ]
    for where, text in (("behind", "behind a plate and back"), ("outside", "out of the image and back")):
        some = [reach for reach in reaches if reach.where == where]
        rows.append(
            (
                f"pairs of reaches {text} that end below {THERE_PX:g} px, by the truth (goal: 18 of 20)",
                f"{sum(reach.good for reach in some)} of {len(some)}; "
                f"{sum(reach.end == 'reached' for reach in some)} said *reached*, "
                f"{sum(reach.wrong for reach in some)} wrongly",
            )
        )
    off = [reach.true_px for reach in reaches], [reach.away_px for reach in reaches]
    rows += [
        (
            "how far off they end, back in sight / where the point is not seen: median (worst) [px]",
            " / ".join(f"{np.median(px):.1f} ({max(px):.1f})" for px in off),
        ),
        ("frames in which the point was not seen, and said so", f"{said} of {unseen}"),
    ]
    return [
        "What is hidden, on our arm after 10 s of babbling, clean images, seeds that nothing was tuned on "
        f"(`profiling/hidden_points.py`; {seeds_in_words(arguments['seeds'])}, {result.origin()}):",
        "",
        "| | |",
        "|---|---|",
        *(f"| {name} | {value} |" for name, value in rows),
    ]
