"""The closed loop on a robot and camera of the user's own: it learns, it reaches, it says what is wrong."""

from typing import Any

import numpy as np
import pytest
from planar_scene import PlanarScene

from dense_vs import Camera, DenseJacobian, DenseVSError, Robot, ServoLoop, VisualServo


class PlanarRobot:
    """A robot of four joints that follows its commands before the next image is taken."""

    joint_names = PlanarScene.joint_names
    joint_limits = np.array([[-0.5, 0.5]] * 4)

    def __init__(self):
        self.q = np.zeros(4)
        self.time = 0.0

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.q = self.q + delta
        self.time += 1 / 30


class PlaneCamera:
    """Looks at the plane that the robot moves."""

    def __init__(self, robot, scene):
        self.robot, self.scene = robot, scene

    def read(self):
        gray = self.scene.image(self.robot.q)
        return np.repeat(gray[..., None], 3, axis=2), self.robot.time


def make(scene, **options):
    robot = PlanarRobot()
    camera = PlaneCamera(robot, scene)
    # Its joints shift a plane: no body whose joints turn.
    return robot, ServoLoop(camera, robot, **{"device": "cpu", "seed": 2, "body_model": False} | options)


@pytest.fixture(scope="module")
def learned(scene):
    """A loop that has babbled for six seconds."""
    robot, loop = make(scene)
    loop.babble(6.0)
    return robot, loop


def test_the_users_classes_are_a_camera_and_a_robot(scene):
    assert isinstance(PlanarRobot(), Robot)
    assert isinstance(PlaneCamera(PlanarRobot(), scene), Camera)
    assert not isinstance(scene, Robot)


@pytest.mark.slow
def test_babbling_learns_the_image_jacobian(scene, learned):
    robot, loop = learned
    J, true = np.array(loop.estimator.jacobian)[16:-16, 16:-16], scene.jacobian(robot.q)[16:-16, 16:-16]
    error = np.linalg.norm(J - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))
    assert np.median(error) < 0.15
    assert (np.abs(robot.q) <= 0.5).all()
    assert loop.frame.time == pytest.approx(6.0, abs=1 / 30)


@pytest.mark.slow
def test_reaches_where_the_point_truly_is(scene, learned):
    robot, loop = learned
    start = np.array([60.0, 50.0])
    on_plane = scene.to_plane(start, robot.q)
    loop.define_point(start)
    for target in ([75.0, 42.0], [52.0, 58.0], [66.5, 40.25]):
        reach = loop.reach(target)
        true = scene.to_image(on_plane, robot.q)
        assert reach.reached
        assert not reach.lost
        assert reach.target == tuple(target)
        assert reach.frames < 150
        np.testing.assert_allclose(true, target, atol=1.5)
        np.testing.assert_allclose(loop.point, true, atol=0.3)
        assert reach.error_px == pytest.approx(np.hypot(*(loop.point - target)))
        assert (np.abs(robot.q) <= 0.5 + 1e-9).all()


def test_says_when_it_could_not_reach(learned):
    _, loop = learned
    loop.define_point([60.0, 50.0])
    reach = loop.reach([4.0, 4.0], max_frames=3)
    assert (reach.reached, reach.frames) == (False, 3)
    assert reach.error_px > 10


def test_unlearned_robot_stands_still(scene):
    robot, loop = make(scene)
    loop.define_point([60.0, 50.0])
    loop.reach([70.0, 50.0], max_frames=4)
    np.testing.assert_array_equal(robot.q, 0)


def test_calls_back_after_every_frame(scene):
    seen = []
    _, loop = make(scene, on_frame=lambda loop: seen.append(loop.frame.time))
    loop.babble(0.2)
    np.testing.assert_allclose(seen, np.arange(1, len(seen) + 1) / 30)
    assert len(seen) == pytest.approx(6, abs=1)


def test_halves_its_images(scene):
    _, loop = make(scene, scale=0.5)
    loop.babble(0.2)
    assert loop.estimator.jacobian.shape == (48, 64, 2, 4)
    assert loop.frame.gray.shape == (48, 64)


def test_keeps_joint_limits_of_its_own_and_of_a_given_servo(scene):
    robot, loop = make(scene)
    np.testing.assert_array_equal(loop.servo.joint_limits, robot.joint_limits)
    servo = VisualServo(4)
    assert make(scene, servo=servo)[1].servo is servo


def test_refuses(scene, learned):
    robot, loop = learned
    before = robot.q.copy()
    for seconds in (0, -1.0, float("nan"), float("inf"), "x", None, 10**400):
        with pytest.raises(DenseVSError, match=r"seconds is .*; expected a finite number above 0"):
            loop.babble(seconds)
    with pytest.raises(DenseVSError, match="are outside the image"):
        loop.define_point([500.0, 3.0])
    loop.define_point([60.0, 50.0])
    for target in ([1.0], [np.nan, 2.0], [1.0, 2.0, 3.0], "there", None):
        with pytest.raises(DenseVSError, match=r"target .*expected"):
            loop.reach(target)
    np.testing.assert_array_equal(robot.q, before)
    _, fresh = make(scene)
    with pytest.raises(DenseVSError, match=r"no point is defined; expected define_point\(\) first"):
        fresh.reach([1.0, 2.0])
    estimator = DenseJacobian(height=scene.height, width=scene.width, joints=7, device="cpu")
    with pytest.raises(DenseVSError, match="estimator has 7 joints; expected 4: x, y, turn, zoom"):
        make(scene, estimator=estimator)
    with pytest.raises(DenseVSError, match=r"once scaled by 1.0; expected 64 x 48"):
        make(scene, estimator=DenseJacobian(height=48, width=64, joints=4, device="cpu"))


def test_a_robot_that_takes_a_command_only_so_often(scene):
    robot, commands = PlanarRobot(), []

    def command(delta):
        commands.append(np.array(delta))
        PlanarRobot.command(robot, delta)

    robot.command = command
    loop = ServoLoop(PlaneCamera(robot, scene), robot, device="cpu", seed=2, command_period=0.2)
    loop.babble(2.0)
    loop.define_point([60.0, 50.0])
    loop.reach([63.0, 48.0], max_frames=20, tolerance=1e-6)
    moved = np.flatnonzero([np.any(delta != 0) for delta in commands])
    np.testing.assert_array_equal(moved, np.arange(0, 80, 6))  # every 0.2 s of 30 frames a second
    assert loop.estimator.updates == 80  # J is learned in between, too
    with pytest.raises(DenseVSError, match="command_period is 0"):
        ServoLoop(PlaneCamera(robot, scene), robot, device="cpu", command_period=0.0)


@pytest.mark.slow
def test_a_patch_that_is_renewed_stays_on_its_point(scene):
    robot, loop = make(scene, renew_patch=0.999999)
    loop.babble(4.0)
    start = np.array([60.0, 50.0])
    on_plane = scene.to_plane(start, robot.q)
    loop.define_point(start, method="aligned")
    renewed = []
    loop.on_frame = lambda loop: renewed.append(float(loop.tracker.correlation[0]) == 1.0)
    for target in ([72.0, 44.0], [54.0, 56.0]):
        assert loop.reach(target).reached
        np.testing.assert_allclose(scene.to_image(on_plane, robot.q), target, atol=1.5)
    assert sum(renewed) > 5  # a patch that was just taken correlates with itself
    for value in (0.0, 1.0, np.nan):
        with pytest.raises(DenseVSError, match="renew_patch is"):
            make(scene, renew_patch=value)


def test_some_of_the_joints_in_an_order_of_their_own(scene):
    robot, loop = make(scene, joints=["y", "x"])
    loop.babble(3.0)
    np.testing.assert_array_equal(robot.q[2:], 0)
    assert (robot.q[:2] != 0).all()
    np.testing.assert_allclose(loop.frame.positions, robot.q[[1, 0]])
    middle = (slice(32, -32), slice(32, -32))
    J, true = np.array(loop.estimator.jacobian)[middle], scene.jacobian(robot.q)[middle][..., [1, 0]]
    assert np.median(np.linalg.norm(J - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))) < 0.2
    with pytest.raises(DenseVSError, match="joint 'elbow' is not in the robot; expected one of x, y, turn, zoom"):
        make(scene, joints=["elbow"])


def test_says_what_a_robot_lacks(scene):
    class NoLimits:
        joint_names = PlanarRobot.joint_names

        def joints(self):
            return np.zeros(4), 0.0

        def command(self, delta):
            pass

    robot: Any = NoLimits()
    with pytest.raises(DenseVSError, match="robot is a NoLimits without joint_limits; expected joint_names, joint_"):
        ServoLoop(PlaneCamera(PlanarRobot(), scene), robot, device="cpu")
    robot.joint_limits = None
    assert not ServoLoop(PlaneCamera(PlanarRobot(), scene), robot, device="cpu").group.limited
