"""Points on either side of every limit: how old an answer may be, when a target is another one, where a point is."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.live import points as live_points
from dense_vs.live.followers import BodyFollower, Following, PatchFollower
from dense_vs.live.points import LivePoint, LivePoints, PointState
from dense_vs.live.seen_point import SeenPoint
from dense_vs.point_servo.tracker import PointTracker


def seen(certain=True, lost=False, uncertainty=0.4, place=(50.0, 40.0)):
    return SeenPoint(np.array(place), certain, lost, uncertainty)


def follower(alive=True, **answer):
    return BodyFollower(SimpleNamespace(alive=alive), np.array([50.0, 40.0]), 100, seen(**answer))


@pytest.mark.parametrize(
    ("late", "fresh", "certain", "why"),
    [(0, True, True, ""), (5, True, True, ""), (6, False, True, ""), (45, False, True, ""),
     (46, False, False, "the body's process is late")],
)  # fmt: skip
def test_an_answer_ages(late, fresh, certain, why):
    one = follower()
    for k in range(late):
        one.carry(101 + k, np.zeros(2))
    assert (one.fresh, one.certain, one.why, one.lost) == (fresh, certain, why, False)


def test_what_is_not_certain_says_why():
    assert follower(alive=False).why == "the body's process ended"
    assert follower(alive=False).lost
    assert follower(lost=True).why == "too little is seen of its link"
    assert follower(lost=True).lost
    assert not follower(lost=True).certain
    assert follower(certain=False, uncertainty=1.25).why == "known to about 2.5 px"
    assert not follower(certain=False).certain


def test_places_are_kept_for_a_hundred_and_twenty_frames():
    one = follower()
    for k in range(121):
        one.carry(101 + k, np.array([1.0, 0.0]))
    one.take(101, seen(place=(0.0, 0.0)))  # that place is forgotten
    np.testing.assert_allclose(one.place, [171.0, 40.0])
    one.take(102, seen(place=(53.0, 40.0)))
    np.testing.assert_allclose(one.place, [172.0, 40.0])


@pytest.mark.parametrize(("correlation", "renewed"), [(0.84, False), (0.85, True), (0.929, True), (0.93, False)])
def test_a_patch_is_renewed_where_it_aligns_and_has_turned(monkeypatch, correlation, renewed):
    events = []
    tracker = SimpleNamespace(
        points=np.array([[3.0, 4.0]]), lost=np.array([False]), correlation=np.array([correlation]),
        options=SimpleNamespace(min_correlation=0.85, window=25), update=lambda flow, gray: events.append("update"),
        redefine=lambda points, gray, weights: events.append(weights),
    )  # fmt: skip
    monkeypatch.setattr(
        "dense_vs.point_servo.following.patch_weights", lambda pipeline, place, window: (pipeline, window)
    )
    monkeypatch.setattr("dense_vs.live.followers.given_up", lambda tracker: bool(tracker.lost[0]))
    monkeypatch.setattr("dense_vs.live.followers.certain", lambda tracker: not tracker.lost[0])
    one = PatchFollower(tracker, None)
    one.update(None, SimpleNamespace(gray=None), "J and labels")
    assert events == ["update", ("J and labels", 25)][: 1 + renewed]
    assert one.certain
    assert one.why == ""
    tracker.lost = np.array([True])
    one.update(None, SimpleNamespace(gray=None), None)
    assert events[-1] == "update"
    assert (one.lost, one.why) == (True, "its surroundings look otherwise now")


@pytest.mark.parametrize(("body", "doubted"), [(None, False), (False, False), (True, True)])
def test_a_patch_alone_is_not_certain_where_the_body_was_sought_in_vain(body, doubted, monkeypatch):
    monkeypatch.setattr("dense_vs.live.followers.given_up", lambda _: False)
    monkeypatch.setattr("dense_vs.live.followers.certain", lambda _: True)
    tracker = SimpleNamespace(points=np.ones((1, 2)))
    process = None if body is None else SimpleNamespace(sought_in_vain=body)
    one = PatchFollower(tracker, process)
    assert one.certain != doubted
    assert ("the body was not found" in one.why) == doubted
    if process is not None:
        process.sought_in_vain = False  # it is known now, and will follow the point
    assert (one.certain, one.why) == (True, "")


def test_a_point_that_the_body_has_no_link_for_is_not_certain_by_its_patch_while_that_body_is_known():
    tracker = PointTracker(np.array([20.0, 20.0]), np.arange(1600, dtype=np.uint8).reshape(40, 40))
    answers = [(102, {7: None, 8: None})]
    body = SimpleNamespace(answers=lambda: answers, alive=True, sought_in_vain=False, knows=True)
    followers = {7: PatchFollower(tracker, body), 8: BodyFollower(body, np.zeros(2), 101, seen())}
    place = followers[8].place
    assert followers[7].certain
    Following(None, body)._hear(body, followers)
    assert (followers[7].certain, followers[7].lost) == (False, False)
    assert followers[7].why == "followed by its surroundings alone, as it is on no link that is known"
    assert followers[8].place is place
    body.knows = False  # it is learned anew
    assert (followers[7].certain, followers[7].why) == (True, "")
    body.sought_in_vain = True
    assert followers[7].why == "followed by its surroundings alone, as the body was not found"
    body.knows, body.sought_in_vain = True, False
    answers[:] = [(103, {7: seen(place=(21.0, 22.0))})]
    Following(None, body)._hear(body, followers)
    assert isinstance(followers[7], BodyFollower)


def test_what_goes_by_the_body_moves_by_j_and_is_corrected():
    answers = [(102, {7: seen(place=(60.0, 45.0)), 9: seen()})]
    body = SimpleNamespace(answers=lambda: answers, alive=True, sought_in_vain=False)
    flows = []
    following = Following(lambda before, now: flows.append((before, now)), body)
    J = np.array([[10.0, 0.0], [0.0, 20.0]])
    pipeline = SimpleNamespace(estimator=SimpleNamespace(at=lambda places: np.stack([J] * len(places))))
    followers = {7: BodyFollower(body, np.array([50.0, 40.0]), 101, seen())}
    before, now = SimpleNamespace(positions=np.array([0.1, 0.1])), SimpleNamespace(positions=np.array([0.3, 0.2]))
    following.carry(followers, before, now, 102, pipeline)
    np.testing.assert_allclose(followers[7].place, [60.0, 45.0])
    answers.clear()
    following.carry(followers, before, now, 103, pipeline)
    np.testing.assert_allclose(followers[7].place, [62.0, 47.0])
    assert flows == []  # no patch needs any


class Placed:
    """A follower that is where it is put."""

    def __init__(self, place=(10.0, 20.0), certain=True, lost=False, fresh=True):
        self.place, self.certain, self.lost, self.fresh, self.why = np.array(place), certain, lost, fresh, ""


def all_points(*ones):
    points = LivePoints.__new__(LivePoints)
    points._size, points._points, points._next = (48, 64), {one.number: one for one in ones}, len(ones) + 1
    points._following = SimpleNamespace(carry=lambda *_: None, body=None)
    return points


def test_a_point_says_how_it_is_doing():
    one = LivePoint(1, Placed())
    assert np.isnan(one.error)
    assert one.state is PointState.TRACKING
    one.target = np.array([13.0, 24.0])
    assert one.error == pytest.approx(5.0)
    one.reachability.why = "joint limit"
    assert one.state is PointState.UNREACHABLE
    assert one.why == "joint limit"
    for _ in range(5):
        one.arrival.observe(0.5)
    assert one.state is PointState.REACHED
    one.follower.certain = False
    assert one.state is PointState.UNCERTAIN
    one.follower.lost = True
    assert one.state is PointState.LOST


@pytest.mark.parametrize(("moved", "anew"), [(11.9, False), (12.1, True)])
def test_a_target_that_moves_a_little_is_the_same(moved, anew):
    one = LivePoint(1, Placed())
    points = all_points(one)
    points.aim(1, [20.0, 20.0])
    before = one.arrival
    points.aim(1, [20.0 + 0.6 * moved, 20.0 + 0.8 * moved])
    assert (one.arrival is not before) == anew
    points.aim(1, None)
    assert one.target is None
    assert one.arrival is not before


@pytest.mark.parametrize(
    ("place", "inside"),
    [((0.0, 0.0), True), ((63.0, 47.0), True), ((-0.1, 5.0), False), ((63.1, 5.0), False), ((5.0, -0.1), False),
     ((5.0, 47.1), False)],
)  # fmt: skip
def test_places_inside_the_image(place, inside):
    points = all_points(LivePoint(1, Placed()))
    if inside:
        points.aim(1, place)
        return
    with pytest.raises(DenseVSError, match="outside the image of 64 x 48 pixels"):
        points.aim(1, place)
    assert next(iter(points)).target is None


def test_a_point_whose_body_is_forgotten_is_followed_by_its_look_inside_the_image(monkeypatch):
    placed = []

    def tracker(place, gray, weights):
        placed.append(place.tolist())
        return SimpleNamespace(points=place[None])

    monkeypatch.setattr(live_points, "PointTracker", tracker)
    monkeypatch.setattr(live_points, "patch_weights", lambda *_: None)
    body = BodyFollower(SimpleNamespace(alive=True), np.array([70.0, -3.0]), 1, seen())
    ones = [LivePoint(1, body), LivePoint(2, Placed())]
    all_points(*ones).follow_by_patches(SimpleNamespace(gray=None), None)
    assert placed == [[63.0, 0.0]]
    assert isinstance(ones[0].follower, PatchFollower)
    assert isinstance(ones[1].follower, Placed)


@pytest.mark.parametrize(("fresh", "error", "counted"), [(True, 0.5, True), (False, 0.5, False), (False, 2.5, True)])
@pytest.mark.parametrize("stops", [False, True])
def test_arrival_is_counted_where_the_point_is_seen(fresh, error, counted, stops):
    one = LivePoint(1, Placed(fresh=fresh), target=np.array([10.0 + error, 20.0]))
    told = []
    one.arrival = SimpleNamespace(observe=lambda error, blind: told.append((round(error, 6), blind)))
    now = SimpleNamespace(faults=[SimpleNamespace(stops=stops)])
    points = all_points(one)
    points.follow(None, now, None)
    assert told == ([(error, stops)] if counted else [])
    points.follow(now, now, None)
    assert len(told) == counted  # the same frame says nothing new


def test_the_step_counts_points_with_targets_that_are_known():
    asked = {}

    def together(J, places, targets, weights, q, held):
        asked.update(places=places, targets=targets, weights=weights, held=held)
        return np.array([0.1, 0.2])

    servo = SimpleNamespace(joints=2, together=together, options=SimpleNamespace(damping=15.0))
    J = np.array([[100.0, 0.0], [0.0, 50.0]])
    watch = SimpleNamespace(stuck=np.array([False, True]))
    loop = SimpleNamespace(
        estimator=SimpleNamespace(at=lambda places: np.stack([J] * len(places))), group=SimpleNamespace(limits=None),
        joints=SimpleNamespace(newest=np.array([0.3, 0.1]), watch=watch),
        frame=SimpleNamespace(positions=np.array([0.2, 0.3])),
    )  # fmt: skip
    told = []
    ones = [LivePoint(k, Placed((10.0 * k, 20.0))) for k in range(1, 5)]
    for one in ones:
        one.reachability = SimpleNamespace(observe=lambda J, error, *_: told.append(error.tolist()), why="")
    points = all_points(*ones)
    assert points.step(servo, loop).tolist() == [0.0, 0.0]
    assert np.isnan(points.worst_error)
    for one in ones[:3]:
        one.target = one.place + np.array([3.0, 4.0])
    ones[1].weight, ones[2].follower.lost, ones[0].target = 5.0, True, ones[0].place + np.array([6.0, 8.0])
    assert points.step(servo, loop).tolist() == [0.1, 0.2]
    np.testing.assert_allclose(asked["places"], [[20.0, 10.0], [30.0, 10.0]])  # where they are by the newest reading
    np.testing.assert_allclose(asked["targets"], [[16.0, 28.0], [23.0, 24.0]])
    assert asked["weights"].tolist() == [1.0, 5.0]
    assert asked["held"] is watch.stuck
    assert told == [[6.0, 8.0], [3.0, 4.0]]
    assert points.worst_error == 10.0
    for _ in range(5):
        ones[0].arrival.observe(0.1)
    assert points.step(servo, loop).any()
    for _ in range(5):
        ones[1].arrival.observe(0.1)
    assert not points.step(servo, loop).any()  # all of them are there


def test_no_more_than_eight_points_and_weights_up_to_a_hundred(monkeypatch):
    points = all_points(*(LivePoint(k, Placed()) for k in range(8)))
    with pytest.raises(DenseVSError, match="there are 8 points already"):
        points.add((1.0, 1.0), [], None)
    points.weigh(3, 100)
    assert list(points)[3].weight == 100
    for wrong in (0.0, -1.0, 100.1):
        with pytest.raises(DenseVSError, match="weight"):
            points.weigh(3, wrong)
    with pytest.raises(DenseVSError, match="point is 9; expected one of 0, 1"):
        points.aim(9, None)
    points.remove(3)
    assert (len(points), 3 in points, 4 in points) == (7, False, True)
    points.clear()
    assert len(points) == 0


class Followed:
    """A tracker that is carried by a flow, and keeps how it was made and defined anew."""

    made, lost = None, np.array([False])

    def __init__(self, place, gray, weights=None):
        self.points, self.events, Followed.made = np.array(place, float)[None], [("made", gray, weights)], self

    def update(self, flow, gray):
        self.points = self.points + flow
        self.events.append(("update", gray))

    def redefine(self, points, gray, weights):
        self.events.append(("redefine", points.tolist(), gray, weights))


@pytest.mark.parametrize(
    ("flow", "lost", "end"),
    [((2.0, 1.0), False, [[14.0, 22.0]]), ((40.0, -15.0), False, [[63.0, 0.0]]), ((-9.0, 20.0), False, [[0.0, 47.0]]),
     ((2.0, 1.0), True, None)],
)  # fmt: skip
def test_a_click_on_an_old_frame_is_carried_to_the_present_one(monkeypatch, flow, lost, end):
    """Its surroundings are then learned anew, inside the image, by the present J."""
    monkeypatch.setattr(live_points, "PointTracker", Followed)
    monkeypatch.setattr(live_points, "patch_weights", lambda _, place, window: ("surface", place.tolist(), window))
    sought = []
    points = all_points()
    points._flow = lambda before, after: np.array(flow)
    points._following.seek = lambda *given: sought.append(given)
    frames = [SimpleNamespace(gray=k) for k in range(3)]
    monkeypatch.setattr(Followed, "lost", np.array([lost]))
    one = points.add((10.0, 20.0), frames, "J", number=7)
    events = [("made", 0, None), ("update", 1), ("update", 2)]
    if end is not None:
        events.append(("redefine", end, 2, ("surface", end[0], 25)))
    assert Followed.made.events == events
    assert sought == [(1, one.follower, 7, frames[-1], "J")]
    assert (one.number, one in list(points)) == (1, True)
    second = points.add((5.0, 6.0), frames[-1:], "J")
    assert Followed.made.events == [("made", 2, ("surface", [5.0, 6.0], 25))]
    assert (second.number, len(points)) == (2, 2)


@pytest.mark.parametrize(
    ("knows", "lost", "asked"), [(True, False, True), (True, True, False), (False, False, False), (False, True, False)]
)
def test_a_body_is_asked_where_it_and_the_point_are_known(knows, lost, asked):
    told = []
    body = SimpleNamespace(knows=knows, follow=lambda *given: told.append(given))
    J = np.ones((2, 2))
    pipeline = SimpleNamespace(estimator=SimpleNamespace(to_numpy=lambda: J))
    point = Placed(lost=lost)
    Following(None, body).seek(3, point, 11, "frame", pipeline)
    assert len(told) == asked
    for given in told:
        assert (given[0], given[2], given[3]) == (3, 11, "frame")
        assert given[1] is point.place
        np.testing.assert_array_equal(given[4], J)
        assert given[4] is not J  # the estimator goes on
    Following(None, None).seek(3, point, 11, "frame", pipeline)
