"""A loop takes a body model that was learned elsewhere, and forgets J and body together."""

from types import SimpleNamespace

import numpy as np
import pytest
from planar_scene import TURN, PlanarScene

from dense_vs import DenseVSError, ServoLoop
from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.following import follow, in_sight, point_jacobian

SCENE = PlanarScene()


class TurnedPlate:
    """Camera and robot: one joint turns the plate in the image plane."""

    joint_names = ("turn",)
    joint_limits = np.array([[-0.5, 0.5]])

    def __init__(self):
        self.q, self.time = np.zeros(1), 0.0

    def read(self):
        gray = SCENE.image(np.array([0.0, 0.0, self.q[0] / TURN, 0.0]))
        return np.repeat(gray[..., None], 3, axis=2), self.time

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.q = self.q + delta
        self.time += 1 / 30


def model(size=(SCENE.height, SCENE.width)):
    pixels = SCENE.pixels.reshape(-1, 2)
    points = np.column_stack([(pixels - SCENE.center) / 100.0, np.ones(len(pixels))])
    surface = Surface(points, np.zeros(len(points), int), np.ones(len(points)), np.full(len(points), 90, np.uint8))
    chain = Chain(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.array([-1]))
    center = float(SCENE.center[0]), float(SCENE.center[1])
    limits = np.array([[-0.3, 0.3]])
    return BodyModel(ModelContent(chain, 100.0, center, size, surface, np.ones(1, bool), limits, 0.1))


@pytest.fixture
def loop():
    robot = TurnedPlate()
    return ServoLoop(robot, robot, device="cpu", seed=1)


def test_a_model_from_elsewhere_is_js_prior_and_what_points_go_by(loop):
    assert loop.learned_body.wanted
    loop.use_body(model())
    assert not loop.learned_body.wanted
    arm = np.array([84.0, 40.0]) - SCENE.center
    expected = np.array([[-arm[1]], [arm[0]]])
    # Nothing speaks against the model yet.
    np.testing.assert_allclose(loop.estimator.at([84.0, 40.0])[0], expected, rtol=0.05)
    for _ in range(45):
        loop.babble_once()
    loop.define_point([84.0, 40.0])
    assert isinstance(loop.tracker, BodyTracker)


def test_another_bodys_model_is_refused_and_changes_nothing(loop):
    with pytest.raises(DenseVSError, match="expected 1 and"):
        loop.use_body(model(size=(64, 64)))
    assert loop.body_model is None
    assert loop.learned_body.wanted


def test_j_and_body_are_forgotten_together(loop):
    loop.use_body(model())
    for _ in range(10):
        loop.babble_once()
    loop.forget()
    assert loop.body_model is None
    assert loop.learned_body.wanted
    assert loop.pipeline.prior is None
    assert not np.any(loop.estimator.jacobian)
    loop.babble_once()
    assert loop.frame.dq is None  # the first frame again
    loop.babble_once()
    assert loop.frame.dq is not None


def test_out_of_sight_a_points_j_is_the_chains_and_the_loop_says_why(loop):
    loop.use_body(model())
    for _ in range(45):
        loop.babble_once()
    loop.define_point([84.0, 40.0])
    tracker, pipeline, q = loop.tracker, loop.pipeline, loop.frame.positions
    assert in_sight(tracker.point, pipeline)
    seen = point_jacobian(tracker, pipeline, q)
    np.testing.assert_array_equal(seen, loop.estimator.at(tracker.point)[0])
    arm = tracker.point - SCENE.center
    covered = np.ones((SCENE.height, SCENE.width), bool)
    pipeline.prior = SimpleNamespace(hidden=covered, agrees=True)
    assert not in_sight(tracker.point, pipeline)
    np.testing.assert_allclose(point_jacobian(tracker, pipeline, q), [[-arm[1]], [arm[0]]], rtol=0.1, atol=2.0)
    tracker.unseen = 0
    said = follow(tracker, pipeline, None, loop.frame, loop.frame, None)
    assert said.startswith("something covers it; by the rest of its link it is known to")
    pipeline.prior = None
    tracker.point = np.array([SCENE.width + 5.0, 40.0])
    assert not in_sight(tracker.point, pipeline)
    assert np.isfinite(point_jacobian(tracker, pipeline, q)).all()
    assert not pipeline.hidden_at(tracker.point)


def test_how_a_point_is_followed_by_its_link_is_checked_too(loop):
    loop.use_body(model())
    for name in ("window", "min_correlation", "max_jump", "lost_after"):
        for value in (-1, "1", {1}, np.longdouble("1e400")):
            with pytest.raises(DenseVSError, match=f"{name} is"):
                loop.define_point(SCENE.center, **{name: value})
    for x, y in ((3e38, 10.0), (10.0, -3e38), (SCENE.width, 10.0), (10.0, -0.1)):
        with pytest.raises(DenseVSError, match="outside the image of"):
            loop.define_point([x, y])
    assert loop.tracker is None
