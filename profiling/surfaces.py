"""J, labels and reaches on commercial arms as they come, clean and with a real camera's faults, beside our own arms.

    dense-vs arms panda ur5e baxter fetch
    python profiling/surfaces.py --jobs 30 --json profiling/results/surfaces.json
    python profiling/surfaces.py --jobs 30 --joints 7 --seconds 20 --json profiling/results/surfaces_7.json
    dense-vs arms spot-arm tiago gr1  # no constant was found on these
    python profiling/surfaces.py --arms spot-arm,tiago --json profiling/results/surfaces_other_arms.json
    python profiling/surfaces.py --arms panda,ur5e,baxter,fetch,spot-arm,tiago,gr1 --cameras C,D,E,F,G,H \\
        --images realistic --targets 3 --json profiling/results/surfaces_other_cameras.json

Each arm babbles as ``dense-vs reach`` does, all with the same default settings, then goes to targets over its whole
range. J by exact flow stands beside the estimate, as what is left is the flow's share. A reach counts where the true
point ends below 2 px; a wrong "reached" is one that the loop believes in and that does not count. Every view runs in a
process of its own; the file is written anew with everything that is known whenever a view has news, so a run that is
stopped early has not run for nothing: with --resume it goes on with the views that had not come to their end.
"""

import argparse
import multiprocessing
import os
import queue
import signal
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parent))  # python -P leaves it out

from metrics import add_report_arguments, report
from stopped_run import stopped_run
from surface_scores import OURS, ViewScore, metrics_of, view_score
from surface_table import table_lines

from dense_vs.files import write_json
from dense_vs.sims.engine.built_scenes import ARM_NAMES, TUNED_ARMS, scene_file
from dense_vs.view.provenance import provenance

IMAGES = ("clean", "sensor", "realistic")
TOLD_EVERY = 0.5  # s


def main() -> int:
    """Run the command."""
    options = _arguments()
    views = _views(options)
    origin = provenance(options, leave_out=("json", "gate"))
    if options.jobs > 1:  # inherited by the processes, before they load what reads it
        for name in ("OMP_NUM_THREADS", "DENSE_VS_THREADS"):
            os.environ.setdefault(name, "1")
    signal.signal(signal.SIGTERM, _stop)
    before, began = stopped_run(options.json, origin) if options.resume else ([], {})
    ended = {view.key: view for view in map(view_score, before) if view.ended}
    found = {view.key: ended.get(view.key, view) for view in views}
    started = time.perf_counter()

    def heard(view: ViewScore) -> None:
        found[view.key] = view
        state = view.failure or ("done" if view.finished else f"{len(view.reaches)} of {view.targets} reaches")
        name = " ".join(part for part in (view.arm, view.camera, view.images) if part)
        print(f"{time.perf_counter() - started:6.0f} s  {name} {view.seed}: J {view.j_median:.3f}, {state}", flush=True)
        if options.json is not None:
            metrics = [asdict(metric) for metric in metrics_of(_known(found.values()))]
            write_json(options.json, {**origin, **began, **_content(found.values()), "metrics": metrics})

    try:
        _run([view for view in views if view.key not in ended], options, heard)
    except KeyboardInterrupt:
        print("stopped early", file=sys.stderr)
    known = _known(found.values())
    print("\n".join(table_lines(known)))
    code = report(metrics_of(known), options, **began, **_content(found.values()))
    return max(code, int(any(view.failure or not view.finished for view in found.values())))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arms = ",".join([*TUNED_ARMS, "painted", "arm"])
    parser.add_argument("--arms", default=arms, help=f"names or MJCF files, by comma (default: {arms})")
    parser.add_argument("--cameras", default="A,B", help="of the commercial arms, by comma (default: A,B)")
    parser.add_argument(
        "--images", default="clean,realistic", help=f"some of {', '.join(IMAGES)}, by comma (default: clean,realistic)"
    )
    parser.add_argument("--joints", type=int, default=4, help="of the commercial arms, from the base (default: 4)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of babbling (default: 10)")
    parser.add_argument("--targets", type=int, default=5, help="of each view; 0 for none (default: 5)")
    parser.add_argument("--seeds", default="0", help="of motion, targets and faults, by comma (default: 0)")
    parser.add_argument("--jobs", type=int, default=1, help="views at a time, a core each where above 1 (default: 1)")
    parser.add_argument(
        "--limit", type=float, default=float("inf"), help="seconds after which it stops (default: none)"
    )
    parser.add_argument("--resume", action="store_true", help="go on with a run that was stopped, as --json has it")
    parser.add_argument("--device", default="cpu", help="auto, cpu or cuda:N (default: cpu)")
    parser.add_argument(
        "--world-device", default="", help="where the robot and its images are simulated; some by comma share the views"
        " out (default: --device)"
    )  # fmt: skip
    parser.add_argument("--no-exact", dest="exact", action="store_false", help="leave J by exact flow out")
    add_report_arguments(parser)
    options = parser.parse_args()
    unknown = set(options.images.split(",")) - set(IMAGES)
    if unknown:
        parser.error(f"--images has {', '.join(sorted(unknown))}; expected some of {', '.join(IMAGES)}")
    if options.jobs < 1 or options.joints < 1 or options.targets < 0:
        parser.error("--jobs and --joints are at least 1, --targets at least 0")
    for arm in set(options.arms.split(",")) & set(ARM_NAMES):
        scene_file(arm)
    return options


def _views(options: argparse.Namespace) -> list[ViewScore]:
    """Every view, kind of images and seed; those that take longest first."""
    return [
        ViewScore(arm, camera, images, int(seed), options.joints, options.targets)
        for images in sorted(options.images.split(","), key=IMAGES.index, reverse=True)
        for seed in options.seeds.split(",")
        for arm in options.arms.split(",")
        for camera in ([""] if arm in OURS else options.cameras.split(","))
    ]


def _known(views: Iterable[ViewScore]) -> list[ViewScore]:
    return [view for view in views if view.learned or view.failure]


def _content(views: Iterable[ViewScore]) -> dict[str, Any]:
    """What the file holds beside its origin and the metrics."""
    views = sorted(views, key=lambda view: (view.images, view.arm, view.camera, view.seed))
    return {"finished": all(view.ended for view in views), "rows": [asdict(view) for view in views]}


def _run(views: list[ViewScore], options: argparse.Namespace, heard: Any) -> None:
    """Measure all views, so many at a time; none outlives this call."""
    context = multiprocessing.get_context("spawn")
    news: Any = context.Queue()
    waiting, running, latest = list(views), {}, {}
    end = time.monotonic() + options.limit
    try:
        while waiting or running:
            while waiting and len(running) < options.jobs:
                view = waiting.pop(0)
                running[view.key] = context.Process(target=_work, args=(view, options, news))
                running[view.key].start()
                latest[view.key] = view
            over = [key for key, process in running.items() if not process.is_alive()]
            _hear(news, latest, heard, wait=not over)
            for key in over:
                process, view = running.pop(key), latest[key]
                process.join()
                if not view.ended:
                    heard(replace(view, failure=f"the process ended with exit code {process.exitcode}"))
            if time.monotonic() > end:
                raise KeyboardInterrupt
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.join()


def _hear(news: Any, latest: dict[tuple, ViewScore], heard: Any, wait: bool) -> None:
    """Pass on what has come; first wait a little for something to come."""
    while True:
        try:
            view = news.get(timeout=TOLD_EVERY)
        except queue.Empty:
            return
        latest[view.key] = view
        heard(view)
        if wait:
            return


def _work(view: ViewScore, options: argparse.Namespace, news: Any) -> None:
    """Measure one view in a process of its own."""
    import cv2
    import warp as wp
    from surface_view import measure

    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    wp.config.log_level = wp.LOG_ERROR
    if options.jobs > 1:
        cv2.setNumThreads(1)
    measure(view, options, news.put)


def _stop(*_: Any) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    raise SystemExit(main())
