"""The trust region and the search on cases made by hand on either side of every limit."""

import numpy as np
import pytest

from dense_vs.kernels.masks.region_sums import BOTTOM, LEFT, RIGHT, TOP
from dense_vs.mask_servo.object_search import search_offsets
from dense_vs.mask_servo.trust_region import TrustRegion, View, _room
from dense_vs.segmentation import MaskQuality, MaskVerdict, assess_mask

SIZE = (480, 640)
H = np.eye(2)


def quality(area=1000, border=0, box=(300, 200, 40, 40), verdict=MaskVerdict.GOOD):
    mask = np.zeros(SIZE, bool)
    mask[200:240, 300:340] = True
    seen = assess_mask(mask)
    return MaskQuality(**{**vars(seen), "area": area, "border": border, "box": box, "verdict": verdict})


def region(coupling=H, tolerance=5.0, min_motion=0.02, max_step=0.3, image_step=40.0):
    return TrustRegion(coupling, tolerance, min_motion, max_step, image_step)


def q(*values):
    return np.array(values, dtype=float)


def started(one, error=(50.0, 50.0), at=(0.0, 0.0), seen=None):
    one.advance(View.ANEW, q(*at), q(*error), seen or quality())
    return one


@pytest.mark.parametrize(
    ("area", "view"),
    [(750, View.WHOLE), (749, View.PART), (1000, View.WHOLE), (1333, View.WHOLE), (1334, View.ANEW)],
)
def test_a_whole_view_has_three_quarters_of_the_area(area, view):
    one = started(region())
    assert one.judge(quality(area), q(0, 0), None) is view
    assert region().judge(quality(area), q(0, 0), None) is View.ANEW
    other = [verdict for verdict in MaskVerdict if verdict is not MaskVerdict.GOOD]
    assert one.judge(quality(verdict=other[0]), q(0, 0), None) is View.PART


@pytest.mark.parametrize(
    ("command", "moved", "view"),
    [
        ((0.0026, 0.0), (0.0, 0.0), View.BLOCKED),
        ((0.0024, 0.0), (0.0, 0.0), View.WHOLE),  # so little says nothing
        ((0.01, 0.01), (0.0031, 0.0031), View.WHOLE),
        ((0.01, 0.01), (0.0031, 0.0029), View.BLOCKED),
        ((0.01, -0.01), (0.01, -0.0029), View.BLOCKED),
    ],
)
def test_a_joint_that_goes_less_than_three_tenths_of_its_way_is_blocked(command, moved, view):
    one = started(region())
    one.command(q(*command))
    assert one.judge(quality(), q(*moved), q(0, 0)) is view
    assert one.judge(quality(), q(*moved), None) is View.WHOLE


@pytest.mark.parametrize(
    ("moved", "step"),
    [
        (40.0, 0.02),  # as far as a step should move it
        (80.0, 0.01),
        (200.0, 0.01),  # at most halved
        (32.0, 0.025),
        (20.0, 0.03),  # at most one and a half times
        (1.0, 0.03),
    ],
)
def test_the_step_follows_how_far_the_object_moved(moved, step):
    one = started(region(), error=(0.0, 300.0))
    assert one.step == 0.02
    one.advance(View.WHOLE, q(0.02, 0), q(0.6 * moved, 300 - 0.8 * moved), quality())
    assert one.step == pytest.approx(step)


@pytest.mark.parametrize(("went", "changed"), [(0.0099, False), (0.0101, True)])
def test_the_step_stays_where_it_was_not_what_bounded_the_motion(went, changed):
    one = started(region(), error=(0.0, 300.0))
    one.advance(View.WHOLE, q(0, -went), q(80.0, 300), quality())
    assert (one.step != 0.02) == changed
    anew = started(region())
    anew.advance(View.ANEW, q(0.02, 0), q(200.0, 50), quality())
    assert anew.step == 0.02


def test_the_step_stays_between_its_bounds():
    one = started(region(max_step=0.025), error=(0.0, 300.0))
    one.advance(View.WHOLE, q(0.02, 0), q(20.0, 300), quality())
    assert one.step == 0.025
    for k in range(4):
        one.advance(View.WHOLE, q(0.05 * (k + 2), 0), q(500.0 * k, 300), quality())
    assert one.step == 0.005
    assert region(max_step=0.01).step == 0.01


@pytest.mark.parametrize(
    ("before", "after", "alone"),
    [
        ((50.0, 50.0), (53.9, 40.0), None),
        ((50.0, 50.0), (54.1, 40.0), 0),
        ((-50.0, 50.0), (-54.1, 40.0), 0),
        ((5.0, 50.0), (9.9, 40.0), None),  # within twice the tolerance
        ((5.0, 50.0), (10.1, 40.0), 0),
        ((50.0, 50.0), (54.5, 56.0), 1),  # the one that grew most
    ],
)
def test_a_feature_whose_error_grows_is_moved_alone(before, after, alone):
    one = started(region(), error=before)
    one.advance(View.WHOLE, q(0.02, 0.02), q(*after), quality())
    active = one.active(np.ones((2, 2)))
    assert [int(one.any()) for one in active] == ([1, 1] if alone is None else [int(k == alone) for k in range(2)])


@pytest.mark.parametrize(("share", "counts"), [(0.09, False), (0.11, True)])
def test_a_feature_that_was_not_meant_to_change_is_not_blamed(share, counts):
    one = started(region())
    one.advance(View.WHOLE, q(0.02, 0.02 * share), q(50.0, 70.0), quality())
    assert (one.active(np.ones((2, 2)))[0].any() == 0) == counts


def test_none_is_moved_alone_where_it_is_not_known_which_joints_move_it():
    one = started(region(coupling=None))
    one.advance(View.WHOLE, q(0.02, 0.02), q(90.0, 40.0), quality())
    assert one._alone is None
    assert one.active(np.ones((2, 2))).all()


@pytest.mark.parametrize(("after", "alone"), [(58.1, True), (57.9, False), (5.0, False), (5.1, False)])
def test_a_feature_is_moved_alone_until_its_error_falls(after, alone):
    one = started(region())
    one.advance(View.WHOLE, q(0.02, 0.02), q(60.0, 50.0), quality())
    one.advance(View.WHOLE, q(0.04, 0.02), q(after, 50.0), quality())
    assert bool(one.active(np.ones((2, 2)))[1].any()) != alone


def test_twice_it_goes_back_and_then_it_is_lost():
    one = started(region(), at=(0.1, 0.2))
    assert region().retreat(q(0, 0), q(9, 9), quality(), SIZE) is None  # it was never seen whole
    first = one.retreat(q(0.12, 0.2), q(np.nan, np.nan), quality(area=0), SIZE)
    assert first is not None
    assert one.step == 0.01
    second = one.retreat(q(0.15, 0.2), q(90, 50), quality(), SIZE)
    np.testing.assert_allclose(second, [-0.05, 0.0])  # the second time no farther
    assert one.step == 0.005
    assert one.retreat(q(0.15, 0.2), q(90, 50), quality(), SIZE) is None
    assert one.retreats == 2
    one.advance(View.WHOLE, q(0.1, 0.2), q(50, 50), quality())
    assert one.retreat(q(0.12, 0.2), q(90, 50), quality(), SIZE) is not None


@pytest.mark.parametrize(
    ("error", "border", "beyond"),
    [
        ((90.0, 50.0), 0, 1.0),  # 40 px are as far as a step should go
        ((70.0, 50.0), 0, 2.0),
        ((55.0, 50.0), 0, 4.0),  # at most four times
        ((53.0, 50.0), 0, 0.0),  # noise
        ((53.0, 50.0), LEFT, 4.0),  # the centroid of a part moves less
        ((53.0, 50.0), RIGHT, 4.0),
        ((53.0, 50.0), TOP | BOTTOM, 0.0),
        ((130.0, 50.0), 0, 1.0),
    ],
)
def test_it_goes_as_far_the_other_way_as_a_step_should(error, border, beyond):
    one = started(region())
    step = one.retreat(q(0.02, 0.001), q(*error), quality(border=border), SIZE)
    np.testing.assert_allclose(step, [-0.02 * (1 + beyond), -0.001], atol=1e-12)
    if beyond:
        assert not one.active(np.ones((2, 2)))[1].any()


@pytest.mark.parametrize(("border", "alone"), [(TOP, 1), (BOTTOM, 1)])
def test_what_leaves_by_the_top_or_the_bottom_has_moved_down_or_up(border, alone):
    one = started(region())
    step = one.retreat(q(0.001, 0.02), q(50.0, 52.0), quality(border=border), SIZE)
    np.testing.assert_allclose(step, [-0.001, -0.1])
    assert one.active(np.ones((2, 2)))[alone].all()
    assert not one.active(np.ones((2, 2)))[1 - alone].any()


def test_without_a_coupling_all_joints_go_the_other_way():
    one = started(region(coupling=None))
    step = one.retreat(q(0.02, 0.01), q(90.0, 50.0), quality(), SIZE)
    np.testing.assert_allclose(step, [-0.04, -0.02])
    np.testing.assert_array_equal(one.active(np.ones((2, 2))), 1.0)


@pytest.mark.parametrize(("least", "scaled"), [(0.02, False), (0.1, True)])
def test_a_joint_that_was_stopped_goes_back_far_enough_to_learn_from(least, scaled):
    one = started(region(min_motion=least))
    one.command(q(0.06, 0.01))
    assert one.judge(quality(), q(0.0, 0.01), q(0, 0)) is View.BLOCKED
    step = one.retreat(q(0.0, 0.01), q(50.0, 45.0), quality(), SIZE)
    away = 2.5 * least if scaled else 0.06
    np.testing.assert_allclose(step, [-away, -0.01])
    assert not one.active(np.ones((2, 2)))[1].any()


@pytest.mark.parametrize(
    ("dq", "error", "found"),
    [
        ((0.0049, 0.1), (50.0, 20.0), (0.025, 0.0)),  # below a quarter of what is learned from
        ((0.0051, 0.1), (50.0, 20.0), None),
        ((0.0049, 0.1), (9.9, 50.0), None),  # its error is within twice the tolerance
        ((0.0049, 0.1), (10.1, 50.0), (0.025, 0.0)),
        ((-0.001, 0.002), (20.0, -50.0), (0.0, 0.025)),  # the larger error first
        ((0.0, 0.0), (50.0, 50.0), None),
    ],
)
def test_a_small_step_is_enlarged_for_one_feature(dq, error, found):
    step = region().enough(q(*dq), q(*error))
    np.testing.assert_allclose(step, dq if found is None else found)


@pytest.mark.parametrize(
    ("shift", "share"),
    [
        ((100.0, 0.0), 1.0),
        ((-100.0, 0.0), 1.0),
        ((300.0, 0.0), 0.8),  # 300 px to the right border
        ((600.0, 0.0), 0.4),
        ((-600.0, 0.0), 0.4),  # 300 px to the left
        ((0.0, 480.0), 0.4),  # 240 px to the bottom
        ((0.0, -400.0), 0.4),  # 200 px to the top
        ((600.0, -400.0), 0.4),
        ((0.0, 0.0), 1.0),
    ],
)
def test_room_for_a_shift(shift, share):
    assert _room((300, 200, 40, 40), q(*shift), SIZE) == pytest.approx(share)
    assert _room((-5, 200, 40, 40), q(-10, 0), SIZE) == 0.0


def test_a_search_begins_here_and_goes_round_by_rings():
    """A ring's sides before its corners, each going round."""
    expected = [(0, 0), (0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)]
    offsets = search_offsets((0.5, 2.0))
    ways = offsets / [0.5, 2.0]
    assert ways.tolist()[0] == [0.0, 0.0]
    assert {tuple(one) for one in ways[1:5].tolist()} == set(expected[1:5])
    assert {tuple(one) for one in ways[5:].tolist()} == set(expected[5:])
    turn = np.arctan2(ways[:, 0], ways[:, 1])
    assert (np.diff(turn[1:5]) > 0).all()
    assert (np.diff(turn[5:]) > 0).all()
    two = search_offsets((1.0, 1.0), rings=2)
    assert len(two) == 25
    assert (np.diff(np.abs(two).max(axis=1)) >= 0).all()
    assert np.abs(two[9:13]).sum(axis=1).tolist() == [2.0] * 4
    assert len(search_offsets((1.0, 1.0), rings=0)) == 1
