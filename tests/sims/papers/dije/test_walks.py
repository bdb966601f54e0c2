"""Which frames of a walk are scored and shown, with labelers and views made by hand."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.dije import label_pictures, labeling, labels, leak, leak_figure, transport
from dense_vs.sims.papers.dije.labeling import View, _distractor_geoms, make_labelers, views

BAR = SimpleNamespace(update=lambda: None, set_description=lambda _: None)


def columns(first, last):
    mask = np.zeros((20, 40), bool)
    mask[:, first:last] = True
    return mask


def view(index, time, walker=(30, 35), robot=(0, 10), flow=2.0):
    moved = np.zeros((20, 40, 2), np.float32)
    moved[..., 0] = flow
    return View(index, time, np.zeros((20, 40, 3), np.uint8), moved, np.zeros(4), columns(*robot), columns(*walker))


class Labeler:
    """Labels the first columns, as many as frames were taken; keeps what it was asked."""

    def __init__(self, name="default"):
        self.name, self.taken, self.scored, self.iou = name, [], [], []
        self.body = SimpleNamespace(clusters_wanted=5, threshold=0.2)
        self.estimator = SimpleNamespace(to_numpy=lambda: f"J of {name} after {len(self.taken)}")

    def take(self, one):
        self.taken.append(one.index)

    def score(self, one):
        self.scored.append(one.index)
        self.iou.append(one.index / 100)

    def labels(self):
        return columns(0, min(len(self.taken), 40))


class Carried:
    """A transport that covers columns 6 to 13 and leaks a quarter."""

    made = None

    def __init__(self, J, own, prediction, device, threads):
        Carried.made.append((J, int(own[0].sum()), prediction))
        self.taken = []
        Carried.of[prediction] = self

    def take(self, one):
        self.taken.append(one.index)

    def own(self):
        return columns(6, 13)

    def leak(self):
        return 0.25


@pytest.fixture
def walked(monkeypatch):
    def run(frames, last=None):
        Carried.made, Carried.of = [], {}
        made = []

        def make(seed, device, threads, prediction="model"):
            made.append(prediction)
            return {"default": Labeler("default"), "paper": Labeler(prediction)}

        monkeypatch.setattr(labeling, "make_labelers", make)
        monkeypatch.setattr(labeling, "views", lambda seed, arguments: frames)
        monkeypatch.setattr(transport, "Transport", Carried)
        return leak.run_seed(3, Namespace(device="cpu", threads=None), BAR)

    return run


def test_a_walk_is_scored_after_warming_up_and_transported_for_a_hundred_frames(walked):
    frames = [view(k, k / 30, walker=(30, 31 + (k % 7 == 0) * 3)) for k in range(1, 400)]
    found = walked(frames)
    assert {name: one.name for name, one in found.labelers.items()} == {
        "default": "default",
        "(13)": "flow",
        "(14)": "model",
    }
    for one in found.labelers.values():
        assert one.taken == list(range(1, 400))
        assert one.scored == list(range(120, 400, 5))  # every fifth from 4 s on
    assert found.shown.index == 140  # the first scored in which most of the walker is seen
    assert {int(own[0].sum()) for own in found.shown_labels.values()} == {40}
    # The default's J and labels of the frame at 8 s go on without any correction.
    assert Carried.made == [("J of default after 240", 40, "flow"), ("J of default after 240", 40, "model")]
    for one in Carried.of.values():
        assert one.taken == list(range(241, 341))
    assert found.transport_view.index == 340
    for name in ("(13)", "(14)"):
        assert found.transported[name] == (0.3, 0.6, 0.25)  # beyond the arm, lost of it, of the walker
        np.testing.assert_array_equal(found.transport_labels[name], columns(6, 13))
    assert found.seed == 3


def test_a_walk_that_is_too_short_is_not_transported(walked):
    found = walked([view(k, k / 30) for k in range(1, 240)])
    assert Carried.made == []
    assert found.transported == {}
    assert found.transport_view is None


def test_every_seed_walks_once(monkeypatch, tmp_path):
    ran = []
    monkeypatch.setattr(leak, "run_seed", lambda seed, arguments, bar: ran.append(seed) or seed)
    monkeypatch.setattr(leak, "leak_rows", lambda runs: runs)
    monkeypatch.setattr(leak_figure, "draw_leak", lambda *_: None)
    monkeypatch.setattr(leak_figure, "plot_leak", lambda *_: None)
    arguments = Namespace(seconds=12.0, period=0.7, seeds=[5, 6], out=tmp_path)
    assert leak.run(arguments) == [5, 6] == ran


@pytest.fixture
def pictured(monkeypatch, tmp_path):
    """Rows of a run of 3 s over views made by hand, its labelers, and which frames were drawn and written."""

    def run(seen, seeds=(4,)):
        drawn, both = [], {name: Labeler(name) for name in ("default", "paper")}
        monkeypatch.setattr(labeling, "make_labelers", lambda *_: both)
        monkeypatch.setattr(labeling, "views", lambda seed, arguments: seen(seed) if callable(seen) else seen)
        monkeypatch.setattr(labels, "draw_stages", lambda one, labelers: drawn.append(one.index) or one.index)
        monkeypatch.setattr(label_pictures, "write_image", lambda path, image: drawn.append((path.name, image)))
        monkeypatch.setattr(labels, "check_labeling_arguments", lambda *_: None)
        return labels.run(Namespace(seconds=3.0, seeds=[*seeds], device="cpu", threads=None, out=tmp_path)), both, drawn

    return run


def test_the_picture_is_of_a_late_frame_with_much_to_see(pictured):
    """Every fifth frame after 0.6 of the time is looked at: 50 is too early, and 71 is none of them."""
    shown = {50: 9.0, 65: 1.0, 70: 3.0, 71: 9.0, 80: 2.0}
    seen = [view(k, k / 30, flow=shown.get(k, 0.1)) for k in range(1, 91)]
    seen[84] = view(85, 85 / 30, walker=(0, 0), flow=0.2)  # the walker is not seen: the robot's motion alone counts
    rows, both, drawn = pictured(seen)
    assert drawn == [55, 65, 70, ("seed4.png", 70)]
    assert [row.ours for row in rows] == [5, 0.2, 0.7, 0.7]
    assert [row.paper for row in rows] == [5, 0.2, None, None]
    assert both["default"].taken == list(range(1, 91))


def test_labels_are_scored_in_the_picture_of_every_seed(pictured):
    """Seed 4's is frame 65 and seed 5's frame 85; labelers go on, so each has the IoU of the last one scored."""

    def seen(seed):
        return [view(k, k / 30, flow=1.0 if k == {4: 65, 5: 85}[seed] else 0.1) for k in range(1, 91)]

    rows, _, drawn = pictured(seen, (4, 5))
    assert [what for what in drawn if isinstance(what, tuple)] == [("seed4.png", 65), ("seed5.png", 85)]
    assert [row.ours for row in rows] == [5, 0.2, 0.75, 0.75]
    assert rows[2].seeds == (4, 5)


def test_the_picture_shows_robot_and_walker_both_moving(pictured):
    seen = [view(k, k / 30, walker=(30, 40), flow=1.0) for k in range(1, 91)]  # both of one size
    seen[59].flow[:, :10] = 9.0  # frame 60: the robot alone moves more
    seen[64].flow[:, 30:] = 9.0  # frame 65: the walker alone
    seen[69].flow[:] = 1.5  # frame 70: both
    _, _, drawn = pictured(seen)
    assert drawn == [55, 70, ("seed4.png", 70)]


def test_where_nothing_moves_the_first_late_frame_is_the_picture(pictured):
    rows, _, drawn = pictured([view(k, k / 30, flow=0.0) for k in range(1, 91)])
    assert drawn == [55, ("seed4.png", 55)]
    assert [row.ours for row in rows[2:]] == [0.55, 0.55]


def test_how_much_there_is_to_see():
    one = view(1, 0.1, flow=3.0)
    assert labels._motion(one, columns(0, 10)) == pytest.approx(3.0 * 0.5)
    assert labels._motion(one, columns(0, 40)) == pytest.approx(3.0)
    assert labels._motion(one, columns(0, 0)) == 0.0


class World:
    """Two joints that go where they are sent, a frame later; the ids of an image are its frame's number."""

    def __init__(self, name, *, joints, **options):
        self.options, self.q, self.number = options, np.array([0.95, 0.0, 0.0, 0.0]), 0
        self.joint_limits = np.array([[-1.0, 1.0]] * 4)

    def frame(self):
        ids = np.array([[7, 8], [9, 0]])
        return SimpleNamespace(rgb=np.full((2, 2, 3), self.number, np.uint8), ids=ids)

    def joints(self):
        return self.q.copy(), self.number / 30

    def robot_mask(self):
        return np.eye(2, dtype=bool)


@pytest.fixture
def seen(monkeypatch):
    made = {}

    class Robot:
        def __init__(self, world, command_seconds):
            made.update(world=world, seconds=command_seconds, sent=[])

        def command(self, delta):
            made["sent"].append(np.array(delta))
            made["world"].q = made["world"].q + delta
            made["world"].number += 1

    class Steps:
        def __init__(self, joints, seed, frame_time):
            made.update(frame_time=frame_time, joints=joints)

        def step(self):
            return np.array([0.04, -0.1, 0.0, 0.02])

    monkeypatch.setattr(labeling, "SimWorld", World)
    monkeypatch.setattr(labeling, "SimRobot", Robot)
    monkeypatch.setattr(labeling, "Babbling", Steps)
    monkeypatch.setattr(labeling, "_distractor_geoms", lambda world: np.array([8, 9]))
    monkeypatch.setattr(labeling, "to_gray", lambda rgb: int(rgb[0, 0, 0]))
    monkeypatch.setattr(labeling, "FlowEstimator", lambda method: lambda before, now: (before, now))

    def run(seconds, period):
        arguments = Namespace(distractor="walker", device="cpu", threads=None, seconds=seconds, period=period)
        return list(views(1, arguments)), made

    return run


def test_views_are_the_frames_after_the_first_with_their_truth(seen):
    found, made = seen(0.3, 0.1)
    assert [one.index for one in found] == list(range(1, 10))
    assert [one.flow for one in found] == [(k, k + 1) for k in range(9)]
    np.testing.assert_allclose([one.time for one in found], np.arange(1, 10) / 30)
    # A command every third frame, cut at the limit of the first joint; its target is what was sent.
    sent = np.array(made["sent"])
    assert (np.flatnonzero(np.abs(sent).any(axis=1)) == [0, 3, 6]).all()
    np.testing.assert_allclose(sent[[0, 3, 6]][:, 0], [0.04, 0.01, 0.0])
    np.testing.assert_allclose(sent[[0, 3, 6]][:, 1], -0.1)
    np.testing.assert_allclose([one.dq for one in found], sent)
    np.testing.assert_array_equal(found[0].walker, [[False, True], [True, False]])
    np.testing.assert_array_equal(found[0].robot, np.eye(2, dtype=bool))
    assert made["frame_time"] == pytest.approx(0.1)
    assert (made["seconds"], made["joints"], made["world"].options["distractor"]) == (0.1, 4, "walker")


def test_without_a_period_every_frame_has_a_command(seen):
    found, made = seen(0.1, 0.0)
    assert len(found) == 3
    assert np.array(made["sent"]).any(axis=1).all()


def test_a_walker_is_what_hangs_on_its_body():
    model = SimpleNamespace(
        body_mocapid=np.array([-1, 0, -1, 1]), body_rootid=np.array([0, 1, 1, 3]), geom_bodyid=np.array([0, 2, 1, 3, 2])
    )
    for mocap, geoms in ((0, [1, 2, 4]), (1, [3]), (-1, [])):
        world = SimpleNamespace(scene=SimpleNamespace(model=model, distractor=mocap))
        assert _distractor_geoms(world).tolist() == geoms


def test_ours_and_the_paper_s_labelers_see_the_same_but_differ():
    both = make_labelers(0, "cpu", 1, prediction="flow")
    try:
        assert both["paper"].estimator.options.covariance == "diagonal"
        assert both["paper"].estimator.options.prediction == "flow"
        assert both["paper"].estimator.options.prediction_iterations == 1
        assert both["default"].estimator.options.covariance != "diagonal"
        assert both["default"].estimator.options.joints == 4
    finally:
        for one in both.values():
            one.body.close()


def test_a_labeler_submits_every_third_frame():
    done = []
    estimator = SimpleNamespace(update=lambda *_: done.append("update"), jacobian="J")
    body = SimpleNamespace(observe=lambda *_: done.append("observe"), submit=lambda J: done.append(f"submit {J}"))
    labeler = labeling.Labeler(estimator, body)
    for k in range(1, 7):
        labeler.take(view(k, k / 30))
    assert done == ["update", "observe"] * 3 + ["submit J"] + ["update", "observe"] * 3 + ["submit J"]
