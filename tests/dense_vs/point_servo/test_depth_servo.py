"""Servoing in image and depth: the law's third row, the followed depth, and the loop on a plane that comes nearer."""

import numpy as np
import pytest
from planar_scene import PlanarScene
from reference_control import damped_servo_step

from dense_vs import DenseJacobian, DenseVSError, ServoLoop, VisualServo
from dense_vs.point_servo import ReachEnd
from dense_vs.point_servo.followed_depth import LOST_AFTER, FollowedDepth

RNG = np.random.default_rng(0)
NEARER = np.array([0.05, 0.0, 0.0, -0.4])  # m/rad, how the plane's depth answers to each joint


@pytest.mark.parametrize("scale", [30.0, 300.0])
def test_the_third_row_counts_meters_as_pixels(scale):
    J = np.vstack([RNG.normal(0, 100, (2, 5)), RNG.normal(0, 0.4, 5)])
    point, target = np.array([50.0, 40.0, 0.9]), np.array([62.0, 33.0, 0.95])
    servo = VisualServo(5, gain=0.3, damping=15.0, max_step=1e3, dither=0.0)
    step = servo(J, point, target, pixels_per_meter=scale)
    weighted = np.diag([1.0, 1.0, scale])
    np.testing.assert_allclose(step, damped_servo_step(weighted @ J, weighted @ (target - point), 0.3, 15.0), rtol=1e-6)


def test_the_scale_does_not_change_where_the_point_ends():
    J = np.vstack([RNG.normal(0, 100, (2, 4)), RNG.normal(0, 0.4, 4)])
    goal = J @ np.array([0.2, -0.1, 0.15, 0.1])
    for scale in (100.0, 900.0):
        servo, q = VisualServo(4, dither=0.0), np.zeros(4)
        for _ in range(400):
            q = q + servo(J, J @ q, goal, pixels_per_meter=scale)
        np.testing.assert_allclose((J @ q - goal) * [1, 1, scale], 0, atol=1e-2)


def test_the_law_refuses():
    servo, J = VisualServo(4), np.ones((3, 4))
    for arguments, said in (
        ((J[:2], [1, 2, 3], [1, 2, 3]), "jacobian has shape"),
        ((J, [1, 2], [1, 2, 3]), "point has shape"),
        ((J, [1, 2, 3], [1, 2, np.nan]), "target is"),
    ):
        with pytest.raises(DenseVSError, match=said):
            servo(*arguments, pixels_per_meter=300.0)
    for scale in (0.0, -1.0, np.nan, "much"):
        with pytest.raises(DenseVSError, match="pixels_per_meter is"):
            servo(J, [1, 2, 3], [1, 2, 3], pixels_per_meter=scale)


HEIGHT, WIDTH = 40, 50


def seen(depth, frames=1):
    """An estimator that has seen a depth image some times."""
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=2, depth=True, device="cpu", on_bad_flow="skip")
    for _ in range(frames):
        estimator.update(np.zeros((HEIGHT, WIDTH, 2), np.float32), np.full(2, 1e-4), depth=depth)
    return estimator


def test_depth_between_pixels_of_a_slanted_surface():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    estimator = seen(0.9 + 0.002 * x - 0.001 * y)
    for place in ([20.0, 15.0], [20.4, 15.7], [1.3, 38.2]):
        followed = FollowedDepth(estimator, np.array(place))
        assert followed.depth == pytest.approx(0.9 + 0.002 * place[0] - 0.001 * place[1], abs=3e-4)


def test_at_an_outline_the_nearer_surface_is_followed_and_kept():
    depth = np.where(np.arange(WIDTH) < 25, 0.8, 1.4) * np.ones((HEIGHT, 1))
    depth[:, 24:26] = 0.0  # as depth cameras have it
    estimator = seen(depth)
    followed = FollowedDepth(estimator, np.array([23.0, 20.0]))
    assert followed.depth == pytest.approx(0.8, abs=1e-3)
    for _ in range(10):  # tracked on the wrong side of it
        followed.update(estimator, np.array([26.0, 20.0]), np.zeros(2), depth)
    assert followed.depth == pytest.approx(0.8, abs=1e-3)
    assert followed.unseen == 0


def test_goes_along_by_j_where_no_depth_is_seen_and_says_when_for_too_long():
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=2, depth=True, device="cpu", order=1)
    still, q = np.zeros((HEIGHT, WIDTH, 2), np.float32), np.zeros(2)
    for k in range(60):
        dq = 0.3 * np.sin(0.2 * k * np.array([1.0, 1.3]) + [0, 1]) - q
        q = q + dq
        estimator.update(still, dq, depth=np.full((HEIGHT, WIDTH), 1.0 + q @ [0.3, -0.2]))
    followed = FollowedDepth(estimator, np.array([25.0, 20.0]))
    start = followed.depth
    nearer = np.full((HEIGHT, WIDTH), 0.6)  # something covers it
    estimator.predict(np.zeros(2), depth=nearer)
    row = estimator.depth_jacobian[20, 25].copy()
    followed.update(estimator, np.array([25.0, 20.0]), np.array([0.05, 0.0]), nearer)
    assert followed.depth == pytest.approx(start + 0.05 * row[0], abs=1e-6)
    assert (followed.unseen, followed.lost) == (1, False)
    for _ in range(LOST_AFTER):
        followed.update(estimator, np.array([25.0, 20.0]), np.zeros(2), None)
    assert followed.lost


def test_a_place_without_depth_is_refused():
    depth = np.ones((HEIGHT, WIDTH))
    depth[10:30, 10:30] = 0.0
    estimator = seen(depth)
    with pytest.raises(DenseVSError, match="depth is known at 0 of the pixels around"):
        FollowedDepth(estimator, np.array([20.0, 20.0]))
    assert FollowedDepth.found(estimator, np.array([20.0, 20.0])) is None
    assert FollowedDepth.found(estimator, np.array([5.0, 5.0])) is not None


class PlanarRobot:
    joint_names = PlanarScene.joint_names
    joint_limits = np.array([[-0.5, 0.5]] * 4)

    def __init__(self):
        self.q, self.time = np.zeros(4), 0.0

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.q, self.time = self.q + delta, self.time + 1 / 30


class PlaneCamera:
    """Color and depth of the plane, 4 mm of noise and holes."""

    def __init__(self, robot, scene):
        self.robot, self.scene, self.rng = robot, scene, np.random.default_rng(0)
        self.covered, self.offset = False, 0.0

    def read(self):
        return np.repeat(self.scene.image(self.robot.q)[..., None], 3, axis=2), self.robot.time

    def depth(self):
        shape = self.scene.height, self.scene.width
        if self.covered:
            return np.zeros(shape)
        noisy = 1.0 + self.offset + NEARER @ self.robot.q + 0.004 * self.rng.standard_normal(shape)
        return np.where(self.rng.random(shape) < 0.1, np.nan, noisy)


def make(scene, **options):
    robot = PlanarRobot()
    camera = PlaneCamera(robot, scene)
    return robot, camera, ServoLoop(camera, robot, **{"device": "cpu", "seed": 2, "body_model": False} | options)


@pytest.fixture(scope="module")
def learned(scene):
    robot, camera, loop = make(scene, depth=True)
    loop.babble(6.0)
    return robot, camera, loop


@pytest.mark.slow
def test_reaches_in_image_and_depth(scene, learned):
    robot, _, loop = learned
    row = loop.estimator.depth_jacobian[30:60, 40:80]
    assert np.median(np.linalg.norm(row - NEARER, axis=2)) < 0.15 * np.linalg.norm(NEARER)
    start = np.array([60.0, 50.0])
    on_plane = scene.to_plane(start, robot.q)
    loop.define_point(start)
    for target in ([70.0, 44.0, 0.96], [56.0, 55.0, 1.03], [63.0, 46.0, 1.0]):
        reach = loop.reach(target)
        assert reach.reached
        assert reach.target == tuple(target)
        np.testing.assert_allclose(loop.target, target)
        np.testing.assert_allclose(scene.to_image(on_plane, robot.q), target[:2], atol=1.5)
        assert 1.0 + NEARER @ robot.q == pytest.approx(target[2], abs=0.012)  # 1 px is 8 mm before this camera
        assert loop.point_depth == pytest.approx(1.0 + NEARER @ robot.q, abs=0.004)
    assert loop.reach([60.0, 50.0]).target == (60.0, 50.0)  # in the image alone, as ever


@pytest.mark.slow
def test_a_depth_camera_that_says_nothing_for_a_moment_is_bridged(scene, learned):
    robot, camera, loop = learned
    loop.define_point([60.0, 50.0])
    camera.covered = True
    goal = loop.point_depth + 0.01
    reach = loop.reach([60.5, 50.0, goal], max_frames=LOST_AFTER - 1, tolerance=1.5)
    assert reach.end is not ReachEnd.LOST
    later = loop.reach([60.5, 50.0, goal], max_frames=LOST_AFTER, settle_frames=LOST_AFTER)
    camera.covered = False
    assert later.end is ReachEnd.LOST
    assert loop.reach([60.5, 50.0, goal]).reached
    assert 1.0 + NEARER @ robot.q == pytest.approx(goal, abs=0.02)


@pytest.mark.slow
def test_a_point_whose_depth_is_something_elses_for_long_is_lost(learned):
    _, camera, loop = learned
    loop.define_point([60.0, 50.0])
    camera.offset = -0.4  # as of something that color does not show
    reach = loop.reach([60.0, 50.0, loop.point_depth], max_frames=40, settle_frames=100)
    camera.offset = 0.0
    assert reach.end is ReachEnd.LOST


def test_refuses_in_the_loop(scene, learned):
    _, _, loop = learned
    loop.define_point([60.0, 50.0])
    for target, said in (
        ([60.0, 50.0, 0.0], "a depth above 0"),
        ([60.0, 50.0, np.nan], "target is"),
        ([60.0, 50.0, 1.0, 1.0], "target"),
    ):
        with pytest.raises(DenseVSError, match=said):
            loop.reach(target)
    robot, camera, plain = make(scene)
    plain.define_point([60.0, 50.0])
    with pytest.raises(DenseVSError, match=r"target has 3 numbers; expected 2, .*ServoLoop\(depth=True\)"):
        plain.reach([60.0, 50.0, 1.0])
    assert np.isnan(plain.point_depth)

    class ColorCamera:
        read = camera.read

    with pytest.raises(DenseVSError, match=r"camera is a ColorCamera without depth\(\); expected a DepthCamera"):
        ServoLoop(ColorCamera(), robot, device="cpu", depth=True)
    camera.covered = True
    with pytest.raises(DenseVSError, match="depth has no pixel that is known"):
        ServoLoop(camera, robot, device="cpu", depth=True)


def test_an_image_that_waits_for_its_readings_keeps_its_own_depth(scene):
    robot, camera, loop = make(scene, depth=True, joint_delay=0.1)
    depths = {}

    def depth():
        depths[robot.time] = np.full((scene.height, scene.width), 1.0 + 0.01 * len(depths))
        return depths[robot.time]

    camera.depth = depth
    for _ in range(12):
        frame = loop.step(np.zeros(4))
    assert frame.time < robot.time - 0.05
    np.testing.assert_allclose(frame.depth, depths[frame.time], rtol=1e-6)
