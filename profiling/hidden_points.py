"""What becomes of J, labels and reaches where the robot is hidden: something in front, or out of the image.

    python profiling/hidden_points.py [--seeds 0,1,2,3] [--parts covered,behind,outside] [--reaches 3] [--jobs N]
                                      [--json FILE]

Our own arm babbles for 10 s and learns its body. Then a textured plate comes in from the side, circles in front of the
robot for 2 s and goes, 3 s in all, while it babbles on; the truth behind the plate is the simulator's, as the plate is
drawn over its images, and a twin babbles with nothing in front. Then come pairs of reaches: one to a target where the
point is not seen, behind a plate that stands still or out of the image, and one back to where it is. A pair begins in
the first posture, where the point is chosen anew.
"""

import argparse
import json
import multiprocessing
import os
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
import warp as wp
from hidden_scene import HEIGHT, PASSING, SECONDS, WIDTH, Covering, NarrowWorld, places_out_of_sight
from hidden_scores import CoveredScore, HiddenReach, metrics_of, share_of_both
from metrics import add_report_arguments, report

from dense_vs.body import SelfBody
from dense_vs.health.faults import FaultKind
from dense_vs.jacobian.error import jacobian_error
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.papers.dije.reaching import ReachingExperiment
from dense_vs.view.tables import table

WATCHED_EVERY = 6  # frames
AFTER = 5  # frames, right after the plate has gone
REST = 120  # frames of babbling between pairs of reaches: a tracker looks back for features that moved in sight
AT_HOME, LARGEST_STEP, MOST_FRAMES = 0.01, 0.03, 150  # rad from there, rad and frames on the way
PARTS = ("covered", "behind", "outside")


@dataclass(frozen=True)
class Watched:
    """What is measured in a frame, or on average: see :class:`CoveredScore`."""

    j: float
    j_around: float
    overlap: float
    share: float
    covered_overlap: float


class HiddenTrial:
    """One robot with one seed: learned, covered, sent out of sight."""

    def __init__(self, seed: int, options: argparse.Namespace, narrow: bool = False):
        self.seed = seed
        self.world = (NarrowWorld if narrow else SimWorld)("arm", seed=seed, device="cpu")
        self._home = self.world.joints()[0]
        self.covering = Covering(self.world, seed=seed)
        self.body = SelfBody(device="cpu")
        self.frames: list[tuple[bool, bool]] = []  # not seen, said
        self.watched: list[Watched] = []
        self._each = self._watch_reach
        self.run = ReachingExperiment(
            self.world,
            traced=False,
            seed=seed,
            babble_seconds=options.seconds,
            injector=self.covering,
            on_frame=lambda _: self._each(),
            device="cpu",
            body=self.body,
            body_model=options.body_model,
        )
        self.run.learn()

    def cover(self, passes: bool = True) -> tuple[Watched, Watched, Watched]:
        """Something in front for 3 s while the robot babbles, or nothing: the 3 s before, meanwhile, right after."""
        loop = self.run.loop
        y, x = np.nonzero(self.world.robot_mask())
        place = np.array([np.median(x), np.median(y)])
        columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        around = (np.abs(columns - place[0]) < PASSING / 2) & (np.abs(rows - place[1]) < PASSING / 2)
        self._each = lambda: self._watch(around)
        loop.babble(SECONDS)
        before = self._mean()
        if passes:
            self.covering.pass_by(place)
        loop.babble(SECONDS)
        meanwhile = self._mean()
        self.covering.stand(None)
        self._each = lambda: self._watch(around, every=1)
        loop.babble(AFTER * FRAME_SECONDS)
        after = self._mean()
        self._each = self._watch_reach
        return before, meanwhile, after

    def reach(self, where: str, number: int) -> HiddenReach:
        """Out of sight and back."""
        self.covering.stand(None)
        self._go_home()
        self.run.loop.babble(REST * FRAME_SECONDS)
        start = self.run.choose()
        assert self.run.surface_point is not None
        away, back = places_out_of_sight(self.world, self.run.surface_point, start, where, (self.seed, number))
        self.frames.clear()
        if where == "behind":
            self.covering.stand(away)
        first = self.run.reach(away)
        second = self.run.reach(back)
        unseen = [said for hidden, said in self.frames if hidden]
        return HiddenReach(
            self.seed, where, len(unseen), first.reach.end.value, first.true_error_px, second.reach.end.value,
            second.true_error_px, sum(unseen),
        )  # fmt: skip

    def _go_home(self) -> None:
        """Back to the posture in which everything began, where the point is in sight."""
        self.run.surface_point = None
        for _ in range(MOST_FRAMES):
            off = self._home - self.world.joints()[0]
            if np.abs(off).max() < AT_HOME:
                return
            self.run.loop.step(np.clip(off, -LARGEST_STEP, LARGEST_STEP))

    def _watch(self, around: np.ndarray, every: int = WATCHED_EVERY) -> None:
        """Error of J on the robot and on a part of the image, labels' overlap there and behind the plate."""
        if round(self.world.time / FRAME_SECONDS) % every:
            return
        J, mask = self.run.truth()
        estimated, labels = self.run.loop.estimator.to_numpy(), self.run.loop.pipeline.labels()
        plate = self.covering.plate
        self.watched.append(
            Watched(
                jacobian_error(estimated, J, mask).median,
                jacobian_error(estimated, J, mask & around).median,
                share_of_both(labels, mask),
                float((mask & plate).sum() / max(1, mask.sum())),
                share_of_both(labels & plate, mask & plate),
            )
        )

    def _mean(self) -> Watched:
        """Over the frames that were watched; what is behind the plate counts where there is anything."""
        rows, self.watched = np.array([astuple(row) for row in self.watched]), []
        known = np.where(np.isfinite(rows), rows, np.nan)
        return Watched(*(float(np.nanmean(c)) if np.isfinite(c).any() else float("nan") for c in known.T))

    def _watch_reach(self) -> None:
        run = self.run
        if run.surface_point is None or run.loop.tracker is None:
            return
        x, y = np.rint(run.project(run.surface_point)).astype(int)
        hidden = not (0 <= x < WIDTH and 0 <= y < HEIGHT) or bool(self.covering.plate[y, x])
        said = any(fault.kind is FaultKind.POINT for fault in run.loop.faults)
        self.frames.append((hidden, said))


def covered_score(seed: int, trial: HiddenTrial, twin: HiddenTrial) -> CoveredScore:
    """A plate before one robot, nothing before its twin."""
    before, meanwhile, after = trial.cover()
    without = twin.cover(passes=False)[2]
    return CoveredScore(
        seed, meanwhile.share, before.j, after.j, before.j_around, after.j_around, before.overlap, after.overlap,
        meanwhile.overlap, meanwhile.covered_overlap, without.j, without.j_around,
    )  # fmt: skip


def run_parts(run: tuple[int, list[str], argparse.Namespace]) -> tuple[list[CoveredScore], list[HiddenReach]]:
    """One seed's parts that need the same world, told as they come."""
    seed, parts, options = run
    wp.config.log_level = wp.LOG_ERROR
    covered: list[CoveredScore] = []
    reaches: list[HiddenReach] = []
    trial = HiddenTrial(seed, options, narrow="outside" in parts)
    if "covered" in parts:
        twin = HiddenTrial(seed, options)
        covered.append(covered_score(seed, trial, twin))
        twin.body.close()
        print(json.dumps({**asdict(covered[-1]), "ratio": covered[-1].ratio}), flush=True)
    for part in parts:
        for number in range(options.reaches if part != "covered" else 0):
            reaches.append(trial.reach(part, number))
            print(json.dumps({**asdict(reaches[-1]), "good": reaches[-1].good}), flush=True)
    trial.body.close()
    return covered, reaches


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0,1,2,3", help="of everything, by comma (default: 0,1,2,3)")
    parser.add_argument("--parts", default=",".join(PARTS), help=f"some of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--reaches", type=int, default=3, help="pairs of each kind and seed (default: 3)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of babbling (default: 10)")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time, a core each where above 1 (default: 1)")
    parser.add_argument("--no-model", dest="body_model", action="store_false", help="learn no body, for comparison")
    add_report_arguments(parser)
    options = parser.parse_args()
    parts = options.parts.split(",")
    if not set(parts) <= set(PARTS):
        parser.error(f"--parts is {options.parts}; expected some of {', '.join(PARTS)}, by comma")
    groups = [[part for part in parts if part != "outside"], [part for part in parts if part == "outside"]]
    runs = [(int(seed), chosen, options) for seed in options.seeds.split(",") for chosen in groups if chosen]
    results = map(run_parts, runs)
    if options.jobs > 1:
        os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "DENSE_VS_THREADS": "1"}
        results = multiprocessing.get_context("spawn").Pool(options.jobs).imap(run_parts, runs)
    covered: list[CoveredScore] = []
    reaches: list[HiddenReach] = []
    for more_covered, more_reaches in results:
        covered += more_covered
        reaches += more_reaches
    metrics = metrics_of(covered, reaches)
    print(table(["figure", "value"], [[m.name, f"{m.value:.3g}"] for m in metrics]))
    rows: dict[str, Any] = {"covered": [asdict(row) for row in covered], "reaches": [asdict(row) for row in reaches]}
    return report(metrics, options, **rows)


if __name__ == "__main__":
    raise SystemExit(main())
