"""What is measured of a hidden robot, with loops, plates and truths made by hand."""

import sys
from argparse import Namespace
from dataclasses import astuple
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import hidden_points
from hidden_points import AFTER, HiddenTrial, Watched, covered_score
from hidden_scores import CoveredScore, HiddenReach

from dense_vs.health.faults import FaultKind

POINT, OTHER = SimpleNamespace(kind=FaultKind.POINT), SimpleNamespace(kind=FaultKind.FROZEN)
PLATE = np.zeros((240, 320), bool)
PLATE[100:164, 200:264] = True


class Covering:
    """Says what it was told."""

    def __init__(self, calls):
        self.plate = PLATE.copy()
        self.pass_by = lambda place: calls.append(("passes", *place))
        self.stand = lambda place: calls.append(("stands", None if place is None else tuple(place)))


@pytest.fixture
def trial():
    """A trial without a robot; ``calls`` is what it asked for, in order."""
    one = HiddenTrial.__new__(HiddenTrial)
    one.seed, one.calls, one.frames, one.watched = 3, [], [], []
    one.world = SimpleNamespace(time=0.0)
    one.covering = Covering(one.calls)
    loop = SimpleNamespace(tracker="tracker", faults=[], babble=lambda seconds: one.calls.append(("babbles", seconds)))
    one.run = SimpleNamespace(loop=loop, surface_point="point", project=lambda point: np.array([0.0, 0.0]))
    return one


@pytest.mark.parametrize(
    ("place", "hidden"),
    [
        ((150.0, 120.0), False),
        ((210.0, 110.0), True),  # column, row
        ((110.0, 210.0), False),
        ((199.6, 99.6), True),  # by the nearest pixel
        ((199.4, 110.0), False),
        ((263.4, 163.4), True),
        ((263.6, 110.0), False),
        ((-0.4, 0.0), False),
        ((-0.6, 120.0), True),
        ((319.4, 239.4), False),
        ((319.6, 120.0), True),
        ((150.0, 239.6), True),
        ((150.0, -3.0), True),
        ((-1e4, 120.0), True),
    ],
)
@pytest.mark.parametrize(("faults", "said"), [([], False), ([OTHER], False), ([OTHER, POINT], True)])
def test_a_point_is_hidden_by_the_truth_and_said_to_be_by_a_fault(trial, place, hidden, faults, said):
    asked = []
    trial.run.project = lambda point: asked.append(point) or np.array(place)
    trial.run.loop.faults = faults
    trial._watch_reach()
    assert trial.frames == [(hidden, said)]
    assert asked == ["point"]  # the true one, not the tracked


def test_a_frame_without_a_point_is_not_one_of_a_reach(trial):
    trial.run.surface_point = None
    trial._watch_reach()
    trial.run.surface_point, trial.run.loop.tracker = "point", None
    trial._watch_reach()
    assert trial.frames == []


def test_everything_that_is_watched_in_a_frame(trial):
    """Ten pixels of the robot, eight labels, a plate before five of the robot's, J off by more around it."""
    mask, labels, plate, around = np.zeros((4, 2, 10), bool)
    mask[0] = True
    labels[0, 2:] = labels[1, 0] = True
    plate[:, 5:] = True
    around[:, 4:] = True
    true = np.full((2, 10, 2, 1), 2.0)
    off = np.array([0.1, 0.1, 0.2, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    estimated = true * (1 + np.stack([off, 9 + off]))[..., None, None]
    trial.covering.plate = plate
    trial.run.truth = lambda: (true, mask)
    trial.run.loop.estimator = SimpleNamespace(to_numpy=lambda: estimated)
    trial.run.loop.pipeline = SimpleNamespace(labels=lambda: labels)
    trial._watch(around)
    (watched,) = trial.watched
    assert watched.j == pytest.approx(0.35)
    assert watched.j_around == pytest.approx(0.55)  # of six pixels
    assert watched.overlap == pytest.approx(8 / 11)
    assert watched.share == 0.5
    assert watched.covered_overlap == 1.0
    labels[:, 8:] = False
    labels[1, 6] = True
    trial._watch(around)
    assert trial.watched[1].overlap == pytest.approx(6 / 12)
    assert trial.watched[1].covered_overlap == pytest.approx(3 / 6)
    mask[:] = False
    trial._watch(around)
    assert np.isnan([trial.watched[2].j, trial.watched[2].j_around]).all()
    assert trial.watched[2].share == 0.0


@pytest.mark.parametrize(("every", "frames"), [(None, [0, 6, 12, 18, 24]), (1, list(range(25))), (5, range(0, 25, 5))])
def test_only_some_frames_are_watched(trial, every, frames):
    seen = []
    trial.run.truth = lambda: seen.append(trial.frame) or (np.ones((1, 1, 2, 1)), np.ones((1, 1), bool))
    trial.run.loop.estimator = SimpleNamespace(to_numpy=lambda: np.ones((1, 1, 2, 1)))
    trial.run.loop.pipeline = SimpleNamespace(labels=lambda: np.ones((1, 1), bool))
    trial.covering.plate = np.ones((1, 1), bool)
    for trial.frame in range(25):
        trial.world.time = trial.frame / 30 + 1e-9 * (-1) ** trial.frame  # sums of frames' durations are not exact
        trial._watch(np.ones((1, 1), bool), *([] if every is None else [every]))
    assert seen == list(frames)
    assert len(trial.watched) == len(seen)


def test_means_are_of_what_is_known(trial):
    nan = float("nan")
    trial.watched = [Watched(0.1, nan, 0.8, 0.0, nan), Watched(0.3, 0.5, 0.6, 0.4, nan), Watched(nan, 0.7, 1, 0.2, nan)]
    found = trial._mean()
    assert astuple(found)[:4] == pytest.approx((0.2, 0.6, 0.8, 0.2))
    assert np.isnan(found.covered_overlap)
    assert trial.watched == []  # the next mean is of other frames


@pytest.mark.parametrize("passes", [True, False])
def test_a_plate_passes_in_the_middle_and_is_gone_when_it_is_compared(trial, passes):
    """Each babbling has frames of its own; the robot's middle is at (100, 60)."""
    mask = np.zeros((240, 320), bool)
    mask[60, 80:121] = mask[40:81, 100] = True
    trial.world.robot_mask = lambda: mask
    given = iter([0.1, 0.2, 0.3])

    def watch(around, every=hidden_points.WATCHED_EVERY):
        trial.calls.append(("watches", every))
        trial.watched.append(Watched(*[next(given)] * 5))
        y, x = np.nonzero(around)
        assert (x.min(), x.max(), y.min(), y.max()) == (59, 141, 19, 101)  # the plate's size, about the middle
        assert around.sum() == 83**2

    def babble(seconds):
        trial.calls.append(("babbles", seconds))
        trial._each()

    trial._watch, trial.run.loop.babble = watch, babble
    found = trial.cover() if passes else trial.cover(passes=False)
    assert found == tuple(Watched(*[value] * 5) for value in (0.1, 0.2, 0.3))
    assert trial.calls == [
        ("babbles", 3.0),
        ("watches", 6),
        *([("passes", 100.0, 60.0)] if passes else []),
        ("babbles", 3.0),
        ("watches", 6),
        ("stands", None),
        ("babbles", pytest.approx(5 / 30)),
        ("watches", 1),
    ]
    assert AFTER == 5
    assert trial._each == trial._watch_reach  # what follows are reaches


def test_what_is_measured_before_meanwhile_and_after_goes_where_it_belongs():
    """Before, meanwhile and after of a trial are 1, 2 and 3 and a tenth of its field; the twin's are 4 to 6."""

    def watched(number):
        return Watched(*[number + field / 10 for field in range(1, 6)])

    calls = []

    def covering(numbers):
        def cover(passes=True):
            calls.append(passes)
            return tuple(map(watched, numbers))

        return SimpleNamespace(cover=cover)

    score = covered_score(7, covering([1, 2, 3]), covering([4, 5, 6]))
    assert score == CoveredScore(
        seed=7,
        share=2.4,
        j_before=1.1,
        j_after=3.1,
        covered_before=1.2,
        covered_after=3.2,
        overlap_before=1.3,
        overlap_after=3.3,
        overlap_meanwhile=2.3,
        covered_overlap=2.5,
        j_without=6.1,
        covered_without=6.2,
    )
    assert len(set(astuple(score))) == 12
    assert calls == [True, False]  # nothing is in front of the twin


@pytest.mark.parametrize("where", ["behind", "outside"])
def test_a_reach_leads_out_of_sight_and_back(trial, monkeypatch, where):
    away, back = np.array([210.0, 110.0]), np.array([20.0, 30.0])

    def places(*asked):
        assert asked == (trial.world, "chosen", "start", where, (3, 2))
        return away, back

    def choose():
        trial.calls.append("chooses")
        trial.run.surface_point = "chosen"
        return "start"

    def reach(target):
        trial.calls.append(("reaches", *target))
        first = target is away
        trial.frames += [(True, True), (True, False), (False, True)] if first else [(True, True), (False, False)]
        end = SimpleNamespace(end=SimpleNamespace(value="lost" if first else "reached"))
        return SimpleNamespace(reach=end, true_error_px=8.0 if first else 0.5)

    monkeypatch.setattr(hidden_points, "places_out_of_sight", places)
    trial.frames = [(True, True)]  # of another reach
    trial.run.choose, trial.run.reach = choose, reach
    trial._go_home = lambda: trial.calls.append("goes home")
    assert trial.reach(where, 2) == HiddenReach(3, where, 3, "lost", 8.0, "reached", 0.5, 2)
    plate = [("stands", (210.0, 110.0))] if where == "behind" else []
    assert trial.calls == [
        ("stands", None), "goes home", ("babbles", 4.0), "chooses", *plate, ("reaches", 210, 110), ("reaches", 20, 30)
    ]  # fmt: skip


@pytest.mark.parametrize(("start", "steps"), [([0.5, 0.0], 17), ([0.0, 0.0099], 0), ([9.0, 0.0], 150)])
def test_the_way_home_is_gone_without_a_point(trial, start, steps):
    q, told = np.array(start), []

    def step(dq):
        told.append(np.abs(dq).max())
        q[:] += dq

    trial.world.joints, trial.run.loop.step, trial._home = (lambda: (q.copy(), 0.0)), step, np.zeros(2)
    trial._go_home()
    assert trial.run.surface_point is None
    assert len(told) == steps
    assert max(told, default=0.0) <= 0.03
    assert steps == 150 or np.abs(q).max() < 0.01


@pytest.mark.parametrize(
    ("parts", "made", "asked"),
    [
        (["covered", "behind"], [False, False], [("behind", 0), ("behind", 1)]),
        (["behind"], [False], [("behind", 0), ("behind", 1)]),
        (["outside"], [True], [("outside", 0), ("outside", 1)]),
    ],
)
def test_a_part_is_measured_in_its_own_world(monkeypatch, capsys, parts, made, asked):
    worlds, ended = [], []

    class Trial:
        def __init__(self, seed, options, narrow=False):
            worlds.append(narrow)
            self.number, self.asked = len(worlds), []
            self.body = SimpleNamespace(close=lambda: ended.append(self.number))

        def reach(self, part, number):
            assert self.number == 1
            self.asked.append((part, number))
            return HiddenReach(4, part, number, "lost", 8.0, "reached", 0.5, 0)

    score = CoveredScore(4, *[0.5] * 11)
    monkeypatch.setattr(hidden_points, "HiddenTrial", Trial)
    monkeypatch.setattr(
        hidden_points, "covered_score", lambda seed, trial, twin: (trial.number, twin.number) == (1, 2) and score
    )
    covered, reaches = hidden_points.run_parts((4, parts, Namespace(reaches=2)))
    assert worlds == made
    assert covered == ([score] if "covered" in parts else [])
    assert [(reach.where, reach.unseen_frames) for reach in reaches] == asked
    assert sorted(ended) == list(range(1, len(made) + 1))
    assert len(capsys.readouterr().out.splitlines()) == len(covered) + len(reaches)


def test_every_seed_and_part_is_run_once(monkeypatch, capsys):
    run, told = [], {}
    score, reach = CoveredScore(4, *[0.5] * 11), HiddenReach(4, "behind", 9, "lost", 8.0, "reached", 0.5, 7)

    def run_parts(one):
        run.append(one[:2])
        return ([score], []) if "covered" in one[1] else ([], [reach])

    monkeypatch.setattr(hidden_points, "run_parts", run_parts)
    monkeypatch.setattr(hidden_points, "report", lambda metrics, _, **rows: told.update(rows, metrics=metrics) or 5)
    monkeypatch.setattr(sys, "argv", ["hidden_points.py", "--seeds", "2,5"])
    assert hidden_points.main() == 5
    assert run == [(seed, parts) for seed in (2, 5) for parts in (["covered", "behind"], ["outside"])]
    assert [len(told[name]) for name in ("covered", "reaches")] == [2, 2]
    assert told["reaches"][0]["said_frames"] == 7
    assert {metric.name: metric.value for metric in told["metrics"]}["behind: frames unseen"] == 18
    assert "behind: frames unseen" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["hidden_points.py", "--parts", "covered,beside"])
    with pytest.raises(SystemExit):
        hidden_points.main()
