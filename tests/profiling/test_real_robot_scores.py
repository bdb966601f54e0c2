"""What the humanoid's figures count, on flows, labels and marks made by hand."""

import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import g1_episodes
import real_robot
from real_robot import SIZE, Judge

Y, X = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
LEFT = X < 80


def along_x(values):
    flow = np.zeros((*SIZE, 2), np.float32)
    flow[..., 0] = values
    return flow


def judge_of(predicted, labels=None):
    judge = Judge.__new__(Judge)
    judge.memory, judge.labels = None, None
    for name in ("memory_frames", "own_memory_frames", "frames", "own_frames", "steady_frames"):
        setattr(judge, name, [])
    judge._predicted = predicted
    judge.done = SimpleNamespace(labels=lambda: labels, last_frame=None)
    if labels is not None:
        judge.labels = object()
    return judge


def test_only_pixels_that_move_by_more_than_a_limit_count():
    judge = judge_of(along_x(np.where(LEFT, 1.5, 0.2)))
    judge._add(along_x(np.where(LEFT, 2.0, 0.69)))
    rest, moved, motion = judge.frames[0]
    assert rest == moved == pytest.approx(0.25 * LEFT.sum())
    assert motion == pytest.approx(4 * LEFT.sum())
    assert judge.share(0, 1) == judge.share(0, 1, moved=True) == pytest.approx(1 - 0.25 / 4)
    judge._add(along_x(np.where(LEFT, 2.0, 0.71)))  # now everything moves
    rest, _, motion = judge.frames[1]
    assert rest == pytest.approx(0.25 * LEFT.sum() + 0.51**2 * (~LEFT).sum())
    assert motion == pytest.approx(4 * LEFT.sum() + 0.71**2 * (~LEFT).sum())


def test_motion_of_just_the_limit_does_not_count(monkeypatch):
    """A limit that single precision holds exactly."""
    monkeypatch.setattr(real_robot, "MOVING_PX", 0.75)
    judge = judge_of(along_x(0.5))
    judge._add(along_x(np.where(LEFT, 0.75, 1.0)))
    rest, _, motion = judge.frames[0]
    assert (rest, motion) == (0.25 * (~LEFT).sum(), (~LEFT).sum())


def test_motion_beside_the_camera_s_counts_from_the_same_limit():
    """The image is still but for a part of it, so that the camera's own motion is none."""
    arm = (X > 120) & (X < 180) & (Y > 60) & (Y < 120)
    for more, counted in ((0.8, True), (0.6, False)):
        judge = judge_of(along_x(np.where(arm, 0.5, 0.0)))
        judge._add(along_x(np.where(arm, more, 0.0)))
        rest, motion = judge.steady_frames[0]
        assert motion == pytest.approx(more**2 * arm.sum() * counted, rel=1e-3)
        assert rest == pytest.approx((more - 0.5) ** 2 * arm.sum() * counted, rel=1e-2)


def test_both_components_count():
    flow = np.stack([along_x(3.0)[..., 0], along_x(4.0)[..., 0]], axis=2)
    judge = judge_of(flow / 2)
    judge._add(flow)
    assert judge.frames[0] == pytest.approx((6.25 * X.size, 6.25 * X.size, 25 * X.size))


@pytest.mark.parametrize("axis", [0, 1])
def test_the_moved_prediction_is_that_of_where_the_pixel_came_from(axis):
    """A prediction of p x / 10 moves a pixel that is now at x from x / 1.1, so that its flow is x / 11."""
    place = (X, Y)[axis]
    predicted, flow = np.zeros((*SIZE, 2), np.float32), np.zeros((*SIZE, 2), np.float32)
    predicted[..., axis], flow[..., axis] = place / 10, place / 11
    judge = judge_of(predicted)
    judge._add(flow)
    rest, moved, motion = judge.frames[0]
    assert moved < 1e-4 * motion
    assert rest == pytest.approx(0.01 * motion, rel=1e-3)
    assert judge.share(0, 1) == pytest.approx(0.99, abs=1e-3)
    assert judge.share(0, 1, moved=True) > 0.9999


def test_shares_lie_between_fractions_of_the_episode():
    judge = judge_of(along_x(0))
    judge.frames = [(10.0, 5.0, 10.0)] * 2 + [(1.0, 2.0, 10.0)] * 4 + [(6.0, 8.0, 10.0)]
    judge.own_frames = judge.steady_frames = [(rest, motion) for rest, _, motion in judge.frames]
    assert judge.share(0, 0.25) == pytest.approx(0.0)  # two of seven frames, rounded up
    assert judge.share(0.25, 1) == pytest.approx(1 - 10 / 50)
    assert judge.share(0.25, 1, moved=True) == pytest.approx(1 - 16 / 50)
    assert judge.share(0, 1) == pytest.approx(1 - 30 / 70)
    judge.own_frames = [(4.0, 8.0), (3.0, 4.0)]
    judge.steady_frames = [(1.0, 8.0), (1.0, 2.0)]
    assert judge.own_share(0, 1) == pytest.approx(1 - 7 / 12)
    assert judge.own_share(0.5, 1) == pytest.approx(0.25)
    assert judge.steady_share(0, 1) == pytest.approx(0.8)
    assert judge.steady_share(0, 0.5) == pytest.approx(1 - 1 / 8)
    judge.own_frames = [(1.0, 1.0), (0.0, 1.0), (1.0, 2.0), (0.0, 4.0), (3.0, 4.0)]
    assert judge.own_share(0, 0.25) == pytest.approx(0.5)  # two of five frames, rounded up
    assert judge.own_share(0.25, 1) == pytest.approx(1 - 4 / 10)


def test_the_arm_s_own_pixels_are_those_labeled_that_move():
    own = X < 40
    judge = judge_of(along_x(np.where(own, 1.0, 0.0)), labels=own)
    judge._add(along_x(np.where(LEFT & (Y < 100), 2.0, 0.0)))
    count = (own & (Y < 100)).sum()
    assert judge.own_frames == [pytest.approx((count, 4 * count))]


def test_the_camera_s_own_motion_is_taken_out_of_the_steady_share():
    """The camera moves everything by 1.5 px, the arm its part by 3 px more; J knows half of that."""
    arm = (X > 120) & (X < 180) & (Y > 60) & (Y < 120)
    judge = judge_of(along_x(np.where(arm, 1.5, 0.0)))
    judge._add(along_x(np.where(arm, 4.5, 1.5)))
    rest, motion = judge.steady_frames[0]
    assert motion == pytest.approx(9 * arm.sum(), rel=0.02)
    assert rest == pytest.approx(2.25 * arm.sum(), rel=0.03)
    rest, _, motion = judge.frames[0]
    assert rest == pytest.approx(9 * arm.sum() + 2.25 * (~arm).sum(), rel=1e-4)
    assert motion == pytest.approx(4.5**2 * arm.sum() + 2.25 * (~arm).sum(), rel=1e-4)


def test_a_memory_is_judged_by_the_joints_of_the_frame():
    own = X < 40
    judge = judge_of(along_x(0), labels=own)
    judge.done.last_frame = SimpleNamespace(positions="q", dq="dq")
    judge.memory = SimpleNamespace(flow=lambda q, dq: along_x(0.5) if (q, dq) == ("q", "dq") else None)
    judge._add(along_x(np.where(LEFT, 2.0, 0.3)))
    assert judge.memory_frames == [pytest.approx((2.25 * LEFT.sum(), 4 * LEFT.sum()))]
    assert judge.own_memory_frames == [pytest.approx((2.25 * own.sum(), 4 * own.sum()))]


class Estimate:
    """Frames of a texture that moves by 2 px to the right, and a J that predicts what it is told."""

    def __init__(self, episode, **options):
        self.options = options
        self.estimator = SimpleNamespace(predicted_flow=lambda dq: along_x(dq[0]))
        self.steps = episode

    def __iter__(self):
        texture = np.random.default_rng(0).uniform(0, 255, (60, 100)).astype(np.float32)
        wide = cv2.resize(texture, (400, 240), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
        for k, step in enumerate(self.steps):
            self.options["before_update"](0.0, None, np.array([step]))
            gray = np.ascontiguousarray(wide[:, 40 - 2 * k : 360 - 2 * k])
            yield SimpleNamespace(flow=None if k == 0 else "some", gray=gray), None


@pytest.mark.parametrize(("step", "share"), [(2.0, 1.0), (0.0, 0.0), (-2.0, -3.0), (1.0, 0.75)])
def test_motion_is_from_the_image_before_to_this_one(monkeypatch, step, share):
    monkeypatch.setattr(real_robot, "RecordedEstimate", Estimate)
    judge = Judge([step] * 4)
    assert len(judge.frames) == 3  # the first image has no motion
    assert judge.share(0, 1) == pytest.approx(share, abs=0.05 * (1 + abs(share)))
    assert judge.done.options["scale"] == 0.5
    assert not judge.done.options["label"]
    assert len(Judge([step] * 4, most=2).frames) == 2


def test_j_is_carried_through_episodes_in_their_order(tmp_path, monkeypatch):
    ran = []

    class Carried:
        def __init__(self, episode, *, start, **_):
            ran.append((episode, start))
            self.estimator = SimpleNamespace(save=lambda file: file.write_text(f"{start}+{episode}"))

        def __iter__(self):
            return iter([1, 2])

    def episode(number):
        return SimpleNamespace(shifted=lambda clock: f"{number}{clock}")

    monkeypatch.setattr(real_robot, "RecordedEstimate", Carried)
    monkeypatch.setattr(real_robot, "open_recording", lambda data, joint_names: SimpleNamespace(episode=episode))
    monkeypatch.setattr(real_robot.DenseJacobian, "load", lambda file, device: file.read_text())
    carried = real_robot.CarriedOn({5: "a", 10: "b", 20: "c"}, tmp_path)
    assert carried.after([]) is None
    assert carried.after([5, 20]) == "None+5a+20c"
    assert carried.after([5, 10]) == "None+5a+10b"
    assert [one for one, _ in ran] == ["5a", "20c", "10b"]  # what both begin with ran once


@pytest.fixture
def found(monkeypatch, tmp_path):
    """Metrics of the program with episodes made by hand: E is the episode's number in hundredths."""
    seen, tolerances = {}, {}

    class One:
        def __init__(self, number, clocks, carried, remembered):
            assert set(clocks) == set(real_robot.NUMBERS)
            names = ("arm", "first quarter, from nothing")
            self.shares = {name: number / 100 for name in names}
            self.offset = SimpleNamespace(seconds=0.1)
            self.offset_errors = [0.001 * number, -0.05] if number == 20 else [0.001, 0.002]
            self.labels = [(number / 100, number / 50)] * (2 if number == 5 else 1)
            self.repeated = 0.5

    recording = SimpleNamespace(episode=lambda number: number)
    marks = [{"episode": 5}]
    monkeypatch.setattr(real_robot, "DATA", tmp_path)
    monkeypatch.setattr(real_robot, "OneEpisode", One)
    monkeypatch.setattr(real_robot, "open_recording", lambda data, joint_names: recording)
    monkeypatch.setattr(real_robot, "survey_episode", lambda number: SimpleNamespace(offset=number))
    monkeypatch.setattr(real_robot, "Remembered", lambda clocks: None)
    monkeypatch.setattr(real_robot, "marked_points", lambda: marks)
    distances = np.array([0.5, 9.0, 1.5, 0.7, 0.6]), np.array([False, True, False, False, False])
    monkeypatch.setattr(real_robot, "tracking_errors", lambda mark: distances)

    def report(metrics, _):
        seen.update({m.name: m.value for m in metrics})
        tolerances.update({m.name: m.tolerance for m in metrics})
        return 0

    monkeypatch.setattr(real_robot, "report", report)
    monkeypatch.setattr(sys, "argv", ["real_robot.py"])
    assert real_robot.main() == 0
    assert {name: share for name, share in tolerances.items() if name.startswith("E, ")} == {
        "E, arm, tuned": 0.02,
        "E, arm, confirmed": 0.02,
        "E, first quarter, from nothing, tuned": 0.02,
        "E, first quarter, from nothing, confirmed": 0.02,
        "E, first quarter, from nothing, least": 0.02,
    }
    assert tolerances["offset, worst miss of a shift by 200 ms"] == 0.5
    assert tolerances["point of the hand, episode 5, median error"] == 0.5
    assert tolerances["point of the hand, episode 5, worst error not flagged"] == 1.0
    return seen


def test_tuned_and_confirmed_episodes_are_kept_apart(found):
    assert found["E, arm, tuned"] == pytest.approx((5 + 20 + 37) / 300)
    assert found["E, arm, confirmed"] == pytest.approx((10 + 28 + 43) / 300)
    assert found["E, first quarter, from nothing, least"] == 0.05
    assert "E, arm, least" not in found
    assert found["offset, worst miss of a shift by 200 ms"] == pytest.approx(50)
    tuned, confirmed = (5 + 5 + 20 + 37 + 10) / 5, (28 + 43) / 2  # episode 10 tuned the labels
    assert found["labels, IoU, 5 frames, tuned"] == pytest.approx(tuned / 100)
    assert found["labels, recall, 5 frames, tuned"] == pytest.approx(tuned / 50)
    assert found["labels, IoU, 2 frames, confirmed"] == pytest.approx(confirmed / 100)


def test_what_is_flagged_does_not_count_as_the_worst(found):
    assert found["point of the hand, episode 5, median error"] == pytest.approx(0.7)
    assert found["point of the hand, episode 5, worst error not flagged"] == pytest.approx(1.5)


class Asked:
    """Stands in for a judge: its shares say what it was asked and how it was made."""

    def __init__(self, episode, **options):
        self.episode, self.options = episode, options
        self.labels = SimpleNamespace(quality=lambda: ["quality"]) if options.get("label") else None
        self.frames = [0] * 9
        self.memory_frames, self.own_memory_frames = [(1.0, 2.0), (0.0, 2.0)], [(0.0, 1.0), (1.0, 9.0)]
        self.done = SimpleNamespace(repeated=3, images=12)

    def share(self, begin, end, moved=False):
        return ("share", self, begin, end, moved)

    def own_share(self, begin, end):
        return ("own", self, begin, end)

    def steady_share(self, begin, end):
        return ("steady", self, begin, end)


class Log:
    def __init__(self, number, names="all", shift=0):
        self.number, self.names, self.shift = number, names, shift

    def shifted(self, shift):
        return Log(self.number, self.names, shift)


def test_an_episode_is_judged_by_what_the_others_taught(monkeypatch):
    def recording(data, joint_names="all"):
        return SimpleNamespace(episode=lambda number: Log(number, joint_names))

    monkeypatch.setattr(real_robot, "open_recording", recording)
    monkeypatch.setattr(real_robot, "Judge", Asked)
    # The finder is 10 ms off where the log is shifted back, 20 ms where it is shifted on.
    miss = {-real_robot.SHIFT: 0.01, real_robot.SHIFT: 0.02}

    def survey(log):
        return SimpleNamespace(offset=SimpleNamespace(seconds=0.1 - log.shift + miss[log.shift]))

    monkeypatch.setattr(real_robot, "survey_episode", survey)
    monkeypatch.setattr(real_robot.BodyPrior, "of", lambda memory, size, joints: ("prior", memory, size, joints))
    remembered = SimpleNamespace(of=lambda numbers: SimpleNamespace(numbers=numbers, joint_count=7))
    carried = SimpleNamespace(after=lambda numbers: ("after", numbers))
    clocks = {number: SimpleNamespace(seconds=0.1) for number in real_robot.NUMBERS}
    one = real_robot.OneEpisode(20, clocks, carried, remembered)
    assert one.offset_errors == pytest.approx([0.01, 0.02])
    assert one.repeated == 0.25
    assert one.labels == ["quality"]
    shares = one.shares
    kind, whole, *rest = shares["arm"]
    assert (kind, rest) == ("share", [0.25, 1.0, False])
    assert (whole.episode.number, whole.episode.shift) == (20, clocks[20])
    assert whole.options["memory"].numbers == [5, 37, 10, 28, 43]  # never the episode that it is judged on
    assert shares["arm, moved"] == ("share", whole, 0.25, 1.0, True)
    assert shares["arm, its own pixels"] == ("own", whole, 0.25, 1.0)
    assert shares["arm, without sway"] == ("steady", whole, 0.25, 1.0)
    assert shares["arm, from the first image"] == ("share", whole, 0, 1, False)
    assert shares["arm, its own pixels, from the first image"] == ("own", whole, 0, 1)
    assert shares["first quarter, from nothing"] == ("share", whole, 0, 0.25, False)
    assert shares["arm, model of the other five, no update"] == 0.75
    assert shares["arm, its own pixels, model of the other five, no update"] == pytest.approx(0.9)
    updated = shares["arm, model of the other five, with updates"][1]
    assert updated.options["prior"][1] is whole.options["memory"]
    assert updated.options["label"]
    assert shares["arm, model of the other five, with updates"] == ("share", updated, 0, 1, False)
    assert shares["first quarter, model of the other five, with updates"] == ("share", updated, 0, 0.25, False)
    again = shares["first quarter, from the other five"]
    assert again[2:] == (0, 1, False)
    assert again[1].options == {"start": ("after", [5, 10, 28, 37, 43]), "most": 3}  # a quarter of nine, rounded up
    assert shares["log as stamped"][1].episode.shift == 0
    assert shares["flow dis"][1].options == {"method": "dis"}
    assert shares["joints not smoothed"][1].options == {"smoothing": 0.0}
    sway = shares["sway taken out of J"][1]
    assert sway.options == {"sway": True}
    assert shares["sway taken out of J, without sway"] == ("steady", sway, 0.25, 1.0)
    assert shares["arm and hand"][1].episode.names == g1_episodes.ARM_AND_HAND
    assert shares["all 26 joints"][1].episode.names == "all"
    for name in ("flow dis", "joints not smoothed", "sway taken out of J", "arm and hand", "all 26 joints"):
        assert shares[name][1].episode.shift == clocks[20]
