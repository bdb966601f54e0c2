"""Why a point does not get to its target."""

import numpy as np
import pytest

from dense_vs.live.reachability import PATIENCE, Reachability, reason

FREE = np.array([[-1.0, 1.0]] * 3)
GOOD = np.array([[100.0, 20.0, 0.0], [0.0, 80.0, 30.0]])


@pytest.mark.parametrize(
    ("J", "error", "positions", "word"),
    [
        (np.full((2, 3), 0.1), [30, 0], [0, 0, 0], "not learned"),
        (np.array([[100.0, 50, 20], [0.5, 0, 0]]), [0, 30], [0, 0, 0], "singular"),
        (np.array([[100.0, 0, 0], [0, 80, 30]]), [30, 0], [1, 0, 0], "joint limit: joint 1"),
        (GOOD, [30, 0], [0, 0, 0], "does not come nearer"),
    ],
)
def test_each_reason_is_found(J, error, positions, word):
    said = reason(J, np.array(error, float), np.array(positions, float), FREE, 15.0)
    assert word in said


def test_it_speaks_only_once_the_error_no_longer_falls():
    watch = Reachability()
    for k in range(3 * PATIENCE):
        watch.observe(GOOD, [100 * 0.98**k, 0], np.zeros(3), FREE, 15.0)
        assert not watch.why
    for _ in range(PATIENCE):
        watch.observe(GOOD, [20, 0], np.zeros(3), FREE, 15.0)
    assert watch.why
    watch.observe(GOOD, [0.5, 0], np.zeros(3), FREE, 15.0)
    assert not watch.why


@pytest.mark.parametrize(("size", "learned"), [(2.9, False), (3.1, True)])
def test_a_j_below_three_pixels_a_radian_is_not_learned(size, learned):
    J = size * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    said = reason(J, np.array([30.0, 0.0]), np.zeros(3), FREE, 15.0)
    assert said.startswith("it does not come nearer" if learned else "not learned")


@pytest.mark.parametrize(("along", "singular"), [(14.9, True), (15.1, False)])
def test_a_posture_is_singular_whose_joints_hardly_move_the_point_there(along, singular):
    J = np.array([[100.0, 0.0, 0.0], [0.0, along, 0.0]])
    for error in ([0.0, 30.0], [0.0, -3.0]):
        assert reason(J, np.array(error), np.zeros(3), FREE, 15.0).startswith("singular") == singular
    assert not reason(J, np.array([30.0, 0.0]), np.zeros(3), FREE, 15.0).startswith("singular")


@pytest.mark.parametrize(
    ("position", "error", "held"),
    [
        (0.985, 30.0, True),  # within a hundredth of its range from the limit
        (0.975, 30.0, False),
        (-0.985, -30.0, True),
        (-0.975, -30.0, False),
        (0.985, -30.0, False),  # the way back is free
        (-0.985, 30.0, False),
    ],
)
def test_a_joint_is_held_at_its_limit_in_the_direction_of_its_step(position, error, held):
    J = np.array([[100.0, 0.0, 0.0], [0.0, 80.0, 0.0]])
    said = reason(J, np.array([error, 0.0]), np.array([position, 0.0, 0.0]), FREE, 15.0)
    assert said.startswith("joint limit: joint 1") == held
    assert not reason(J, np.array([error, 0.0]), np.array([position, 0, 0]), FREE * np.inf, 15.0).startswith("joint")


@pytest.mark.parametrize(("other", "word"), [(33.0, "joint limit: joint 1"), (36.0, "held by joint limits (1)")])
def test_less_than_a_fifth_of_the_motion_is_left_by_a_limit(other, word):
    """With 100 px/rad of damping, joints of size s do s^2 / (s^2 + d^2) of it.

    Both together 0.526 or 0.530; the second alone 0.098 or 0.115, which is 0.187 or 0.216 of that.
    """
    J = np.array([[100.0, other, 0.0], [0.0, 0.0, 80.0]])
    assert reason(J, np.array([30.0, 0.0]), np.array([1.0, 0.0, 0.0]), FREE, 100.0).startswith(word)


def test_several_joints_at_their_limits_are_named():
    J = np.array([[100.0, 50.0, 0.0], [0.0, 0.0, 80.0]])
    said = reason(J, np.array([30.0, 0.0]), np.array([1.0, 1.0, 0.0]), FREE, 15.0)
    assert said == "joint limit: joints 1, 2"


def test_its_patience_is_a_second_and_a_half():
    watch = Reachability()
    watch.observe(GOOD, [20, 0], np.zeros(3), FREE, 15.0)
    for k in range(1, 60):
        watch.observe(GOOD, [19.01, 0], np.zeros(3), FREE, 15.0)  # more than 0.95 of the least
        assert bool(watch.why) == (k >= 45)
    watch.observe(GOOD, [18.99, 0], np.zeros(3), FREE, 15.0)
    assert not watch.why
    for _ in range(100):
        watch.observe(GOOD, [0.99, 0], np.zeros(3), FREE, 15.0)  # near enough not to worry
        assert not watch.why
