"""The surfaces' table in Markdown: from a run, or from the committed results for the page on performance."""

import json
import math
from collections.abc import Sequence
from typing import Any

from results_file import RESULTS, origin, present, seeds_in_words
from surface_scores import ASTRAY_PX, OURS, REACHED_PX, Tally, ViewScore, mean_of, over_seeds, view_score

from dense_vs.jacobian.options import JacobianOptions

OTHER_CAMERAS = "surfaces_other_cameras"
# 4 joints after 10 s, 7 joints after 20 s, and the first on other arms and before other cameras
FILES = ("surfaces", "surfaces_7", "surfaces_other_arms", OTHER_CAMERAS)
ARMS = {
    "surfaces_other_arms": "Commercial arms that no constant was tuned on (with other seeds of the GR1, the search for "
    "the delay of joint readings was mended)",
    OTHER_CAMERAS: "Commercial arms before other cameras, two behind the robot, where its trunk hides some of its arm "
    "(with other seeds before these, the search for the delay of joint readings was mended)",
}
STOPPED = "the run was stopped early; what it had not come to, more often long ways as of lost points, is left out"
HEAD = (
    "arm, camera",
    "images",
    "J error (90 %)",
    "exact flow",
    "label IoU",
    f"below {REACHED_PX:g} px",
    "said reached",
    "wrongly",
    "lost",
    "missed",
    "astray, not said",
)
LEGEND = (
    "In the tables of arms that follow:",
    "",
    "- J error: median over the robot's pixels, in parentheses what nine in ten stay below; means over the seeds.",
    "- exact flow: J error of the filter alone, without a body model, from the true flow and the true joint positions; "
    "in realistic images that flow has the camera's sway in it. A dash where it was left out.",
    "- label IoU: of the labels with the true robot.",
    f"- below {REACHED_PX:g} px: of the reaches that were asked for, those that end so near the target by the truth, "
    "whatever the loop says.",
    "- said reached, lost, missed (out of frames): how the loop itself ended the reach.",
    f"- wrongly: of those said reached, the ones more than {REACHED_PX:g} px off by the truth.",
    f"- astray, not said: not called lost, though the tracked point was more than {ASTRAY_PX:g} px from the true one.",
    "- failed: views (an arm before a camera with a seed) which ended in an error; their reaches count as asked for.",
)


def table_lines(views: Sequence[ViewScore]) -> list[str]:
    """A line for each arm and camera, seeds together, then the means over the commercial arms."""
    lines = [f"| {' | '.join(HEAD)} |", "|" + "---|" * len(HEAD)]
    for images in sorted({view.images for view in views}):
        some = [view for view in views if view.images == images]
        for (arm, camera, _), group in sorted(over_seeds(some).items(), key=lambda item: (item[0][0] in OURS, item[0])):
            lines.append(_line(f"{arm} {camera}".strip(), images, group))
        arms = [view for view in some if view.arm not in OURS]
        if arms:
            lines.append(_line("**all commercial arms**", images, arms))
    return lines


def _line(name: str, images: str, views: Sequence[ViewScore]) -> str:
    tally = Tally.of(views)
    failed = [view for view in views if view.failure]
    cells = [
        name + (f" ({len(failed)} of {len(views)} failed)" if failed else ""),
        images,
        f"{_figure(mean_of(views, 'j_median'))} ({_figure(mean_of(views, 'j_p90'))})",
        _figure(mean_of(views, "exact_median")),
        _figure(mean_of(views, "overlap")),
        f"{tally.good} of {tally.asked}" if tally.asked else "-",
        *(str(count) if tally.asked else "-" for count in (tally.said, tally.wrong, tally.lost, tally.missed)),
        str(tally.unsaid) if tally.asked else "-",
    ]
    return f"| {' | '.join(cells)} |"


def _figure(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"


def committed(name: str) -> dict[str, Any] | None:
    """A committed result; none where there is none and the tables may do without."""
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if present(name, file.is_file()) else None


def surface_lines() -> list[str]:
    """The part of the page on performance."""
    lines = []
    for name in FILES:
        content = committed(name)
        if content is None:
            continue
        views, told = list(map(view_score, content["rows"])), content["arguments"]
        arms = ARMS.get(name, "Commercial arms as they come and our own")
        order = JacobianOptions(height=240, width=320, joints=told["joints"]).order
        lines += [
            f"{arms}, first {told['joints']} joints, J of order {order}, {told['seconds']:g} s of babbling, targets "
            f"over the whole range, {seeds_in_words(told['seeds'])} (`profiling/surfaces.py`; {origin(content)})"
            + ("" if all(view.ended for view in views) else f"; {STOPPED}")
            + ":",
            "",
            *table_lines([view for view in views if view.learned or view.failure]),
            "",
        ]
    return [*LEGEND, "", *lines] if lines else []


def few_surface_lines() -> list[str]:
    """Rows of the README: J, reaches and what is said of them over all commercial arms, clean and realistic; the same
    of realistic images of other cameras.
    """
    content = committed(FILES[0])
    if content is None:
        return []
    views = [view_score(row) for row in content["rows"] if row["arm"] not in OURS]
    errors, reaches, said = [], [], []
    for images in ("clean", "realistic"):
        some = [view for view in views if view.images == images and (view.learned or view.failure)]
        tally = Tally.of(some)
        errors.append(_figure(mean_of(some, "j_median")))
        reaches.append(f"{tally.good} of {tally.asked}")
        said.append(f"{tally.said} ({tally.wrong})")
    arms = len({view.arm for view in views})
    early = "" if all(view.ended for view in views) else ", of those made until the run was stopped"
    return [
        f"| J error on {arms} commercial arms as they come, clean / realistic images | {' / '.join(errors)} |",
        f"| their reaches within {REACHED_PX:g} px over the whole range{early} | {' / '.join(reaches)} |",
        f"| said to be there (of these wrongly) | {' / '.join(said)} |",
        *_few_other_camera_lines(),
    ]


def _few_other_camera_lines() -> list[str]:
    content = committed(OTHER_CAMERAS)
    if content is None:
        return []
    views = [view_score(row) for row in content["rows"] if row["images"] == "realistic"]
    known = [view for view in views if view.learned or view.failure]
    tally, arms = Tally.of(known), len({view.arm for view in known})
    cameras = len({view.camera for view in known})
    return [
        f"| {arms} arms before {cameras} other cameras, realistic images: J error; reaches within "
        f"{REACHED_PX:g} px; said to be there (wrongly) | {_figure(mean_of(known, 'j_median'))}; {tally.good} of "
        f"{tally.asked}; {tally.said} ({tally.wrong}) |"
    ]
