"""What the table of faults counts, with a loop, a robot and truths made by hand."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import faults

STUCK = SimpleNamespace(kind=SimpleNamespace(value="stuck joint"))


def measured(end="reached", true_error=0.5):
    return SimpleNamespace(reach=SimpleNamespace(end=SimpleNamespace(value=end)), true_error_px=true_error)


class Run:
    """Plays frames: time, true place and tracked place in x, faults that the loop names, whether it says lost."""

    def __init__(self, trial, errors=(), reaches=()):
        self.trial, self.errors, self.reaches = trial, list(errors), list(reaches)
        self.loop = SimpleNamespace(
            faults=[], tracker=None, point=np.zeros(2), joint_delay=0.0, frame=SimpleNamespace(time=0.0), pipeline=None
        )
        self.loop.babble = lambda seconds: self.calls.append(("babble", seconds))
        self.surface_point = None
        self.calls = []

    def play(self, *frames):
        for time, true, tracked, named, lost in frames:
            self.true = true
            self.trial.world.time = self.loop.frame.time = time
            self.loop.point, self.loop.faults = np.array([tracked, 0.0]), named
            self.loop.tracker = SimpleNamespace(lost=np.array([lost]))
            self.surface_point = "point"
            self.trial._after_frame(self)

    def project(self, _):
        return np.array([self.true, 0.0])

    def jacobian_error(self):
        return SimpleNamespace(median=self.errors.pop(0))

    def choose(self):
        self.calls.append("choose")

    def targets(self, count):
        return np.arange(2.0 * count).reshape(count, 2)

    def reach(self, target, max_frames):
        self.calls.append(("reach", float(target[0]), max_frames))
        frames, result = self.reaches.pop(0)
        self.play(*frames)
        return result


@pytest.fixture
def trial():
    one = faults.FaultTrial.__new__(faults.FaultTrial)
    one.arm, one.seed = "arm", 3
    one.world = SimpleNamespace(time=0.0, project=lambda name: name)
    one.begun, one.ended = [], []

    def begin(fault, joint, at):
        one.begun.append((fault, len(one.frames)))
        assert joint == 1  # the published figures are of this one
        return 2.0

    one.injector = SimpleNamespace(begin=begin, end=lambda: one.ended.append(len(one.begun)))
    one.named, one.frames, one.due, one.places = set(), [], None, {}
    return one


@pytest.mark.parametrize(
    ("tracked", "named", "lost", "frame"),
    [
        (13.0, [], False, (False, False, 3.0)),  # the border is not off
        (13.01, [], False, (True, False, 3.01)),
        (6.9, [STUCK], False, (True, True, 3.1)),
        (6.9, [], True, (True, True, 3.1)),
        (10.0, [STUCK], True, (False, True, 0.0)),
    ],
)
def test_a_frame_is_off_by_the_truth_and_flagged_by_what_is_said(trial, tracked, named, lost, frame):
    Run(trial).play((1.0, 10.0, tracked, named, lost))
    assert trial.frames == [pytest.approx(frame)]
    assert trial.named == ({"stuck joint"} if named else set())


@pytest.mark.parametrize(("delay", "distance"), [(0.0, 4.0), (-0.1, 2.0), (-0.2, 0.0), (0.1, 4.0)])
def test_the_truth_is_that_of_the_image_s_time(trial, delay, distance):
    """The point moves by 2 px every 0.1 s; readings that are late do not make an image newer."""
    run = Run(trial)
    run.loop.joint_delay = delay
    run.play((1.0, 0.0, 0.0, [], False), (1.1, 2.0, 0.0, [], False), (1.2, 4.0, 0.0, [], False))
    assert trial.frames[-1][2] == pytest.approx(distance)


def test_without_a_point_only_the_names_are_kept(trial):
    run = Run(trial)
    run.loop.faults = [STUCK]
    trial._after_frame(run)
    run.surface_point = "point"
    trial._after_frame(run)  # it has no tracker
    assert trial.frames == []
    assert trial.named == {"stuck joint"}


def frames_of(*states):
    """Frames from words: n is near, o is off and nothing said, f is off and a fault is named."""
    return [(0.1 * k, 0.0, 0.0 if s == "n" else 5.0 + 0.1 * k, [STUCK] if s == "f" else [], False)
            for k, s in enumerate("".join(states))]  # fmt: skip


def test_a_row_without_a_fault(trial):
    """What J's error and reaches come to when nothing breaks: no fault begins, neither babbling nor in the reach."""
    run = trial.run = Run(
        trial,
        errors=[*[0.1, 0.08, 0.12, 0.1, 0.1] * 3, 0.11, *[0.14, 0.15, 0.13, 0.16, 0.12] * 3],
        reaches=[(frames_of("nnnnnnnnn"), measured()), *[([], measured(true_error=px)) for px in (1.0, 2.0, 0.5)]],
    )
    row = trial.meet(faults.NOTHING, 4)
    assert (row.fault, row.before, row.at_end, row.after) == (
        faults.NOTHING,
        pytest.approx(0.1),
        0.11,
        pytest.approx(0.14),
    )
    assert trial.begun == []
    assert ("babble", faults.LASTS) in run.calls


def test_a_row_of_one_fault(trial):
    run = trial.run = Run(
        trial,
        errors=[*[0.1, 0.2, 0.1, 0.0, 0.1] * 3, 0.5, *[0.12, 0.12, 0.2, 0.04, 0.12] * 3],
        reaches=[
            (frames_of("nnnnnnn", "oo", "f", "ooo", "n", "o"), measured("missed", 7.0)),
            ([], measured(true_error=1.0)),
            ([], measured(true_error=2.0)),
            ([], measured("lost", 9.0)),
        ],
    )
    trial.named = {"from before"}
    row = trial.meet("stuck", 4)
    assert row == faults.Row("arm", 3, "stuck", pytest.approx(0.1), 0.5, pytest.approx(0.12), ["stuck joint"], "missed",
                             7.0, pytest.approx(6.4), 3, [1.0, 2.0, 9.0])  # fmt: skip
    # At once while it babbles; in the reach after six frames, and once.
    assert trial.begun == [("stuck", 0), ("stuck", 6)]
    assert trial.ended == [1, 2]
    # J's error over 3 s before, at the fault's end, from 1.5 s to 4.5 s after it, and once more before other reaches.
    assert [call[1] for call in run.calls if call[0] == "babble"] == [0.2] * 15 + [2.0, 1.5] + [0.2] * 15 + [1.0]
    assert [call for call in run.calls if call[0] == "reach"] == [("reach", x, 150) for x in (0.0, 2.0, 4.0, 6.0)]
    assert run.calls.count("choose") == 4
    assert run._seed == 304  # other targets for every fault


def test_a_row_without_a_frame_off(trial):
    trial.run = Run(
        trial,
        errors=[0.1] * 31,
        reaches=[(frames_of("nnnnnnnn"), measured())] + [([], measured())] * 3,
    )
    row = trial.meet("stuck", 0)
    assert (row.worst, row.unflagged, row.named, row.reach) == (0.0, 0, [], "reached")


def test_a_reach_that_ends_before_a_frame_was_never_off(trial):
    trial.run = Run(trial, errors=[0.1] * 31, reaches=[([], measured("lost"))] * 4)
    row = trial.meet("stuck", 0)
    assert (row.worst, row.unflagged) == (0.0, 0)
    trial.run = Run(trial, errors=[0.1] * 31, reaches=[([], measured("lost"))] * 5)
    trial.restart = lambda: None
    row = trial.meet_restart(0)
    assert (row.worst, row.unflagged) == (0.0, 0)


def test_a_row_of_a_restart(trial):
    first = Run(trial, errors=[0.1] * 15)
    second = Run(trial, errors=[0.2, *[0.15] * 15], reaches=[(frames_of("ooooo"), measured())])
    third = Run(
        trial,
        reaches=[
            (frames_of("noo", "f", "o"), measured("lost", 8.0)),
            *[([], measured(true_error=error)) for error in (1.0, 3.0, 0.0)],
        ],
    )
    runs = [second, third]
    trial.run = first

    def restart():
        trial.run = runs.pop(0)

    trial.restart = restart
    row = trial.meet_restart(2)
    # What was off before the second restart is not its reach's.
    assert row == faults.Row("arm", 3, faults.RESTART, pytest.approx(0.1), 0.2, pytest.approx(0.15), ["stuck joint"],
                             "lost", 8.0, pytest.approx(5.4), 2, [1.0, 3.0, 0.0])  # fmt: skip
    assert [call for call in second.calls if call != ("babble", 0.2)] == [("babble", 1.5), "choose", ("reach", 0.0, 6)]
    assert third.calls[:3] == [("babble", 3.0), "choose", ("reach", 0.0, 150)]
    assert [call[1] for call in third.calls[3:] if call != "choose"] == [2.0, 4.0, 6.0]
    assert third.calls.count("choose") == 4


def row(fault, seed=0, **figures):
    plain = {"arm": "arm", "seed": seed, "fault": fault, "before": 0.1, "at_end": 0.5, "after": 0.12, "named": []}
    plain |= {"reach": "reached", "reach_px": 1.0, "worst": 2.0, "unflagged": 0, "after_px": [1.0, 2.0, 0.5]}
    return {**plain, **figures}


def test_a_line_is_the_worst_of_its_rows():
    one, two, *_ = faults.NAMES
    lines = faults.summary(
        [
            row(two, before=0.2, at_end=0.2, after=0.2),
            row(one, named=["late images"]),
            row(one, 1, before=0.05, after=0.1, at_end=0.3, reach_px=2.0, worst=7.26, unflagged=4, named=["black"]),
            row(one, 2, reach="lost", after_px=[1.99]),
            row("of another program"),
        ]
    )
    # A reach counts that is said to be there and is, nearer than 2 px.
    assert lines == [
        [one, "0.05 to 0.10", "0.30 to 0.50", "0.10 to 0.12", "2.00", "5 of 7", "1 of 3", "7.3", "4",
         "black, late images"],
        [two, "0.20", "0.20", "0.20", "1.00", "2 of 3", "1 of 1", "2.0", "0", "nothing"],
    ]  # fmt: skip
    assert len(lines[0]) == len(faults.HEAD)
    assert faults.summary([]) == []
