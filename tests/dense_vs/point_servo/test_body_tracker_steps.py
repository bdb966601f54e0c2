"""The body tracker's place of its point, each step by itself, on features whose places follow by plain sums."""

from types import MethodType, SimpleNamespace

import numpy as np
import pytest
from counted_features import DROPPED, GRAY, KNOWN, YOUNG, Features, bare, directions_of, link_of

from dense_vs.point_servo.place_uncertainty import OwnLook, place_uncertainty
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


def reference_offset(there, expected, off):
    """A weighted mean, then once more with weights that fall for features unlike it; and its standard error.

    That is the spread over the root of their number, and more by how far their middle is off in units of their extent.
    """
    weights = np.array([np.exp(-(np.hypot(*(place - expected)) ** 2) / (2 * 28.0**2)) + 1e-3 for place in there])
    middle = sum(w * place for w, place in zip(weights, there, strict=True)) / weights.sum()
    extent = sum(w * np.hypot(*(place - middle)) ** 2 for w, place in zip(weights, there, strict=True)) / weights.sum()
    lever = np.hypot(*(expected - middle)) ** 2 / max(extent, 1.0)
    mean = sum(w * o for w, o in zip(weights, off, strict=True)) / weights.sum()
    weights = np.array([w / (1 + np.hypot(*(o - mean)) ** 2) for w, o in zip(weights, off, strict=True)])
    mean = sum(w * o for w, o in zip(weights, off, strict=True)) / weights.sum()
    squared = sum(w * np.hypot(*(o - mean)) ** 2 for w, o in zip(weights, off, strict=True))
    return mean, np.sqrt(squared / weights.sum() * (1 + lever) / len(there))


@pytest.mark.parametrize("count", [2, 3, 6])
def test_the_point_is_off_by_what_features_around_it_are_off(count):
    """From three features on; fewer leave the offset as it was, and the link counts as unseen."""
    rng = np.random.default_rng(count)
    at = np.vstack([[40.0, 30.0], rng.uniform(0, 120, (count, 2)), [[40, 31], [41, 30]]])
    features = Features(at, rng.normal(0, 20, at.shape), links=[1] * (count + 1) + [0, 1])
    features.states[-1] = YOUNG
    q = np.array([0.3])
    live = np.array([0, *range(1, count + 3)])  # the point itself, one of another link and a young one do not count
    off = rng.normal(0, 2, (len(live), 2))
    there = features.project(live, q)
    tracker = bare(features, live, there + off, unseen=4, _offset=np.array([0.5, -0.5]), _aside=9.0, held=True)
    astray = np.array([0.9, -0.4])  # what they were off where the point was defined says nothing of it
    tracker.on_link = link_of(astray=lambda at: astray * (at is q))
    tracker._correct(q, 1, GRAY, directions_of(tracker))
    expected = there[0]
    assert tracker.seen == count
    assert not tracker.held  # neither by too few, nor by features of later images
    if count < 3:
        assert (tracker.unseen, tracker._aside) == (5, 9.0)
        np.testing.assert_allclose(tracker.point, expected + np.array([0.5, -0.5]))
        return
    mean, error = reference_offset(there[1 : count + 1], expected, off[1 : count + 1])
    assert tracker.unseen == 0
    told = 1 - 3 / count  # they are not of the point's own image: three of them may have drifted together
    np.testing.assert_allclose(tracker._offset, told * (mean - astray), atol=1e-12)
    assert tracker._aside == pytest.approx(0.3 + error)
    np.testing.assert_allclose(tracker.point, expected + told * (mean - astray))


@pytest.mark.parametrize(
    ("sure", "first", "told", "held"),
    [
        ([], [1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6], False),  # all, though none is sure
        ([2, 4], [2], [1, 2, 3, 4, 5, 6], False),
        ([2, 4, 6], [2, 4], [2, 4, 6], False),
        ([1, 2, 4, 6], [1, 4, 6, 9], [1, 4, 6], True),
        ([1, 4, 6], [], [1, 4, 6], False),
    ],
)
def test_features_of_the_first_image_tell_most_then_those_that_look_as_at_first(sure, first, told, held):
    rng = np.random.default_rng(3)
    at = np.vstack([[40.0, 30.0], rng.uniform(0, 80, (6, 2))])
    off = rng.normal(0, 2, (6, 2))
    tracker = bare(Features(at, np.zeros_like(at)), range(1, 7), at[1:] + off)
    tracker._sure, tracker._first = np.array(sure, int), np.array(first, int)
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    mean, error = reference_offset(at[told], at[0], off[np.array(told) - 1])
    np.testing.assert_allclose(tracker._offset, mean if held else (1 - 3 / len(told)) * mean, atol=1e-12)
    assert tracker._aside == pytest.approx(0.3 + error)
    assert (tracker.seen, tracker.held) == (6, held)


@pytest.mark.parametrize(("place", "taken"), [(0.99e5, True), (1.01e5, False), (-1.01e5, False), (np.nan, False)])
def test_a_place_far_outside_leaves_the_point_and_counts_as_unseen(place, taken):
    at = np.array([[40.0, place], [40, 30], [41, 30], [42, 30]])
    tracker = bare(Features(at, np.zeros_like(at)), [1, 2, 3], at[1:])
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    assert tracker.unseen == (0 if taken else 1)
    np.testing.assert_array_equal(tracker.point, [40.0, place] if taken else [7.0, 7.0])


@pytest.mark.parametrize("held", [False, True])
def test_its_own_look_corrects_a_point_whose_depth_is_known(held):
    """Three links' features in sight: what else may be off is 0.3 px and their spread over the root of three.

    Where they are none of its own image, the chain may be off by 1.2 px as well.
    """
    at = np.array([[40.0, 30.0], [40, 30], [50, 30], [40, 40]])
    off = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 3.0]])
    asked = []
    tracker = bare(Features(at, np.zeros_like(at)), [1, 2, 3], at[1:] + off)
    tracker._first = tracker._sure = np.arange(1, 4) if held else np.zeros(0, int)
    tracker.on_link.depth = PointDepth(1.0, 0.1)
    tracker._by_look = lambda q, gray, place, spread: asked.append((place, spread)) or place + np.array([3.0, 4.0])
    tracker._correct(np.zeros(1), 1, GRAY, directions_of(tracker))
    mean, error = reference_offset(at[1:], at[0], off)
    ((place, aside),) = asked
    np.testing.assert_allclose(place, at[0] + (mean if held else 0.0))
    assert aside == pytest.approx(np.hypot(0.3 + error, 0 if held else 1.2))
    np.testing.assert_allclose(tracker.point, place + np.array([3.0, 4.0]))


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


@pytest.mark.parametrize(
    ("found", "turned", "place", "own", "sighting", "correlation"),
    [
        (0.92, 0.0, [10.3, 19.6], np.inf, [10.6, 19.2], 0.92),  # no witness, as features of its image are not in sight
        (0.93, 0.0, [10.3, 19.6], 0.5, [10.6, 19.2], 0.93),
        (0.99, 0.0, [10.3, 19.6], 0.5, [10.6, 19.2], 0.99),  # half the way; 0.7 of a drift of 0.1 px, but half a pixel
        (0.88, 0.0, [10.3, 19.6], np.inf, [10.6, 19.2], 0.88),
        (0.835, 0.0, [10.15, 19.8], np.inf, [10.6, 19.2], 0.835),  # halfway between 0.8 and 0.87
        (0.80, 0.99, [10, 20], np.inf, None, 0.80),  # as expected, but hardly
        (0.79, 0.99, [10, 22], 0.5, None, 0.99),  # turned otherwise: its place counts, but tells no depth
        (0.79, -1.0, [10, 20], np.inf, None, 0.79),
        (0.79, 0.835, [10, 21], np.inf, None, 0.835),
    ],
)
def test_the_own_look_counts_by_how_alike_it_is(found, turned, place, own, sighting, correlation):
    tracker, asked = looking(found, turned)
    corrected = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.5)
    np.testing.assert_allclose(corrected, place, atol=1e-9)
    assert tracker._own.deviation == pytest.approx(own)
    assert tracker._own.apart == pytest.approx(np.hypot(*(np.array(place) - [10, 20])))  # half of how far it is off
    np.testing.assert_equal(tracker._sighting, None if sighting is None else np.array(sighting, float))
    assert tracker.correlation[0] == np.float32(correlation)
    ((affine, covariance),) = asked
    np.testing.assert_array_equal(affine, [[1, 2], [3, 4]])
    # 1.5 deviations of 0.1 along (30, 40), half a pixel beside it.
    np.testing.assert_allclose(covariance, np.outer([4.5, 6.0], [4.5, 6.0]) + 0.25 * np.eye(2))


def test_the_own_look_is_sought_and_taken_where_a_point_that_is_farther_away_would_be():
    tracker, _ = looking(0.99, 0.0)
    tracker.on_link.slip = 0.02  # of which 1 is (30, 40) px
    found = tracker._look.found
    tracker._look.found = lambda gray, place, affine, covariance: (
        np.testing.assert_allclose(place, [10.6, 20.8]) or found(gray, place, affine, covariance)
    )
    corrected = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.5)
    np.testing.assert_allclose(corrected, [10.3, 19.6])  # halfway to (0.6, -0.8) off, as without
    assert tracker._own.apart == pytest.approx(0.5)
    np.testing.assert_allclose(tracker._sighting, [11.2, 20.0])  # as it is seen


@pytest.mark.parametrize(("found", "own"), [(0.86, np.inf), (0.87, 0.7 * 1.3), (0.88, 0.7 * 1.2)])
def test_beside_features_of_its_own_image_a_look_that_is_less_alike_counts(found, own):
    tracker, _ = looking(found, 0.0)
    tracker.held = True
    tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.5)
    assert tracker._own.deviation == pytest.approx(own)


@pytest.mark.parametrize(
    ("found", "turned", "middle", "place", "own", "correlation"),
    [
        (0.79, -1.0, 0.95, [10, 21], 0.7 * 1.0, 0.95),  # seen where the whole look is not, with a drift of its own
        (0.79, -1.0, 0.85, [10, 20 + 5 / 7], np.inf, 0.85),
        (0.79, -1.0, 0.84, [10, 20], np.inf, 0.79),
        (0.79, 0.95, 0.99, [10, 22], 0.5, 0.95),  # the whole look tells more, also where it is turned otherwise
        (0.99, -1.0, 1.00, [10.3, 19.6], 0.5, 0.99),
    ],
)
def test_the_middle_of_the_own_look_counts_where_the_whole_is_not_seen(found, turned, middle, place, own, correlation):
    tracker, _ = looking(found, turned, middle)
    tracker.held = True
    corrected = tracker._by_look(np.zeros(1), GRAY, np.array([10.0, 20.0]), 0.5)
    np.testing.assert_allclose(corrected, place, atol=1e-9)
    assert tracker._own.deviation == pytest.approx(own)
    assert tracker.correlation[0] == np.float32(correlation)
    by_middle = correlation == middle
    assert (tracker._sighting is None) == (not by_middle and found < 0.8)


@pytest.mark.parametrize(("deviation", "left_open"), [(0.1, 0.15), (0.04, 0.06), (0.02, 0.05), (0.001, 0.05)])
def test_a_search_leaves_some_depth_open(deviation, left_open):
    tracker, _ = looking(0.0, 0.0)
    tracker.on_link.depth = PointDepth(1.0, deviation)
    covariance = tracker._covariance(np.array([10.0, -20.0]), 2.0)
    off = left_open * np.array([10.0, -20.0])
    np.testing.assert_allclose(covariance, np.outer(off, off) + 4 * np.eye(2))


def test_uncertainty_is_of_what_the_tracker_knows():
    """The depth's deviation of 0.02 moves the place by 1 px, as its view says; the joints' positions say nothing."""
    tracker, _ = looking(0.0, 0.0)
    tracker.on_link.depth = PointDepth(1.0, 0.02)
    tracker._aside, tracker._own = 0.7, OwnLook(0.9, 0.5, 0.2)
    tracker._offset, tracker._told, tracker.held = np.array([0.9, -1.2]), 3, True
    expected = place_uncertainty(np.array([0.6, 0.8]), np.array([0.9, -1.2]), True, 3, 0.7, tracker._own)
    for q in ([0.5, 0.5], [3.0, 1.7]):
        assert tracker._uncertainty(np.array(q)) == pytest.approx(expected)
    tracker._doubt = 1.7  # of the body as a whole
    assert tracker._uncertainty(np.zeros(2)) == pytest.approx(1.7 * expected)
    tracker._doubt, tracker.held = 1.0, False
    assert tracker._uncertainty(np.zeros(2)) > expected
    tracker.on_link.depth = None
    assert tracker._uncertainty(np.zeros(2)) == np.inf


@pytest.mark.parametrize(
    ("unseen", "uncertainty", "certain", "lost"),
    [(0, 0.7, True, False), (0, 0.71, False, False), (1, 0.1, False, False), (4, 0.1, False, False),
     (5, 0.1, False, True), (6, 9.0, False, True)],
)  # fmt: skip
def test_certain_and_lost(unseen, uncertainty, certain, lost):
    lately = [0.01] * 4 + [uncertainty] * 5  # images, of which the last few alone make no place certain
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), unseen=unseen, uncertainty=0.02, lately=lately)
    assert tracker.certain() == certain
    assert tracker.usual_uncertainty == uncertainty
    assert tracker.lost.tolist() == [lost]


@pytest.mark.parametrize(("tolerance", "most"), [(0.2, 0.7), (1.0, 0.7), (2.0, 1.4), (10.0, 7.0)])
def test_a_place_has_to_be_known_as_well_as_a_tolerance_of_at_least_a_pixel_asks_for(tolerance, most):
    for uncertainty, certain in ((most - 1e-9, True), (most + 1e-9, False)):
        tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), uncertainty=0.02, lately=[uncertainty] * 9)
        assert tracker.certain(tolerance) == certain
        tracker.unseen = 1
        assert not tracker.certain(tolerance)


@pytest.mark.parametrize(("now", "certain"), [(1.4, True), (1.41, False), (np.inf, False)])
def test_a_place_that_an_image_shows_much_worse_than_usual_is_not_certain(now, certain):
    """In the same image, not once the middle of the last nine has followed."""
    lately = [0.5] * 8 + [now]
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))), uncertainty=now, lately=lately)
    assert tracker.certain() == certain


def test_what_is_known_of_a_place_is_kept_for_as_many_images_as_make_it_certain():
    tracker = bare(Features(np.zeros((1, 2)), np.zeros((1, 2))))
    told = iter(np.arange(1.0, 20.0))
    tracker._uncertainty = lambda q: next(told)
    for k in range(12):
        tracker._locate(np.array([0.1 * k, 0.0]), GRAY, directions_of(tracker))
    assert tracker.uncertainty == 12
    assert list(tracker.lately) == [*range(4, 13)]
    assert tracker.usual_uncertainty == 8
    np.testing.assert_array_equal(tracker._positions, [1.1, 0.0])
