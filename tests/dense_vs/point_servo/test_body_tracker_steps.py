"""The body tracker's place of its point, each step by itself, on features whose places follow by plain sums."""

from types import MethodType, SimpleNamespace

import numpy as np
import pytest
from counted_features import CHAIN, DROPPED, GRAY, KNOWN, YOUNG, Features, bare, directions_of, link_of

from dense_vs.point_servo.place_posterior import off_by_features, place_uncertainty, untied, with_look
from dense_vs.point_servo.point_depth import PointDepth
from dense_vs.point_servo.point_look import PointLook


def test_features_are_expected_where_the_chain_takes_them_and_young_ones_with_those_around():
    rate = [[0, 0], [1, -5], [2, -3], [6, -4], [50, 9], [70, 8], [0, 0], [0, 0], [2e4, 0]]
    at = [[0, 0], [0, 0], [10, 0], [20, 0], [100, 0], [200, 0], [12, 0], [170, 1], [400, 0]]
    states = [KNOWN] * 6 + [YOUNG, DROPPED, KNOWN]
    features = Features(at, rate, states)
    places = np.array(at[1:]) + 0.25
    tracker = bare(features, range(1, 9), places, _positions=np.array([3.0]))
    step = tracker._expected(features.project(tracker._live, np.array([4.0]))) - places
    np.testing.assert_allclose(step[:5], rate[1:6])
    np.testing.assert_allclose(step[5], [2, -4])  # medians of the three that are nearest: 10, 0 and 20
    np.testing.assert_allclose(step[6], [50, 8])  # 200, 100, 20
    np.testing.assert_array_equal(step[7], 0.0)  # one of the places is behind the camera: 20,000 px say nothing
    features.states[:] = YOUNG
    np.testing.assert_array_equal(tracker._expected(features.project(tracker._live, np.array([4.0]))), places)


def test_motion_since_the_last_keyframe_is_that_of_the_feature_that_moves_most():
    features = Features(np.zeros((4, 2)), [[0, 0], [1, 0], [-3, 4], [0, 2]])
    tracker = bare(features, _kept_at=np.array([1.0]))
    assert tracker._moved(np.array([1, 2, 3]), np.array([3.0])) == pytest.approx(10.0)
    assert tracker._moved(np.array([1, 3]), np.array([3.0])) == pytest.approx(4.0)
    features.rate[2] = 1e6, 0  # behind the camera by now
    assert tracker._moved(np.array([1, 2, 3]), np.array([3.0])) == pytest.approx(4.0)
    features.rate[2] = np.nan
    assert tracker._moved(np.array([2]), np.array([3.0])) == 0.0


def by_features(at, off, told, astray=(0.0, 0.0)):
    """What some features in sight make of how far the point is off, and the covariance of that."""
    told = np.array(told, int)
    distances = np.hypot(*(at[told] - at[0]).T)
    directions = np.tile(np.eye(2), (len(told), 1, 1))  # GRAY is plain
    return off_by_features(CHAIN, off[told] - astray, directions, distances)


@pytest.mark.parametrize("count", [2, 3, 6])
def test_the_point_is_off_by_what_features_around_it_are_off(count):
    """From three in sight on; with fewer the chain alone tells, and the link counts as unseen."""
    rng = np.random.default_rng(count)
    at = np.vstack([[40.0, 30.0], rng.uniform(0, 120, (count, 2)), [[40, 31], [41, 30]]])
    features = Features(at, rng.normal(0, 20, at.shape), links=[1] * (count + 1) + [0, 1])
    features.states[-1] = YOUNG
    q = np.array([0.3])
    live = np.array([0, *range(1, count + 3)])  # the point itself, one of another link and a young one do not count
    off = rng.normal(0, 2, (len(live), 2))
    there = features.project(live, q)
    tracker = bare(features, live, there + off, unseen=4, _offset=np.array([0.5, -0.5]), held=True)
    tracker._first = tracker._sure = live
    astray = np.array([0.9, -0.4])  # what they were off where the point was defined says nothing of it
    tracker.on_link = link_of(astray=lambda at: astray * (at is q))
    tracker._correct(q, 1, GRAY, directions_of(tracker))
    assert tracker.seen == count
    assert tracker.held == (count >= 3)
    if count < 3:
        assert tracker.unseen == 5
        np.testing.assert_allclose(tracker.point, there[0])  # not where features that were being covered had it
        np.testing.assert_array_equal(tracker._offset, 0.0)
        np.testing.assert_array_equal(tracker._covariance, CHAIN)
        return
    mean, covariance = by_features(there, off, range(1, count + 1), astray)
    assert tracker.unseen == 0
    np.testing.assert_allclose(tracker._offset, mean, atol=1e-12)
    np.testing.assert_allclose(tracker._covariance, covariance, atol=1e-12)
    np.testing.assert_allclose(tracker.point, there[0] + mean)


@pytest.mark.parametrize(
    ("sure", "first", "told", "held"),
    [
        ([], [1, 2, 3, 4, 5, 6], [], False),  # none is sure: the chain alone
        ([2, 4], [2], [2], False),
        ([2, 4, 6], [2, 4], [2, 4], False),
        ([1, 2, 4, 6], [1, 4, 6, 9], [1, 4, 6], True),
        ([1, 4, 6], [], [], False),  # what came into sight later agrees with the chain however far it is off
    ],
)
def test_features_of_the_first_image_that_look_as_at_first_tell_of_the_point(sure, first, told, held):
    rng = np.random.default_rng(3)
    at = np.vstack([[40.0, 30.0], rng.uniform(0, 80, (6, 2))])
    off = rng.normal(0, 2, (7, 2))
    tracker = bare(Features(at, np.zeros_like(at)), range(1, 7), at[1:] + off[1:])
    tracker._sure, tracker._first = np.array(sure, int), np.array(first, int)
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    mean, covariance = by_features(at, off, told)
    np.testing.assert_allclose(tracker._offset, mean, atol=1e-12)
    np.testing.assert_allclose(tracker._covariance, covariance, atol=1e-12)
    assert (tracker.seen, tracker.held) == (6, held)


@pytest.mark.parametrize(("place", "taken"), [(0.99e5, True), (1.01e5, False), (-1.01e5, False), (np.nan, False)])
def test_a_place_far_outside_leaves_the_point_and_counts_as_unseen(place, taken):
    at = np.array([[40.0, place], [40, 30], [41, 30], [42, 30]])
    tracker = bare(Features(at, np.zeros_like(at)), [1, 2, 3], at[1:], _own=0.99, _sighting=np.array([7.0, 7.0]))
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    assert tracker.unseen == (0 if taken else 1)
    assert taken or tracker._covariance[0, 0] > 1e6  # nothing is known of it, and of no image before
    assert tracker._sighting is None
    assert tracker._own == -1.0
    np.testing.assert_array_equal(tracker.point, [40.0, place] if taken else [7.0, 7.0])


def test_its_own_look_corrects_a_point_whose_depth_is_known():
    at = np.array([[40.0, 30.0], [40, 30], [50, 30], [40, 40]])
    off = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 3.0]])
    asked = []
    tracker = bare(Features(at, np.zeros_like(at)), [1, 2, 3], at[1:] + off[1:])
    tracker._first = tracker._sure = np.arange(1, 4)
    tracker.on_link.depth = PointDepth(1.0, 0.1)

    def by_look(q, gray, place, covariance):
        asked.append((place, covariance))
        return place + np.array([3.0, 4.0]), 2 * covariance

    tracker._by_look = by_look
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    mean, covariance = by_features(at, off, [1, 2, 3])
    ((place, given),) = asked
    np.testing.assert_allclose(place, at[0] + mean)
    np.testing.assert_allclose(given, covariance)
    np.testing.assert_allclose(tracker.point, place + np.array([3.0, 4.0]))
    np.testing.assert_allclose(tracker._covariance, 2 * covariance)


def looking(found, turned, middle=None):
    """A tracker at (10, 20) whose look is found 1 px away, and turned at (10, 24), with these correlations.

    Its middle is found 2 px away.
    """
    asked = []
    look = SimpleNamespace(
        found=lambda gray, place, affine, covariance: (
            asked.append((affine, covariance)) or (place + np.array([0.6, -0.8]), found)
        ),
        turned=lambda gray, place, affine: (place + np.array([0, 4]), turned),
        drift=lambda correlation: 10 * (1 - correlation),
        pixels=625,
        middle=middle
        and SimpleNamespace(
            found=lambda gray, place, affine, covariance: (place + np.array([0, 2]), middle),
            drift=lambda correlation: 20 * (1 - correlation),
        ),
    )
    look.seen = MethodType(PointLook.seen, look)
    views = (np.zeros((1, 2)), np.array([[[1.0, 2.0], [3.0, 4.0]]]), np.array([[30.0, 40.0]]))
    on_link = link_of(view=lambda postures: views, depth=PointDepth(1.0, 0.1), link=1, defined_at=np.array([0.5, 0.5]))
    features = Features(np.zeros((1, 2)), np.zeros((1, 2)))
    features.chain = SimpleNamespace(moved_by=np.array([[True, False], [False, True], [False, False]]))
    return bare(features, _look=look, on_link=on_link), asked


BY_DEPTH = np.array([3.0, 4.0])  # px, by one deviation of the depth of 0.1


def known(seen, drift):
    """Place and covariance, of (10, 20) with a covariance of 0.25 px^2 each way and the depth's, and of a look."""
    covariance = 0.25 * np.eye(2) + np.outer(BY_DEPTH, BY_DEPTH)
    place = np.array([10.0, 20.0])
    return (place, covariance) if seen is None else with_look(place, covariance, np.array(seen), drift)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("found", "turned", "seen", "drift", "sighting", "correlation"),
    [
        (0.99, 0.0, [10.6, 19.2], 0.1, [10.6, 19.2], 0.99),
        (0.88, 0.0, [10.6, 19.2], 1.2, [10.6, 19.2], 0.88),
        (0.87, 0.0, [10.6, 19.2], 1.3, [10.6, 19.2], 0.87),
        (0.86, 0.0, None, 0.0, [10.6, 19.2], 0.86),  # tells depths of keyframes, but no place
        (0.80, 0.99, None, 0.0, None, 0.80),  # as expected, but hardly
        (0.79, 0.99, None, 0.0, None, 0.99),  # turned otherwise
        (0.79, -1.0, None, 0.0, None, 0.79),
    ],
)
def test_the_own_look_counts_by_its_drift_where_it_is_alike(found, turned, seen, drift, sighting, correlation, held):
    tracker, asked = looking(found, turned)
    tracker.held = held
    place, covariance = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.25 * np.eye(2))
    expected = known(seen if held else None, drift)  # untied, it is the depth alone that it tells of
    np.testing.assert_allclose(place, expected[0], atol=1e-9)
    np.testing.assert_allclose(covariance, expected[1], atol=1e-9)
    np.testing.assert_equal(tracker._sighting, None if sighting is None else np.array(sighting, float))
    assert tracker.correlation[0] == np.float32(correlation)
    ((affine, sought),) = asked
    np.testing.assert_array_equal(affine, [[1, 2], [3, 4]])
    # 1.5 deviations of 0.1 along (30, 40), what it is beside that, and 1.2 px of what is tied to no first image.
    beside = 0.25 + 0.09 + (0.0 if held else 1.44)
    np.testing.assert_allclose(sought, 1.5**2 * np.outer(BY_DEPTH, BY_DEPTH) + beside * np.eye(2))


def test_the_own_look_is_sought_and_taken_where_a_point_that_is_farther_away_would_be():
    tracker, _ = looking(0.99, 0.0)
    tracker.held = True
    tracker.on_link.slip = 0.02  # of which 1 is (30, 40) px
    found = tracker._look.found
    tracker._look.found = lambda gray, place, affine, covariance: (
        np.testing.assert_allclose(place, [10.6, 20.8]) or found(gray, place, affine, covariance)
    )
    place, _ = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.25 * np.eye(2))
    np.testing.assert_allclose(place, known([10.6, 19.2], 0.1)[0])  # as without
    np.testing.assert_allclose(tracker._sighting, [11.2, 20.0])  # as it is seen


@pytest.mark.parametrize(
    ("found", "turned", "middle", "seen", "drift", "correlation"),
    [
        (0.79, -1.0, 0.95, [10, 22], 1.0, 0.95),  # seen where the whole look is not, with a drift of its own
        (0.79, -1.0, 0.85, None, 0.0, 0.85),
        (0.79, -1.0, 0.84, None, 0.0, 0.79),
        (0.79, 0.95, 0.99, None, 0.0, 0.95),  # the whole look comes first, also where it is turned otherwise
        (0.99, -1.0, 1.00, [10.6, 19.2], 0.1, 0.99),
    ],
)
def test_the_middle_of_the_own_look_counts_where_the_whole_is_not_seen(found, turned, middle, seen, drift, correlation):
    tracker, _ = looking(found, turned, middle)
    tracker.held = True
    place, covariance = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.25 * np.eye(2))
    expected = known(seen, drift)
    np.testing.assert_allclose(place, expected[0], atol=1e-9)
    np.testing.assert_allclose(covariance, expected[1], atol=1e-9)
    assert tracker.correlation[0] == np.float32(correlation)
    by_middle = correlation == middle
    assert (tracker._sighting is None) == (not by_middle and found < 0.8)


@pytest.mark.parametrize(("deviation", "left_open"), [(0.1, 0.15), (0.04, 0.06), (0.02, 0.05), (0.001, 0.05)])
def test_a_search_leaves_some_depth_open(deviation, left_open):
    tracker, _ = looking(0.0, 0.0)
    tracker.on_link.depth = PointDepth(1.0, deviation)
    covariance = tracker._searched(np.array([10.0, -20.0]), 4 * np.eye(2))
    off = left_open * np.array([10.0, -20.0])
    np.testing.assert_allclose(covariance, np.outer(off, off) + 4 * np.eye(2))


def test_uncertainty_is_of_what_the_tracker_knows():
    tracker, _ = looking(0.0, 0.0)
    tracker._covariance, tracker._own = np.diag([0.7, 0.4]), 0.9
    tracker._offset, tracker.held = np.array([0.9, -1.2]), True
    expected = place_uncertainty(np.diag([0.7, 0.4]), np.array([0.9, -1.2]), True, 0.9)
    assert tracker._uncertainty() == pytest.approx(expected)
    tracker._doubt = 1.7  # of the body as a whole
    assert tracker._uncertainty() == pytest.approx(1.7 * expected)
    tracker._doubt, tracker.held = 1.0, False
    assert tracker._uncertainty() == pytest.approx(np.hypot(expected, untied(0.9)))
    tracker.on_link.depth = None
    assert tracker._uncertainty() == np.inf


@pytest.mark.parametrize(
    ("unseen", "uncertainty", "certain", "lost"),
    [(0, 0.8, True, False), (0, 0.81, False, False), (1, 0.1, False, False), (4, 0.1, False, False),
     (5, 0.1, False, True), (6, 9.0, False, True)],
)  # fmt: skip
def test_certain_and_lost(unseen, uncertainty, certain, lost):
    lately = [0.01] * 4 + [uncertainty] * 5  # images, of which the last few alone make no place certain
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), unseen=unseen, uncertainty=0.02, lately=lately)
    assert tracker.certain() == certain
    assert tracker.usual_uncertainty == uncertainty
    assert tracker.lost.tolist() == [lost]


@pytest.mark.parametrize(("tolerance", "most"), [(0.2, 0.8), (1.0, 0.8), (2.0, 1.6), (10.0, 8.0)])
def test_a_place_has_to_be_known_as_well_as_a_tolerance_of_at_least_a_pixel_asks_for(tolerance, most):
    for uncertainty, certain in ((most - 1e-9, True), (most + 1e-9, False)):
        tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), uncertainty=0.02, lately=[uncertainty] * 9)
        assert tracker.certain(tolerance) == certain
        tracker.unseen = 1
        assert not tracker.certain(tolerance)


@pytest.mark.parametrize(("now", "certain"), [(1.6, True), (1.61, False), (np.inf, False)])
def test_a_place_that_an_image_shows_much_worse_than_usual_is_not_certain(now, certain):
    """In the same image, not once the middle of the last nine has followed."""
    lately = [0.5] * 8 + [now]
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), uncertainty=now, lately=lately)
    assert tracker.certain() == certain


def test_what_is_known_of_a_place_is_kept_for_as_many_images_as_make_it_certain():
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))))
    told = iter(np.arange(1.0, 20.0))
    tracker._uncertainty = lambda: next(told)
    for k in range(12):
        tracker._locate(np.array([0.1 * k, 0.0]), GRAY, directions_of(tracker))
    assert tracker.uncertainty == 12
    assert list(tracker.lately) == [*range(4, 13)]
    assert tracker.usual_uncertainty == 8
    np.testing.assert_array_equal(tracker._positions, [1.1, 0.0])
