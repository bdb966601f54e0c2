"""A point of a textured plate that three joints turn in space: followed, covered, found again, never taken for sure."""

from dataclasses import replace

import numpy as np
import pytest
from planar_scene import PlanarScene

from dense_vs.point_servo.link_motion import LinkMotion
from dense_vs.point_servo.link_tracker import LinkTracker

START = np.array([60.0, 50.0])
HIDDEN = np.full((96, 128), 90, np.uint8)


class Plate:
    """The plane Z = 1 of the reference posture, carried by a chain of three axes, before a camera."""

    def __init__(self):
        self.scene = PlanarScene()
        axes = np.array([[0.2, 0.1, -0.97], [0.9, 0.3, 0.3], [-0.2, 0.95, 0.2]])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        places = np.array([[-0.15, 0.1, 1.1], [0.05, 0.2, 1.2], [0.2, 0.0, 1.15]])
        places -= axes * np.sum(axes * places, axis=1, keepdims=True)
        center = self.scene.center
        self.chain = LinkMotion(np.zeros(3), axes, places, 115.0, center, np.zeros((1, 3))).with_points(START)

    def image(self, q):
        rotation, shift = (value[0] for value in self.chain.poses(q))
        rays = np.dstack(
            [(self.scene.pixels - self.chain.center) / self.chain.focal, np.ones(self.scene.pixels.shape[:2])]
        )
        normal = rotation[:, 2]
        depth = normal @ (normal + shift) / (rays @ normal)
        local = (depth[..., None] * rays - shift) @ rotation
        places = self.chain.center + self.chain.focal * local[..., :2]
        return np.rint(self.scene.texture(places)).astype(np.uint8)

    def place(self, q):
        return self.chain.project(q)[0, 0]


@pytest.fixture(scope="module")
def plate():
    return Plate()


def babbled(plate, seed=0):
    """Images and joints of a random walk that ends in the reference posture."""
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(0, 0.03, (50, 3)), axis=0)
    return [(plate.image(q), q) for q in np.clip(steps - steps[-1], -0.3, 0.3)]


@pytest.fixture
def tracker(plate):
    found = LinkTracker(babbled(plate), START, np.zeros(HIDDEN.shape), lost_after=5)
    assert found.motion is not None
    return found


def alike():
    return np.zeros(HIDDEN.shape)


def test_it_follows_beyond_the_postures_it_has_seen(plate, tracker):
    errors = []
    for share in np.linspace(0, 1, 31)[1:]:
        q = share * np.array([0.5, -0.35, 0.3])
        tracker.update(plate.image(q), q, alike)
        errors.append(np.linalg.norm(tracker.point - plate.place(q)))
    assert np.max(errors) < 0.5
    assert tracker.certain
    assert not tracker.lost[0]
    np.testing.assert_array_equal(tracker.points, tracker.point[None])


def test_a_covered_point_is_predicted_flagged_and_found_again(plate, tracker):
    path = np.linspace(0, 1, 21)[1:, None] * np.array([0.25, -0.2, 0.2])
    for q in path[:10]:
        tracker.update(plate.image(q), q, alike)
    for q in path[10:]:
        tracker.update(HIDDEN, q, alike)
        assert not tracker.certain
    assert tracker.lost[0]
    assert tracker.correlation[0] == -1
    assert np.linalg.norm(tracker.point - plate.place(path[-1])) < 1.5
    for _ in range(3):
        tracker.update(plate.image(path[-1]), path[-1], alike)
    assert not tracker.lost[0]
    assert np.linalg.norm(tracker.point - plate.place(path[-1])) < 0.3


def test_joints_that_do_not_move_the_point_are_left_out(plate):
    rng = np.random.default_rng(3)
    history = [(gray, np.insert(q, 1, rng.normal())) for gray, q in babbled(plate)]
    tracker = LinkTracker(history, START, alike(), joints=np.array([True, False, True, True]))
    assert tracker.motion is not None
    q = np.array([0.1, -0.1, 0.1])
    tracker.update(plate.image(q), np.insert(q, 1, 5.0), alike)
    assert np.linalg.norm(tracker.point - plate.place(q)) < 0.3


def test_what_moves_otherwise_than_by_the_joints_is_no_link(plate):
    rng = np.random.default_rng(5)
    history = [(gray, rng.normal(0, 0.1, 3)) for gray, _ in babbled(plate)]
    assert LinkTracker(history, START, alike()).motion is None


def test_too_little_seen_is_no_link(plate):
    assert LinkTracker(babbled(plate)[-5:], START, alike()).motion is None
    flat = [(HIDDEN, q) for _, q in babbled(plate)]
    assert LinkTracker(flat, START, alike()).motion is None


def test_a_posture_that_the_motion_cannot_show_leaves_the_point_where_it_was(plate, tracker):
    before = tracker.point.copy()
    tracker.motion = replace(tracker.motion, points=tracker.motion.points * [1, 1, -1])
    tracker.update(HIDDEN, np.zeros(3), alike)
    np.testing.assert_array_equal(tracker.point, before)
    assert tracker.unseen == 1
    assert not tracker.certain
