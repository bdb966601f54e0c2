"""What becomes of J, of a reach and of the reaches after it when something breaks: the table of docs/faults.md.

    python profiling/faults.py [--arms arm planar] [--seeds 0 1 2] [--faults NAME ...] [--jobs N] [--json FILE]
    python profiling/faults.py --page    # writes the table from profiling/results; --check fails where it differs

For every fault, and for none, a robot babbles for 10 s and learns its body. Then: J's error while it babbles for 3 s
(the truth is the simulator's), the fault while it babbles, J's error at its end and 3 s later, the same fault again in
the middle of a reach, and three reaches after it. J's error goes with the posture, so before and after a fault it is a
mean over 3 s: of means over a second, one in a hundred is 1.4 times the one before where nothing has happened.
A frame counts as off where the tracked point is more than 3 px from where the true one was at the image's time, as far
as the loop knows that time, and as flagged where the loop names a fault or says that the point is lost or its place
uncertain.
"""

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import warp as wp

from dense_vs.files import write_json
from dense_vs.point_servo.checkpoint import Checkpoint
from dense_vs.point_servo.following import certain
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.faults import FAULTS, FaultInjector
from dense_vs.sims.papers.dije.reaching import ReachingExperiment
from dense_vs.view.provenance import provenance
from dense_vs.view.tables import table

RESULT = Path(__file__).parent / "results" / "faults.json"
PAGE = Path(__file__).parent.parent / "docs" / "faults.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"
OFF = 3.0  # px
REACHED = 2.0  # px
POINTS = {"arm": "tip", "planar": "tip"}
JOINT = 1  # that is at fault
BEFORE, AFTER = 3.0, 3.0  # s in which J's error is taken, before a fault and around 3 s after its end
LATER = 3.0 - AFTER / 2  # s from its end until then
SAMPLES = 15  # of each
INTO_REACH = 6  # frames
RESTART = "killed and restarted"  # the process: nothing is left but its checkpoint and the robot where it is
NOTHING, LASTS = "nothing, to compare with", 2.0  # s: J's error differs from posture to posture without any fault
NAMES = (*FAULTS, RESTART, NOTHING)


@dataclass
class Row:
    """One fault on one robot with one seed.

    Attributes:
        before, at_end, after: median error of J before the fault, at its end and 3 s later, the first and the last as
            a mean over some postures.
        named: kinds of fault that the loop named while it babbled.
        reach: how the reach with the fault in it ended; its true error [px].
        worst: largest distance of the tracked from the true point [px].
        unflagged: longest run of frames in which the point was off and nothing was said.
        after_px: true errors of the reaches after it [px].
    """

    arm: str
    seed: int
    fault: str
    before: float
    at_end: float
    after: float
    named: list[str]
    reach: str
    reach_px: float
    worst: float
    unflagged: int
    after_px: list[float]


class FaultTrial:
    """One robot with one seed."""

    def __init__(self, arm: str, seed: int):
        self.arm, self.seed = arm, seed
        self.world = SimWorld(arm, seed=seed, device="cpu")
        self.injector = FaultInjector(self.world, seed=seed)
        self.named: set[str] = set()
        self.frames: list[tuple[bool, bool, float]] = []  # off, flagged, distance
        self.due: str | None = None  # fault that begins in the reach
        self.places: dict[float, np.ndarray] = {}  # where the true point was, by time
        self.run = ReachingExperiment(
            self.world, traced=False, point=POINTS[arm], seed=seed, injector=self.injector, on_frame=self._after_frame
        )
        self.run.learn()

    def restart(self) -> None:
        """Begin anew with what a checkpoint keeps, the robot where it is."""
        with TemporaryDirectory() as folder:
            checkpoint = Checkpoint(Path(folder) / "kept.npz", self.world.joint_names)
            checkpoint.keep(self.run.loop, 0.0)
            checkpoint.end()
            estimator = self.run.loop.estimator.options
            kept = checkpoint.resume((estimator.height, estimator.width), device="cpu")
        assert kept is not None
        kept.bring_to(self.world.joints()[0])
        self.run = ReachingExperiment(
            self.world,
            traced=False,
            point=POINTS[self.arm],
            seed=self.seed,
            injector=self.injector,
            on_frame=self._after_frame,
            estimator=kept.estimator,
            body_model=kept.body or True,
        )

    def meet_restart(self, number: int) -> Row:
        """The process killed while it babbles, and again in a reach, after which its point has to be chosen anew."""
        before = self._error(BEFORE)
        self.named = set()
        self.restart()
        at_end = self.run.jacobian_error().median
        self.run.loop.babble(LATER)
        after = self._error(AFTER)
        self.run.choose()
        target, *others = self._targets(number)
        self.run.reach(target, max_frames=INTO_REACH)
        self.restart()
        self.run.loop.babble(3.0)
        self.frames, self.due, self.places = [], None, {}
        self.run.choose()
        during = self.run.reach(target, max_frames=150)
        runs = [len(list(run)) for silent, run in groupby(off and not said for off, said, _ in self.frames) if silent]
        worst = max((distance for *_, distance in self.frames), default=0.0)
        after_px = []
        for other in others:
            self.run.choose()
            after_px.append(self.run.reach(other, max_frames=150).true_error_px)
        return Row(
            self.arm, self.seed, RESTART, before, at_end, after, sorted(self.named), during.reach.end.value,
            during.true_error_px, worst, max(runs, default=0), after_px,
        )  # fmt: skip

    def meet(self, fault: str, number: int) -> Row:
        """A fault while babbling, in a reach, and what is left of both."""
        loop = self.run.loop
        loop.tracker = self.run.surface_point = None
        before = self._error(BEFORE)
        self.named = set()
        at = self.world.project(POINTS[self.arm])
        loop.babble(LASTS if fault == NOTHING else self.injector.begin(fault, joint=JOINT, at=at))
        at_end = self.run.jacobian_error().median
        self.injector.end()
        loop.babble(LATER)
        after = self._error(AFTER)
        self.run.choose()
        target, *others = self._targets(number)
        self.frames, self.due, self.places = [], None if fault == NOTHING else fault, {}
        during = self.run.reach(target, max_frames=150)
        self.injector.end()
        runs = [len(list(run)) for silent, run in groupby(off and not said for off, said, _ in self.frames) if silent]
        worst = max((distance for *_, distance in self.frames), default=0.0)
        loop.babble(1.0)
        after_px = []
        for target in others:
            self.run.choose()
            after_px.append(self.run.reach(target, max_frames=150).true_error_px)
        end = during.reach.end.value
        return Row(
            self.arm, self.seed, fault, before, at_end, after, sorted(self.named), end, during.true_error_px, worst,
            max(runs, default=0), after_px,
        )  # fmt: skip

    def _targets(self, number: int) -> np.ndarray:
        """Four places that the point can reach, others for every fault."""
        self.run._seed = 100 * self.seed + number
        return self.run.targets(4)

    def _error(self, seconds: float) -> float:
        """J's median error while the robot babbles on for some seconds, mean of several moments."""
        errors = []
        for _ in range(SAMPLES):
            self.run.loop.babble(seconds / SAMPLES)
            errors.append(self.run.jacobian_error().median)
        return float(np.mean(errors))

    def _after_frame(self, run: ReachingExperiment) -> None:
        loop = run.loop
        self.named |= {fault.kind.value for fault in loop.faults}
        if run.surface_point is None or loop.tracker is None:
            return
        self.places[self.world.time] = run.project(run.surface_point)
        seen_at = loop.frame.time + min(loop.joint_delay, 0.0)
        time = min(self.places, key=lambda time: abs(time - seen_at))
        distance = float(np.hypot(*(loop.point - self.places[time])))
        said = bool(loop.faults) or bool(loop.tracker.lost[0]) or not certain(loop.tracker)
        self.frames.append((distance > OFF, said, distance))
        if self.due is not None and len(self.frames) == INTO_REACH:
            self.injector.begin(self.due, joint=JOINT, at=run.project(run.surface_point))
            self.due = None


def summary(rows: list[dict[str, Any]]) -> list[list[str]]:
    """A line a fault over robots and seeds, ranges where there are several."""
    lines = []
    for fault in NAMES:
        of = [row for row in rows if row["fault"] == fault]
        if not of:
            continue
        after_px = [px for row in of for px in row["after_px"]]
        ratio = max(row["after"] / row["before"] for row in of)
        named = sorted({name for row in of for name in row["named"]})
        lines.append(
            [
                fault,
                _range([row["before"] for row in of]),
                _range([row["at_end"] for row in of]),
                _range([row["after"] for row in of]),
                f"{ratio:.2f}",
                f"{sum(px < REACHED for px in after_px)} of {len(after_px)}",
                f"{sum(row['reach'] == 'reached' and row['reach_px'] < REACHED for row in of)} of {len(of)}",
                f"{max(row['worst'] for row in of):.1f}",
                str(max(row["unflagged"] for row in of)),
                ", ".join(named) or "nothing",
            ]
        )
    return lines


HEAD = (
    "fault",
    "J before",
    "at its end",
    "3 s later",
    "largest ratio",
    "reaches after it",
    "reaches with it",
    "farthest off [px]",
    "frames off unsaid",
    "named",
)


def _range(values: list[float]) -> str:
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def write_page(check: bool) -> int:
    """The table between its markers; 1 where ``check`` finds another one."""
    content = json.loads(RESULT.read_text(encoding="utf-8"))
    made = f"Robots {', '.join(sorted({row['arm'] for row in content['rows']}))}; seeds " + ", ".join(
        str(seed) for seed in sorted({row["seed"] for row in content["rows"]})
    )
    made += f"; {content['date'][:10]}, commit {content['commit'][:7]}."
    rows = [f"| {' | '.join(line)} |" for line in summary(content["rows"])]
    lines = [made, "", f"| {' | '.join(HEAD)} |", "|" + "---|" * len(HEAD), *rows]
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    whole = f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{rest.split(END)[1]}"
    if check and whole != text:
        print(f"{PAGE.name} is not what {RESULT.name} says; run python profiling/faults.py --page", file=sys.stderr)
        return 1
    if not check:
        PAGE.write_text(whole, encoding="utf-8")
    return 0


def measure(arm: str, seed: int, fault: str) -> Row:
    """One fault on a robot that has met none before."""
    wp.config.log_level = wp.LOG_ERROR
    trial, number = FaultTrial(arm, seed), NAMES.index(fault)
    return trial.meet_restart(number) if fault == RESTART else trial.meet(fault, number)


def _rows(arguments: argparse.Namespace) -> Iterator[Row]:
    """Every row as soon as it is known."""
    cases = [(arm, seed, fault) for fault in arguments.faults for seed in arguments.seeds for arm in arguments.arms]
    if arguments.jobs == 1:
        yield from (measure(*case) for case in cases)
        return
    os.environ.update({"OMP_NUM_THREADS": "1", "DENSE_VS_THREADS": "1"})  # inherited before anything reads it
    with ProcessPoolExecutor(arguments.jobs, multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(measure, *case) for case in cases]):
            yield done.result()


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="What becomes of J and of reaches when something breaks.")
    parser.add_argument("--arms", nargs="+", default=list(POINTS), choices=list(POINTS), help="robots (default: all)")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], help="of everything (default: 0 1 2)")
    parser.add_argument("--faults", nargs="+", default=list(NAMES), choices=list(NAMES), help="(default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="robots at a time, a core each where above 1 (default: 1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result here, after every fault")
    parser.add_argument(
        "--page", action="store_true", help="write docs/faults.md from the committed result, run nothing"
    )
    parser.add_argument("--check", action="store_true", help="with --page: change nothing, fail where it differs")
    arguments = parser.parse_args()
    if arguments.page:
        return write_page(arguments.check)
    origin = provenance(arguments, leave_out=("json", "page", "check", "jobs"))
    rows: list[dict[str, Any]] = []
    for row in _rows(arguments):
        rows.append(asdict(row))
        rows.sort(key=lambda row: (row["seed"], row["arm"], NAMES.index(row["fault"])))
        print(json.dumps(asdict(row)), flush=True)
        if arguments.json is not None:
            write_json(arguments.json, {**origin, "rows": rows})
    print(table(HEAD, summary(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
