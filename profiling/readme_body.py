"""Lines of the table about body models, from the result of ``profiling/body_model.py``."""

from body_scores import BodyScore, Summary, summary
from results_file import Result, seeds_in_words

GOALS = {  # of our own arms, of commercial ones
    "points_median": (1.5, 2.5),
    "points_p90": (5.0, 8.0),
    "stays_p90": (5.0, 8.0),
    "jacobian_median": (0.10, 0.15),
    "depth": (0.08, None),
    "link_share": (0.95, None),
    "point_link_share": (0.95, None),
    "predict_ms": (5.0, 5.0),
}
ROWS = (
    ("points_median", "surface points at postures not seen, off by [px]", "{:.2f}"),
    ("known_share", "share of them that the model knows", "{:.2f}"),
    ("known_p90", "nine in ten of these are off by at most [px]", "{:.1f}"),
    ("stays_p90", "nine in ten of all are, where others stay", "{:.1f}"),
    ("points_p90", "nine in ten of all are, where others are infinitely far off", "{:.1f}"),
    ("jacobian_median", "J error, all of the robot's pixels, no image", "{:.3f}"),
    ("overlap", "label IoU", "{:.2f}"),
    ("depth", "depth, one scale for all", "{:.1%}"),
    ("link_share", "tracks on the right link", "{:.2f}"),
    ("point_link_share", "of those that stay within 1 px of the surface point at which they began", "{:.2f}"),
    ("fit_cpu_seconds", "a fit, time of one core [s]", "{:.1f}"),
    ("predict_ms", "J of the whole image [ms]", "{:.1f}"),
)


def body_lines() -> list[str]:
    """The table of the page on performance."""
    result = Result("body_model")
    arguments = result.content["arguments"]
    scores = [BodyScore.of_row(row) for row in result.content["rows"]]
    columns = [
        (f"{whose}, {images}", place, summary(scores, place == 0, images))
        for place, whose in enumerate(("our arms", "commercial arms"))
        for images in ("clean", "realistic")
    ]
    rows = [[text, *(_cell(field, place, bodies, form) for _, place, bodies in columns)] for field, text, form in ROWS]
    rows.insert(0, ["bodies found", *(f"{bodies.found} of {bodies.count}" for *_, bodies in columns)])
    return [
        f"Body models from {arguments['seconds']:g} s of babbling, asked at postures that they have not seen: medians "
        "of all bodies (of an even number the worse of the two in the middle; in parentheses the worst), and how many "
        "keep to the goal. What a model takes for the background it predicts "
        "to stay where it is, so its J is 1 off there; of the points there it says that it does not know them, so they "
        "count as infinitely far off unless it is said otherwise "
        f"(`profiling/body_model.py`; {seeds_in_words(arguments['seeds'])}, which nothing was tuned on, "
        f"{arguments['joints']} joints of commercial arms, {result.origin()})"
        + (":" if result.content["finished"] else "; the run was stopped early, and has not come to all:"),
        "",
        f"| | {' | '.join(head for head, *_ in columns)} |",
        "|---" * (len(columns) + 1) + "|",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        time_line(),
    ]


def time_line() -> str:
    """How long fits take by the clock, with all cores of the machine."""
    result = Result("body_fit_time")
    scores = [BodyScore.of_row(row) for row in result.content["rows"]]
    bodies, longest = Summary(scores), max(scores, key=lambda score: score.fit_seconds)
    seconds = result.content["arguments"]["seconds"]
    return (
        f"A fit of {seconds:g} s of video takes {bodies.middle('fit_seconds'):.1f} s by the clock, tracks and surface "
        f"included (median of {bodies.count} arms; the longest {longest.fit_seconds:.1f} s, {longest.name}; goal: "
        f"10 s; `profiling/body_model.py`; {result.origin()})."
    )


def few_body_lines() -> list[str]:
    """The row of the README."""
    scores = [BodyScore.of_row(row) for row in Result("body_model").content["rows"]]
    clean, realistic = (summary(scores, False, images) for images in ("clean", "realistic"))
    places, errors = (
        " / ".join(form.format(bodies.middle(field)) for bodies in (clean, realistic))
        for field, form in (("points_median", "{:.1f}"), ("jacobian_median", "{:.2f}"))
    )
    return [
        "| a body learned from 20 s of video, asked at postures that it has not seen, clean / realistic images: "
        f"surface points off by [px]; J error without an image | {places}; {errors} |"
    ]


def _cell(field: str, place: int, bodies: Summary, form: str) -> str:
    words = f"{form.format(bodies.middle(field))} ({form.format(bodies.worst(field))})"
    goal = GOALS.get(field, (None, None))[place]
    if goal is None:
        return words
    limit = f"{goal:.0%}" if "%" in form else f"{goal:g}"
    return f"{words}; {bodies.holding(field, goal)} of {bodies.count} keep to {limit}"
