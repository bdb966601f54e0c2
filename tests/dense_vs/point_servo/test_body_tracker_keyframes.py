"""What the body tracker carries along, keeps, forgets and looks for, each step by itself."""

from types import SimpleNamespace

import numpy as np
import pytest
from counted_features import DROPPED, GRAY, KNOWN, YOUNG, Features, Looks, bare, directions_of, link_of

from dense_vs.point_servo import body_tracker, more_features
from dense_vs.point_servo.body_features import Keyframe
from dense_vs.point_servo.point_depth import PointDepth


def carrying(monkeypatch, off, believed):
    asked = []

    def carried(before, now, places, expected):
        asked.append((before, now, places.copy(), expected.copy()))
        return expected + off, np.array(believed)

    monkeypatch.setattr(body_tracker, "carried", carried)
    return asked


@pytest.mark.parametrize(("away", "kept"), [(1.9, True), (2.1, False)])
def test_a_feature_that_leaves_its_link_is_given_up(monkeypatch, away, kept):
    """Off by more than 2 px from the median of the believed ones of its link; young ones and rare links may be."""
    at = np.array([[0, 0], [10, 10], [20, 10], [30, 10], [40, 10], [50, 10], [10, 30], [20, 30], [60, 50]], float)
    states = [KNOWN] * 8 + [YOUNG]
    features = Features(at, np.tile([[2.0, 1.0]], (9, 1)), states, [1, 1, 1, 1, 1, 1, 0, 0, 1])
    off = np.tile([5.0, 5.0], (8, 1))
    off[3] = [5.0, 5.0 + away]
    off[4] = [90.0, 90.0]  # not believed, and no part of the median
    off[5] = [70.0, 5.0]  # two features of another link: too few to tell
    off[7] = [30.0, 30.0]
    asked = carrying(monkeypatch, off, [True] * 4 + [False] + [True] * 3)
    tracker = bare(features, range(1, 9), at[1:], _kept_at=np.array([1.0]))
    corrected = []
    tracker._correct = lambda q, link, gray, directions: corrected.append((q[0], link))
    later = GRAY + 1
    tracker.update(later, [1.0])
    ((before, now, places, expected),) = asked
    assert before is GRAY
    assert now is later
    np.testing.assert_array_equal(places, at[1:])
    np.testing.assert_allclose(expected, at[1:] + np.array([2, 1]))
    assert tracker._live.tolist() == [1, 2, 3] + [4] * kept + [6, 7, 8]
    np.testing.assert_allclose(tracker._places, (expected + off)[tracker._live - 1])
    assert corrected == [(1.0, 1)]
    assert tracker._gray is later
    assert tracker._positions.tolist() == [1.0]


def test_features_are_held_to_their_first_looks(monkeypatch):
    """Those of the point's link and those of others in turn; what looks otherwise is given up."""
    monkeypatch.setattr(body_tracker, "HELD", 2)
    monkeypatch.setattr(body_tracker, "OTHERS_HELD", 3)
    at = np.array([[0, 0], *([10 * k, 10] for k in range(1, 9))], float)
    features = Features(at, np.zeros_like(at), links=[1, 1, 1, 1, 1, 0, 0, 0, 0])
    looks = Looks({1: (0.5, 0.25), 6: (1.0, 0.0)}, unsure=[2], unlike=[3])
    carrying(monkeypatch, 0.0, [True] * 8)
    tracker = bare(features, range(1, 9), at[1:], _looks=looks, _sure=np.array([2, 3, 5]))
    seen = []
    tracker._correct = lambda q, link, gray, directions: seen.append((tracker._live.tolist(), tracker._sure.tolist()))
    tracker.update(GRAY, np.zeros(1))
    assert looks.asked == [[1, 3, 5, 8]]
    assert seen == [([1, 2, 4, 5, 6, 7, 8], [1, 2, 3, 5, 8])]  # the third is not in sight any more
    np.testing.assert_allclose(tracker._places[0], at[1] + [0.5, 0.25])
    np.testing.assert_array_equal(tracker._places[1:], at[[2, 4, 5, 6, 7, 8]])
    carrying(monkeypatch, 0.0, [True] * 7)
    tracker.update(GRAY, np.zeros(1))
    carrying(monkeypatch, 0.0, [False] + [True] * 6)
    tracker.update(GRAY, np.zeros(1))
    assert looks.asked[1:] == [[2, 4, 7], [6]]  # and what is not seen at all is not held
    assert seen[1:] == [([1, 2, 4, 5, 6, 7, 8], [1, 3, 4, 5, 7, 8]), ([2, 4, 5, 6, 7, 8], [1, 3, 4, 5, 6, 7, 8])]


@pytest.mark.parametrize(("motion", "kept"), [(14.9, False), (15.1, True)])
def test_a_keyframe_is_taken_when_a_feature_of_the_link_has_moved_by_fifteen_pixels(monkeypatch, motion, kept):
    at = np.array([[0, 0], [10, 10], [20, 10], [30, 10], [40, 10]], float)
    features = Features(at, [[0, 0], [motion, 0], [0, motion / 2], [0, 0], [30, 0]], links=[1, 1, 1, 1, 0])
    carrying(monkeypatch, 0.0, [True] * 4)
    tracker = bare(features, range(1, 5), at[1:])
    keyframes = []
    tracker._keep = lambda gray, q, directions: keyframes.append(q[0])
    tracker.update(GRAY, np.array([1.0]))
    assert keyframes == [1.0] * kept
    features.links[1:4] = 0  # none of its link is in sight
    keyframes.clear()
    tracker.update(GRAY, np.array([9.0]))
    assert keyframes == []


def test_it_is_found_again_by_the_features_of_its_first_image(monkeypatch):
    at = np.array([[0, 0], [10, 10], [20, 10], [30, 10], [40, 10], [50, 10]], float)
    features = Features(at, [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [5, 0]], [KNOWN] * 4 + [YOUNG, KNOWN])
    tracker = bare(features, [1], [[0, 0]], _first=np.arange(6), _begun=at + 0.5, _first_gray=GRAY + 9, unseen=3)
    looks = tracker._looks = Looks({2: (0.0, 1.0)})
    tracker.on_link.defined_at = np.array([1.0])
    asked = carrying(monkeypatch, 0.25, [True, True, True, False])
    later = GRAY + 1
    assert tracker.find_again(later, [3.0])
    ((before, now, places, expected),) = asked
    assert before[0, 0] == 9
    assert now is later
    np.testing.assert_array_equal(places, at[[1, 2, 3, 5]] + 0.5)
    np.testing.assert_allclose(expected, places + 2 * features.rate[[1, 2, 3, 5]])
    assert tracker._live.tolist() == [1, 2, 3]
    np.testing.assert_allclose(tracker._places, expected[:3] + 0.25 + [[0, 0], [0, 1], [0, 0]])
    assert looks.calls == [("unturned", [1, 2, 3, 5])]
    assert looks.asked == [[1, 2, 3]]
    assert tracker.held
    assert tracker.unseen == 0
    assert tracker._gray is later
    assert tracker._positions.tolist() == [3.0]
    assert tracker.uncertainty == np.inf  # its depth is not known
    carrying(monkeypatch, 0.25, [True, True, False, False])
    assert not tracker.find_again(later, [3.0])


def test_places_of_the_own_look_are_kept_where_they_are_alike():
    """A place of more than 0.72 tells the point's depth, by how far it may have drifted, one of less is forgotten."""
    places = np.array([[1.0, 1.0], [2.0, 2.0]])
    frames = [Keyframe(np.array([float(k)]), np.array([0, 4]), places, GRAY + k) for k in range(3)]
    features = Features(np.zeros((5, 2)), np.zeros((5, 2)))
    features.keyframes = frames
    asked = []

    def found(gray, place, affine, covariance):
        asked.append((gray[0, 0], place, affine, covariance))
        return place + 0.5, 0.73 if gray[0, 0] == 2 else 0.71

    def view(postures):
        count = len(postures)
        return 10 * postures.repeat(2, axis=1), np.arange(count)[:, None, None] + np.eye(2), np.full((count, 2), 20.0)

    drift = {0.73: 2.0, 0.71: 0.1}
    tracker = bare(features, _look=SimpleNamespace(found=found, drift=drift.get))
    tracker.on_link = link_of(view=view)
    tracker._find_in([0, 2])
    assert asked == []  # nothing to expect it by
    tracker.on_link.depth = PointDepth(1.0, 0.1)
    tracker._find_in([])
    assert asked == []
    tracker._find_in([0, 2])
    assert features.keyframes[1] is frames[1]
    assert features.keyframes[0].features.tolist() == [4]
    assert features.keyframes[2].features.tolist() == [4, 0]
    np.testing.assert_allclose(features.keyframes[2].places, [[2.0, 2.0], [20.5, 20.5]])
    weights = np.linalg.norm(features.keyframes[2].directions, ord=2, axis=(1, 2))
    np.testing.assert_allclose(weights, [1, 0.5 / 2.0])
    np.testing.assert_allclose([one[1] for one in asked], [[0.0, 0.0], [20.0, 20.0]])
    np.testing.assert_allclose(asked[1][2], 1 + np.eye(2))
    np.testing.assert_allclose(asked[0][3], np.full((2, 2), 9.0) + np.eye(2))  # 1.5 * 0.1 * 20, and 1 px beside it
    tracker.on_link.slip = 0.03
    tracker._find_in([1])
    np.testing.assert_allclose(asked[-1][1], 10.0 + 0.03 * 20.0)  # where a point that is farther away would be


def test_a_keyframe_holds_known_features_that_look_as_they_did_alone():
    features = Features(np.zeros((6, 2)), np.zeros((6, 2)), [YOUNG, KNOWN, KNOWN, DROPPED, YOUNG, KNOWN])
    features.keyframes = [Keyframe(np.zeros(1), np.array([1]), np.zeros((1, 2)), GRAY)] * 2
    tracker = bare(features, [1, 2, 4, 5], np.arange(8.0), _sure=np.array([2, 3, 4]), _next=0)
    tracker._find_in = tracker._look_for_more = tracker.on_link.place = lambda one: None
    tracker._keep(GRAY, np.zeros(1), directions_of(tracker))
    assert features.keyframes[-1].features.tolist() == [2, 4]
    np.testing.assert_array_equal(features.keyframes[-1].places, [[2.0, 3.0], [4.0, 5.0]])
    assert tracker._live.tolist() == [1, 2, 4, 5]  # all are followed on


def test_a_keyframe_is_kept_with_the_sighting_and_young_features_are_decided(monkeypatch):
    features = Features(np.zeros((6, 2)), np.zeros((6, 2)), [YOUNG, KNOWN, YOUNG, DROPPED, YOUNG, KNOWN])
    frame = Keyframe(np.zeros(1), np.array([1]), np.zeros((1, 2)), GRAY)
    features.keyframes = [frame] * 10
    calls = []
    tracker = bare(features, [0, 1, 2, 3, 4], np.arange(10.0), _sighting=np.array([3.0, 4.0]), _next=8)
    tracker._sure = np.arange(6)
    tracker._first = np.array([0, 1, 5])
    tracker._find_in = lambda keyframes: calls.append(list(keyframes))
    tracker._look_for_more = lambda gray: calls.append("more")
    tracker.on_link.place = lambda first: calls.append(list(first))
    q = np.array([0.5])
    tracker._keep(GRAY, q, directions_of(tracker))
    kept = features.keyframes[-1]
    assert kept.features.tolist() == [1, 2, 3, 4, 0]
    np.testing.assert_array_equal(kept.places[-1], [3.0, 4.0])
    np.testing.assert_array_equal(kept.places[:-1], np.arange(10.0).reshape(5, 2)[1:])
    assert kept.positions is not q
    assert tracker._kept_at.tolist() == [0.5]
    assert features.assigned == [[2, 4]]  # young, the point aside
    assert calls == ["more"]
    assert tracker._live.tolist() == [0, 1, 2, 4]  # without what no link explains
    np.testing.assert_array_equal(tracker._places, np.arange(10.0).reshape(5, 2)[[0, 1, 2, 4]])
    # In the next two images: four of the ten former keyframes, from the ninth on and round; then the adjustment.
    find, learn = tracker._due
    find()
    assert calls == ["more", [0, 1, 8, 9]]
    assert tracker._next == 12
    assert features.refined == []
    learn()
    assert calls == ["more", [0, 1, 8, 9], [0, 1, 5]]
    assert features.refined == [([0, 1, 2, 4, 0], [1, 5])]
    tracker._keep(GRAY, q, directions_of(tracker))
    tracker._due[0]()
    assert calls[4] == sorted(k % 11 for k in range(12, 16))


def alone(monkeypatch, rate):
    """A tracker of a point that moves by so many px a rad, with nothing else of its link in sight."""
    features = Features(np.array([[40.0, 30.0]]), np.array([[rate, 0.0]]), links=[1])
    carrying(monkeypatch, 0.0, np.zeros(0, bool))
    tracker = bare(features, [], np.zeros((0, 2)), _kept_at=np.array([0.0]))
    tracker._correct = lambda q, link, gray, directions: None
    return tracker


def test_a_part_of_what_a_keyframe_asks_for_is_done_in_each_image(monkeypatch):
    tracker = alone(monkeypatch, 16.0)
    done = []

    def keep(gray, q, directions):
        done.append(q[0])
        tracker._due = [lambda: done.append("find"), lambda: done.append("learn")]
        tracker._kept_at = q

    tracker._keep = keep
    for q in (1.0, 2.0, 3.0, 4.0, 4.1):
        tracker.update(GRAY, [q])
    assert done == [1.0, "find", "learn", 4.0, "find"]


@pytest.mark.parametrize(("many", "forgotten"), [(600, False), (601, True)])
def test_of_many_features_those_that_no_keyframe_holds_are_forgotten(many, forgotten):
    features = Features(np.zeros((many, 2)), np.zeros((many, 2)))
    features.keyframes = [Keyframe(np.zeros(1), np.array([1]), np.zeros((1, 2)), GRAY)] * 2
    asked = []
    features.forget_unseen = lambda others: asked.append(list(others)) or np.arange(many)[::-1]
    tracker = bare(features, [3, 4], np.zeros((2, 2)), _first=np.array([0, 7]), _next=0, _sure=np.array([4, 5]))
    tracker.on_link.place = lambda one: None
    tracker._learn()
    assert asked == ([[3, 4, 0, 7]] if forgotten else [])
    assert tracker._live.tolist() == ([many - 4, many - 5] if forgotten else [3, 4])
    assert tracker._first.tolist() == ([many - 1, many - 8] if forgotten else [0, 7])
    assert tracker._sure.tolist() == ([many - 5] if forgotten else [4, 5])  # of those in sight
    assert tracker._looks.calls == ([("renumber", [*range(many)][::-1])] if forgotten else [])


def test_new_features_are_sought_about_those_of_each_link_in_sight(monkeypatch):
    """Up to 70 on the point's own link and 25 on each other learned one, 4 to 9 px about what is in sight."""
    own = [[20, 20], [40, 20]]  # two features, and the point at (30, 40)
    other = [[60, 40], [70, 40], [65, 50]]
    at = np.array([[30, 40], *own, *other, [5, 55], [6, 55], [7, 56]], float)
    features = Features(at, np.zeros_like(at), links=[1, 1, 1, 0, 0, 0, 2, 2, 2])
    asked = []

    def new_features(gray, where, count, apart):
        asked.append((where.copy(), count, apart))
        return np.array([[1.0, 2.0], [64.0, 45.0]])[: len(asked)]

    monkeypatch.setattr(more_features, "new_features", new_features)
    tracker = bare(features, range(1, 9), at[1:], point=at[0])
    features.keyframes = [Keyframe(np.zeros(1), np.array([1]), at[1:2], GRAY)]
    tracker._look_for_more(GRAY)
    (first, wanted, apart), (second, others, _) = asked
    assert (wanted, others, apart) == (70 - 2, 25 - 3, 4)

    def distance(places):
        return np.min([np.hypot(*(np.mgrid[:60, :80][::-1] - np.reshape(c, (2, 1, 1)))) for c in places], axis=0)

    for mask, corners in ((first, [*own, [30, 40]]), (second, other)):
        taken = distance(at[1:])
        assert mask[(distance(corners) < 8) & (taken > 5)].all()
        assert not mask[taken < 4].any()
        outside = np.ones(GRAY.shape, bool)
        low, high = np.min(corners, axis=0).astype(int) - 9, np.max(corners, axis=0).astype(int) + 10
        outside[max(low[1], 0) : high[1], max(low[0], 0) : high[0]] = False
        assert not mask[outside].any()
    assert tracker._live.tolist() == [*range(1, 9), 9, 10, 11]
    found = [[1, 2], [1, 2], [64, 45]]
    np.testing.assert_array_equal(tracker._places[8:], found)
    assert tracker._looks.calls == [("take", [9, 10, 11], found)]
    assert features.keyframes[-1].features.tolist() == [1, 9, 10, 11]
    np.testing.assert_array_equal(features.keyframes[-1].places, [at[1], *found])


def test_what_is_found_on_one_link_is_kept_apart_from_on_the_next(monkeypatch):
    at = np.array([[30, 40], [26, 30], [34, 30], [22, 36], [38, 36], [30, 28]], float)
    features, masks = Features(at, np.zeros_like(at), links=[1, 1, 1, 0, 0, 0]), []
    monkeypatch.setattr(
        more_features, "new_features", lambda *given: masks.append(given[1] > 0) or np.array([[30, 34.0]])
    )
    tracker = bare(features, range(1, 6), at[1:], point=at[0])
    features.keyframes = [Keyframe(np.zeros(1), np.array([1]), at[1:2], GRAY)]
    tracker._look_for_more(GRAY)
    y, x = np.mgrid[:60, :80]
    near = np.hypot(x - 30, y - 34) < 4
    assert masks[0][34, 30]
    assert not masks[1][near].any()
    assert masks[1].any()


def test_no_new_features_on_another_link_where_too_few_are_in_sight_or_enough(monkeypatch):
    asked = []
    monkeypatch.setattr(more_features, "new_features", lambda *given: asked.append(given) or np.zeros((0, 2)))
    at = np.vstack([[[30, 40], [20, 20]], np.tile([[60.0, 40.0]], (24, 1)), [[60, 40]]])
    features = Features(at, np.zeros_like(at), links=[1, 1] + [0] * 24 + [2])
    tracker = bare(features, range(1, 26), at[1:26], point=at[0])
    tracker._look_for_more(
        GRAY
    )  # one and the point of its own link; one is wanted of the first and two are of no other
    assert [given[2] for given in asked] == [69, 1]
    features.links[26] = 0
    tracker._live, tracker._places = np.arange(1, 27), at[1:]
    tracker._look_for_more(GRAY)  # and now none is
    assert [given[2] for given in asked] == [69, 1, 69]
    assert len(features) == 27


@pytest.mark.parametrize("seen", [0, 1, 2])
def test_a_link_of_which_hardly_anything_is_seen_gets_features_about_the_point(monkeypatch, seen):
    """Within 20 px of it and of those, where another link's would be forgotten; 9 px from three places on."""
    asked = []
    monkeypatch.setattr(more_features, "new_features", lambda *given: asked.append(given[1]) or np.zeros((0, 2)))
    at = np.array([[40, 30], [41, 30], [40, 31]], float)
    features = Features(at[: 1 + seen], np.zeros((1 + seen, 2)), links=[1] * (1 + seen))
    tracker = bare(features, range(1, 1 + seen), at[1 : 1 + seen], point=at[0])
    tracker._look_for_more(GRAY)
    (mask,) = asked
    y, x = np.mgrid[:60, :80]
    distance = np.hypot(x - 40, y - 30)
    most = 9 if seen == 2 else 20
    assert mask[(distance < most - 1) & (distance > (6 if seen else 0))].all()
    assert not mask[distance > most + 2].any()


def test_a_keyframe_is_due_as_the_point_moves_where_nothing_else_of_its_link_is_seen(monkeypatch):
    tracker = alone(monkeypatch, 4.5)
    kept = []
    tracker._keep = lambda gray, q, directions: kept.append(q[0])
    for q in (1.0, 3.3, 3.4):
        tracker.update(GRAY, [q])
    assert kept == [3.4]  # 15.3 px


@pytest.mark.parametrize(
    ("given", "state", "link"), [(None, KNOWN, 2), (None, YOUNG, 1), (0, KNOWN, 0), (3, YOUNG, 3), (3, DROPPED, 3)]
)
def test_a_point_that_is_on_no_link_by_itself_goes_to_that_of_most_around_it(monkeypatch, given, state, link):
    features = Features(np.zeros((0, 2)), np.zeros((0, 2)), [], [])
    features.states, features.links = np.zeros(0, int), np.zeros(0, int)
    around = np.column_stack([31.0 + np.arange(12), np.full(12, 40.0)])
    asked = []

    def new_features(gray, where, count, apart):
        asked.append((where, count, apart))
        return around

    def assign(numbers):
        features.states[:] = KNOWN
        features.states[[0, 4]] = [state, DROPPED]
        features.links[:] = [2, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0]

    features.assign = assign
    monkeypatch.setattr(body_tracker, "new_features", new_features)
    frames = [object()]
    monkeypatch.setattr(body_tracker, "followed_back", lambda history, numbers, begun, trace: frames)
    tracker = bare(features, point=np.array([30.0, 40.0]))
    body = np.ones(GRAY.shape, bool)
    tracker._look_back([], body, given, None)
    ((where, count, apart),) = asked
    y, x = np.mgrid[:60, :80]
    away = np.hypot(x - 30, y - 40)
    assert not where[away <= 5].any()
    assert where[away > 6].all()
    assert body.all()  # whose own it is
    assert (count, apart) == (180, 5)
    # Of the seven that are nearest and known, features 1, 2, 3, 5, 6, 7, 8: three on link 0, four on link 1.
    assert features.links[0] == link
    assert features.keyframes is frames
    assert tracker._first.tolist() == list(range(13))
    assert tracker._looks.calls == [("take", list(range(13)), tracker._begun.tolist())]
    np.testing.assert_array_equal(tracker._begun, np.vstack([[30, 40], around]))
    assert tracker._live.tolist() == [1, 2, 3, *range(5, 13)]  # without the point, which is known by its look
    np.testing.assert_array_equal(tracker._places, tracker._begun[tracker._live])
