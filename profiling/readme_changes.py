"""Lines of the table about what has changed since a body was learned, from ``profiling/body_changes.py``."""

from change_scores import ChangeScore, median_of
from results_file import Result, seeds_in_words

from dense_vs.body_model import ChangeKind

WORDS = {
    ChangeKind.NOTHING: "nothing",
    ChangeKind.JOINT: "one joint's zero, by 0.02 to 0.2 rad",
    ChangeKind.CAMERA: "the camera, by up to 5 cm and 0.08 rad",
    ChangeKind.JOINTS: "all joints' zeros, by 0.05 rad (standard deviation)",
    ChangeKind.UNKNOWN: "the body itself (mirrored)",
}


def change_lines() -> list[str]:
    """The table of the page on performance."""
    result = Result("body_changes")
    arguments = result.content["arguments"]
    every = [ChangeScore.of_row(row) for row in result.content["rows"]]
    scores = [score for score in every if not score.failure]
    images = list(dict.fromkeys(score.images for score in scores))
    bodies = len({score.body for score in scores})
    rows = [
        [words if k == 0 else "", one, *_cells([s for s in scores if (s.changed, s.images) == (kind, one)], kind)]
        for kind, words in WORDS.items()
        for k, one in enumerate(images)
    ]
    head = ["has changed", "images", "named rightly", "or among those said to look alike", "its error [rad]",
            "J error before", "after"]  # fmt: skip
    return [
        f"What has changed since a body was learned from {arguments['seconds']:g} s of babbling, by 5 s of another "
        f"babbling, {bodies} bodies of our arms and of commercial ones; medians (worst); J without an image, at "
        f"postures not seen (`profiling/body_changes.py`; {seeds_in_words(arguments['seeds'])}, which nothing was "
        f"tuned on, {arguments['joints']} joints of commercial arms, {result.origin()})"
        + (":" if result.content["finished"] else "; the run was stopped early, and has not come to all:"),
        "",
        f"| {' | '.join(head)} |",
        "|---" * len(head) + "|",
        *(f"| {' | '.join(row)} |" for row in rows),
        *(["", f"Runs in which no body was found: {len(every) - len(scores)}."] if len(scores) < len(every) else []),
    ]


def _cells(scores: list[ChangeScore], kind: ChangeKind) -> list[str]:
    if not scores:
        return ["-"] * 5
    named, among = (sum(getattr(score, field) for score in scores) for field in ("named", "among"))
    off = "-"
    if kind in (ChangeKind.JOINT, ChangeKind.JOINTS):
        off = f"{median_of(scores, 'offset_error'):.3f} ({max(score.offset_error for score in scores):.3f})"
    errors = (
        f"{median_of(scores, field):.3f} ({max(getattr(score, field) for score in scores):.3f})"
        for field in ("before", "after")
    )
    return [f"{named} of {len(scores)}", f"{among} of {len(scores)}", off, *errors]
