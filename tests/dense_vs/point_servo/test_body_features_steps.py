"""Features on a body's links by hand: what keyframes hold, which link explains a feature, what an adjustment takes."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.point_servo import body_features
from dense_vs.point_servo.body_features import BodyFeatures, FeatureState, Keyframe

FOCAL, CENTER = 200.0, np.array([64.0, 48.0])
IMAGE = np.zeros((96, 128), np.uint8)
KNOWN, YOUNG, DROPPED = FeatureState.KNOWN, FeatureState.YOUNG, FeatureState.DROPPED


def two_joints():
    """Axes along z and y at different places, the second carried by the first."""
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    return Chain(axes, np.array([[0.1, 0.0, 1.0], [-0.1, 0.0, 1.2]]), np.array([0.0, 0.1]), np.array([-1, 0]))


def features(learned=(True, True), information=None):
    return BodyFeatures(two_joints(), FOCAL, CENTER, np.array(learned), information)


def place(link, point, q):
    """A point of the home posture taken along by plain turns, from the last joint to the first."""
    chain = two_joints()
    here = np.array(point, float)
    for n in range(link, -1, -1):
        turn = Rotation.from_rotvec((q[n] - chain.home[n]) * chain.axes[n])
        here = turn.apply(here - chain.points[n]) + chain.points[n]
    return here


def pixel(link, point, q):
    here = place(link, point, q)
    return FOCAL * here[:2] / here[2] + CENTER


def keyframe(numbers, places=None, q=(0.0, 0.0)):
    numbers = np.array(numbers, int)
    places = np.zeros((len(numbers), 2)) if places is None else np.array(places, float)
    return Keyframe(np.array(q, float), numbers, places, IMAGE)


def test_features_are_seen_where_their_links_take_them():
    body = features()
    assert len(body) == 0
    assert body.added(2).tolist() == [0, 1]
    assert body.added(2).tolist() == [2, 3]
    assert body.links.tolist() == [-1] * 4
    assert body.states.tolist() == [YOUNG] * 4
    assert (body.points == 0).all()
    body.links[:] = [0, 1, 1, -1]
    body.points[:] = [[0.1, 0.2, 1.0], [-0.2, 0.1, 0.9], [0, 0, -2.0], [0.3, 0.1, 2.0]]
    q = np.array([0.4, -0.3])
    np.testing.assert_allclose(
        body.positions(np.array([1, 0]), q), [place(1, body.points[1], q), place(0, body.points[0], q)]
    )
    np.testing.assert_allclose(body.positions(np.array([3]), q), body.points[3:])  # the background
    seen = body.project(np.arange(4), q)
    np.testing.assert_allclose(seen[:2], [pixel(0, body.points[0], q), pixel(1, body.points[1], q)])
    assert (seen[2] == -1e6).all()  # behind the camera
    body.states[:] = [KNOWN, KNOWN, YOUNG, KNOWN]
    assert body.seen_on(1, np.array([0, 1, 2, 3])).tolist() == [False, True, False, False]


@pytest.mark.parametrize(("depth", "shown"), [(0.002, True), (0.0005, False), (-1.0, False)])
def test_a_millimeter_before_the_camera_is_the_least(depth, shown):
    found = features().pixels(np.array([[0.0, 0.0, depth]]))
    np.testing.assert_allclose(found[0], CENTER if shown else [-1e6, -1e6])


def test_tracks_are_of_the_features_asked_about_in_their_order():
    body = features()
    body.added(4)
    body.keep(keyframe([0, 2, 3], [[1, 1], [2, 2], [3, 3]], q=(0.1, 0.2)))
    body.keep(keyframe([3, 1], [[4, 4], [5, 5]], q=(0.3, 0.4)))
    body.keyframes[0].directions[:] = np.arange(1, 4)[:, None, None]
    postures, places, directions = body.tracks(np.array([3, 0]))
    np.testing.assert_array_equal(postures, [[0.1, 0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(places[:, 0], [[3, 3], [4, 4]])
    np.testing.assert_array_equal(places[0, 1], [1, 1])
    assert np.isnan(places[1, 1]).all()
    np.testing.assert_array_equal(directions[:, :, 0, 0], [[3, 1], [directions[1, 0, 0, 0], 0]])


def test_a_place_counts_as_much_as_it_is_told_to():
    image = (np.add.outer(np.zeros(96), np.arange(128) > 40) * 200).astype(np.uint8)  # an edge upward, at x = 40.5
    seen = Keyframe(np.zeros(2), np.array([3, 5]), np.array([[40.5, 30], [40.5, 60]]), image)
    np.testing.assert_allclose(seen.directions, np.tile(np.diag([1, 0.1]), (2, 1, 1)), atol=1e-6)
    less = seen.with_place(3, np.array([40.5, 33]), 0.25)
    assert less.features.tolist() == [5, 3]
    np.testing.assert_allclose(less.directions, [np.diag([1, 0.1]), np.diag([0.25, 0.025])], atol=1e-6)
    again = less.with_place(5, None)  # what stays keeps its weight
    np.testing.assert_allclose(again.directions, [np.diag([0.25, 0.025])], atol=1e-6)
    assert again.with_place(3, None).directions.shape == (0, 2, 2)
    more = less.with_more(np.array([7]), np.array([[40.5, 50.0]]))
    assert more.features.tolist() == [5, 3, 7]
    np.testing.assert_array_equal(more.places, [[40.5, 60], [40.5, 33], [40.5, 50]])
    np.testing.assert_allclose(more.directions, [*less.directions, np.diag([1, 0.1])], atol=1e-6)


@pytest.mark.parametrize("lasting", [False, True])
def test_of_too_many_keyframes_every_sixth_of_the_older_half_goes(lasting):
    """The first stays, and those that hold a lasting feature while there are others."""
    body = features()
    body.added(2)
    body.lasting = np.array([0])
    for k in range(110):
        body.keep(keyframe([0 if lasting and k % 2 else 1], q=(k, 0)))
    assert len(body.keyframes) == 110
    body.keep(keyframe([1], q=(110, 0)))
    left = [int(one.positions[0]) for one in body.keyframes]
    spare = [k for k in range(1, 55) if not (lasting and k % 2)]
    assert sorted(set(range(111)) - set(left)) == spare[::6]
    assert left == sorted(left)


def test_all_older_keyframes_may_go_where_each_holds_a_lasting_feature():
    body = features()
    body.added(1)
    body.lasting = np.array([0])
    for k in range(111):
        body.keep(keyframe([0], q=(k, 0)))
    assert len(body.keyframes) == 111 - len(range(1, 55)[::6])


@pytest.mark.parametrize(
    ("count", "travel", "state"),
    [(3, 0.0, YOUNG), (4, 0.99, DROPPED), (4, 1.01, YOUNG), (9, 2.99, YOUNG), (5, 3.01, KNOWN), (4, 9.0, YOUNG)],
)
def test_what_is_decided_of_a_young_feature(monkeypatch, count, travel, state):
    """Still in four keyframes: background. Moved by 3 px in five: its link is decided. The other way is shorter."""
    body = features()
    (number,) = body.added(1)
    monkeypatch.setattr(body, "_decide", lambda numbers, *_: body.states.__setitem__(numbers, KNOWN))
    for k in range(10):
        body.keep(keyframe([number], [[20 + travel * k / (count - 1), 30 - 0.5 * travel * k / (count - 1)]])
                  if k < count else keyframe([]))  # fmt: skip
    body.assign(np.array([number]))
    assert body.states[0] == state
    body.states[0] = YOUNG
    body.assign(np.zeros(0, int))
    assert body.states[0] == YOUNG


def seen_in(body, links, points, postures):
    """New features with exact tracks."""
    numbers = body.added(len(links))
    for q in postures:
        body.keep(keyframe(numbers, [pixel(n, point, q) for n, point in zip(links, points, strict=True)], q))
    return numbers


POSTURES = np.random.default_rng(0).uniform(-0.3, 0.3, (12, 2)) + np.array([0.0, 0.1])


def test_a_feature_goes_to_the_link_that_explains_it():
    body = features()
    links = [1, 0, 1, 0]
    points = np.array([[0.15, 0.1, 1.1], [-0.1, 0.2, 0.9], [-0.05, -0.15, 1.3], [0.2, -0.1, 1.0]])
    numbers = seen_in(body, links, points, POSTURES)
    wrong = body.added(1)
    rng = np.random.default_rng(1)
    for k, one in enumerate(body.keyframes):
        body.keyframes[k] = one.with_place(wrong[0], rng.uniform(30, 60, 2))
    body.assign(np.append(numbers, wrong))
    assert body.links[:4].tolist() == links
    assert body.states.tolist() == [KNOWN] * 4 + [DROPPED]
    for k in range(2):  # both links: the place in space follows too, exactly for what turns about two axes
        np.testing.assert_allclose(body.points[2 * k], points[2 * k], atol=1e-3)
    unknown = features((True, False))
    numbers = seen_in(unknown, links, points, POSTURES)
    unknown.assign(numbers)
    assert unknown.states.tolist() == [DROPPED, KNOWN, DROPPED, KNOWN]  # of what is learned, none explains the others
    assert unknown.links[[1, 3]].tolist() == [0, 0]


def test_a_feature_that_the_latest_keyframes_do_not_show_begins_where_it_was_seen_last(monkeypatch):
    body = features()
    links, points = [1, 0, 1], np.array([[0.15, 0.1, 1.1], [-0.1, 0.2, 0.9], [-0.05, -0.15, 1.3]])
    numbers = seen_in(body, links, points, POSTURES)
    for k, (number, last) in enumerate(zip(numbers, (8, 5, 11), strict=True)):
        for frame, one in enumerate(body.keyframes):
            if frame > last:
                kept = one.features != number
                body.keyframes[frame] = Keyframe(one.positions, one.features[kept], one.places[kept], IMAGE)
        assert np.isfinite(body.tracks(numbers)[1][last, k]).all()
    started, place_points = [], body_features.place_points

    def placed(chain, focal, center, postures, places, links, starts, *rest):
        started.append(starts.copy())
        return place_points(chain, focal, center, postures, places, links, starts, *rest)

    monkeypatch.setattr(body_features, "place_points", placed)
    body.assign(numbers)
    assert body.links[:3].tolist() == links
    (starts,) = started
    chain = two_joints()
    for link in (0, 1):
        for k, last in enumerate((8, 5, 11)):
            rotation, translation = (pose[0, link] for pose in chain.link_poses(POSTURES[last : last + 1]))
            seen = rotation @ starts[3 * link + k] + translation  # at a depth of 1
            np.testing.assert_allclose(seen, [*(pixel(links[k], points[k], POSTURES[last]) - CENTER) / FOCAL, 1.0])


def test_the_usual_depth_is_the_median_of_the_link_s_features():
    body = features()
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    rotation, shift = np.array([np.eye(3), turn]), np.array([[0, 0, 0.5], [0.1, 0.2, 1.0]])
    np.testing.assert_array_equal(body._usual_depths(1, rotation, shift), 1.0)
    body.added(5)
    body.points[:] = [[0, 0, 1.0], [0.5, 0, 1.4], [0, 0.2, 4.0], [0, 0, 7.0], [0, 0, 8.0]]
    body.links[:] = [1, 1, 1, 0, 1]
    body.states[:] = [KNOWN, KNOWN, KNOWN, KNOWN, YOUNG]
    depths = [
        [(turn_k @ point)[2] + shift_k[2] for point in body.points[:3]]
        for turn_k, shift_k in zip(rotation, shift, strict=True)
    ]
    np.testing.assert_allclose(body._usual_depths(1, rotation, shift), np.median(depths, axis=1))
    np.testing.assert_allclose(body._usual_depths(2, rotation, shift), 2.7)  # of all that are known: 1, 1.4, 4, 7
    np.testing.assert_allclose(body._usual_depths(1, rotation, shift - [0, 0, 9.0]), 0.1)


@pytest.fixture
def adjusting(monkeypatch):
    """The arguments of the adjustment, which here moves points by 1 and the focal length by 10."""
    calls = []

    def adjusted(problem, state, rounds, iterations):
        calls.append(SimpleNamespace(**problem, state=state, rounds=rounds, iterations=iterations))
        return replace(
            state, chain=state.chain.scaled(1.0), focal=state.focal + 10, points=state.points + 1.0,
            bend=state.bend - 0.01, moved=state.moved + np.arange(9.0),
        )  # fmt: skip

    names = inspect.signature(body_features.TrackProblem).parameters
    monkeypatch.setattr(body_features, "TrackProblem", lambda *given: dict(zip(names, given, strict=True)))
    monkeypatch.setattr(body_features, "adjusted", adjusted)
    return calls


@pytest.mark.parametrize(("known", "adjusted"), [(9, False), (10, True)])
def test_ten_features_that_were_seen_five_times_are_adjusted(adjusting, known, adjusted):
    body = features()
    numbers = body.added(13)
    body.states[:] = KNOWN
    body.states[known + 2 :] = YOUNG
    body.links[:] = 1
    for k in range(6):
        body.keep(keyframe(numbers if k < 4 else np.append(numbers[:known], numbers[12:]), q=(k, 0)))
    before = body.chain
    body.refine(np.zeros(0, int), np.zeros(0, int))
    assert len(adjusting) == adjusted
    assert (body.focal == FOCAL + 10) == adjusted
    assert (body.lens.bend == -0.01) == adjusted
    assert (body.chain is not before) == adjusted
    assert (body.points[:known] == adjusted).all()
    assert (body.points[known:] == 0).all()
    if adjusted:
        (call,) = adjusting
        assert call.links.tolist() == [1] * 10
        assert call.joints[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
        assert call.center == (64.0, 48.0)
        assert call.focal_prior == (FOCAL, 0.02)
        assert (call.noise, call.bend_deviation) == (0.5, 0.01)
        assert (call.rounds, call.iterations) == (1, 1)
        np.testing.assert_array_equal(call.weights, np.ones((6, 10)))


def test_what_a_fit_knew_of_the_chain_counts_twice_however_far_it_has_moved_since(adjusting):
    told = np.diag(np.arange(1.0, 10))
    for body, expected in ((features(), None), (features(information=told), 2.0 * told)):
        numbers = body.added(10)
        body.states[:], body.links[:] = KNOWN, 1
        for k in range(5):
            body.keep(keyframe(numbers, q=(k, 0)))
        for turn in range(2):
            body.refine(np.zeros(0, int), np.zeros(0, int))
            call = adjusting[-1]
            np.testing.assert_array_equal(call.state.moved, turn * np.arange(9.0) if turn else 0.0)
            assert call.directions.shape == (5, 10, 2, 2)
            np.testing.assert_array_equal(call.information, expected)


def test_an_adjustment_takes_what_is_preferred_and_was_seen_most_in_spread_and_latest_keyframes(adjusting):
    body = features()
    numbers = body.added(170)
    body.states[:] = KNOWN
    body.links[:] = np.arange(170)
    for k in range(100):
        seen = numbers[(numbers < 100) | (k < 50)]
        body.keep(keyframe(seen[(seen != 7) | (k < 20)], q=(k, 0)))
    body.refine(np.arange(140, 165), np.zeros(0, int))
    (call,) = adjusting
    used = set(call.links.tolist())
    assert len(used) == 160
    assert used >= set(range(140, 165))
    assert used >= set(range(100)) - {7}  # seen more often than the others
    assert 7 not in used
    assert call.links.tolist() == sorted(used)
    spread = np.linspace(0, 99, 80).round().astype(int)
    assert call.joints[:, 0].tolist() == sorted({*spread, *range(92, 100)})
    assert call.pixels.shape == (len(call.joints), 160, 2)


def test_features_that_took_no_part_are_placed_anew_on_the_chain(adjusting):
    body = features()
    points = np.array([[0.15, 0.1, 1.1], [-0.1, 0.2, 0.9], [-0.05, -0.15, 1.3]])
    seen_in(body, [1, 1, 0], points, POSTURES[:4])
    body.links[:] = [1, 1, 0]
    body.states[:] = [KNOWN, DROPPED, KNOWN]
    body.points[:] = points * 1.05
    moved = body.points.copy()
    body._follow(np.array([0, 1]))
    np.testing.assert_allclose(body.points[0], points[0], atol=5e-3)
    np.testing.assert_array_equal(body.points[1:], moved[1:])
    body._follow(np.array([1]))
    np.testing.assert_array_equal(body.points[1:], moved[1:])
    used = body.added(10)
    body.states[used], body.links[used] = KNOWN, 1
    for _ in range(5):
        body.keep(keyframe(used))
    followed = []
    body._follow = lambda numbers: followed.append(numbers.tolist())
    body.refine(np.zeros(0, int), np.array([0, 2, 5]))
    assert followed == [[0, 2]]


def test_a_bent_lens_is_where_features_are_seen_and_how_they_are_placed():
    body = features()
    body.lens = Lens.of_center(CENTER, -0.08)
    body.added(3)
    body.links[:], body.states[:] = 1, KNOWN
    body.points[:] = [[0.2, 0.15, 1.0], [-0.25, 0.2, 0.9], [0.0, 0.0, 1.1]]
    q = np.array([0.1, 0.2])
    straight = np.array([pixel(1, point, q) for point in body.points])
    seen = body.project(np.arange(3), q)
    np.testing.assert_allclose(seen, body.lens.bent(straight), atol=1e-9)
    assert np.linalg.norm(seen - straight, axis=1).max() > 1.0
    there = np.array([place(1, point, q) for point in body.points])
    np.testing.assert_allclose(body.rays(seen), there / there[:, 2:], atol=1e-9)


def test_features_seen_by_a_bent_lens_find_links_depths_and_bend(monkeypatch):
    """A point alone is found in a bent image with the lens known; many of them tell the lens too."""
    monkeypatch.setattr(body_features, "BEND_DEVIATION", 0.1)
    lens = Lens.of_center(CENTER, -0.06)
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.3, -0.2, 0.8], [0.3, 0.2, 1.1], (40, 3))
    links = np.arange(40) % 2
    postures = rng.uniform(-0.5, 0.5, (25, 2))
    frames = []
    for q in postures:
        places = lens.bent(np.array([pixel(link, point, q) for link, point in zip(links, points, strict=True)]))
        frames.append(keyframe(np.arange(40), places, q))
    body = features()
    body.lens = lens
    body.added(40)
    body.keyframes = frames
    body.assign(np.arange(40))
    np.testing.assert_array_equal(body.states, KNOWN)
    np.testing.assert_array_equal(body.links, links)
    np.testing.assert_allclose(body.points, points, atol=0.01)
    unaware = features()
    unaware.added(40)
    unaware.keyframes, unaware.links, unaware.points = frames, links.copy(), points.copy()
    unaware.states[:] = KNOWN
    for _ in range(10):
        unaware.refine(np.arange(40), np.arange(40))
    assert unaware.lens.bend == pytest.approx(-0.06, abs=0.006)
    assert unaware.focal == pytest.approx(FOCAL, rel=0.02)
    off = unaware.project(np.arange(40), postures[0]) - frames[0].places
    assert np.linalg.norm(off, axis=1).max() < 0.2
