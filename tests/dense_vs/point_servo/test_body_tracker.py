"""A point of a textured plate that three joints turn in space: followed, covered, found again, never taken for sure."""

import numpy as np
import pytest
from turned_plate import START, Plate

from dense_vs.point_servo.body_features import MOST_KEYFRAMES
from dense_vs.point_servo.body_tracker import BodyTracker

HIDDEN = np.full((96, 128), 90, np.uint8)
EVERYWHERE = np.ones(HIDDEN.shape, bool)
LEARNED = np.ones(3, bool)


@pytest.fixture(scope="module")
def plate():
    return Plate()


def babbled(plate, seed=0, count=50):
    """Images and joints of a random walk that ends in the reference posture."""
    steps = np.cumsum(np.random.default_rng(seed).normal(0, 0.03, (count, 3)), axis=0)
    return [(plate.image(q), q) for q in np.clip(steps - steps[-1], -0.3, 0.3)]


def make(plate, history=None, chain=None, learned=LEARNED):
    return BodyTracker(
        chain or plate.chain,
        plate.focal,
        plate.center,
        learned,
        history or babbled(plate),
        START,
        EVERYWHERE,
        lost_after=5,
    )


def follow(tracker, plate, end, frames=30):
    """Errors [px] on the way to a posture."""
    errors = []
    for share in np.linspace(0, 1, frames + 1)[1:]:
        tracker.update(plate.image(share * end), share * end)
        errors.append(float(np.linalg.norm(tracker.point - plate.place(share * end))))
    return errors


END = np.array([0.5, -0.35, 0.3])


def test_it_follows_beyond_the_postures_it_has_seen(plate):
    tracker = make(plate)
    assert tracker.known
    assert tracker.features.links[0] == 2
    assert np.max(follow(tracker, plate, 0.4 * END)) < 0.5
    assert tracker.certain()
    for share in np.linspace(0.4, 1.0, 20):
        tracker.update(plate.image(share * END), share * END)
    assert np.linalg.norm(tracker.point - plate.place(END)) < 1.0
    assert not tracker.lost[0]
    np.testing.assert_array_equal(tracker.points, tracker.point[None])


def test_a_chain_that_is_somewhat_wrong_is_refined(plate):
    wrong = plate.chain.moved(np.random.default_rng(1).normal(0, 0.02, (3, 4)))
    tracker, far = make(plate, chain=wrong), np.array([0.4, 0.3, -0.3])
    rotation, shift = (value[0, 2] for value in wrong.link_poses(far[None]))
    here = rotation @ np.append((START - plate.center) / plate.focal, 1.0) + shift
    before = np.linalg.norm(plate.center + plate.focal * here[:2] / here[2] - plate.place(far))

    def off():
        return np.linalg.norm(tracker.features.project(np.array([0]), far)[0] - plate.place(far))

    assert before > 1.5
    assert off() < 0.5 * before  # by the images before the point was defined
    assert np.max(follow(tracker, plate, END)) < 1.0
    assert off() < 0.5 * before


def test_the_point_itself_is_found_in_images_before_and_tells_its_depth(plate):
    history = babbled(plate)
    tracker = make(plate, history)
    postures, places, _ = tracker.features.tracks(np.array([0]))
    seen = np.isfinite(places[:, 0, 0])
    assert seen.sum() > 40
    off = [np.linalg.norm(place[0] - plate.place(q)) for q, place in zip(postures[seen], places[seen], strict=True)]
    assert np.median(off) < 0.3
    assert abs(tracker.on_link.depth.depth - 1.0) < 0.01  # the plate's plane, in the chain's unit
    assert tracker.on_link.depth.deviation < 0.02


def test_places_of_the_point_are_kept_when_keyframes_are_many(plate):
    tracker = make(plate)
    features = tracker.features
    own = sum(0 in one.features for one in features.keyframes)
    empty = features.keyframes[-1].with_place(0, None)
    for _ in range(3 * MOST_KEYFRAMES):
        features.keep(empty)
    assert len(features.keyframes) <= MOST_KEYFRAMES
    assert sum(0 in one.features for one in features.keyframes) == own


def test_features_that_no_keyframe_holds_are_forgotten_and_nothing_else_changes(plate, monkeypatch):
    trackers = [make(plate), make(plate)]
    usual = follow(trackers[0], plate, END)
    monkeypatch.setattr("dense_vs.point_servo.body_features.MOST_KEYFRAMES", 20)
    monkeypatch.setattr("dense_vs.point_servo.body_tracker.MOST_FEATURES", 0)
    features = trackers[1].features
    assert np.max(np.abs(np.array(follow(trackers[1], plate, END)) - usual)) < 0.3  # fewer keyframes, the same point
    held = np.unique(np.concatenate([one.features for one in features.keyframes]))
    assert len(features) <= len(np.union1d(held, trackers[1]._first))
    assert features.links[0] == 2
    rows = features.tracks(np.array([0]))[1][:, 0]
    assert np.isfinite(rows[:, 0]).any()
    links, points = features.links.copy(), features.points.copy()
    again = features.forget_unseen(np.array([1]))
    np.testing.assert_array_equal(features.links, links[again >= 0])
    np.testing.assert_array_equal(features.points, points[again >= 0])
    np.testing.assert_array_equal(features.tracks(np.array([0]))[1][:, 0], rows)


def test_a_covered_point_is_predicted_flagged_and_found_again(plate):
    tracker = make(plate)
    path = np.linspace(0, 1, 21)[1:, None] * np.array([0.25, -0.2, 0.2])
    for q in path[:10]:
        tracker.update(plate.image(q), q)
    for q in path[10:]:
        tracker.update(HIDDEN, q)
        assert not tracker.certain()
    assert tracker.lost[0]
    assert np.linalg.norm(tracker.point - plate.place(path[-1])) < 1.5


def test_what_moves_otherwise_than_by_the_joints_is_on_no_link(plate):
    rng = np.random.default_rng(5)
    history = [(gray, rng.normal(0, 0.1, 3)) for gray, _ in babbled(plate)]
    tracker = make(plate, history)
    assert not tracker.known
    assert not tracker.certain()


def test_a_posture_that_the_chain_cannot_show_leaves_the_point_where_it_was(plate):
    tracker = make(plate)
    before = tracker.point.copy()
    tracker.features.points = tracker.features.points * [1, 1, -1]
    tracker.update(HIDDEN, np.zeros(3))
    np.testing.assert_array_equal(tracker.point, before)
    assert tracker.unseen == 1
    assert not tracker.certain()


def test_it_is_less_certain_the_farther_it_turns_from_what_it_has_seen(plate):
    known = []
    for turned in (0.0, 0.3, 0.9):
        tracker = make(plate, babbled(plate)[-12:])
        tracker.update(HIDDEN, turned * np.array([1.0, -1.0, 1.0]))
        known.append(tracker.uncertainty)
    assert known[0] < known[1] < known[2]
