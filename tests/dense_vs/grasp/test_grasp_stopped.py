"""Old images and old readings move nothing: a grasp ends with that said, the robot and the gripper as they were."""

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom, Said

from dense_vs.grasp import GraspAction, GraspLoop, GraspOutcome, GripperModel, HandGeometry, RegraspPolicy
from dense_vs.mask_servo.loop import ServoEnd

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
GRIP, BEHIND, HIGH = 0.17, 0.03, 0.21  # HIGH: of the camera above the object's top at the start
INTRINSICS = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
ASIDE = (0.05, 0.6)


class Late(FlatRoom):
    """A room whose stamps are late by what is told, while that is to be so."""

    def __init__(self, place=(0.02, 0.01), *, image=0.0, joints=0.0, begins=lambda room: True):
        super().__init__(Disc(np.array(place), 0.02, 0.1), start=(0.0, 0.0, 0.1 + HIGH, 0.0))
        self.grip, self.axis, self.slack = GRIP, np.array([-BEHIND, 0.0]), 0.02
        self.late_image, self.late_joints, self.begins = image, joints, begins
        self.opened, self.closed, self.late_commands, self.late_closed = 0, 0, [], 0

    def read(self):
        image, time = super().read()
        return image, time - self.late_image * self.begins(self)

    def joints(self):
        q, time = super().joints()
        return q, time - self.late_joints * self.begins(self)

    def command(self, delta):
        if self.begins(self):
            self.late_commands.append(np.array(delta))
        super().command(delta)

    def open(self):
        self.opened += 1
        return super().open()

    def close(self):
        self.late_closed += bool(self.begins(self))
        self.closed += 1
        return super().close()


class Nothing:
    def segment(self, image):
        return np.zeros(image.shape[:2], bool)


def grasp(world, **options):
    pose = np.array([[0, -1, 0, -BEHIND], [1, 0, 0, 0], [0, 0, 1, GRIP], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    hand = HandGeometry(GRIP, (CENTER[0] - FOCAL * BEHIND / GRIP, CENTER[1]), CENTER, INTRINSICS, model, bite=0.0)
    pinv = np.diag([-0.2 / FOCAL, -0.2 / FOCAL])
    return GraspLoop(
        world, world, world, world, hand, lift="lift", wrist="wrist", base=("forward", "right"), pinv=pinv, **options
    ).run(0.1)


OLD = [({"image": 10.0}, "the image is 10.000 s old"), ({"joints": 10.0}, "the joint reading is 10.000 s old")]


@pytest.mark.parametrize("place", [(0.02, 0.01), (-BEHIND, 0.0)])  # to be centered, and centered
@pytest.mark.parametrize(("late", "why"), OLD)
def test_nothing_moves_on_old_stamps(place, late, why):
    world = Late(place, **late)
    before, attempts = world.q.copy(), []
    run = grasp(world, others=(Nothing(),), aside=ASIDE, on_attempt=attempts.append)
    assert run.stopped == why
    assert not run.held
    (attempt,) = run.attempts
    assert attempts == [attempt]
    assert (attempt.servo, attempt.check.outcome) == (ServoEnd.STOPPED, GraspOutcome.STOPPED)
    np.testing.assert_array_equal(world.q, before)
    assert (world.opened, world.closed) == (1, 0)


@pytest.mark.parametrize(("late", "why"), OLD)
@pytest.mark.parametrize(
    "begins",
    [
        lambda room: room.closed,  # at the object
        lambda room: room.closed and room.q[2] > 0.3,  # risen
        lambda room: room.closed and room.q[1] > 0.3,  # aside
    ],
)
def test_a_grasp_stops_where_stamps_begin_to_be_old(late, why, begins):
    world = Late(**late, begins=begins)
    run = grasp(world, others=(Nothing(),), aside=ASIDE)
    assert run.stopped
    assert "old" in run.stopped
    assert not run.held
    assert run.attempts[-1].check.outcome is GraspOutcome.STOPPED
    assert run.attempts[-1].servo is ServoEnd.CONVERGED  # as far as it came
    assert world.opened == 1
    assert (world.closed, world.late_closed) == (1, 0)
    if "joints" in late:  # the ways up and aside are gone by the joints alone
        assert not any(command.any() for command in world.late_commands)
    assert world.held  # and not dropped


@pytest.mark.parametrize("late", [{"image": 10.0}, {"joints": 10.0}])
def test_a_search_in_a_grasp_stops_too(late):
    world = Late((5.0, 5.0), **late)
    run = grasp(world)
    assert run.attempts[0].check.outcome is GraspOutcome.LOST
    assert run.stopped.endswith("s old")
    assert not any(command.any() for command in world.commands)


def test_a_reading_that_stops_on_the_way_down_is_not_followed():
    world = Late()
    stamps, joints = [], world.joints

    def frozen():
        q, time = joints()
        if stamps or world.q[2] < 0.309:
            stamps.append(time)
            time = stamps[0]
        return q, time

    world.joints = frozen
    run = grasp(world, others=(Nothing(),), aside=ASIDE)
    assert run.stopped.endswith("s old")
    assert world.held


def test_the_way_back_is_not_gone_on_old_readings():
    world = Late(joints=10.0, begins=lambda room: room.opened == 2)
    world.close = lambda: Said(0.0, False)
    run = grasp(world)
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.MISSED]
    assert run.stopped == "the joint reading is 10.000 s old"
    assert not any(command.any() for command in world.late_commands)


@pytest.mark.parametrize("moved", [1e30, np.float64(2000.0)])
def test_a_reading_that_is_far_out_is_no_way_to_go(moved):
    world = Late()
    joints = world.joints

    def wild():
        q, time = joints()
        q[2] += moved * (world.q[2] < 0.3)
        return q, time

    world.joints = wild
    run = grasp(world)
    assert "expected at most 100" in run.stopped
    assert not run.held


def test_a_stop_ends_the_attempts():
    policy = RegraspPolicy(attempts=9)
    assert policy.decide(GraspOutcome.STOPPED).action is GraspAction.GIVE_UP


def test_a_run_after_one_that_was_stopped():
    world = Late(image=10.0)
    assert grasp(world).stopped
    world.late_image = 0.0
    run = grasp(world, others=(Nothing(),), aside=ASIDE)
    assert run.held
    assert run.stopped == ""
