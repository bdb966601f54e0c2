"""The steps of a grasp on a robot whose joints go where they are sent: how deep, how far back, what is compared."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.grasp import GraspOutcome, GripperModel, WristVerdict, check_grasp
from dense_vs.grasp import loop as grasping
from dense_vs.grasp.loop import GraspLoop, HandGeometry
from dense_vs.mask_servo.loop import ServoEnd

NAMES = ("lift", "wrist", "forward", "right")


class Robot:
    joint_names, joint_limits = NAMES, np.array([[0.1, 1.0], [-2.0, 2.0], [-5.0, 5.0], [-5.0, 5.0]])

    def __init__(self, floor=-1.0):
        self.q, self.floor, self.sent = np.array([0.5, 0.1, 1.0, 2.0]), floor, []

    def joints(self):
        return self.q.copy(), 0.0

    def command(self, delta):
        self.sent.append(np.array(delta))
        self.q = self.q + delta
        self.q[0] = max(self.q[0], self.floor)


def hand(bite=0.018):
    intrinsics = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    model = GripperModel(opening=0.1, width=0.02, thickness=0.01, length=0.03, T_camera_hand=np.eye(4))
    return HandGeometry(0.17, (220.0, 240.0), (320.0, 240.0), intrinsics, model, bite=bite)


def loop_of(robot, **options):
    tool = SimpleNamespace(
        open=lambda: SimpleNamespace(jammed=False, opening=0.1),
        close=lambda: SimpleNamespace(jammed=True, opening=0.02),
    )
    unused = SimpleNamespace(read=lambda: None, segment=lambda _: None)
    return GraspLoop(unused, robot, unused, tool, hand(), lift="lift", wrist="wrist", base=("forward", "right"),
                     pinv=np.eye(2), **options)  # fmt: skip


@pytest.mark.parametrize(("distance", "x"), [(0.17, 220.0), (0.34, 270.0), (0.0850, 120.0)])
def test_the_target_nears_the_middle_with_distance(distance, x):
    np.testing.assert_allclose(hand().target_at(distance), [x, 240.0])


@pytest.mark.parametrize(("z_object", "deeper", "end"), [(0.1, 0.0, 0.252), (0.1, 0.008, 0.244), (-0.2, 0.0, 0.1)])
def test_the_way_down_ends_below_the_object_s_top_or_at_the_limit(z_object, deeper, end):
    """The camera stops the gripper's length above, a bite lower."""
    robot = Robot()
    assert not loop_of(robot)._descend(z_object, deeper)
    assert robot.q[0] == pytest.approx(end, abs=1e-4)
    steps = [sent[0] for sent in robot.sent]
    assert min(steps) >= -0.008 - 1e-12
    assert all(step == pytest.approx(-0.008) for step in steps[:-1])
    np.testing.assert_array_equal(np.array(robot.sent)[:, 1:], 0.0)


def test_what_is_in_the_way_ends_it_and_is_let_go():
    robot = Robot(floor=0.4)
    assert loop_of(robot)._descend(0.1, 0.0)
    # It was sent to 0.396, stayed at 0.4, and is then commanded up by what it stays behind and a little.
    assert robot.sent[-1][0] == pytest.approx(0.004 + 0.0015)
    assert robot.q[0] == pytest.approx(0.4055)
    patient = Robot(floor=0.4)
    assert loop_of(patient, contact_lag=0.0045)._descend(0.1, 0.0)
    assert len(patient.sent) == len(robot.sent) + 1


@pytest.mark.parametrize(("by", "commands"), [(0.3, [0.2, 0.1]), (-0.2, [-0.2]), (0.0, []), (0.45, [0.2, 0.2, 0.05])])
def test_a_long_way_is_gone_in_several_commands(by, commands):
    robot = Robot()
    one = loop_of(robot, max_step=0.2)
    one._move(one._lift, by)
    np.testing.assert_allclose([sent[0] for sent in robot.sent], commands, atol=1e-12)


def test_a_way_ends_at_a_limit():
    robot = Robot()
    one = loop_of(robot)
    one._move(one._lift, 2.0)
    assert robot.q[0] == pytest.approx(1.0)
    one._move(one._base, np.array([0.3, -0.4]))
    np.testing.assert_allclose(robot.q[2:], [1.3, 1.6])
    one._move(one._base, np.array([0.0, 0.4]))  # one of both alone
    np.testing.assert_allclose(robot.q[2:], [1.3, 2.0])


@pytest.mark.parametrize(
    ("by", "steps", "commands"),
    [
        ((-0.45, 0.1), (0.2, 0.2), [(-0.2, 0.4 / 9), (-0.2, 0.4 / 9), (-0.05, 0.1 / 9)]),
        ((0.1, 0.1), (0.5, 0.03), [(0.03, 0.03)] * 3 + [(0.01, 0.01)]),
        ((0.1, -0.05), (0.04, 0.5), [(0.04, -0.02), (0.04, -0.02), (0.02, -0.01)]),
        ((0.0, -5.5), (2.0, 2.0), [(0.0, -2.0)] * 2 + [(0.0, -1.5)]),
        ((0.0, -9.0), (2.0, 2.0), [(0.0, -2.0)] * 3 + [(0.0, -1.0)]),  # the limit is 7 away
    ],
)
def test_a_way_of_two_joints_is_straight_whatever_each_may_go_at_once(by, steps, commands):
    robot = Robot()
    one = loop_of(robot)
    one._gates[one._base.names].max_step = np.array(steps)
    one._move(one._base, np.array(by))
    np.testing.assert_allclose(np.array(robot.sent)[:, 2:], commands, atol=1e-12)


def test_a_lost_object_is_sought_where_it_was_seen(monkeypatch):
    robot, asked = Robot(), {}
    one = loop_of(robot)
    one._seen_from = np.array([1.5, 1.5])

    def search(camera, robot, segmenter, joints, reach):
        asked.update(joints=joints, reach=reach)
        return SimpleNamespace(found=True)

    monkeypatch.setattr(grasping, "search_object", search)
    assert one._search(0.5)
    np.testing.assert_allclose(robot.q[2:], [1.5, 1.5])
    assert asked["joints"] == ("forward", "right")
    assert asked["reach"] == pytest.approx((0.24, 0.24))  # half of the shorter side at that distance


@pytest.fixture
def attempted(monkeypatch):
    """An attempt with a servo and masks that come out as told."""

    def run(end=ServoEnd.CONVERGED, mask=True, areas=(1000.0, 800.0), raised=0.15):
        robot, asked = Robot(), {}
        one = loop_of(robot, raise_by=raised)
        seen = np.ones((4, 6), bool) if mask else None

        class Servo:
            def __init__(self, camera, robot, segmenter, **options):
                asked.update(options)

            def run(self, looks):
                asked["looks"] = looks
                return SimpleNamespace(end=end, mask=seen)

        def choose(mask, fingers, angles, rank):
            asked.update(angles=angles, rank=rank)
            return SimpleNamespace(angle=0.4, verdict=WristVerdict.CLEAR)

        def area(remember=False):
            asked.setdefault("remember", []).append(remember)
            return left.pop(0)

        def check(before, after, opening, behind):
            asked.update(behind=behind, before=before, after=after)
            return check_grasp(before, after, opening=opening, behind=behind)

        left = list(areas)
        one.hand = SimpleNamespace(**{**vars(one.hand), "target_at": lambda distance: distance,
                                      "model": SimpleNamespace(finger_masks=lambda *_: None)})  # fmt: skip
        monkeypatch.setattr(grasping, "MaskServo", Servo)
        monkeypatch.setattr(grasping, "choose_wrist_angle", choose)
        monkeypatch.setattr(grasping, "check_grasp", check)
        monkeypatch.setattr(grasping, "forget_images", lambda _: None)
        one._area, one._descend = area, lambda z, deeper: asked.update(z=z, deeper=deeper) or False
        return one._attempt(0.1, 0.008, 1), asked, robot, one

    return run


def test_an_attempt_centers_turns_goes_down_closes_and_lifts(attempted):
    attempt, asked, robot, one = attempted()
    assert asked["target"] == pytest.approx(0.4)  # the lift above the object
    assert (asked["gain"], asked["max_step"], asked["tolerance"], asked["looks"]) == (0.8, 0.06, 6.0, 15)
    np.testing.assert_allclose(np.rad2deg(asked["angles"]), np.arange(-90, 90, 5))
    assert (asked["rank"], asked["z"], asked["deeper"]) == (1, 0.1, 0.008)
    assert robot.q[1] == pytest.approx(0.5)
    assert robot.q[0] == pytest.approx(0.65)
    assert asked["remember"] == [False, True]
    assert asked["behind"] == pytest.approx((0.17 / 0.32) ** 2)
    assert (asked["before"], asked["after"]) == (1000.0, 800.0)
    assert attempt.check.outcome is GraspOutcome.HELD
    assert (attempt.areas, attempt.opening, attempt.angle, attempt.contact) == ((1000.0, 800.0), 0.02, 0.4, False)
    np.testing.assert_allclose(one._seen_from, [1.0, 2.0])


@pytest.mark.parametrize(("end", "mask"), [(ServoEnd.LOST, True), (ServoEnd.CONVERGED, False)])
def test_an_attempt_at_what_is_not_seen_is_lost(attempted, end, mask):
    attempt, asked, robot, one = attempted(end=end, mask=mask)
    assert attempt.check.outcome is GraspOutcome.LOST
    assert attempt.wrist is WristVerdict.EMPTY
    assert attempt.areas == (0.0, 0.0)
    assert "angles" not in asked
    assert robot.sent == []
    assert not attempt.contact
    np.testing.assert_array_equal(one._seen_from, 0.0)


@pytest.mark.parametrize(
    ("grasp", "raised", "opening", "behind", "outcome"),
    [
        (1000, 501, None, 1.0, GraspOutcome.HELD),
        (1000, 500, None, 1.0, GraspOutcome.MISSED),  # half is not more than half
        (15, 900, None, 1.0, GraspOutcome.UNKNOWN),
        (16, 16, None, 1.0, GraspOutcome.HELD),
        (1000, 15, None, 1.0, GraspOutcome.LOST),
        (1000, 16, None, 1.0, GraspOutcome.MISSED),
        (1000, 900, 0.0015, 1.0, GraspOutcome.MISSED),  # closed fingers hold nothing
        (1000, 900, 0.0016, 1.0, GraspOutcome.HELD),
        (1000, 400, 0.02, 0.3, GraspOutcome.HELD),  # more than of one left behind: a part hangs down
        (1000, 360, 0.02, 0.3, GraspOutcome.MISSED),
        (1000, 361, 0.02, 0.3, GraspOutcome.HELD),
        (1000, 400, 0.001, 0.3, GraspOutcome.MISSED),
        (15, 900, 0.02, 1.0, GraspOutcome.HELD),
        (15, 900, 0.001, 1.0, GraspOutcome.MISSED),
        (1000, 15, 0.02, 1.0, GraspOutcome.HELD),
        (1000, 15, 0.001, 1.0, GraspOutcome.LOST),
    ],
)
def test_what_the_areas_and_the_fingers_say(grasp, raised, opening, behind, outcome):
    check = check_grasp(grasp, raised, opening=opening, behind=behind)
    assert check.outcome is outcome
    assert check.held == (outcome is GraspOutcome.HELD)


@pytest.mark.parametrize(("way", "count"), [(0.0, 1), (0.1, 2), (0.25, 4), (-1.0, 1)])
def test_a_way_takes_as_many_commands_as_it_has_steps_and_one(way, count):
    assert grasping._commands(way, 0.1) == count
