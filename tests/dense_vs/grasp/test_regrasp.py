"""What follows an attempt: never the same again, bounded, and deeper or turned as the docstring says."""

import pytest

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspAction, GraspOutcome, RegraspPolicy, grasp_camera_position


def test_attempts_after_misses_go_deeper_and_every_second_one_turns():
    policy = RegraspPolicy(attempts=6, step=0.008, max_deeper=0.02)
    steps = [policy.decide(GraspOutcome.MISSED) for _ in range(5)]
    assert [step.action for step in steps] == [GraspAction.REGRASP] * 5
    assert [step.deeper for step in steps] == pytest.approx([0.008, 0.016, 0.02, 0.02, 0.02])
    assert [step.angle_rank for step in steps] == [0, 1, 1, 0, 0]
    assert policy.decide(GraspOutcome.MISSED).action is GraspAction.GIVE_UP


def test_held_ends_it_at_any_attempt():
    policy = RegraspPolicy(attempts=2)
    assert policy.decide(GraspOutcome.MISSED).action is GraspAction.REGRASP
    assert policy.decide(GraspOutcome.HELD).action is GraspAction.FINISH


def test_searches_are_bounded():
    policy = RegraspPolicy(attempts=10, searches=2)
    actions = [policy.decide(GraspOutcome.LOST).action for _ in range(3)]
    assert actions == [GraspAction.SEARCH, GraspAction.SEARCH, GraspAction.GIVE_UP]


def test_a_lost_object_or_a_jam_is_no_miss():
    policy = RegraspPolicy(attempts=10)
    for outcome in (GraspOutcome.LOST, GraspOutcome.JAMMED, GraspOutcome.UNKNOWN, GraspOutcome.WRONG):
        step = policy.decide(outcome)
        assert (step.deeper, step.angle_rank) == (0.0, 0)
    assert policy.attempts_made == 4
    policy.reset()
    assert policy.attempts_made == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [({"attempts": 0}, "attempts is 0"), ({"searches": -1}, "searches is -1"), ({"step": 1.0}, "step is 1.0")],
)
def test_bad_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        RegraspPolicy(**options)
    with pytest.raises(DenseVSError, match=r"expected one of GraspOutcome\.HELD"):
        RegraspPolicy().decide("held")


def test_camera_stops_the_gripper_s_length_above_the_object():
    assert grasp_camera_position(0.12, 0.17) == pytest.approx(0.29)
    with pytest.raises(DenseVSError, match="z_object is nan"):
        grasp_camera_position(float("nan"), 0.17)
