"""A joint that moves by another share than its readings say: told by flow made by hand, and by nothing else."""

import numpy as np
import pytest

from dense_vs.health.gain_check import GainChange, GainCheck, factors_of, speaks_for_one, weighted_median
from dense_vs.health.motion_check import Motion

PLACES, JOINTS = 40, 3
SPAN = np.array([0.03, 0.04, -0.03])
WHOLE = np.ones(JOINTS)


def jacobian(seed=0):
    J = np.random.default_rng(seed).normal(0, 80, (PLACES, 2, JOINTS))
    J[PLACES // 2 :, :, 2] = 0.0  # half of the places are before the last joint
    return J


def motion(gains, J=None, span=SPAN, begin=0.0, noise=0.0, seed=1):
    J = jacobian() if J is None else J
    flow = J @ (np.asarray(gains) * span) + noise * np.random.default_rng(seed).normal(size=(PLACES, 2))
    return Motion(begin, begin + 0.1, flow, J, True)


def judged(check, gains, times, **options):
    return [check.judge(motion(gains, begin=0.1 * k, seed=k, **options), SPAN, WHOLE) for k in range(times)]


@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("gain", [0.0, 0.7, 0.81])
def test_four_motions_that_agree_tell_a_gain(joint, gain):
    gains = np.ones(JOINTS)
    gains[joint] = gain
    *before, found = judged(GainCheck(JOINTS), gains, 4)
    assert before == [None] * 3
    # One that stands still while its reading moves keeps a little, by which it can be found to move again.
    assert found == GainChange(joint, pytest.approx(max(gain, 0.05), abs=1e-9), 0.0)


@pytest.mark.parametrize(("now", "factor", "told"), [
    (1.0, 1.2, False), (0.7, 1 / 0.7, True), (0.7, 1.64, True), (0.7, 0.5, True),
    (1.0, -0.06, False), (1.0, -0.04, True), (0.5, -0.11, False), (0.5, -0.09, True),
])  # fmt: skip
def test_a_joint_moves_by_no_more_than_is_read_and_no_other_way(now, factor, told):
    check, gains = GainCheck(JOINTS), np.array([1.0, now, 1.0])
    found = [check.judge(motion((1, factor, 1)), SPAN, gains) for _ in range(6)]
    assert (found[3] is not None) == told
    assert told or found == [None] * 6


def test_noise_of_flow_is_no_gain_and_hides_none():
    found = [change for change in judged(GainCheck(JOINTS), (1, 0.7, 1), 6, noise=0.3) if change is not None]
    assert found[0].joint == 1
    assert found[0].factor == pytest.approx(0.7, abs=0.03)
    assert judged(GainCheck(JOINTS), np.ones(JOINTS), 30, noise=0.3) == [None] * 30


@pytest.mark.parametrize("gain", [0.83, 1.0, 1.14])
def test_a_small_change_counts_as_none(gain):
    assert judged(GainCheck(JOINTS), (1, gain, 1), 8) == [None] * 8


def test_a_motion_that_is_explained_comes_between():
    """Four of the last five have to agree."""
    check = GainCheck(JOINTS)
    told = (0.7, 1, 0.7, 1, 0.7, 0.7, 0.7)
    said = [check.judge(motion((1, gain, 1), begin=k), SPAN, WHOLE) for k, gain in enumerate(told)]
    assert said[:6] == [None] * 6
    assert said[6] == GainChange(1, pytest.approx(0.7), 2.0)


def test_gains_that_differ_do_not_agree():
    check = GainCheck(JOINTS)
    assert [check.judge(motion((1, gain, 1)), SPAN, WHOLE) for gain in (0.7, 0.5, 0.3) * 3] == [None] * 9
    check.restart()
    assert [check.judge(motion((1, gain, 1)), SPAN, WHOLE) for gain in (0.66, 0.74, 0.7)] == [None] * 3
    assert check.judge(motion((1, 0.7, 1)), SPAN, WHOLE) == GainChange(1, pytest.approx(0.7), 0.0)


def test_what_no_joint_explains_is_none_of_them():
    """A bump, another J, and two joints at once."""
    shifted = motion(np.ones(JOINTS))
    shifted = Motion(0.0, 0.1, shifted.flow + np.array([5.0, 0.0]), shifted.jacobian, True)
    other = Motion(0.0, 0.1, jacobian(7) @ SPAN, jacobian(), True)
    for strange in (shifted, other):
        check = GainCheck(JOINTS)
        assert [check.judge(strange, SPAN, WHOLE) for _ in range(8)] == [None] * 8


def test_a_joint_that_stands_still_is_not_judged_and_takes_no_votes():
    still = np.array([0.03, 0.0, -0.03])
    factors, left = factors_of(motion((0.7, 1, 1), span=still), still)
    assert np.isnan(factors[1])
    assert left[1] == 1
    assert factors[0] == pytest.approx(0.7)
    assert left[0] == pytest.approx(0.0, abs=1e-9)
    check = GainCheck(JOINTS)
    found = [check.judge(motion((1, 0.7, 1)), SPAN, WHOLE) for _ in range(3)]
    found += [check.judge(motion((1, 1, 1), span=still), still, WHOLE) for _ in range(6)]
    found += [check.judge(motion((1, 0.7, 1)), SPAN, WHOLE)]
    assert found[:-1] == [None] * 9
    assert found[-1] == GainChange(1, pytest.approx(0.7), 0.0)


def test_votes_are_forgotten():
    check = GainCheck(JOINTS)
    judged(check, (1, 0.7, 1), 3)
    check.restart()
    assert judged(check, (1, 0.7, 1), 3) == [None] * 3


@pytest.mark.parametrize(("noise", "told"), [(0.15, True), (0.25, False)])
def test_what_is_left_has_to_be_little_of_the_flow(noise, told):
    """Where J is wrong in other ways as well, the best gain is none."""
    one = motion((1, 0.2, 1))
    sizes = np.linalg.norm(one.flow, axis=1, keepdims=True)
    turned = one.flow + noise * sizes * np.array([0.6, 0.8])
    factors, left = factors_of(Motion(0.0, 0.1, turned, one.jacobian, True), SPAN)
    assert factors[1] == pytest.approx(0.2, abs=0.15)
    assert (left[1] < 1) == told


def test_a_few_places_that_are_far_off_change_nothing():
    far = motion((1, 0.7, 1))
    far.flow[::4] += 30.0
    far.flow[1] = np.nan
    factors, left = factors_of(far, SPAN)
    assert factors[1] == pytest.approx(0.7, abs=0.05)
    assert left[1] < 0.5


@pytest.mark.parametrize(("places", "told"), [(11, False), (12, True)])
def test_it_takes_twelve_places(places, told):
    one = motion((0.7, 1, 1))
    few = Motion(0.0, 0.1, one.flow[:places], one.jacobian[:places], True)
    assert (factors_of(few, SPAN) is not None) == told
    missing = motion((0.7, 1, 1))
    missing.flow[places:] = np.nan
    assert (factors_of(missing, SPAN) is not None) == told


@pytest.mark.parametrize(("size", "told"), [(0.49, False), (0.51, True)])
def test_a_joint_has_to_move_places_by_half_a_pixel(size, told):
    J = np.zeros((PLACES, 2, 1))
    J[:, 0] = size / 0.01
    factors, _ = factors_of(Motion(0.0, 0.1, 0.7 * J[..., 0] * 0.01, J, True), np.array([0.01]))
    assert np.isfinite(factors[0]) == told


def test_weighted_median():
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.ones(3)) == 2
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([10.0, 1.0, 1.0])) == 3
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([1.0, 3.0, 2.0])) == 1  # half is reached there


SLIPS = np.array([1.0, 0.7, 1.0])


def again(check, true, times, **options):
    """What is said while the second joint is taken to slip, and truly moves by that gain."""
    said = []
    for k in range(times):
        one = motion((1, true, 1), begin=0.1 * k, seed=k, **options)
        said.append(check.judge(one, SLIPS * SPAN, SLIPS))
    return said


def test_three_motions_tell_that_a_slip_has_ended():
    assert again(GainCheck(JOINTS), 1.0, 3) == [None, None, GainChange(1, pytest.approx(1 / 0.7), 0.0)]
    check = GainCheck(JOINTS)
    assert again(check, 1.0, 2) == [None, None]
    check.restart()
    assert again(check, 1.0, 2) == [None, None]
    assert again(GainCheck(JOINTS), 0.7, 20, noise=0.3) == [None] * 20
    ended = [said for said in again(GainCheck(JOINTS), 1.0, 8, noise=0.3) if said is not None]
    assert ended[0] == GainChange(1, pytest.approx(1 / 0.7), pytest.approx(0.0, abs=0.3))


def test_motions_that_speak_for_the_slip_count_against_its_end():
    check, said = GainCheck(JOINTS), []
    for k, true in enumerate((1, 0.7, 0.7, 1, 1, 0.7, 1)):
        said.append(check.judge(motion((1, true, 1), begin=k), SLIPS * SPAN, SLIPS))
    assert said[:6] == [None] * 6
    assert said[6] == GainChange(1, pytest.approx(1 / 0.7), 3.0)  # three of the last four


def pieces(places=12, size=2.0):
    whole = np.zeros((places, 2))
    whole[:, 0] = size
    return 0.5 * whole, whole


@pytest.mark.parametrize(("true", "speaks"), [
    (0.5, False), (1.0, True), (0.76, None), (0.74, None), (0.72, False), (0.78, True),
])  # fmt: skip
def test_the_gain_that_leaves_a_fifth_less_is_spoken_for(true, speaks):
    part, whole = pieces()
    assert speaks_for_one(part, whole, true * whole - part) is speaks


def test_few_places_or_small_motion_speak_for_none():
    part, whole = pieces(11)
    assert speaks_for_one(part, whole, whole - part) is None
    part, whole = pieces(12, size=0.49)
    assert speaks_for_one(part, whole, whole - part) is None
    part, whole = pieces(12, size=0.51)
    assert speaks_for_one(part, whole, whole - part) is True
    part, whole = pieces(13)
    error = whole - part
    error[0, 1] = np.nan  # half of a place is none
    assert speaks_for_one(part, whole, error) is True
    error[1] = np.nan
    assert speaks_for_one(part, whole, error) is None


def test_what_speaks_for_one_joint_says_of_the_others_that_they_move_as_they_read():
    check = GainCheck(JOINTS)
    for k in range(3):
        assert check.judge(motion((0.7, 1, 1), begin=0.1 * k, seed=k), SPAN, WHOLE) is None
    for k in range(3, 6):  # the next one stands still
        assert check.judge(motion((1, 0, 1), begin=0.1 * k, seed=k), SPAN, WHOLE) is None
    found = check.judge(motion((1, 0, 1), begin=0.6, seed=6), SPAN, WHOLE)
    assert found == GainChange(1, pytest.approx(0.05, abs=1e-9), pytest.approx(0.3))


def test_what_a_joint_leaves_is_told_at_half_of_the_places():
    """Some that fail grossly do not count: (2, 0.5) px are left before, and half a pixel across after."""
    J, part = np.zeros((PLACES, 2, 1)), np.array([10.0, 0.0])
    J[:, :, 0] = part / 0.05
    flow = np.tile(part + np.array([2.0, 0.5]), (PLACES, 1))
    flow[:10] = part + np.array([20.0, 0.5])
    factors, left = factors_of(Motion(0.0, 0.1, flow, J, True), np.array([0.05]))
    np.testing.assert_allclose(factors, [1.2])
    np.testing.assert_allclose(left, [0.5 / np.hypot(2.0, 0.5)])
