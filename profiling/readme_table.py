"""Write the README's table of measured figures from the committed results, so that none is typed by hand.

    python profiling/readme_table.py [--check]

``--check`` changes nothing and exits 1 where the README differs from the results.
"""

import argparse
import json
import sys
from pathlib import Path

from readme_experiments import experiment_lines, summary_lines

ROOT = Path(__file__).parent.parent
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"

ACCURACY = (
    ("J error, {mode}, estimated flow, median", "J error over the robot's pixels, default flow"),
    ("J error, {mode}, estimated flow, inner_median", "the same 3 px inside the outline"),
    ("J error, {mode}, exact flow, median", "J error with exact flow"),
)
MODES = {
    "default": "default",
    "default, order 1": "without the image Hessian",
    "diagonal (9)-(11), model (14)": "paper: (9)-(11), (14)",
    "Hosoda (12), model (14)": "Hosoda: (12), (14)",
}
SPEED = (
    ("predict_update_vs_scipy", "the paper's equations with SciPy's `interpn`", 1),
    ("predict_update_vs_scipy_planes", "plane-wise NumPy, its fastest form, with `interpn`", 1),
    ("predict_update_vs_numpy", "the equations in NumPy", 1),
    ("predict_update_vs_opencv", "OpenCV's `remap` and plane-wise NumPy", 1),
    ("predict_update_vs_taichi", "Taichi", 1),
    ("predict_update_vs_torch", "PyTorch", 1),
)
FRAME = (
    ("predict_update_default_ms", "predict and update in the default mode [ms]", 2),
    ("frame_fps_320x240", "whole frame (flow, update, tracking, servo) at 320x240 [fps]", 0),
    ("frame_fps_640x480", "whole frame at 640x480 [fps]", 0),
)

BATCH = (
    ("closed_loop_h200", "closed loop, 1024 worlds, cuda:0", "whole loop, 1024 robots [frames/s]", "{:,.0f}"),
    ("closed_loop_h200", "render, 1024 worlds, cuda:0", "of that per frame of all: rendering [ms]", "{:.1f}"),
    ("closed_loop_h200", "flow, 1024 worlds, cuda:0", "optical flow [ms]", "{:.1f}"),
    ("closed_loop_h200", "update, 1024 worlds, cuda:0", "predict and update [ms]", "{:.1f}"),
    ("closed_loop_h200", "physics, 1024 worlds, cuda:0", "physics [ms]", "{:.1f}"),
    ("closed_loop_h200", "device memory, 1024 worlds, cuda:0", "memory [GiB]", "{:.1f}"),
    (
        "closed_loop_h200",
        "share of reaches within 3 px, 1024 worlds, cuda:0",
        "reaches that end within 3 px of a random target by the simulator's truth",
        "{:.1%}",
    ),
    (
        "closed_loop_h200_one",
        "image to command, 1 worlds, cuda:0",
        "one robot: from image to command [ms]",
        "{:.2f}",
    ),
    (
        "roofline_h200",
        "share_of_copy_rate, shared, order 1, 512 worlds, cuda:0",
        "predict and update, 512 worlds: share of the copy rate",
        "{:.2f}",
    ),
    ("roofline_h200", "share_of_copy_rate, shared, order 2, 512 worlds, cuda:0", "the same with order 2", "{:.2f}"),
)


def load(name: str) -> tuple[dict, dict[str, float]]:
    """Header and values by name of a result file."""
    content = json.loads((ROOT / "profiling" / "results" / f"{name}.json").read_text(encoding="utf-8"))
    return content, {metric["name"]: metric["value"] for metric in content["metrics"]}


def measured() -> str:
    """The section's text."""
    header, accuracy = load("accuracy")
    lines = [
        f"Accuracy after 10 s of babbling at 30 fps, 320x240, 2 robots x 5 seeds, mean (worst) of the medians of "
        f"||J - J*|| / ||J*|| (`profiling/accuracy.py`, {header['date'][:10]}):",
        "",
        "| | " + " | ".join(MODES.values()) + " |",
        "|---|" + "---|" * len(MODES),
    ]
    for pattern, text in ACCURACY:
        cells = []
        for mode in MODES:
            name = pattern.format(mode=mode)
            cells.append(f"{accuracy[name + ': mean']:.3f} ({accuracy[name + ': worst']:.3f})")
        lines.append(f"| {text} | " + " | ".join(cells) + " |")
    reaches = round(accuracy["reaches"])
    close = round(accuracy["reaches"] * accuracy["reaches below 2 px"])
    lines += [
        "",
        f"Reaches after that: {close} of {reaches} end within 2 px by the simulator's truth, "
        f"median {accuracy['reach error, median']:.2f} px, worst {accuracy['reach error, worst']:.2f} px, "
        f"in {accuracy['reach frames, median']:.0f} frames (median).",
        "",
    ]
    header, speed = load("frame_budget")
    speed |= load("peers")[1]
    machine, warp = header["machine"], header["versions"]["warp-lang"]
    lines += [
        f"Speed on {machine['cores']} cores of an {machine['cpu']}, 4 joints, interleaved in one run, medians "
        f"(`profiling/peers.py`, `profiling/frame_budget.py`, {header['date'][:10]}, Warp {warp}):",
        "",
        "| predict and update, diagonal form: times as fast as | steady loop | caches emptied before each call |",
        "|---|---|---|",
    ]
    cold = load("peers_cold")[1]
    lines += [f"| {text} | {speed[name]:.{digits}f} | {cold[name]:.{digits}f} |" for name, text, digits in SPEED]
    lines += ["", "| | |", "|---|---|"]
    lines += [f"| {text} | {speed[name]:.{digits}f} |" for name, text, digits in FRAME]
    header = load("closed_loop_h200")[0]
    lines += [
        "",
        f"Many robots on one {header['machine']['gpus'][0]}, 320x240, 4 joints, links, textures, lights and cameras "
        f"all different (`profiling/closed_loop.py`, `profiling/roofline.py`, {header['date'][:10]}):",
        "",
        "| | |",
        "|---|---|",
    ]
    lines += [f"| {text} | {form.format(load(file)[1][name])} |" for file, name, text, form in BATCH]
    lines += [
        "",
        "Arms and objects, on seeds that nothing was tuned on; one figure a seed or that of all (`dense-vs reproduce "
        "... --json`, gathered by `profiling/experiments.py`):",
        "",
        *experiment_lines(),
        "",
        *summary_lines(*(load(name)[1] for name in ("segmentation", "reducers", "generative"))),
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Write the README's measured figures from profiling/results.")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 where the README differs")
    arguments = parser.parse_args()
    path = ROOT / "README.md"
    text = path.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    wanted = f"{before}{BEGIN}\n{measured()}\n{END}{after}"
    if arguments.check:
        return int(wanted != text)
    path.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
