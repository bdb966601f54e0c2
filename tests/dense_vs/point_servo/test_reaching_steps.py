"""A reach on a loop that only counts: when a way is planned, when a point is looked for, when it ends and how."""

from types import SimpleNamespace

import numpy as np
import pytest
from counting_loop import Arrival, Loop, body_tracker, point_tracker

from dense_vs.point_servo import following
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.point_memory import PointMemory
from dense_vs.point_servo.reach import ReachEnd
from dense_vs.point_servo.reaching import Reaching


def test_a_reach_ends_when_the_point_has_settled():
    loop, arrival = Loop(away=10.0), Arrival()
    reach = Reaching(loop, arrival, 100).run()
    assert (reach.end, reach.frames, reach.target, reach.error_px) == (ReachEnd.REACHED, 10, (0.0, 0.0), 0.0)
    assert loop.steps == ["servo"] * 10
    assert arrival.given[:2] == [(9.0, False), (8.0, False)]


@pytest.mark.parametrize(("close_from", "frames"), [(0, 10), (7, 14), (99, 10 + 15)])
def test_a_point_that_has_settled_comes_closer_for_some_frames_more(close_from, frames):
    reach = Reaching(Loop(away=10.0), Arrival(close_from=close_from), 400).run()
    assert (reach.end, reach.frames) == (ReachEnd.REACHED, frames)


@pytest.mark.parametrize(("frames", "end"), [(9, ReachEnd.MISSED), (10, ReachEnd.REACHED)])
def test_a_reach_has_so_many_frames(frames, end):
    reach = Reaching(Loop(away=10.0), Arrival(), frames).run()
    assert (reach.end, reach.frames, reach.uncertainty_px, reach.error_px) == (end, frames, None, 10 - frames)


def test_a_place_that_is_not_certain_is_waited_for_and_then_called_lost():
    loop = Loop(away=10.0)
    loop.certain = False
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.frames) == (ReachEnd.LOST, 9 + 45)  # settled with the tenth, and then waited for


@pytest.mark.parametrize(("tolerance", "end"), [(2.0, ReachEnd.LOST), (3.0, ReachEnd.REACHED)])
def test_a_place_is_certain_by_the_tolerance_of_its_reach(tolerance, end):
    loop = Loop(away=10.0)
    loop.certain = 2.5  # from this tolerance on
    assert Reaching(loop, Arrival(within=tolerance), 400).run().end is end


def test_a_patch_alone_is_not_believed_where_a_body_was_sought_in_vain():
    loop = Loop(away=10.0)
    loop.learned_body.sought_in_vain = True
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.frames) == (ReachEnd.LOST, 9 + 45)
    tracker, _ = body_tracker([np.array([9.0, 0.0])] * 20)
    by_link = Loop(away=10.0, tracker=tracker)
    by_link.learned_body.sought_in_vain = True  # after a change, and it is followed by the body from before
    assert Reaching(by_link, Arrival(), 400).run().end is ReachEnd.REACHED


@pytest.mark.parametrize(("by_link", "model", "end"), [
    (True, "a body", ReachEnd.LOST), (True, None, ReachEnd.REACHED), (False, "a body", ReachEnd.REACHED),
])  # fmt: skip
def test_a_patch_alone_is_not_believed_where_a_body_has_no_link_for_it(by_link, model, end):
    loop = Loop(away=10.0)
    nothing = np.zeros(2)
    loop.memory, loop.learned_body.model = PointMemory(nothing, nothing, nothing, None, by_link=by_link), model
    assert Reaching(loop, Arrival(), 400).run().end is end


def test_frames_at_the_target_count_though_it_is_left_between_them():
    """A place that noise takes to and fro is waited for no longer than one that rests."""

    class Unsteady(Arrival):
        def observe(self, distance, *, blind):
            self.seen += 1
            self.settled = self.seen % 3 == 0

    loop = Loop(away=0.0)
    loop.certain = False
    reach = Reaching(loop, Unsteady(), 400).run()
    assert (reach.end, reach.frames) == (ReachEnd.LOST, 3 * 45)


def test_faults_are_told_and_frames_with_those_that_stop_do_not_count():
    loop, arrival = Loop(away=4.0), Arrival()
    old, new = SimpleNamespace(kind="late", stops=False, n=1), SimpleNamespace(kind="late", stops=False, n=2)
    stopped = SimpleNamespace(kind="frozen", stops=True)
    given = iter([[old], [new, stopped], [stopped], [], [], []])
    usual = loop.step

    def step(command):
        usual(command)
        loop.faults = next(given)

    loop.step = step
    reach = Reaching(loop, arrival, 100).run()
    assert [blind for _, blind in arrival.given] == [False, True, True, False, False, False]
    assert reach.faults == (new, stopped)  # the latest of a kind


@pytest.mark.parametrize(("away", "planned"), [(15.9, False), (16.1, True)])
def test_a_way_of_more_than_eight_percent_of_the_width_is_planned(away, planned):
    tracker, asked = body_tracker([np.array([0.3, 0.0])])
    loop = Loop(away=away, tracker=tracker)
    assert Reaching(loop, Arrival(), 1).run().uncertainty_px == 0.7  # as its tracker tells
    assert len(asked) == planned
    if planned:
        target, positions, limits, held, start = asked[0]
        assert target is loop.target
        assert (positions.tolist(), limits, held.tolist(), start) == ([0.0, 0.0], "limits", [False, True], None)
        np.testing.assert_allclose(loop.steps[0], [0.03, 0.0])


@pytest.mark.parametrize(("across", "step"), [(130.0, 0.03), (134.0, 4 / 134), (400.0, 0.01), (-400.0, 0.01)])
def test_a_planned_way_is_not_faster_in_the_image_than_two_percent_of_its_width(across, step):
    """Of 200 px; unless nothing of its link is in sight, where the chain may be wrong about that."""
    for unseen, expected in ((0, step), (1, 0.03)):
        tracker, _ = body_tracker([np.array([0.3, 0.0])], ((0.6 * across, 0.0), (0.8 * across, 9.0)))
        tracker.unseen = unseen
        loop = Loop(away=90.0, tracker=tracker)
        Reaching(loop, Arrival(), 1).run()
        np.testing.assert_allclose(loop.steps[0], [expected, 0.0])


def test_targets_with_depth_are_not_planned():
    tracker, asked = body_tracker()
    loop = Loop(away=90.0, tracker=tracker)
    loop.target, loop.point = np.zeros(3), np.array([90.0, 0.0])
    Reaching(loop, Arrival(), 2).run()
    assert asked == []


def test_the_servo_takes_over_near_the_target_and_keeps_the_way():
    """At 2.5 % of the width, here 5 px; a point that moves off again is not planned for in the same reach."""
    tracker, asked = body_tracker([np.array([9.0, 0.0])] * 9)
    loop = Loop(away=20.0, tracker=tracker)
    arrival = Arrival(frames=100)
    usual = loop.step

    def step(command):
        usual(command)
        if len(loop.steps) == 18:
            loop.point = np.array([60.0, 0.0])

    loop.step = step
    Reaching(loop, arrival, 30).run()
    way = [isinstance(command, str) for command in loop.steps]
    assert way == [False] * 15 + [True] * 15
    assert len(asked) == 1


def test_a_posture_is_planned_anew_every_fifteen_frames_from_the_last_one():
    postures = [np.array([9.0, 0.0]), np.array([0.0, -9.0]), None]
    tracker, asked = body_tracker(postures)
    loop = Loop(away=100.0, tracker=tracker)
    Reaching(loop, Arrival(), 40).run()
    assert [one[4] if one[4] is None else one[4].tolist() for one in asked] == [None, [9.0, 0.0], [0.0, -9.0]]
    np.testing.assert_allclose(loop.steps[:15], [[0.03, 0.0]] * 15)
    second = np.array(loop.steps[15:30])
    np.testing.assert_allclose(second[:, 1], -0.03)
    assert loop.steps[30:] == ["servo"] * 10  # none was found


@pytest.mark.parametrize(("off", "taken"), [(0.019, False), (0.021, True)])
def test_a_posture_that_is_reached_leaves_the_rest_to_the_servo(off, taken):
    tracker, _ = body_tracker([np.array([0.001, -off])])
    loop = Loop(away=100.0, tracker=tracker)
    Reaching(loop, Arrival(), 1).run()
    assert isinstance(loop.steps[0], str) != taken
    if taken:
        np.testing.assert_allclose(loop.steps[0], [0.001, -off])  # no longer than the way


def test_without_a_chain_a_far_way_is_the_servo_s():
    loop = Loop(away=100.0)
    Reaching(loop, Arrival(), 3).run()
    assert loop.steps == ["servo"] * 3


def test_a_step_toward_a_posture_is_straight_and_as_long_as_the_servo_s():
    loop = Loop()
    loop.joints.newest = np.array([0.1, 0.0])
    one = Reaching(loop, Arrival(), 1)
    np.testing.assert_allclose(one._toward(np.array([-0.2, 0.15])), [-0.03, 0.015])
    np.testing.assert_allclose(one._toward(np.array([0.11, -0.02])), [0.01, -0.02])
    np.testing.assert_array_equal(one._toward(np.array([0.1, 0.0])), 0.0)
    loop.servo.options.max_step = 9.0
    np.testing.assert_allclose(one._toward(np.array([9.1, -9.0])), [0.5, -0.5])  # what the joints' limits leave


def test_a_lost_point_is_looked_for_five_frames_where_it_was_defined_once():
    loop = Loop(away=100.0, speed=0.0, tracker=point_tracker(lost=True))
    loop.memory = SimpleNamespace(positions=np.array([0.3, -0.3]))
    reach = Reaching(loop, Arrival(), 100).run()
    assert reach.end is ReachEnd.MISSED  # the aim is certain, here
    assert loop.found == [10, 11, 12, 13, 14]  # from the tenth step of 0.03 rad on it is there
    assert reach.frames == 14


def test_without_a_memory_a_lost_point_ends_the_reach():
    loop = Loop(away=100.0, tracker=point_tracker(lost=True))
    assert Reaching(loop, Arrival(), 100).run().frames == 0
    assert loop.steps == []


@pytest.mark.parametrize(("off", "there"), [(0.009, True), (0.011, False)])
def test_it_is_looked_for_within_a_hundredth_of_a_radian_and_not_in_frames_with_faults(off, there):
    loop = Loop(away=100.0, speed=0.0, tracker=point_tracker(lost=True))
    loop.memory = SimpleNamespace(positions=np.zeros(2))
    loop.group.clip_step = lambda step, q: np.zeros(2)
    loop.frame.positions = loop.joints.newest = np.array([0.0, -off])
    Reaching(loop, Arrival(), 7).run()
    assert len(loop.found) == (5 if there else 0)
    loop.faults = [SimpleNamespace(kind="black", stops=True)]
    loop.found.clear()
    Reaching(loop, Arrival(), 7).run()
    assert loop.found == []


def test_a_point_that_is_found_goes_on_to_its_target():
    tracker = point_tracker(lost=True)
    loop = Loop(away=30.0, speed=1.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.zeros(2))

    def find_again():
        tracker.gone = False
        return True

    loop.find_again = find_again
    reach = Reaching(loop, Arrival(), 100).run()
    assert reach.end is ReachEnd.REACHED
    assert not isinstance(loop.steps[0], str)
    assert loop.steps[1:] == ["servo"] * (reach.frames - 1)
    tracker.gone, loop.point = True, np.array([30.0, 0.0])
    loop.find_again = lambda: setattr(tracker, "gone", True) or True  # seen, and lost again at once
    again = Reaching(loop, Arrival(), 100).run()
    assert again.frames == 1  # it is looked for once in a reach


def test_a_point_that_was_at_its_target_and_lost_there_has_not_arrived_where_it_is_found():
    """Settled but not certain, then gone: seen again far away, it is certain, and must go there first."""
    tracker = point_tracker()
    loop = Loop(away=5.0, speed=1.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.zeros(2))
    loop.certain = False
    usual = loop.step

    def step(command):
        usual(command)
        tracker.gone = tracker.gone or len(loop.steps) == 12

    def find_again():
        loop.point, loop.certain, tracker.gone = np.array([60.0, 0.0]), True, False
        loop.step = usual
        return True

    loop.step, loop.find_again = step, find_again
    reach = Reaching(loop, Arrival(), 400).run()
    assert reach.end is ReachEnd.REACHED
    assert reach.error_px <= 2.0
    assert reach.frames > 12 + 55


@pytest.mark.parametrize(("unseen", "gone"), [(44, False), (45, True)])
def test_a_link_that_is_unseen_for_long_is_gone(unseen, gone):
    tracker, _ = body_tracker()
    tracker.unseen = unseen
    assert Reaching(Loop(tracker=tracker), Arrival(), 1)._gone() == gone
    assert Reaching(Loop(tracker=point_tracker(lost=gone)), Arrival(), 1)._gone() == gone


def test_a_link_that_is_seen_again_is_not_looked_for_any_more():
    tracker, _ = body_tracker()
    tracker.unseen = 60
    loop = Loop(away=8.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.zeros(2))
    loop.find_again = lambda: setattr(tracker, "unseen", 0) or True
    reach = Reaching(loop, Arrival(), 100).run()
    assert reach.end is ReachEnd.REACHED
    assert loop.steps[1:] == ["servo"] * (reach.frames - 1)


def unseen_from(loop, tracker, frame, to=10_000):
    """Nothing is seen of the tracker's link from one frame on to another."""
    usual = loop.step

    def step(command):
        usual(command)
        tracker.unseen = tracker.unseen + 1 if frame <= len(loop.steps) < to else 0

    loop.step = step


def test_a_planned_way_goes_on_where_nothing_is_seen_of_the_link():
    """The link has turned away: the chain knows where the point is, and the link is seen again further on."""
    tracker, _ = body_tracker([np.array([9.0, 0.0])] * 20)
    loop = Loop(away=120.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.zeros(2))
    unseen_from(loop, tracker, 10, 100)
    reach = Reaching(loop, Arrival(), 400).run()
    assert reach.end is ReachEnd.REACHED
    assert (reach.frames, loop.found) == (120, [])


def test_a_point_whose_link_is_not_seen_at_its_target_is_called_lost_there():
    tracker, _ = body_tracker([np.array([9.0, 0.0])] * 20)
    loop = Loop(away=60.0, tracker=tracker)
    loop.memory, loop.certain = SimpleNamespace(positions=np.zeros(2)), False
    unseen_from(loop, tracker, 10)
    reach = Reaching(loop, Arrival(), 400).run()
    assert reach.end is ReachEnd.LOST
    assert (reach.error_px, loop.found) == (0.0, [])
    assert reach.frames == 59 + 45  # settled with the sixtieth, and then waited for


@pytest.mark.parametrize(("frames", "returned"), [(15 + 45, False), (15 + 46, True)])
def test_a_link_that_is_not_seen_off_the_planned_way_is_looked_for(frames, returned):
    tracker, _ = body_tracker([np.array([9.0, 0.0])])  # one plan, which ends after 15 frames
    loop = Loop(away=400.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.array([0.45, 0.0]))
    unseen_from(loop, tracker, 11)
    Reaching(loop, Arrival(), frames).run()
    assert loop.steps[15 : 15 + 45] == ["servo"] * 45
    assert bool(loop.found) == returned


@pytest.mark.parametrize(
    ("point", "covered", "seen"),
    [([0, 0], False, True), ([199, 99], False, True), ([199.5, 50], False, False), ([50, 99.5], False, False),
     ([-0.5, 50], False, False), ([50, -0.5], False, False), ([50, 50], True, False)],
)  # fmt: skip
def test_a_point_is_in_sight_inside_the_image_where_nothing_covers_it(point, covered, seen):
    options = SimpleNamespace(width=200, height=100)
    line = SimpleNamespace(estimator=SimpleNamespace(options=options), hidden_at=lambda at: covered)
    assert following.in_sight(np.array(point, float), line) == seen
    tracker = object.__new__(BodyTracker)
    tracker.point, tracker.unseen, tracker.uncertainty = np.array(point, float), 0, 1.26
    why = following._why_unseen(tracker, line)
    if seen:
        assert why == ""
    else:
        assert "it is known to 1.3 px" in why
        assert ("something covers it" in why) == covered
        assert ("is out of the image" in why) != covered
    tracker.unseen = 1
    assert following._why_unseen(tracker, line).startswith("too few features")


@pytest.mark.parametrize(("uncertainty", "said"), [(2.99, ""), (3.01, "its place is known to 3.0 px only")])
def test_a_place_that_is_known_badly_is_said(uncertainty, said):
    tracker = object.__new__(BodyTracker)
    tracker.point, tracker.unseen, tracker.uncertainty = np.array([5.0, 5.0]), 0, uncertainty
    options = SimpleNamespace(width=200, height=100)
    line = SimpleNamespace(estimator=SimpleNamespace(options=options), hidden_at=lambda at: False)
    assert following._why_unseen(tracker, line) == said


def test_j_of_a_point_out_of_sight_is_of_the_chain():
    tracker = object.__new__(BodyTracker)
    tracker.point, tracker.unseen = np.array([-3.0, 5.0]), 0

    by_chain = np.array([[40.0, 7.0, 0.0], [-20.0, 10.0, 0.0]])
    asked = []
    tracker.features = SimpleNamespace(jacobian=lambda number, at: asked.append((number, at)) or by_chain)
    seen = []
    estimator = SimpleNamespace(
        options=SimpleNamespace(width=200, height=100), at=lambda point: seen.append(point) or np.ones((1, 2, 3))
    )
    line = SimpleNamespace(estimator=estimator, hidden_at=lambda at: False)
    q = np.array([0.2, -0.4, 0.1])
    np.testing.assert_array_equal(following.point_jacobian(tracker, line, q), by_chain)
    assert seen == []
    assert [(number, at.tolist()) for number, at in asked] == [(0, q.tolist())]
    tracker.point = np.array([3.0, 5.0])
    np.testing.assert_array_equal(following.point_jacobian(tracker, line, q), np.ones((2, 3)))
    tracker.unseen = 1  # what is seen there is something else
    np.testing.assert_array_equal(following.point_jacobian(tracker, line, q), by_chain)
    other = SimpleNamespace(points=np.array([[-3.0, 5.0]]))
    np.testing.assert_array_equal(following.point_jacobian(other, line, q), np.ones((2, 3)))
