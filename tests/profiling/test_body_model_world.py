"""How a body model is scored in a simulated world: true links, postures that were not seen, figures of a failed fit."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import body_model

from dense_vs.errors import DenseVSError


def error(median, p90=0.0):
    return SimpleNamespace(median=median, p90=p90)


def test_a_link_is_the_last_joint_that_moves_the_pixel():
    J = np.zeros((2, 3, 2, 3))
    J[0, 0, 1, 0] = J[0, 1, 0, 1] = 5.0
    J[0, 1, 0, 0] = J[0, 2, 1, 2] = -4.0
    J[1, 0, 0, 2] = 5e-5  # as good as none
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
        self.steps = []

    def joints(self):
        return self.q.copy(), 0.0

    def step(self, dq):
        self.steps.append(np.abs(dq).max())
        self.q = self.q + dq

    def robot_mask(self):
        return np.arange(8)[None, :].repeat(4, axis=0) < 4

    def true_jacobian(self):
        J = np.zeros((4, 8, 2, 2))
        J[:, 1:, 0] = 1.0  # the first column stands still: no place for points
        return J

    def track_point(self, pixel):
        assert 1 <= pixel[0] < 4
        return pixel - self.q

    def project(self, point):
        return point + self.q

    def frame(self):
        return SimpleNamespace(depth=np.full((4, 8), 2.0))


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
            body = np.arange(8)[None, :].repeat(4, axis=0) < 6
            depths = np.full((4, 8), 6.0)  # of any unit
            depths[:, 0] = 9.0
            return SimpleNamespace(body=body, depths=depths)

    medians = iter(np.arange(1.0, 9.0))
    monkeypatch.setattr(body_model, "jacobian_error", lambda J, true, robot: error(next(medians), 0.5))
    joints = np.array([[0.0, -0.2], [0.3, 0.1], [0.1, 0.0]])
    seen = SimpleNamespace(joints=joints, anchors={})
    points, worst, median, p90, overlap, depth, within = body_model.ask(world, Model(), seen, seed=2)
    assert np.isnan(within)  # nothing tells how well it knows itself
    assert points == pytest.approx(3.0)
    assert worst == np.inf  # a quarter of the points is not known
    assert (median, p90) == pytest.approx((4.5, 0.5))
    assert overlap == pytest.approx(16 / 24)
    assert depth == pytest.approx(0.0)  # one of four columns is half as far again, which the median leaves out
    assert len(asked) == body_model.POSTURES
    inside = np.array(asked)
    assert (inside > joints.min(axis=0) - 0.005).all()
    assert (inside < joints.max(axis=0) + 0.005).all()
    assert np.ptp(inside, axis=0).min() > 0.1
    assert max(world.steps) <= body_model.LARGEST_STEP


def test_a_body_that_is_not_found_has_no_figures(monkeypatch, capsys):
    def fail(*_):
        raise DenseVSError("too few tracks")

    monkeypatch.setattr(body_model, "make_world", lambda *_: None)
    monkeypatch.setattr(body_model, "babble", lambda *_: SimpleNamespace(images=[], joints=[]))
    monkeypatch.setattr(body_model, "follow_points", fail)
    result = body_model.measure("arm", "", 1, SimpleNamespace(seconds=1.0))
    assert result.name == "arm 1"
    assert np.isnan([result.points_median, result.overlap, result.link_share, result.predict_ms]).all()
    assert "too few tracks" in capsys.readouterr().out


def test_the_share_of_right_links_is_of_tracks_with_one(monkeypatch):
    found = SimpleNamespace(all_links=np.array([0, 1, 1, -1, -1, -2, 0, 2]))
    truth = np.array([0, 1, 0, -1, 2, 0, -2, -1])  # right: 2 of those known: both 0, 1 / 1, 0 / -1, 2 / 2, -1
    monkeypatch.setattr(body_model, "make_world", lambda *_: None)
    monkeypatch.setattr(body_model, "babble", lambda *_: SimpleNamespace(images=[], joints=np.zeros((1, 2))))
    monkeypatch.setattr(body_model, "follow_points", lambda *_: SimpleNamespace(size=(24, 32)))
    monkeypatch.setattr(body_model, "fit_body", lambda tracks: found)
    monkeypatch.setattr(body_model, "refit", lambda fit, tracks, images, prior: (fit, prior))
    models = {(id(found), (32.0, 0.15)): SimpleNamespace(jacobian=lambda q: None)}
    monkeypatch.setattr(body_model.BodyModel, "from_fit", lambda anew, *_: models[id(anew[0]), anew[1]])
    monkeypatch.setattr(body_model, "link_truth", lambda seen, tracks: truth)
    monkeypatch.setattr(body_model, "ask", lambda *_: (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.7))
    result = body_model.measure("panda", "A", 0, SimpleNamespace(seconds=1.0))
    assert result.name == "panda A 0"
    assert (result.link_share, result.tracks) == (pytest.approx(2 / 5), 5)
    assert (result.points_median, result.depth, result.within) == (1.0, 6.0, 0.7)
    assert 0 <= result.fit_seconds < 60
    assert 0 <= result.predict_ms < 1000
    values = {metric.name: metric for metric in body_model.metrics_of([result])}
    assert values["body_model/panda A 0/points_p90"].value == 2.0
    assert values["body_model/panda A 0/overlap"].better == "higher"
    found.all_links[:] = -2
    assert np.isnan(body_model.measure("panda", "A", 0, SimpleNamespace(seconds=1.0)).link_share)
