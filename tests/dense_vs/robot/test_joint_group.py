"""Joints by name: the right places, limits and units, and errors that list the valid names."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.robot import JointGroup

NAMES = ["lift", "shoulder", "elbow"]
LIMITS = np.array([[0.0, 0.5], [-1.0, 1.0], [-np.inf, np.inf]])


def test_chosen_joints_come_in_their_order():
    group = JointGroup.choose(["elbow", "lift"], NAMES, limits=LIMITS, units=["m", "rad", "rad"])
    assert group.names == ("elbow", "lift")
    assert group.units == ("rad", "m")
    assert group.total == 3
    np.testing.assert_array_equal(group.indices, [2, 0])
    np.testing.assert_array_equal(group.limits, LIMITS[[2, 0]])
    np.testing.assert_array_equal(group.take([1.0, 2.0, 3.0]), [3.0, 1.0])
    np.testing.assert_array_equal(group.spread([5.0, 7.0]), [7.0, 0.0, 5.0])


@pytest.mark.parametrize("positions", [[1.0, 2.0], [1.0, 2.0, 3.0, 4.0], 1.0, "abc", None, [[1.0, 2.0, 3.0]]])
def test_readings_of_another_number_of_joints_are_refused(positions):
    group = JointGroup.choose(["elbow", "lift"], NAMES)
    with pytest.raises(DenseVSError, match="joint positions"):
        group.take(positions)
    assert np.isnan(group.take([np.nan, 2.0, 3.0])).tolist() == [False, True]  # what is wrong with it, others say


def test_all_joints_without_limits_unless_told():
    group = JointGroup.choose(None, NAMES)
    assert group.names == tuple(NAMES)
    assert group.units == ("rad",) * 3
    assert not group.limited
    step = np.array([1.0, -2.0, 3.0])
    np.testing.assert_array_equal(group.clip_step(step, np.zeros(3)), step)


@pytest.mark.parametrize(("longest", "step"), [(0.2, [0.2, -0.1]), (0.6, [0.6, -0.3]), (9.0, [0.6, -0.3])])
def test_a_step_toward_a_posture_is_straight_and_no_longer_than_the_way(longest, step):
    group = JointGroup.choose(["shoulder", "elbow"], NAMES, limits=LIMITS)
    posture, positions = np.array([0.7, -0.2]), np.array([0.1, 0.1])
    np.testing.assert_allclose(group.step_toward(posture, positions, longest, 1.0), step)
    np.testing.assert_array_equal(group.step_toward(posture, posture, longest, 1.0), 0.0)
    np.testing.assert_allclose(group.step_toward(np.array([9.0, 0.0]), np.array([0.8, 0.0]), 9.0, 1.0), [0.2, 0.0])


@pytest.mark.parametrize(("gain", "step"), [(0.5, [0.3, -0.15]), (0.2, [0.12, -0.06]), (1.0, [0.4, -0.2])])
def test_a_step_toward_a_posture_is_so_much_of_the_way(gain, step):
    group = JointGroup.choose(["shoulder", "elbow"], NAMES, limits=LIMITS)
    posture, positions = np.array([0.7, -0.2]), np.array([0.1, 0.1])
    np.testing.assert_allclose(group.step_toward(posture, positions, 0.4, gain), step)


def test_steps_end_at_the_limits_and_lead_back_to_them():
    group = JointGroup.choose(["shoulder", "elbow"], NAMES, limits=LIMITS)
    np.testing.assert_allclose(group.clip_step(np.array([0.5, 9.0]), np.array([0.8, 0.0])), [0.2, 9.0])
    np.testing.assert_allclose(group.clip_step(np.array([0.1, 0.0]), np.array([1.3, 0.0])), [-0.3, 0.0])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["wrist"], "joint 'wrist' is not in the robot; expected one of lift, shoulder, elbow"),
        (["lift", "lift"], "joint 'lift' is named twice; expected each joint once, out of lift, shoulder, elbow"),
        ([], r"joints is \(\); expected a sequence of names out of lift, shoulder, elbow"),
        ("lift", "joints is 'lift'; expected a sequence of names out of lift, shoulder, elbow"),
    ],
)
def test_refuses_names(names, message):
    with pytest.raises(DenseVSError, match=message):
        JointGroup.choose(names, NAMES)


@pytest.mark.parametrize("units", [["rad"], ["rad", "m", "deg"], "rad", 10**5000, ["m" * 9999]], ids=type)
def test_refuses_units(units):
    with pytest.raises(DenseVSError, match=r"units are .*expected 3, each one of rad, m"):
        JointGroup.choose(None, NAMES, units=units)


def test_units_are_those_that_a_robot_tells():
    class Silent:
        joint_names, joint_limits = NAMES, None

        def joints(self):
            return np.zeros(3), 0.0

        def command(self, delta):
            del delta

    class Telling(Silent):
        joint_units = ("m", "rad", "rad")

    assert JointGroup.of_robot(Silent()).units == ("rad",) * 3
    assert JointGroup.of_robot(Telling(), ["elbow", "lift"]).units == ("rad", "m")


@pytest.mark.parametrize("limits", [[[0, 1]], [[0, 1], [0, 1], [1, 0]], "none"])
def test_refuses_limits(limits):
    with pytest.raises(DenseVSError, match=r"joint_limits are .*expected 3 pairs of least and greatest position"):
        JointGroup.choose(None, NAMES, limits=limits)


BY_HAND = {
    "names": ("b", "a"),
    "indices": [2, 0],
    "limits": [[0.0, 1.0], [-1.0, 1.0]],
    "units": ("rad", "m"),
    "total": 3,
}


def test_a_group_by_hand_is_one_that_was_chosen():
    group = JointGroup(**BY_HAND)
    units, limits = ["m", "rad", "rad"], [[-1.0, 1.0], [0.0, 9.0], [0.0, 1.0]]
    chosen = JointGroup.choose(["b", "a"], ["a", "c", "b"], limits=limits, units=units)
    assert (group.names, group.units, group.total) == (chosen.names, chosen.units, chosen.total)
    np.testing.assert_array_equal(group.indices, chosen.indices)
    np.testing.assert_array_equal(group.limits, chosen.limits)
    np.testing.assert_array_equal(group.take([1, 2, 3]), [3, 1])
    free = JointGroup(**{**BY_HAND, "limits": None})
    assert not free.limited


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"names": "ba"}, "names is 'ba'; expected a sequence of names"),
        ({"names": ("a", "a")}, r"names are .* expected each joint once"),
        ({"indices": [1, 1]}, r"at \[1, 1\]; expected each joint once"),
        ({"indices": [0, 3]}, r"indices are \[0, 3\]; expected places of 3 joints, the first 0"),
        ({"indices": [-1, 0]}, r"indices are \[-1, 0\]; expected places of 3 joints"),
        ({"indices": [0.0, 1.0]}, "expected 2 whole numbers"),
        ({"indices": [0, 1, 2]}, "expected 2 whole numbers"),
        ({"limits": [[1.0, 0.0], [0.0, 1.0]]}, "joint_limits"),
        ({"limits": [[0.0, 1.0]]}, "joint_limits"),
        ({"units": ("rad", "deg")}, "each one of rad, m"),
        ({"units": ("rad",)}, "expected 2, each one of rad, m"),
        ({"total": 1}, "total is 1; expected a whole number"),
        ({"total": 2**60}, "total is 1152921504606846976; expected a whole number"),
        ({"total": 3.0}, "total is 3.0; expected a whole number"),
    ],
)
def test_parts_that_do_not_fit_are_no_group(change, words):
    with pytest.raises(DenseVSError, match=words):
        JointGroup(**{**BY_HAND, **change})
