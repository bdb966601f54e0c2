"""How a body model is scored in a simulated world: true links, postures that were not seen, figures of a failed fit."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import body_model
from body_scores import BodyScore

from dense_vs.errors import DenseVSError

ASKED = {"points_median": 1.0, "depth": 6.0, "within": 0.7}


def error(median, p90=0.0):
    return SimpleNamespace(median=median, p90=p90)


def test_a_link_is_the_last_joint_that_moves_the_pixel():
    J = np.zeros((2, 3, 2, 4))
    J[0, 0, 1, 0] = J[0, 1, 0, 1] = 5.0
    J[0, 1, 0, 0] = J[0, 2, 1, 2] = -4.0
    J[1, 0, 0, 2] = 5e-5  # as good as none
    J[1, 1, 1, 2] = -1e-4
    J[1, 2] = 1.0  # not of the robot
    mask = np.array([[True, True, True], [True, True, False]])
    world = SimpleNamespace(true_jacobian=lambda: J, robot_mask=lambda: mask)
    np.testing.assert_array_equal(body_model.true_links(world), [[0, 1, 2], [-1, -1, -1]])


def test_a_track_near_another_link_has_no_true_link():
    links = np.zeros((20, 20), int)
    links[:, 10:] = 1
    links[:, 19] = -1
    stride = body_model.PointTrackOptions().stride
    seen = SimpleNamespace(links={0: links, 2 * stride: links + 5})
    begin = [(0, 7.4, 5.0), (0, 7.6, 5.0), (0, 11.4, 0.0), (0, 12.0, 19.0), (0, 17.0, 5.0), (2, 3.0, 3.0)]
    pixels = np.full((3, len(begin), 2), np.nan)
    for m, (frame, x, y) in enumerate(begin):
        pixels[frame, m] = x, y
    tracks = SimpleNamespace(pixels=pixels, references=np.array([one[0] for one in begin]))
    np.testing.assert_array_equal(body_model.link_truth(seen, tracks), [0, -2, -2, 1, -2, 5])


class AskedWorld:
    """Robot in the left half of a 4 x 8 image; a point's place is its pixel moved by the joints."""

    def __init__(self):
        self.q = np.array([1.0, 1.0])
        self.joint_names = ["a", "b"]
        self.steps = []
        self.tracked = []

    def joints(self):
        return self.q.copy(), 0.0

    def step(self, dq):
        self.steps.append(np.abs(dq).max())
        self.q = self.q + dq

    def robot_mask(self):
        return np.arange(8)[None, :].repeat(4, axis=0) < 4

    def true_jacobian(self):
        J = np.zeros((4, 8, 2, 2))
        J[:, 1:, 0] = 0.5  # the first column stands still: no place for points
        return J

    def track_point(self, pixel):
        assert 1 <= pixel[0] < 4
        self.tracked.append(tuple(pixel))
        return pixel - self.q

    def project(self, point):
        return point + self.q

    def frame(self):
        return SimpleNamespace(depth=np.tile(2.0 + np.arange(8.0), (4, 1)))


def test_a_model_is_asked_about_postures_that_it_has_not_seen(monkeypatch):
    world, asked = AskedWorld(), []

    class Model:
        precision = None

        def points(self, q):
            return SimpleNamespace(pixels=np.zeros((0, 2)), covariances=np.zeros((0, 2, 2)))

        def trace(self, pixels, q_seen, q):
            np.testing.assert_array_equal(q_seen, [1.0, 1.0])
            asked.append(q)
            off = np.where(np.arange(len(pixels)) < 0.25 * len(pixels), np.nan, 3.0)
            return pixels - q_seen + q + np.array([0.0, 1.0]) * off[:, None]

        def jacobian(self, q):
            return "J"

        def image(self, q):
            body = np.arange(8)[None, :].repeat(4, axis=0) < (6 if len(asked) % 4 else 8)
            depths = 3.0 * world.frame().depth  # of any unit
            depths[:, 0] *= 1.5
            depths[:, 3] *= 0.5
            return SimpleNamespace(body=body, depths=depths)

    medians = iter(np.arange(1.0, 9.0))
    monkeypatch.setattr(body_model, "jacobian_error", lambda J, true, robot: error(next(medians), 0.5))
    joints = np.array([[0.0, -0.2], [0.3, 0.1], [0.1, 0.0]])
    seen = SimpleNamespace(joints=joints, anchors={})
    found = body_model.ask(world, Model(), seen, seed=2)
    assert np.isnan(found["within"])  # nothing tells how well it knows itself
    assert (found["points_median"], found["known_p90"]) == pytest.approx((3.0, 3.0))
    assert found["points_p90"] == np.inf  # a quarter of the points is not known
    stay = [np.repeat(np.linalg.norm(q - 1.0), 3) for q in asked]  # of twelve, at the same place in every posture
    all_of_them = np.concatenate([*stay, np.full(8 * 9, 3.0)])
    assert np.min(stay) < 3.0
    assert found["stays_p90"] == pytest.approx(np.quantile(all_of_them, 0.9, method="higher"))
    assert found["known_share"] == 0.75
    assert (found["jacobian_median"], found["jacobian_p90"]) == pytest.approx((4.5, 0.5))
    assert found["overlap"] == pytest.approx((6 * 16 / 24 + 2 * 16 / 32) / 8)
    assert found["depth"] == pytest.approx(0.25)  # of four columns two are right, one by half too far, one too near
    assert len(asked) == 8
    assert body_model.POINTS == 200  # more than there are pixels here
    assert len(set(world.tracked)) == len(world.tracked) == 12  # each pixel once
    inside = np.array(asked)
    assert (inside > joints.min(axis=0) - 0.005).all()
    assert (inside < joints.max(axis=0) + 0.005).all()
    assert np.ptp(inside, axis=0).min() > 0.1
    assert np.abs(inside[:, None] - joints).max(axis=2).min() > 0.01  # none was seen
    assert np.abs(inside[:, None] - inside)[~np.eye(8, dtype=bool)].max(axis=-1).min() > 0.01  # nor is one asked twice
    assert max(world.steps) <= 0.03


def test_a_body_that_is_not_found_has_no_figures(monkeypatch):
    def fail(*_):
        raise DenseVSError("too few tracks")

    monkeypatch.setattr(body_model, "make_world", lambda *_: None)
    monkeypatch.setattr(body_model, "babble", lambda *_: SimpleNamespace(images=[], joints=[]))
    monkeypatch.setattr(body_model, "follow_points", fail)
    result = body_model.measure(BodyScore("arm", "", "clean", 1), SimpleNamespace(seconds=1.0))
    assert result.name == "arm clean 1"
    assert np.isnan([result.points_median, result.overlap, result.link_share, result.predict_ms]).all()
    assert result.failure == "too few tracks"


def test_the_share_of_right_links_is_of_tracks_with_one(monkeypatch):
    found = SimpleNamespace(all_links=np.array([0, 1, 1, -1, -1, -2, 0, 2, 2, -1]))
    truth = np.array([0, 1, 0, -1, 2, 0, -2, -1, 2, 0])  # right are 0, 1 and 2; wrong 1 / 0, -1 / 2, 2 / -1 and -1 / 0
    of_points = np.array([True, True, False, True, True, True, True, False, False, False])
    asked_for = []
    made = []
    monkeypatch.setattr(body_model, "make_world", lambda asked, options: made.append(vars(options)))
    seen = SimpleNamespace(images=[], joints=np.zeros((1, 2)), commands="commands")
    monkeypatch.setattr(body_model, "babble", lambda *_: seen)
    tracks = SimpleNamespace(size=(24, 32))
    monkeypatch.setattr(body_model, "follow_points", lambda *_: tracks)
    monkeypatch.setattr(body_model, "true_places", lambda make, *given: asked_for.append(given) or (make(), "places"))
    monkeypatch.setattr(body_model, "follows", lambda of, places: of_points * (of is tracks))
    monkeypatch.setattr(body_model, "fit_body", lambda tracks: found)
    monkeypatch.setattr(body_model, "refit", lambda fit, tracks, images, prior: (fit, prior))
    models = {(id(found), (32.0, 0.15)): SimpleNamespace(jacobian=lambda q: None)}
    monkeypatch.setattr(body_model.BodyModel, "from_fit", lambda anew, *_: models[id(anew[0]), anew[1]])
    monkeypatch.setattr(body_model, "link_truth", lambda seen, tracks: truth)
    monkeypatch.setattr(body_model, "ask", lambda *_: ASKED)
    asked = BodyScore("panda", "A", "clean", 0)
    result = body_model.measure(asked, SimpleNamespace(seconds=1.0, device="cuda:0"))
    assert made == [{"seconds": 1.0, "device": device} for device in ("cuda:0", "cpu")]
    assert result.name == "panda A clean 0"
    assert (result.link_share, result.tracks) == (pytest.approx(3 / 7), 7)
    assert (result.point_link_share, result.point_tracks) == (pytest.approx(2 / 3), 3)
    assert asked_for == [("commands", tracks, body_model.PointTrackOptions().stride)]
    assert (result.points_median, result.depth, result.within) == (1.0, 6.0, 0.7)
    assert 0 <= result.fit_seconds < 60
    assert 0 <= result.predict_ms < 1000
    found.all_links[:] = -2
    unknown = body_model.measure(asked, SimpleNamespace(seconds=1.0))
    assert np.isnan([unknown.link_share, unknown.point_link_share]).all()
    assert (unknown.tracks, unknown.point_tracks) == (0, 0)


@pytest.mark.parametrize(("images", "realism"), [("clean", False), ("realistic", "realistic")])
@pytest.mark.parametrize(("arm", "joints", "count"), [("arm", None, None), ("panda", ["a", "b"], 2)])
def test_a_commercial_arm_uses_its_first_joints_and_ours_all(monkeypatch, arm, joints, count, images, realism):
    made = []

    def world(name, **options):
        made.append((name, options))
        return SimpleNamespace(joint_names=["a", "b", "c"])

    monkeypatch.setattr(body_model, "SimWorld", world)
    asked = BodyScore(arm, "B", images, 5)
    body_model.make_world(asked, SimpleNamespace(device="cpu", joints=count))
    common = {"seed": 5, "device": "cpu", "realism": realism}
    if joints is None:
        assert made == [("arm", common)]
    else:
        assert made[-1] == ("panda", {"joints": joints, "camera": "B", **common})
        assert made[0] == ("panda", {"camera": "B", "device": "cpu", "height": 8, "width": 8})


def test_several_devices_share_the_bodies(monkeypatch):
    made = []
    monkeypatch.setattr(body_model, "SimWorld", lambda name, **options: made.append(options["device"]))
    options = SimpleNamespace(device="cuda:0,cuda:1,cuda:2", joints=4)
    for _ in range(2):
        for seed in range(30):
            body_model.make_world(BodyScore("arm", "", "clean", seed), options)
    assert made[:30] == made[30:]  # a body always has the same
    assert all(made[:30].count(f"cuda:{n}") >= 4 for n in range(3))


def test_anchors_are_pixels_of_the_robot_that_joints_move():
    J = np.zeros((6, 8, 2, 2))
    J[:, 2:, 1, 1] = 0.5
    mask = np.zeros((6, 8), bool)
    mask[1, :5] = True
    world = SimpleNamespace(true_jacobian=lambda: J, robot_mask=lambda: mask, track_point=tuple)
    pixels, points = body_model.some_points(world, 3)
    assert sorted(map(tuple, pixels)) == [(2, 1), (3, 1), (4, 1)]  # the first two stand still
    assert points == [tuple(pixel) for pixel in pixels]
    mask = np.ones((6, 80), bool)
    J = np.ones((6, 80, 2, 2))
    many, _ = body_model.some_points(world, 3)
    assert len(np.unique(many, axis=0)) == len(many) == 400  # of 480, none twice


def test_a_place_of_the_model_is_known_by_the_anchor_on_it():
    """Two keyframes; each anchor goes with the nearest place of its own keyframe, nearer than 0.3 px."""
    places = np.array([[1.0, 1.0], [1.25, 1.0], [9.0, 0.0], [1.0, 1.0]])
    precision = SimpleNamespace(postures=np.array([[0.0, 0.0], [1.0, 2.0]]), keyframes=np.array([0, 0, 0, 1]))
    asked = []

    def points(q):
        asked.append(q.tolist())
        return SimpleNamespace(pixels=places)

    seen = SimpleNamespace(
        joints=np.array([[0.0, 0.1], [1.0, 1.9], [0.05, 1.5]]),
        anchors={
            0: (np.array([[1.1, 1.0], [1.2, 1.0], [9.0, 0.3], [5.0, 5.0]]), ["a", "b", "too far", "nothing"]),
            1: (np.array([[1.25, 1.0], [9.0, 0.0]]), ["c", "of the other keyframe"]),
            2: (np.array([[1.0, 1.0]]), ["d"]),  # by the joint that is farthest off, nearer to the second
        },
    )
    indices, found = body_model.anchored_points(SimpleNamespace(precision=precision, points=points), seen)
    assert (indices.tolist(), found) == ([0, 1, 3, 3], ["a", "b", "c", "d"])
    assert asked == seen.joints.tolist()
    precision.keyframes[:] = 0
    seen.anchors = {1: (np.array([[1.0, 1.0]]), ["e"])}  # its keyframe has no place
    assert body_model.anchored_points(SimpleNamespace(precision=precision, points=points), seen)[1] == []
    none, found = body_model.anchored_points(SimpleNamespace(precision=None), seen)
    assert (len(none), found) == (0, [])


def test_a_model_knows_its_errors_where_they_are_as_often_as_they_should():
    """Of four anchored places one is 2 standard deviations off, the others less than one."""
    world = AskedWorld()
    seen = SimpleNamespace(joints=np.array([[0.0, 0.0], [0.2, 0.2]]), anchors={0: "some"})
    off = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 1.0], [0.0, 2.0]])
    spread = np.array([1.0, 1.0, 4.0, 1.0])  # square of the deviation
    start = np.arange(8.0).reshape(4, 2)

    def points(q):
        return SimpleNamespace(pixels=start + q + off, covariances=spread[:, None, None] * np.eye(2))

    mask = world.robot_mask()
    model = SimpleNamespace(
        points=points,
        trace=lambda pixels, q_seen, q: pixels - q_seen + q,
        jacobian=lambda q: np.zeros((4, 8, 2, 2)),
        image=lambda q: SimpleNamespace(body=mask, depths=5.0 * world.frame().depth),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(body_model, "anchored_points", lambda model, seen: (np.arange(4), list(start)))
        found = body_model.ask(world, model, seen, seed=0)
    assert (found["overlap"], found["depth"], found["within"]) == (1.0, 0.0, 0.75)


@pytest.mark.parametrize(("start", "frames"), [([0.0, 0.0], 4), ([0.1, -0.0051], 1), ([0.1, -0.0049], 0)])
def test_the_way_to_a_posture_is_gone_in_small_steps(start, frames):
    world = AskedWorld()
    world.q = np.array(start)
    body_model.go_to(world, np.array([0.1, 0.0]))
    assert len(world.steps) == frames
    assert max(world.steps, default=0.0) <= 0.03
    np.testing.assert_allclose(world.q, [0.1, 0.0], atol=0.005)


def test_a_posture_that_is_not_reached_is_given_up():
    world = AskedWorld()
    world.step = world.steps.append
    body_model.go_to(world, np.array([0.1, 0.0]))
    assert len(world.steps) == 15


def test_a_way_on_which_it_comes_nearer_is_gone_to_its_end():
    """A slow robot, which does a quarter of what it is told, and a tenth of that every other frame."""
    world = AskedWorld()
    go = world.step
    world.step = lambda dq: go((0.25 if len(world.steps) % 2 else 0.025) * dq)
    body_model.go_to(world, np.array([0.2, 0.9]))
    np.testing.assert_allclose(world.q, [0.2, 0.9], atol=0.005)


def test_a_robot_that_rests_is_told_to_stay_while_readings_come():
    world = AskedWorld()
    body_model.rest(world)
    assert world.steps == [0.0] * 3


class Clock:
    """Tells the times that it is given."""

    def __init__(self, wall, cpu=()):
        wall, cpu = iter(wall), iter(cpu)
        self.perf_counter, self.process_time = (lambda: next(wall)), (lambda: next(cpu))


@pytest.mark.parametrize(("postures", "asked"), [(1, 1), (9, 9), (25, 13), (100, 10)])
def test_the_least_time_of_an_image_counts(monkeypatch, postures, asked):
    """Of about ten postures that are spread over all of them."""
    calls = []
    spent = [0.25 if k == asked // 2 else 0.5 for k in range(asked)]
    times = [time for k, duration in enumerate(spent) for time in (10.0 * k, 10.0 * k + duration)]
    monkeypatch.setattr(body_model, "time", Clock(times))
    model = SimpleNamespace(jacobian=calls.append)
    assert body_model.prediction_time(model, np.arange(postures)) == 250.0
    assert len(calls) == asked
    assert calls[0] == 0


def test_a_fit_takes_the_time_between_its_beginning_and_its_end(monkeypatch):
    found = SimpleNamespace(all_links=np.array([0]))
    for name in ("make_world", "fit_body"):
        monkeypatch.setattr(body_model, name, lambda *_: found)
    seen = SimpleNamespace(images=[], joints=np.zeros((1, 2)), commands=None)
    monkeypatch.setattr(body_model, "babble", lambda *_: seen)
    monkeypatch.setattr(body_model, "follow_points", lambda *_: SimpleNamespace(size=(24, 32)))
    monkeypatch.setattr(body_model, "true_places", lambda *_: None)
    monkeypatch.setattr(body_model, "follows", lambda *_: np.array([True]))
    monkeypatch.setattr(body_model, "refit", lambda *_: found)
    monkeypatch.setattr(body_model.BodyModel, "from_fit", lambda *_: None)
    monkeypatch.setattr(body_model, "link_truth", lambda *_: np.array([0]))
    monkeypatch.setattr(body_model, "ask", lambda *_: ASKED)
    monkeypatch.setattr(body_model, "prediction_time", lambda *_: 3.0)
    monkeypatch.setattr(body_model, "time", Clock([100.0, 104.0], [20.0, 26.0]))
    result = body_model.measure(BodyScore("panda", "A", "clean", 0), SimpleNamespace(seconds=1.0))
    assert (result.fit_seconds, result.fit_cpu_seconds, result.predict_ms) == (4.0, 6.0, 3.0)
