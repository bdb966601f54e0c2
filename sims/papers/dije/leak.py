"""Fig. 4: how much of a person who walks past is taken for the robot's own body.

Two experiments in one run. With estimation on: labels of the paper's algorithms, J moved by the measured flow,
DIJE (13), or by the predicted one, DIJE (14), beside our default; the two transports leak alike then. With J only
transported for 100 frames, without any correction: the effect that the figure shows, DIJE (13) leaks and DIJE (14) does
not, but loses parts of the arm.
"""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dense_vs.sims.papers.dije.labeling_arguments import add_labeling_arguments, check_labeling_arguments
from dense_vs.sims.papers.rows import Row

if TYPE_CHECKING:
    from dense_vs.sims.papers.dije.leak_record import LeakRun

WARM_UP = 4.0  # s of learning before labels are scored
SCORE_EVERY = 5  # frames
TRANSPORT_FROM, TRANSPORT_FRAMES = 8.0, 100  # s; frames
METHODS = {"default": "default", "(13)": "paper's algorithms, (13)", "(14)": "paper's algorithms, (14)"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    add_labeling_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.sims.engine.scene import FRAME_SECONDS
    from dense_vs.sims.papers.dije.leak_figure import draw_leak, plot_leak
    from dense_vs.view.progress import progress

    check_labeling_arguments(arguments, TRANSPORT_FROM + (TRANSPORT_FRAMES + 1) * FRAME_SECONDS)
    runs = []
    with progress("seed", len(arguments.seeds) * round(arguments.seconds / FRAME_SECONDS)) as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}")
            found = run_seed(seed, arguments, bar)
            draw_leak(found, METHODS, arguments.out / f"seed{seed}.png")
            runs.append(found)
    plot_leak(runs, METHODS, arguments.out / "leak.png")
    return leak_rows(runs)


def run_seed(seed: int, arguments: Any, bar: Any) -> "LeakRun":
    """One walk past one robot."""
    from dense_vs.sims.papers.dije.labeling import make_labelers, views
    from dense_vs.sims.papers.dije.leak_record import LeakRun
    from dense_vs.sims.papers.dije.transport import Transport

    where = arguments.device, arguments.threads
    both = make_labelers(seed, *where)
    labelers = {
        "default": both["default"],
        "(13)": make_labelers(seed, *where, prediction="flow")["paper"],
        "(14)": both["paper"],
    }
    found = LeakRun(seed, labelers)
    transports: dict[str, Transport] = {}
    begin = end = 0
    for view in views(seed, arguments):
        for labeler in labelers.values():
            labeler.take(view)
        for transport in transports.values():
            transport.take(view)
        if view.time >= WARM_UP and view.index % SCORE_EVERY == 0:
            for labeler in labelers.values():
                labeler.score(view)
            if found.shown is None or view.walker.sum() > found.shown.walker.sum():
                found.shown = view
                found.shown_labels = {name: labeler.labels() for name, labeler in labelers.items()}
        if not begin and view.time >= TRANSPORT_FROM:
            begin, end = view.index, view.index + TRANSPORT_FRAMES
            J, own = labelers["default"].estimator.to_numpy(), labelers["default"].labels()
            transports = {
                "(13)": Transport(J, own, "flow", *where),
                "(14)": Transport(J, own, "model", *where),
            }
        if view.index == end:
            found.transport_view = view
            for name, transport in transports.items():
                carried = transport.own()
                found.transported[name] = (*areas_off(carried, view.robot), transport.leak())
                found.transport_labels[name] = carried
            transports = {}
        bar.update()
    return found


def areas_off(carried: np.ndarray, arm: np.ndarray) -> tuple[float, float]:
    """What a body's J covers beyond the arm and what it lost of it, as shares of its area, from masks ``(H, W)``."""
    area = float(arm.sum())
    return float((carried & ~arm).sum()) / area, float((arm & ~carried).sum()) / area


def leak_rows(runs: "Sequence[LeakRun]") -> list[Row]:
    """Mean over the seeds of each seed's figure, and the worst seed's; the paper shows pictures and no figures."""
    seeds = tuple(run.seed for run in runs)
    rows = []
    for name, title in METHODS.items():
        of = [run.labelers[name] for run in runs]
        iou = [float(np.median(labeler.iou)) for labeler in of]
        leak = [_mean_seen(labeler.leak) for labeler in of]
        pixels = [float(np.mean(labeler.leak_px)) for labeler in of]
        rows += [
            Row(f"{title}: IoU, median over time", None, float(np.mean(iou)), "", seeds),
            Row(f"{title}: IoU, worst seed", None, min(iou), "", seeds),
            Row(f"{title}: leak, share of the walker", None, _mean_seen(leak), "", seeds),
            Row(f"{title}: leak, worst seed", None, max(leak, key=lambda v: -1.0 if np.isnan(v) else v), "", seeds),
            Row(f"{title}: leak", None, float(np.mean(pixels)), "px", seeds),
        ]
    for name in ("(13)", "(14)"):
        leaked, lost, walker = np.array([run.transported[name] for run in runs]).T
        title = f"J only transported, {name}"
        rows += [
            Row(f"{title}: leak, share of the walker", None, _mean_seen(walker.tolist()), "", seeds),
            Row(f"{title}: leaked area / arm area at the end", None, float(leaked.mean()), "", seeds),
            Row(f"{title}: lost area / arm area at the end", None, float(lost.mean()), "", seeds),
        ]
    return rows


def _mean_seen(values: Sequence[float]) -> float:
    """Mean of those that are numbers; NaN where none is."""
    seen = np.array(values)[np.isfinite(values)]
    return float(seen.mean()) if seen.size else float("nan")
