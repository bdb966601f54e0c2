"""Ways to a posture of robots that follow late, or that something holds."""

from types import SimpleNamespace

import numpy as np
import pytest
from counting_loop import Arrival, Loop, body_tracker, point_tracker

from dense_vs.point_servo.posture_approach import STALLED, PostureApproach
from dense_vs.point_servo.reach import ReachEnd
from dense_vs.point_servo.reaching import Reaching

LAG = 5.0  # frames in which a motor makes up for most of what it is behind


class LateLoop(Loop):
    """Its robot adds steps up to what it is sent to, and its motors follow that late; readings are a frame old."""

    def __init__(self, gain, **options):
        super().__init__(speed=0.0, **options)
        self.servo.options.gain = gain
        self.sent, self.at, self.way = np.zeros(2), np.zeros(2), []

    def step(self, command):
        super().step(command if isinstance(command, str) else 0 * command)
        self.joints.newest = self.frame.positions = self.at
        self.sent = self.sent + command
        self.at = self.at + (self.sent - self.at) / LAG
        self.way.append(self.at)


def late_way(gain):
    """How far from a posture the robot is in each frame of its way there [rad], and the loop."""
    posture = np.array([0.5, -0.3])
    loop = LateLoop(gain, away=100.0, tracker=point_tracker(lost=True))
    one = Reaching(loop, Arrival(), 400)
    for _ in range(200):
        one._step(lambda: one._toward(posture))
    return np.abs(np.array(loop.way) - posture).max(axis=1)


def test_a_robot_that_follows_late_comes_to_a_posture_and_rests_there():
    off = late_way(0.2)
    assert off[60:].max() < 0.01
    assert off[20:].max() < 0.06


def test_by_all_of_the_way_at_once_it_swings():
    assert late_way(1.0)[60:].max() > 0.02


def test_a_step_toward_a_posture_is_the_servo_s_share_of_the_way():
    loop = Loop()
    loop.servo.options.gain = 0.2
    one = Reaching(loop, Arrival(), 1)
    np.testing.assert_allclose(one._toward(np.array([0.1, -0.05])), [0.02, -0.01])
    np.testing.assert_allclose(one._toward(np.array([0.6, -0.3])), [0.03, -0.015])
    loop.servo.options.gain = 5.0  # a servo's may be above 1, as its error is damped
    np.testing.assert_allclose(one._toward(np.array([0.02, -0.01])), [0.02, -0.01])


def test_a_posture_to_which_something_holds_the_robot_up_is_left_to_the_servo():
    plan = np.array([0.3, 0.0])
    tracker, _ = body_tracker([plan] * 9)
    loop = Loop(away=100.0, speed=0.0, tracker=tracker)
    usual = loop.step

    def held(command):
        usual(command if isinstance(command, str) or loop.joints.newest[0] < 0.09 else 0 * command)

    loop.step = held
    Reaching(loop, Arrival(), 60).run()
    planned = [not isinstance(step, str) for step in loop.steps]
    assert planned == [True] * (3 + STALLED + 1) + [False] * (60 - 3 - STALLED - 1)


def test_a_lost_point_is_looked_for_where_something_holds_the_robot():
    loop = Loop(away=100.0, speed=0.0, tracker=point_tracker(lost=True))
    loop.memory = SimpleNamespace(positions=np.array([0.3, 0.0]))
    loop.group.clip_step = lambda step, q: np.zeros(2)
    reach = Reaching(loop, Arrival(), 100).run()
    assert loop.found == list(range(STALLED + 1, STALLED + 6))
    assert reach.frames == STALLED + 5


def test_steps_that_are_not_due_or_may_not_be_sent_do_not_count():
    loop = Loop(away=100.0, speed=0.0, tracker=point_tracker(lost=True))
    loop.memory = SimpleNamespace(positions=np.array([0.3, 0.0]))
    loop.when_due = lambda choose: np.zeros(2)
    Reaching(loop, Arrival(), 100).run()
    assert not loop.found


@pytest.mark.parametrize(("other", "over"), [(0.019, True), (0.021, False)])
def test_another_posture_begins_anew(other, over):
    approach, posture, here = PostureApproach(), np.array([0.5, 0.0]), np.array([0.9, 0.0])
    assert not approach.over(posture, here, 0.02)
    for _ in range(STALLED):
        approach.sent(posture, here)
        assert not approach.over(posture, here, 0.02)
    approach.sent(posture, here)
    assert approach.over(posture, here, 0.02)
    assert approach.over(posture + np.array([0.0, other]), here, 0.02) == over
    approach.sent(posture, posture - 0.1)  # it comes nearer, but it has been given up
    assert approach.over(posture, here, 0.02)


@pytest.mark.parametrize(("nearer", "over"), [(3e-5, True), (9e-4, False)])
def test_a_robot_that_still_comes_nearer_is_not_given_up(nearer, over):
    approach, posture = PostureApproach(), np.array([0.5, 0.0])
    for k in range(STALLED + 9):
        approach.sent(posture, np.array([0.9 - nearer * k, 0.0]))
    # What is too little in one step adds up in several.
    assert approach.over(posture, np.zeros(2), 0.02) == over


def begins_unseen(uncertainty, away=60.0):
    """A point whose link is not seen: at home nothing is found of it, from there on plans lead to its target."""
    tracker, _ = body_tracker([np.array([9.0, 0.0])] * 20)
    tracker.unseen, tracker.uncertainty = 45, uncertainty
    loop = Loop(away=away, speed=0.0, tracker=tracker)
    loop.memory, loop.certain = SimpleNamespace(positions=np.zeros(2)), False

    def find_again():
        loop.found.append(len(loop.steps))
        loop.speed = 1.0 if len(loop.found) == 5 else 0.0
        return False

    loop.find_again = find_again
    return loop, tracker


def test_a_point_that_is_not_found_but_known_by_the_chain_goes_on_to_its_target():
    loop, _ = begins_unseen(3.0)
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.error_px, len(loop.found)) == (ReachEnd.LOST, 0.0, 5)
    assert reach.frames == 5 + 59 + 45


def test_a_point_that_is_not_found_nor_known_ends_the_reach():
    loop, _ = begins_unseen(np.inf)
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.error_px, reach.frames) == (ReachEnd.LOST, 60.0, 5)


def test_a_link_that_is_seen_again_on_the_way_home_is_found_though_its_first_look_is_not():
    loop, tracker = begins_unseen(np.inf)
    usual = loop.step

    def step(command):
        usual(command)
        tracker.unseen = 0

    loop.step, loop.certain = step, True
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.frames) == (ReachEnd.REACHED, 5 + 60)


def test_a_robot_that_reads_the_very_posture_stays_there():
    tracker, _ = body_tracker()
    one = Reaching(Loop(tracker=tracker), Arrival(), 1)
    np.testing.assert_array_equal(one._toward(np.zeros(2)), 0.0)


@pytest.mark.parametrize(("uncertainty", "returned"), [(4.9, False), (5.1, True)])  # px; a fortieth of the width is 5
def test_a_point_whose_place_is_known_badly_for_long_is_looked_for(uncertainty, returned):
    """No plan is found, so it is servoed: it must not go on and on to where it takes the point for."""
    tracker, _ = body_tracker()
    tracker.uncertainty = uncertainty
    loop = Loop(away=400.0, tracker=tracker)
    loop.memory = SimpleNamespace(positions=np.zeros(2))
    Reaching(loop, Arrival(), 45 + 9).run()
    assert loop.steps[:45] == ["servo"] * 45
    assert bool(loop.found) == returned


def test_a_place_that_is_known_badly_on_a_planned_way_or_at_the_target_is_not_looked_for():
    tracker, _ = body_tracker([np.array([9.0, 0.0])] * 20)
    tracker.uncertainty = 9.0
    loop = Loop(away=120.0, tracker=tracker)
    loop.memory, loop.certain = SimpleNamespace(positions=np.zeros(2)), False
    reach = Reaching(loop, Arrival(), 400).run()
    assert (reach.end, reach.error_px, loop.found) == (ReachEnd.LOST, 0.0, [])


def test_the_point_moves_a_fiftieth_of_the_width_a_frame_at_most_on_the_way_that_is_left():
    tracker, _ = body_tracker(by_chain=((1000.0, 0.0), (0.0, 0.0)))  # px/rad
    loop = Loop(tracker=tracker)
    loop.joints.newest = np.array([0.4, 0.3])
    step = Reaching(loop, Arrival(), 1)._toward(np.array([0.5, 0.1]))
    np.testing.assert_allclose(step, [0.004, -0.008])  # 4 px of 200


def test_a_posture_at_the_very_border_of_another_one_is_still_the_same():
    approach, posture, here = PostureApproach(), np.zeros(2), np.array([0.9, 0.0])
    for _ in range(STALLED + 1):
        approach.sent(posture, here)
    assert approach.over(np.array([0.02, -0.02]), here, 0.01)
    assert not approach.over(np.array([0.02, np.nextafter(-0.02, -1.0)]), here, 0.01)
    assert not PostureApproach().over(posture, here, 0.9)  # within it is nearer than that
    assert PostureApproach().over(posture, here, 0.91)
