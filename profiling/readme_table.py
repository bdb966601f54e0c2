"""Write the tables of measured figures from the committed results, so that none is typed by hand.

    python profiling/readme_table.py [--check]

The README holds a few of them between its markers, ``docs/performance.md`` all. ``--check`` changes nothing and exits
1 where one of the two differs from the results.
"""

import argparse
import sys
from pathlib import Path

from readme_body import body_lines, few_body_lines
from readme_changes import change_lines
from readme_depth import depth_lines
from readme_experiments import experiment_lines, few_experiment_lines, summary_lines
from readme_frames import arm_frame_lines, few_arm_frame_lines
from readme_hidden import hidden_lines
from readme_live import live_lines
from readme_program import gpu_test_lines, program_lines, rendering_lines
from readme_real_robot import few_real_robot_lines, real_robot_lines
from readme_tracking import few_tracking_lines, tracking_lines
from results_file import Result, committed, in_words, seeds_in_words
from surface_table import few_surface_lines, surface_lines

ROOT = Path(__file__).parent.parent
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"

ACCURACY = (
    ("J error, {mode}, estimated flow, median", "J error over the robot's pixels, default flow"),
    ("J error, {mode}, estimated flow, inner_median", "the same 3 px inside the outline"),
    ("J error, {mode}, exact flow, median", "J error with exact flow"),
)
MODES = {
    "default": "default",
    "default, order 1": "without the image Hessian (order 1)",
    "diagonal (9)-(11), model (14)": "paper: (9)-(11), (14)",
    "Hosoda (12), model (14)": "Hosoda: (12), (14)",
}
PEERS = {
    "predict_update_vs_scipy": "the paper's equations with SciPy's `interpn`",
    "predict_update_vs_numpy": "the equations in NumPy, joints innermost",
    "predict_update_vs_scipy_planes": "planes in NumPy, prediction by SciPy's `interpn`",
    "predict_update_vs_numpy_planes": "planes in NumPy alone",
    "predict_update_vs_opencv": "planes in NumPy, prediction by OpenCV's `remap`",
    "predict_update_vs_taichi": "Taichi",
    "predict_update_vs_torch": "PyTorch",
}
FRAME_PEERS = {
    "frame_vs_paper_without_labels": "the paper's whole frame (Farneback, `interpn`), labels on neither side",
    "frame_vs_paper_with_labels": "the same with labels on both sides",
}
# All of one run, so that they hold for the machine and commit above them.
FRAME = (
    ("update_ms_320x240", "predict and update in the default mode (order 2), of a frame at 320x240 [ms]", 2),
    ("frame_fps_320x240", "whole frame (flow, update, tracking, servo) at 320x240 [fps]", 0),
    ("frame_fps_640x480", "whole frame at 640x480 [fps]", 0),
    ("frame_fps_320x240_body", "the same at 320x240 with a learned body, which follows the point [fps]", 0),
    ("frame_p90_ms_320x240_body", "of its frames nine in ten take at most [ms]", 0),
    ("frame_fps_640x480_body", "at 640x480 with a learned body [fps]", 0),
)

LOOP, ONE, ROOFLINE = "closed_loop_h200", "closed_loop_h200_one", "roofline_h200"
SCALING = ("scaling_h200", "scaling_cpu")
ORDER_2, MANY = "closed_loop_h200_order2", "closed_loop_h200_4096"
FLOW, GPUS = "batch_flow_h200", "closed_loop_h200_gpus"
WORLDS = "1024 worlds, cuda:0"
BATCH = (
    (LOOP, f"closed loop, {WORLDS}", "whole loop with order 1, 1024 robots [frames/s]", "{:,.0f}"),
    (LOOP, "J error after babbling, median, cuda:0", "its J error after babbling, median of 4 robots", "{:.2f}"),
    (LOOP, f"render, {WORLDS}", "of a frame of all robots: rendering [ms]", "{:.1f}"),
    (LOOP, f"flow, {WORLDS}", "optical flow, in tiles [ms]", "{:.1f}"),
    (FLOW, f"flow in passes, {WORLDS}", "the same in passes over the image (`profiling/batch_flow.py`) [ms]", "{:.1f}"),
    (LOOP, f"update, {WORLDS}", "predict and update, order 1 [ms]", "{:.1f}"),
    (LOOP, f"physics, {WORLDS}", "physics [ms]", "{:.1f}"),
    (LOOP, f"device memory, {WORLDS}", "memory [GiB]", "{:.1f}"),
    (
        LOOP,
        f"share of reaches within 3 px, {WORLDS}",
        "reaches that end within 3 px of a random target by the simulator's truth",
        "{:.1%}",
    ),
    (ORDER_2, f"closed loop, {WORLDS}", "whole loop with order 2, 1024 robots [frames/s]", "{:,.0f}"),
    (ORDER_2, "J error after babbling, median, cuda:0", "its J error after babbling, median of 4 robots", "{:.2f}"),
    (ORDER_2, f"device memory, {WORLDS}", "its memory [GiB]", "{:.1f}"),
    (ORDER_2, f"share of reaches within 3 px, {WORLDS}", "its reaches that end within 3 px", "{:.1%}"),
    (MANY, "closed loop, 4096 worlds, cuda:0", "whole loop with order 1, 4096 robots [frames/s]", "{:,.0f}"),
    (MANY, "device memory, 4096 worlds, cuda:0", "its memory [GiB]", "{:.1f}"),
    (ONE, "image to command, 1 worlds, cuda:0", "one robot, order 1: from image to command [ms]", "{:.2f}"),
    (
        ROOFLINE,
        "share_of_copy_rate, shared, order 1, 512 worlds, cuda:0",
        "share of the copy rate: one robot's default filter in 512 worlds, order 1",
        "{:.2f}",
    ),
    (ROOFLINE, "share_of_copy_rate, shared, order 2, 512 worlds, cuda:0", "order 2", "{:.2f}"),
    (GPUS, "closed loop, 4096 worlds, 2 processes, auto", "4096 robots shared by 2 GPUs [frames/s]", "{:,.0f}"),
    (GPUS, "closed loop, 4096 worlds, 4 processes, auto", "4096 robots shared by 4 GPUs [frames/s]", "{:,.0f}"),
)


def everything() -> str:
    """All figures, for the page on performance."""
    lines = [*_accuracy(), "", *surface_lines(), *real_robot_lines(), "", *depth_lines(), ""]
    lines += [*body_lines(), "", *change_lines(), "", *hidden_lines(), ""]
    lines += [*_speed(), "", *arm_frame_lines(), "", *program_lines(), ""]
    lines += [*live_lines(), "", *_batch(), "", *rendering_lines(), "", *gpu_test_lines(), "", *_scaling(), ""]
    lines += [
        "Arms and objects, on seeds that nothing was tuned on; one figure a seed or that of all (`dense-vs reproduce "
        "... --json`, gathered by `profiling/experiments.py`):",
        "",
        *experiment_lines(),
        "",
        *tracking_lines(),
        *summary_lines(*(Result(name) for name in ("segmentation", "reducers", "generative"))),
    ]
    return "\n".join(lines)


def few() -> str:
    """The figures that a newcomer asks for first."""
    accuracy, budget, peers, loop = (Result(name) for name in ("accuracy", "frame_budget", "peers", LOOP))
    strongest = min((peers[name], text) for name, text in PEERS.items() if peers.has(name))
    lines = [
        "| | |",
        "|---|---|",
        f"| J error after 10 s of babbling, mean of {_robots_and_seeds(accuracy)} (the paper's filter) | "
        f"{accuracy['J error, default, estimated flow, median: mean']:.3f} "
        f"({accuracy['J error, diagonal (9)-(11), model (14), estimated flow, median: mean']:.3f}) |",
        f"| reaches within 2 px by the simulator's truth | {_reaches(accuracy)} |",
        *few_surface_lines(),
        *few_body_lines(),
        *few_real_robot_lines(),
        f"| whole frame at 320x240 on {budget.content['machine']['cores']} CPU cores, without / with a learned body "
        "[fps] | "
        f"{budget['frame_fps_320x240']:.0f} / {budget['frame_fps_320x240_body']:.0f} |",
        *few_arm_frame_lines(),
        "| predict and update, times as fast as the paper's equations with SciPy | "
        f"{peers['predict_update_vs_scipy']:.1f} |",
        f"| times as fast as the strongest of {sum(map(peers.has, PEERS))} peers ({strongest[1]}) | "
        f"{strongest[0]:.1f} |",
        f"| 1024 robots on one {loop.content['machine']['gpus'][0]}, order 1 (J error "
        f"{loop['J error after babbling, median, cuda:0']:.2f}) [frames/s] | {loop[f'closed loop, {WORLDS}']:,.0f} |",
        *few_tracking_lines(),
        *few_experiment_lines(),
    ]
    return "\n".join([*lines, "", "[All figures, and what they were measured on](docs/performance.md)."])


def _reaches(accuracy: Result) -> str:
    total = round(accuracy["reaches"])
    return f"{round(total * accuracy['reaches below 2 px'])} of {total}"


def _robots_and_seeds(accuracy: Result) -> str:
    robots, seeds = (accuracy.content["arguments"][name].split(",") for name in ("robots", "seeds"))
    return f"{len(robots)} simulated robots x {len(seeds)} seeds"


def _accuracy() -> list[str]:
    accuracy = Result("accuracy")
    told = accuracy.content["arguments"]
    lines = [
        f"Accuracy after 10 s of babbling at 30 fps, 320x240, {_robots_and_seeds(accuracy)} "
        f"({told['robots'].replace(',', ' and ')}; {seeds_in_words(told['seeds'])}), mean (worst) of the medians of "
        f"||J - J*|| / ||J*|| (`profiling/accuracy.py`; {accuracy.origin()}):",
        "",
        "| | " + " | ".join(MODES.values()) + " |",
        "|---|" + "---|" * len(MODES),
    ]
    for pattern, text in ACCURACY:
        names = [pattern.format(mode=mode) for mode in MODES]
        cells = [f"{accuracy[name + ': mean']:.3f} ({accuracy[name + ': worst']:.3f})" for name in names]
        lines.append(f"| {text} | " + " | ".join(cells) + " |")
    return [
        *lines,
        "",
        f"Reaches after that: {_reaches(accuracy)} end within 2 px by the simulator's truth, "
        f"median {accuracy['reach error, median']:.2f} px, worst {accuracy['reach error, worst']:.2f} px, "
        f"in {accuracy['reach frames, median']:.0f} frames (median).",
    ]


def _speed() -> list[str]:
    peers, cold = Result("peers"), Result("peers_cold")
    lines = [
        "Speed with 4 joints at 320x240, all implementations in turn in one run, medians, and the range over several "
        "runs (`profiling/peers.py`; "
        f"{peers.origin()}; with emptied caches {cold.when()}). Predict and update is the paper's diagonal form on "
        "every side:",
        "",
        "| predict and update: times as fast as | steady loop | caches emptied before each call |",
        "|---|---|---|",
    ]
    for name, text in PEERS.items():
        if peers.has(name):
            lines.append(f"| {text} | {peers.ranged(name)} | {cold.ranged(name)} |")
    lines += ["", "| whole frame: times as fast as | |", "|---|---|"]
    lines += [f"| {text} | {peers.ranged(name)} |" for name, text in FRAME_PEERS.items() if peers.has(name)]
    if "machine_facts" in peers.content:
        lines += ["", f"Of that machine: {in_words(peers.content['machine_facts'])}."]
    budget = Result("frame_budget")
    told = budget.content["arguments"]
    origin = f"`profiling/frame_budget.py`; {told['robot']}, {seeds_in_words(told['seeds'])}; {budget.origin()}"
    lines += ["", f"A whole frame of the loop, mean times ({origin}):", "", "| | |", "|---|---|"]
    return lines + [f"| {text} | {budget[name]:.{digits}f} |" for name, text, digits in FRAME]


def _batch() -> list[str]:
    seed = seeds_in_words(str(Result(LOOP).content["arguments"]["seed"]))
    return [
        "Many robots on one GPU, 320x240, 4 joints, links, textures, lights and cameras all different "
        f"(`profiling/closed_loop.py`, `profiling/roofline.py`; {seed}; {Result(LOOP).origin()}). Order 1 is the "
        "filter without the image Hessian, which is faster and less accurate than the default:",
        "",
        "| | |",
        "|---|---|",
        *(f"| {text} | {form.format(Result(file)[name])} |" for file, name, text, form in BATCH),
    ]


def _scaling() -> list[str]:
    """How the time of predict and update grows, one thing varied at a time: a row each, on every machine measured."""
    lines = ["", "| varied | values | predict and update, order 1 [ms] |", "|---|---|---|"]
    origins = []
    for file in SCALING:
        if not committed(file):
            continue
        result = Result(file)
        origins.append(result.origin())
        times: dict[str, list[tuple[str, float]]] = {}
        for name, value in result.values.items():
            if name.startswith("predict and update, "):
                varied, at, device = name.removeprefix("predict and update, ").replace(",", "").split(" ")
                times.setdefault(f"{varied}, {device}", []).append((at, value))
        for varied, found in times.items():
            values, milliseconds = (
                ", ".join(column) for column in zip(*((a, f"{t:.2g}") for a, t in found), strict=True)
            )
            lines.append(f"| {varied} | {values} | {milliseconds} |")
    start = "One thing varied at a time, else 4 joints, 320x240 and one world (`profiling/scaling.py`; "
    return [start + "; ".join(origins) + "):", *lines]


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Write the tables of measured figures from profiling/results.")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 where a table differs")
    arguments = parser.parse_args()
    stale = 0
    for path, figures in ((ROOT / "README.md", few()), (ROOT / "docs" / "performance.md", everything())):
        text = path.read_text(encoding="utf-8")
        before, rest = text.split(BEGIN)
        _, after = rest.split(END)
        wanted = f"{before}{BEGIN}\n{figures}\n{END}{after}"
        if wanted == text:
            continue
        stale = 1
        if not arguments.check:
            path.write_text(wanted, encoding="utf-8")
    return stale if arguments.check else 0


if __name__ == "__main__":
    sys.exit(main())
