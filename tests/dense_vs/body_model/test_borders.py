"""The small steps of the body model on cases made by hand: which point is in front, which joint carries which."""

import numpy as np
import pytest
from drawn_points import front_points

from dense_vs.body_model.joint_tree import joint_parents
from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.surface import Surface, SurfaceOptions, _box, _thinned
from dense_vs.errors import DenseVSError


def test_the_nearest_point_of_a_pixel_is_in_front():
    places = np.array([[2.0, 1.0], [2.4, 0.6], [2.0, 1.0], [0.0, 0.0], [5.4, 3.4], [-0.6, 0.0], [5.6, 3.0], [1.0, 3.6]])
    depths = np.array([2.0, 1.0, 3.0, 0.0, 0.5, 1.0, 1.0, 1.0])  # the fourth is at the camera
    front = front_points(places, depths, (4, 6))
    expected = np.full((4, 6), -1)
    expected[1, 2], expected[3, 5] = 1, 4
    np.testing.assert_array_equal(front, expected)
    assert front_points(np.zeros((0, 2)), np.zeros(0), (2, 3)).tolist() == [[-1] * 3] * 2


@pytest.mark.parametrize(("sides", "filled"), [(3, False), (4, True)])
def test_a_hole_with_points_on_half_of_its_sides_takes_the_nearest_of_them(sides, filled):
    places = np.array([(1, 1), (3, 1), (1, 3), (3, 3), (5, 0)], float)  # the last is beside it all
    chosen = [*range(sides), 4]
    depths = np.array([3.0, 2.0, 1.5, 4.0, 1.0])
    front = front_points(places[chosen], depths[chosen], (5, 6))
    assert (front[2, 2] == 2) == filled
    assert (front >= 0).sum() == len(chosen) + filled


def test_holes_are_filled_twice_and_no_more():
    """A cross of 5 x 5 without its middle 3 x 3 grows inward by a pixel each time."""
    y, x = np.mgrid[:9, :9]
    ring = (np.maximum(abs(x - 4), abs(y - 4)) >= 3) & (np.maximum(abs(x - 4), abs(y - 4)) <= 4)
    places = np.column_stack([x[ring], y[ring]]).astype(float)
    front = front_points(places, np.ones(len(places)), (9, 9))
    # First the corners of the hole of 5 x 5, which have five sides, then their neighbors with four.
    hole = front[2:7, 2:7] < 0
    assert hole.sum() == 25 - 4 - 8
    assert not hole[[0, 0, 4, 4], [0, 4, 0, 4]].any()
    assert not hole[[0, 0, 1, 3], [1, 3, 0, 0]].any()
    assert hole[2, 2]


def moved_by(*counts):
    """Points that the given sets of joints move, so many of each."""
    rows = []
    for joints, count in counts:
        row = np.zeros(3, bool)
        row[list(joints)] = True
        rows += [row] * count
    return np.array(rows)


@pytest.mark.parametrize(
    ("counts", "parents"),
    [
        ([((0,), 9), ((0, 1), 9), ((0, 1, 2), 9)], [-1, 0, 1]),
        ([((2,), 9), ((2, 1), 9), ((0, 1, 2), 9)], [1, 2, -1]),
        ([((0,), 9), ((0, 1), 9), ((0, 2), 9)], [-1, 0, 0]),  # two arms on one trunk
        ([((0,), 9), ((1,), 9), ((2,), 9)], [-1, -1, -1]),
        ([((0, 1, 2), 9)], [-1, 0, 1]),  # nothing tells: in the order given
        ([((0,), 9), ((0, 1), 4), ((1,), 5), ((2,), 9)], [-1, -1, -1]),  # less than half of what joint 1 moves
        ([((0,), 9), ((0, 1), 6), ((1,), 5), ((2,), 9)], [-1, 0, -1]),
        # Shares that differ by 0.09, 100 of 110 and 100 of 100, leave the order; 0.11 tells it.
        ([((0, 1), 100), ((1,), 10), ((2,), 9)], [-1, 0, -1]),
        ([((0, 1), 100), ((1,), 13), ((2,), 9)], [1, -1, -1]),
    ],
)
def test_a_joint_is_carried_by_those_that_move_what_it_moves(counts, parents):
    found, learned = joint_parents(moved_by(*counts))
    assert found.tolist() == parents
    assert learned.all()


@pytest.mark.parametrize(("count", "known"), [(3, False), (4, True)])
def test_a_joint_that_moves_few_points_is_not_learned(count, known):
    found, learned = joint_parents(moved_by(((0,), 9), ((0, 1), 9), ((0, 1, 2), count)))
    assert learned.tolist() == [True, True, known]
    assert found.tolist() == [-1, 0, 1 if known else -1]


def test_one_point_a_cube_of_a_little_more_than_a_pixel():
    """At a depth of 2 m with 100 px a cube is 1.2 * 2 / 100 = 24 mm wide; the best supported point of it stays."""
    x = np.array([0.001, 0.020, 0.023, 0.025, 0.001])
    points = np.column_stack([x, np.full(5, 0.001), np.full(5, 2.0)])
    support, gray = np.array([0.5, 0.9, 0.9, 0.1, 0.2]), np.arange(5, dtype=np.uint8)
    surface = Surface(points, np.array([0, 0, 0, 0, 1]), support, gray, np.zeros(5, int))
    kept = _thinned(surface, 100.0)
    assert kept.gray.tolist() == [1, 3, 4]  # of equal support the first; another link has a cube of its own
    assert kept.links.tolist() == [0, 0, 1]
    np.testing.assert_array_equal(kept.points, points[[1, 3, 4]])
    assert len(_thinned(surface.some(np.arange(0)), 1.0).links) == 0


def test_the_box_around_what_moves():
    moving = np.zeros((20, 30), bool)
    moving[8, 10] = moving[12, 2] = True
    assert _box(moving) == (slice(4, 17), slice(0, 15))
    assert _box(np.zeros((20, 30), bool)) == (slice(0, 20), slice(0, 30))


@pytest.mark.parametrize(
    "options",
    [{"keyframes": 0}, {"compared": 1}, {"reach": 1}, {"depth_steps": 1}, {"same_depth": 0.0}, {"same_depth": 1.0}],
)
def test_options_of_the_surface_that_say_nothing(options):
    with pytest.raises(DenseVSError, match=next(iter(options))):
        SurfaceOptions(**options)
    assert SurfaceOptions(keyframes=1, compared=2, reach=2, depth_steps=2, same_depth=0.5)


@pytest.mark.parametrize(
    "options",
    [
        *({"length": 0}, {"noise": 0}, {"body": 0.0}, {"body": 1.0}),
        *({"keyframes": 0}, {"keyframes": 4097}, {"step": 0}, {"step": 65}),
    ],
)
def test_options_of_the_memory_that_say_nothing(options):
    with pytest.raises(DenseVSError, match=next(iter(options))):
        MemoryOptions(**options)
    assert MemoryOptions(keyframes=4096, step=64)


def test_keyframes_are_those_that_the_ones_before_tell_least_of():
    """Three steps of one size at far postures, and two that repeat them."""
    q = np.array([[0.0], [50.0], [0.0], [100.0], [50.0]])
    dq = np.array([[0.1], [0.2], [0.1], [-0.1], [0.2]])
    frames = Keyframes.choose(q, dq, options=MemoryOptions(length=0.05))
    assert sorted(frames.positions[:, 0]) == [0.0, 50.0, 100.0]
    assert frames.positions[0, 0] == 50.0  # the largest step first
    assert frames.usual[0] == pytest.approx(np.sqrt(np.mean(dq**2)))
    assert frames.lengths[0] == pytest.approx(0.05 * q.std())
    assert frames.rank == 3
    assert Keyframes.choose(q, dq, options=MemoryOptions(length=0.05, keyframes=2)).rank == 2
    np.testing.assert_allclose(frames.alike(np.array([[50.0], [50.0 + frames.lengths[0]]]))[:, 0], [1, np.exp(-0.5)])


def test_joints_that_do_not_move_or_are_not_learned_have_no_part():
    q, dq = np.random.default_rng(0).normal(size=(2, 9, 3))
    q[:, 1], dq[:, 1] = 0.3, 0.0
    frames = Keyframes.choose(q, dq)
    assert (frames.usual > 0).tolist() == [True, False, True]
    assert np.isinf(frames.lengths).tolist() == [False, True, False]
    np.testing.assert_allclose(frames.learned_units(), frames.usual * np.sqrt(2))
    one = Keyframes.choose(q, dq, learned=[False, True, True])
    assert (one.usual > 0).tolist() == [False, False, True]
    with pytest.raises(DenseVSError, match="none of 3 joints moves in 9 images"):
        Keyframes.choose(q, dq, learned=[False, True, False])


def test_the_covariance_of_usual_steps_is_one():
    rng = np.random.default_rng(1)
    q, dq = rng.normal(size=(40, 2)), rng.choice([-0.1, 0.1], (40, 2)) * [1.0, 3.0]
    frames = Keyframes.choose(q, dq)
    np.testing.assert_allclose(np.diag(frames._covariance(frames.positions, frames.steps)), 1.0)
    features = frames.features(frames.positions, frames.steps)
    np.testing.assert_allclose(features @ features.T, frames._covariance(frames.positions, frames.steps), atol=1e-3)
    J_dq = frames.columns(q[3]) @ dq[3]
    np.testing.assert_allclose(J_dq, frames.features(q[3:4], dq[3:4])[0], atol=1e-12)
