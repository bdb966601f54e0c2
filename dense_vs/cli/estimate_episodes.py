"""Episodes of one recording estimated side by side, each by a process of its own."""

import argparse
from pathlib import Path
from typing import Any

from dense_vs.files import read_json, write_json
from dense_vs.sweep.report import raise_failures
from dense_vs.sweep.run_sweep import run_sweep
from dense_vs.sweep.run_task import OUT_FOLDER, result_folder
from dense_vs.sweep.task import Task
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

# Options of 'estimate' that an episode's own process is given, by their names among the parsed arguments.
_PASSED_ON = {
    "camera": "--camera",
    "joint_names": "--joints",
    "start": "--start",
    "time_offset": "--time-offset",
    "scale": "--scale",
    "every": "--every",
    "flow": "--flow",
    "smoothing": "--smoothing",
    "covariance": "--covariance",
    "prediction": "--prediction",
    "truth": "--truth",
    "device": "--device",
}


def estimate_episodes(arguments: argparse.Namespace, numbers: list[int]) -> None:
    """Estimate episodes by themselves, without carrying J from one to the next; what is there already stays.

    Args:
        arguments: of 'estimate'.
        numbers: of the episodes.

    Raises:
        DenseVSError: some failed; the results of the others are there.
    """
    tasks = [Task(f"episode_{number:06d}", "estimate", _arguments(arguments, number)) for number in numbers]
    out: Path = arguments.out
    outcomes = run_sweep(tasks, out, jobs=arguments.jobs, address=arguments.address, threads=arguments.threads)
    summaries = []
    for outcome in outcomes:
        if not outcome.failure:
            place = result_folder(out, outcome.task) / OUT_FOLDER / "summary.json"
            summaries.append(read_json(place))
    if summaries:
        print(episodes_table(summaries))
    write_json(out / "summary.json", {"episodes": summaries, "versions": versions()})
    print(f"results in {out}/results")
    raise_failures(outcomes)


def episodes_table(summaries: list[dict[str, Any]]) -> str:
    """One line an episode: its images, clock and the motion explained."""
    header = ["episode", "images", "repeated", "offset [s]", "E first quarter", "E after it", "fps"]
    rows = [
        [
            str(s["episode"]),
            str(s["frames"]),
            str(s["repeated_images"]),
            f"{s['time_offset_s']:+.3f}",
            _share(s["explained_motion_by_quarter"][0], 2),
            _share(s["explained_motion"], 3),
            f"{s['fps']:.0f}",
        ]
        for s in summaries
    ]
    return table(header, rows)


def _share(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _arguments(arguments: argparse.Namespace, number: int) -> tuple[str, ...]:
    """The command line of one episode, with paths that hold in any working folder."""
    words = ["estimate", str(arguments.path.resolve())]
    words += [str(arguments.joints.resolve())] if arguments.joints else []
    words += ["--episode", str(number)]
    for name, option in _PASSED_ON.items():
        value = getattr(arguments, name)
        if value is not None:
            words += [f"{option}={value.resolve() if isinstance(value, Path) else value}"]
    words += ["--no-video"] if arguments.no_video else []
    words += ["--sway"] if arguments.sway else []
    words += ["--rerun"] if arguments.rerun else []
    return tuple(words)
