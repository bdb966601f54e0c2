"""Where a fault begins and ends: cases made by hand on either side of every limit, with the limits written out."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.health import FaultKind, ImageWatch, JointWatch
from dense_vs.health.motion_check import MotionCheck

FRAME = 1 / 30
SPAN = np.array([0.1])  # rad


def jacobian(places=20, size=60.0):
    J = np.zeros((places, 2, 1))
    J[:, 0] = size
    return J


def flow_of(share, places=20, predicted=6.0):
    """Flow along x that leaves a share of the motion unexplained: 1 - 2 r / (r^2 + 1) for r times the prediction."""
    rest = 1 - share
    ratio = (1 - np.sqrt(1 - rest**2)) / rest if rest else 0.0
    flow = np.zeros((places, 2))
    flow[:, 0] = ratio * predicted
    return flow


def judged(check, share, **options):
    return check.judge(flow_of(share, **options), jacobian(), SPAN)


def known(share=0.0, times=60):
    check = MotionCheck()
    for _ in range(times):
        assert judged(check, share) is None
    assert check.usual == pytest.approx(share)
    return check


@pytest.mark.parametrize(("times", "told"), [(59, False), (60, True)])
def test_what_is_usual_takes_sixty_motions(times, told):
    assert (judged(known(times=times), 1.0) is not None) == told


@pytest.mark.parametrize(
    ("least", "usual", "share", "told"),
    [
        (0.5, 0.0, 0.49, False),
        (0.5, 0.0, 0.51, True),
        (0.2, 0.0, 0.19, False),
        (0.2, 0.0, 0.21, True),
        (0.2, 0.1, 0.39, False),  # four times what is usual
        (0.2, 0.1, 0.41, True),
        (0.2, 0.149, 0.99, True),
        (0.2, 0.151, 0.99, False),  # J is known too badly to judge by
    ],
)
def test_a_share_counts_above_a_limit_and_above_what_is_usual(least, usual, share, told):
    check = known(usual)
    check.least_share = least
    fault = judged(check, share)
    assert (fault is not None) == told
    assert check.share == pytest.approx(share)
    if fault is not None:
        assert fault.kind is FaultKind.MISFIT
        assert f"a share of {share:.2f}" in fault.text


@pytest.mark.parametrize(("places", "told"), [(11, False), (12, True)])
def test_places_that_move_have_to_be_enough(places, told):
    for still, moving in ((0.0, 6.0), (0.99, 1.01)):
        flow, J = np.zeros((40, 2)), jacobian(40)
        J[:, 0] = moving / SPAN[0]
        J[places:, 0] = still / SPAN[0]
        flow[:, 1] = np.where(np.arange(40) < places, 0.0, still)
        assert (known().judge(flow, J, SPAN) is not None) == told
    flow[:places, 1] = 1.01  # flow alone moves them too
    assert (known().judge(flow, jacobian(40, 5.0), SPAN) is not None) == told


@pytest.mark.parametrize(("size", "told"), [(0.19, False), (0.21, True)])
def test_places_beside_the_robot_are_not_looked_at(size, told):
    """One place moves much, the others by that share of it; their flow is none."""
    J = jacobian(40, 600 * size)
    J[0, 0] = 600.0
    assert (known().judge(np.zeros((40, 2)), J, SPAN) is not None) == told
    flow = np.zeros((40, 2))
    flow[5:] = np.nan  # too few places are known
    assert known().judge(flow, jacobian(40), SPAN) is None


def test_half_of_the_places_that_move_decide():
    for wrong, told in ((19, False), (21, True)):
        for other in (-1.1, -6.0):  # px, against the joints
            flow = flow_of(0.0, 40)
            flow[:wrong, 0] = other
            assert (known().judge(flow, jacobian(40), SPAN) is not None) == told


def test_what_is_usual_follows_slowly():
    check = MotionCheck()
    judged(check, 0.1)
    assert check.usual == pytest.approx(0.1)
    judged(check, 0.3)
    assert check.usual == pytest.approx(0.1 + 0.05 * 0.2)


def test_doubt_lasts_until_six_motions_in_a_row_are_sound():
    check = known()
    first, second = judged(check, 0.9), judged(check, 0.9)
    assert (first.stops, second.stops) == (False, True)  # the first may be chance
    for _ in range(5):
        fault = judged(check, 0.0)
        assert fault.text == "motion was not the joints' a moment ago"
        assert not fault.stops
    assert not judged(check, 0.9).stops  # again a first one
    assert judged(check, 0.9).stops
    assert [judged(check, 0.0) is None for _ in range(7)] == [False] * 5 + [True] * 2
    assert not check.recent
    assert check.usual == pytest.approx(0.0)  # nothing of it has become usual


@pytest.mark.parametrize(("share", "left_out"), [(0.29, False), (0.31, True)])
def test_motion_that_a_j_known_too_little_may_explain_is_said_and_learned(share, left_out):
    """From three tenths on nothing is learned, of the motions after it either, until it is believed again."""
    check = known()
    check.least_share = 0.2
    faults = [judged(check, one) for one in (share, share, 0.0, 0.25)]
    assert [fault.holds for fault in faults] == [left_out] * 4
    assert [fault.stops for fault in faults] == [False, left_out, False, False]
    assert len(check.recent) == 4
    later = [judged(check, one) for one in (0.9, 0.9, 0.0)]
    assert [(fault.holds, fault.stops) for fault in later] == [(True, True), (True, True), (True, False)]
    check.forget_doubt()
    assert not judged(check, 0.25).holds


def test_after_sixty_motions_it_is_the_robot_that_has_changed():
    check = known()
    faults = [judged(check, 0.9) for _ in range(61)]
    assert [fault is not None for fault in faults] == [True] * 59 + [False] * 2
    assert check.usual == pytest.approx(0.9)  # what is usual is learned anew


def test_motions_are_kept_since_the_first_that_was_wrong():
    check = known()
    assert not check.recent
    for k in range(20):
        check.judge(flow_of(0.9, 450), jacobian(450), SPAN, begin=k, end=k + 1)
        assert len(check.recent) == min(k + 1, 16)
    assert (check.recent[0].begin, check.recent[-1].end) == (4, 20)
    assert 150 <= len(check.recent[0].flow) == len(check.recent[0].jacobian) <= 225


MOST = np.array([0.1, 0.2])


def watch(**options):
    one = JointWatch(("a", "b"), MOST, **options)
    one.judge(np.zeros(2), 5.0, 5.0)
    return one


def read(one, q, time, late=0.0):
    return one.judge(np.asarray(q, dtype=float), time - late, time)


@pytest.mark.parametrize(("apart", "good"), [(0.99, True), (-0.99, True), (1.01, False), (-1.01, False)])
def test_the_first_stamps_are_at_most_a_second_apart(apart, good):
    one = JointWatch(("a", "b"), MOST)
    if good:
        assert one.judge(np.zeros(2), 5.0 + apart, 5.0) == []
        assert one.time == 5.0 + apart
    else:
        with pytest.raises(DenseVSError, match="at most 1 s apart"):
            one.judge(np.zeros(2), 5.0 + apart, 5.0)


@pytest.mark.parametrize(
    ("rate", "late", "kind"),
    [
        (30, 0.19, None),
        (30, 0.21, "behind"),
        (5, 0.49, None),  # two and a half images
        (5, 0.51, "behind"),
        (30, -0.21, "ahead of"),
        (30, -0.19, None),
    ],
)
def test_a_stamp_that_shifts_by_more_than_transport_can(rate, late, kind):
    one = watch()
    for k in range(1, 11):
        assert read(one, [0, 0], 5.0 + k / rate, 0.001) == []
    faults = read(one, [0, 0], 5.0 + 11 / rate, late + 0.001)
    # An older stamp than the last is a fault of its own.
    if kind is None and late > 1 / rate:
        assert "before that of the last reading" in faults[0].text
    elif kind is None:
        assert faults == []
    else:
        assert f"{kind} the camera's clock" in faults[0].text
        assert f"is {abs(late):.3f} s" in faults[0].text


@pytest.mark.parametrize(
    ("q", "frames", "good"),
    [
        ([0.19, 0.0], 1, True),
        ([-0.21, 0.0], 1, False),
        ([0.0, -0.39], 1, True),
        ([0.0, 0.41], 1, False),
        ([0.39, 0.0], 2, True),
        ([0.41, 0.0], 2, False),
        ([0.59, 0.0], 9, True),  # three frames at most
        ([0.61, 0.0], 9, False),
    ],
)
def test_a_reading_changes_by_twice_the_largest_command_a_frame(q, frames, good):
    one = watch()
    for k in range(1, 11):
        assert read(one, [0, 0], 5.0 + k * FRAME) == []
    faults = read(one, q, 5.0 + (10 + frames) * FRAME)
    assert (faults == []) == good
    if not good:
        assert faults[0].kind is FaultKind.READING
        assert f"{'a' if q[0] else 'b'} changed by {q[0] or q[1]:.3g}" in faults[0].text
    np.testing.assert_array_equal(one.positions, q if good else [0, 0])


@pytest.mark.parametrize(("speed", "step", "good"), [(3.0, 0.099, True), (3.0, 0.101, False), (30.0, 0.99, True)])
def test_no_motor_is_faster_than_what_is_told(speed, step, good):
    one = watch(max_speed=speed)
    for k in range(1, 11):
        read(one, [0, 0], 5.0 + k * FRAME)
    assert (read(one, [step, 0], 5.0 + 11 * FRAME) == []) == good


def test_a_reading_that_was_stuck_comes_back_by_what_was_commanded():
    for back, good in ((0.29, True), (0.31, False)):
        one = watch()
        for k in range(1, 11):
            read(one, [0, 0], 5.0 + k * FRAME)
        one.commanded(np.array([0.06, 0.0]))
        one.commanded(np.array([0.04, 0.0]))
        assert (read(one, [back, 0], 5.0 + 11 * FRAME) == []) == good


def commanded(one, step, count, start=10, q=(0.0, 0.0)):
    """Frames with the same command whose reading stays: the kinds of faults told in each."""
    told = []
    for k in range(count):
        one.commanded(np.array([step, 0.0]))
        told.append(read(one, q, 5.0 + (start + k + 1) * FRAME))
    return told


def test_a_joint_that_stays_lags_first_and_is_stuck_after_half_a_second():
    one = watch()
    for k in range(1, 11):
        read(one, [0.0, 0.0], 5.0 + k * FRAME)
    told = commanded(one, 0.002, 40)
    lagging = [any("has not followed" in fault.text for fault in faults) for faults in told]
    stuck = [any("left out" in fault.text for fault in faults) for faults in told]
    # 0.015 of the way is commanded with the eighth step, 0.025 with the thirteenth; ten frames stood before them.
    assert np.argmax(lagging) == 7
    assert np.argmax(stuck) == 12
    assert lagging[7:12] == [True] * 5
    assert not any(lagging[12:])
    assert all(fault.stops is False for faults in told for fault in faults)
    assert [faults[0].holds for faults in told[7:14]] == [True] * 6 + [False]
    assert one.stuck.tolist() == [True, False]


def test_a_joint_that_was_commanded_enough_is_stuck_half_a_second_later():
    one = watch()
    told = [f for f in commanded(one, 0.05, 20, start=0)]
    stuck = [any("left out" in fault.text for fault in faults) for faults in told]
    assert np.argmax(stuck) == 14  # 15 frames are half a second
    assert [any("has not followed" in fault.text for fault in faults) for faults in told[:3]] == [False, True, True]


@pytest.mark.parametrize(("moved", "free"), [(0.004, False), (0.006, True)])
def test_a_stuck_joint_is_free_once_it_moves(moved, free):
    one = watch()
    commanded(one, 0.05, 16, start=0)
    assert one.stuck[0]
    read(one, [moved, 0.0], 5.0 + 17 * FRAME)
    assert one.stuck[0] != free
    assert one.changed == free


def test_a_stuck_joint_is_tried_again_after_two_seconds():
    one = watch()
    commanded(one, 0.05, 15, start=0)
    states = []
    for k in range(16, 90):
        read(one, [0.0, 0.0], 5.0 + k * FRAME)
        states.append(bool(one.stuck[0]))
    assert states.index(False) in (59, 60)  # it was named in frame 15
    assert not any(states[60:])


@pytest.mark.parametrize(("change", "follows"), [(0.004, False), (0.006, True)])
def test_a_joint_follows_that_changes_by_a_tenth_of_what_was_commanded(change, follows):
    one = watch()
    commanded(one, 0.05, 1, start=0)
    one.judge(np.array([change, 0.0]), 5.0 + 2 * FRAME, 5.0 + 2 * FRAME)
    assert (one._farthest[0] == 0.0) == follows


def image(contrast, seed=0, size=(60, 90)):
    """Of so much contrast exactly, in the pixels that are looked at."""
    gray = np.full(size, 100.0)
    gray[:, ::6] += contrast
    gray[:, 3::6] -= contrast
    gray[0, 1] += seed  # another image, of the same contrast
    return gray.astype(np.uint8)


@pytest.mark.parametrize(
    ("usual", "contrast", "dark"),
    [(None, 1, True), (None, 2, False), (30, 5, True), (30, 7, False), (35, 8, False), (35, 6, True)],
)
def test_an_image_is_dark_below_a_fifth_of_the_usual_contrast(usual, contrast, dark):
    one = ImageWatch()
    if usual is not None:
        for k in range(3):
            assert one.judge(image(usual, k), lambda: 1.0)[1] is None
    fault = one.judge(image(contrast), lambda: 1.0)[1]
    assert (fault is not None) == dark
    if fault is not None:
        assert fault.kind is FaultKind.DARK
        assert f"contrast {contrast}.0" in fault.text


def test_usual_contrast_follows_slowly():
    one = ImageWatch()
    one.judge(image(40), lambda: 1.0)
    one.judge(image(20, 1), lambda: 1.0)
    fault = one.judge(image(7, 2), lambda: 1.0)[1]
    assert f"at least {0.2 * 39:.1f}" in fault.text


@pytest.mark.parametrize(
    ("moved", "frozen"), [([0.49], False), ([0.51], True), ([0.3, 0.3], True), ([0.2, 0.2], False)]
)
def test_the_same_image_is_frozen_once_the_robot_has_moved_by_half_a_pixel(moved, frozen):
    one = ImageWatch()
    one.judge(image(20), lambda: 9.0)
    one.judge(image(20, 1), lambda: 9.0)
    for px in moved:
        _, fault = one.judge(image(20, 1), lambda px=px: px)
    assert (fault is not None) == frozen
    assert one.judge(image(20, 2), lambda: 9.0)[1] is None
    assert one.judge(image(20, 2), lambda: 0.4)[1] is None  # counted from where the image changed


def test_a_frozen_image_lets_one_motion_of_thirty_through():
    one = ImageWatch()
    one.judge(image(20), lambda: 1.0)
    stops = [one.judge(image(20), lambda: 1.0)[1].stops for _ in range(90)]
    assert [k + 1 for k, stop in enumerate(stops) if not stop] == [30, 60, 90]


@pytest.mark.parametrize(("gray_levels", "stands_out"), [(38, False), (42, True)])
@pytest.mark.parametrize(("count", "usual", "told"), [(20, 0, False), (30, 0, True), (50, 20, False), (80, 20, True)])
def test_pixels_stand_out_that_differ_from_their_neighbors(gray_levels, stands_out, count, usual, told):
    """Of 5,400 pixels, 27 are half a percent."""

    def spotted(spots, seed):
        gray = np.full((60, 90), 100, np.uint8)
        gray[30:] = 140
        y, x = np.unravel_index(np.arange(spots) * 4, (26, 88))
        gray[y + 2, x + 1] = 100 + gray_levels
        gray[59, 0] = seed
        return gray

    one = ImageWatch()
    for seed in range(2):
        assert one.judge(spotted(usual, 140 + seed), lambda: 1.0)[1] is None
    repaired, fault = one.judge(spotted(count, 145), lambda: 1.0)
    told = told and stands_out
    assert (fault is not None) == told
    if fault is not None:
        assert fault.kind is FaultKind.NOISE
        assert f"{100 * count / 5400:.1f} % of the pixels stand out; {100 * usual / 5400:.1f} % are usual" in fault.text
        assert (repaired[:30] == 100).all()
    else:
        np.testing.assert_array_equal(repaired, spotted(count, 145))
