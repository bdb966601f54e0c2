"""The world as its user meets it: commands, joints, time, seeds, and every wrong argument."""

import itertools
from contextlib import contextmanager

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.robot import JointGroup
from dense_vs.sims import FRAME_SECONDS, SimCamera, SimRobot, SimWorld
from dense_vs.sims.engine import world as world_module

SMALL = {"device": "cpu", "height": 24, "width": 32}


@pytest.fixture
def small():
    return SimWorld("planar", **SMALL)


def test_frame_shapes_and_types(world):
    frame = world.frame()
    _, height, width = world.shape
    assert (frame.rgb.shape, frame.rgb.dtype) == ((height, width, 3), np.uint8)
    assert (frame.depth.shape, frame.depth.dtype) == ((height, width), np.float32)
    assert (frame.ids.shape, frame.ids.dtype) == ((height, width), np.int32)
    assert frame.time == world.time == pytest.approx(2 / 30)


def test_our_robots_fill_the_image_with_texture(arm):
    assert 0.10 < arm.robot_mask().mean() < 0.20
    gray = arm.frame().rgb.mean(axis=-1)
    for region in (arm.robot_mask(), ~arm.robot_mask()):
        assert gray[region].std() > 15


@pytest.mark.parametrize("robot", ["arm", "planar"])
def test_the_tip_stays_in_the_image_round_home(robot):
    world = SimWorld(robot, **SMALL)
    for corner in itertools.product((-0.02, 0.02), repeat=len(world.joint_names)):
        world.reset()
        for _ in range(20):
            world.step(corner)
        x, y = world.project("tip")
        assert 0 < x < 31
        assert 0 < y < 23


def test_joints_follow_commands_and_hold(small):
    start, time = small.joints()
    assert time == 0.0
    for _ in range(5):
        small.step([0.02, -0.03, 0.01])
    for _ in range(10):
        small.step()
    end, time = small.joints()
    np.testing.assert_allclose(end - start, [0.1, -0.15, 0.05], atol=1e-6)
    assert time == pytest.approx(0.5)


def test_targets_stay_within_the_limits(small):
    for _ in range(50):
        small.step([0.1, -0.1, 0.0])
    positions, _ = small.joints()
    np.testing.assert_allclose(positions[0], small.joint_limits[0, 1], atol=1e-6)
    np.testing.assert_allclose(positions[1], small.joint_limits[1, 0], atol=1e-6)
    small.step([-0.1, 0.0, 0.0])
    for _ in range(5):
        small.step()
    np.testing.assert_allclose(small.joints()[0][0], small.joint_limits[0, 1] - 0.1, atol=1e-3)


def test_joint_history_covers_the_frame(small):
    times, positions = small.joint_history()
    assert times == pytest.approx([0.0])
    np.testing.assert_array_equal(positions, [small.joints()[0]])
    small.step([0.02, 0.0, 0.0])
    previous, _ = small.joints()
    small.step([0.02, 0.0, 0.0])
    times, positions = small.joint_history()
    assert positions.shape == (8, 3)
    np.testing.assert_allclose(times, FRAME_SECONDS * (1 + np.arange(1, 9) / 8))
    np.testing.assert_array_equal(positions[-1], small.joints()[0])
    assert np.all(np.diff([previous[0], *positions[:, 0]]) > 0)


def test_chosen_joints_of_a_file(eye_in_hand_file):
    world = SimWorld(eye_in_hand_file, camera="hand", joints=["roll", "slide", "finger"], **SMALL)
    assert world.joint_names == ("roll", "slide", "finger")
    # Joint range, and control range over the gear of 2; a hinge without limits.
    np.testing.assert_allclose(world.joint_limits, [[-np.inf, np.inf], [-0.25, 0.3], [-np.inf, np.inf]])
    assert world.joint_units == ("rad", "m", "rad")
    start, _ = world.joints()
    np.testing.assert_allclose(start, [-0.1, 0.05, 0.2], atol=1e-9)  # its keyframe
    world.step([0.02, 0.01, -0.02])
    for _ in range(15):
        world.step()
    np.testing.assert_allclose(world.joints()[0] - start, [0.02, 0.01, -0.02], atol=2e-3)
    assert world.physics.host_state(0).joint("pan").qpos[0] == pytest.approx(0.1, abs=1e-2)
    default = SimWorld(eye_in_hand_file, **SMALL)
    assert default.joint_names == ("slide", "pan", "roll", "finger")
    np.testing.assert_allclose(default.T_world_camera[:3, 3], [0, -1.5, 0.3])  # the first camera


def test_same_seed_same_world():
    worlds = [SimWorld("arm", seed=9, distractor="behind", **SMALL) for _ in range(2)]
    for world in worlds:
        for _ in range(3):
            world.step([0.02, -0.02, 0.01, 0.03])
    first, second = (world.frame() for world in worlds)
    np.testing.assert_array_equal(first.rgb, second.rgb)
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(worlds[0].joints()[0], worlds[1].joints()[0])
    np.testing.assert_array_equal(worlds[0].true_flow(), worlds[1].true_flow())


def test_reset_begins_again_and_anew():
    world = SimWorld("planar", seed=1, distractor="behind", **SMALL)
    start, posture = world.frame(), world.joints()[0]
    for _ in range(3):
        world.step([0.05, 0.0, 0.0])
    assert np.any(world.frame().rgb != start.rgb)
    world.reset()
    assert world.time == 0.0
    np.testing.assert_array_equal(world.frame().rgb, start.rgb)
    np.testing.assert_array_equal(world.joints()[0], posture)
    np.testing.assert_array_equal(world.true_flow(), 0.0)
    world.reset(seed=2)
    other = SimWorld("planar", seed=2, distractor="behind", **SMALL)
    np.testing.assert_array_equal(world.frame().rgb, other.frame().rgb)
    assert np.mean(world.frame().rgb != start.rgb) > 0.9
    assert np.all(world.joints()[0] != posture)


def test_distractor_moves_behind_the_arm_or_before_it():
    plain = SimWorld("arm", **SMALL)
    depths = {kind: SimWorld("arm", distractor=kind, **SMALL) for kind in ("behind", "front")}
    closest = plain.frame().depth[plain.robot_mask()]
    for kind, world in depths.items():
        plate = world.scene.model.geom("distractor").id
        places, seen = [], []
        for _ in range(30):
            for _ in range(5):
                world.step()
            places.append(world.project("distractor"))
            seen.append(world.frame().depth[world.frame().ids == plate])
        assert np.ptp(np.array(places), axis=0).min() > 1
        depth = np.concatenate(seen)
        assert depth.size > 100
        assert depth.min() > closest.max() if kind == "behind" else depth.max() < closest.min()


def test_returned_arrays_are_the_callers_own(small):
    before = small.frame()
    kept = before.rgb.copy()
    flow = small.true_flow()
    small.step([0.1, 0.1, 0.1])
    small.frame()
    np.testing.assert_array_equal(before.rgb, kept)
    assert np.any(small.true_flow() != flow)


@pytest.mark.parametrize(("samples", "per_pixel"), [(1, 24), (2, 24 + 30 * 4), (3, 24 + 30 * 9)])
def test_memory_is_asked_for_of_physics_and_every_pixel(monkeypatch, samples, per_pixel):
    asked = []

    @contextmanager
    def room_for(what, worlds, bytes_per_world, device):
        asked.append((worlds, bytes_per_world))
        raise DenseVSError("no room")
        yield

    monkeypatch.setattr(world_module, "room_for", room_for)
    with pytest.raises(DenseVSError, match="no room"):
        SimWorld("planar", worlds=3, samples=samples, **SMALL)
    assert asked == [(3, per_pixel * 24 * 32 + 50_000)]


def test_any_number_of_threads_gives_the_same_image():
    one, three = (SimWorld("arm", device="cpu", height=61, width=80, threads=threads) for threads in (1, 3))
    for world in (one, three):
        world.step([0.02, 0.02, 0.02, 0.02])
    np.testing.assert_array_equal(one.frame().rgb, three.frame().rgb)
    np.testing.assert_array_equal(one.frame().depth, three.frame().depth)
    np.testing.assert_array_equal(one.true_jacobian(), three.true_jacobian())
    one.step([0.02, 0.02, 0.02, 0.02])  # past the first launches, which run in turn
    three.step([0.02, 0.02, 0.02, 0.02])
    np.testing.assert_array_equal(one.frame().rgb, three.frame().rgb)
    np.testing.assert_array_equal(one.frame().ids, three.frame().ids)


def test_camera_and_robot_of_a_world(small):
    camera, robot = SimCamera(small), SimRobot(small)
    assert robot.joint_names == small.joint_names
    np.testing.assert_array_equal(robot.joint_limits, small.joint_limits)
    assert JointGroup.of_robot(robot).units == ("rad",) * 3
    image, time = camera.read()
    assert (image.shape, image.dtype, time) == ((24, 32, 3), np.uint8, 0.0)
    robot.command([0.01, 0.0, 0.0])
    positions, time = robot.joints()
    assert positions.shape == (3,)
    assert time == camera.read()[1] == pytest.approx(1 / 30)


def test_a_robot_carries_commands_out_over_time(small):
    robot = SimRobot(small, command_seconds=0.3)
    start, places = robot.joints()[0], []
    for frame in range(14):
        robot.command(np.array([0.1, 0.0, -0.05]) if frame in (0, 4) else np.zeros(3))
        places.append(robot.joints()[0] - start)
    steps = np.diff(np.array(places)[:, 0])
    assert steps.max() < 0.035  # minimal jerk: at most 1.9 times the mean speed of either command
    assert np.all(steps > -1e-6)
    for _ in range(8):
        robot.command(np.zeros(3))
    np.testing.assert_allclose(robot.joints()[0] - start, [0.2, 0.0, -0.1], atol=1e-6)
    for seconds in (-1.0, np.nan):
        with pytest.raises(DenseVSError, match="command_seconds"):
            SimRobot(small, command_seconds=seconds)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robot": "leg"}, r"robot 'leg' .*'arm', 'painted', 'planar',.* or the path"),
        ({"robot": "no/such/file.xml"}, r"no/such/file.xml.*'arm', 'painted', 'planar',"),
        ({"joints": ["thumb"]}, r"joint 'thumb'.*joint1, joint2, joint3"),
        ({"joints": []}, r"joints is \(\); expected .*joint1"),
        ({"joints": "joint1"}, r"joints is 'joint1'; expected a sequence"),
        ({"joints": ["joint1", "joint1"]}, "named twice"),
        ({"camera": "lens"}, r"camera 'lens'.*'fixed'"),
        ({"distractor": "above"}, r"distractor is 'above'.*'none', 'behind', 'front'"),
        ({"worlds": 0}, r"worlds is 0; expected"),
        ({"worlds": 1.5}, r"worlds is 1.5; expected"),
        ({"height": 4}, r"height is 4; expected"),
        ({"width": "wide"}, r"width is 'wide'; expected"),
        ({"seed": -1}, r"seed is -1; expected"),
        ({"device": "tpu"}, r"device 'tpu'.*cpu"),
        ({"threads": 0}, r"threads is 0"),
    ],
)
def test_bad_arguments(options, message):
    with pytest.raises(DenseVSError, match=message):
        SimWorld(**({"robot": "planar"} | SMALL | options))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joints": ["idle"]}, r"'idle' has no position actuator .*; expected one of 'slide', 'pan'"),
        ({"joints": ["free"]}, r"'free' is of type free; expected a hinge or slide"),
        ({"distractor": "behind"}, r"expected 'none' with an MJCF file"),
    ],
)
def test_bad_arguments_for_a_file(eye_in_hand_file, options, message):
    with pytest.raises(DenseVSError, match=message):
        SimWorld(eye_in_hand_file, **(SMALL | options))


BODY = '<body><joint name="j"/><geom size="0.1"/></body>'
POSITION = '<actuator><position joint="j"/></actuator>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not MJCF", "does not compile as MJCF"),
        (f"<mujoco><worldbody>{BODY}</worldbody>{POSITION}</mujoco>", "no camera"),
        (f"<mujoco><worldbody><camera/>{BODY}</worldbody></mujoco>", "no joint .* position actuator"),
        (
            f'<mujoco><worldbody><camera name="c" mode="trackcom"/>{BODY}</worldbody>{POSITION}</mujoco>',
            "'c' turns by itself",
        ),
        (
            f'<mujoco><worldbody><camera name="c" projection="orthographic"/>{BODY}</worldbody>{POSITION}</mujoco>',
            "'c' is orthographic",
        ),
    ],
)
def test_bad_files(tmp_path, text, message):
    path = tmp_path / "robot.xml"
    path.write_text(text)
    with pytest.raises(DenseVSError, match=message):
        SimWorld(path, **SMALL)


@pytest.mark.parametrize(
    "delta", [[0.1], [[0.1, 0.1, 0.1]] * 2, 0.1, [0.1, np.nan, 0.1], [0.1, np.inf, 0.1], "abc", ["a", "b", "c"]]
)
def test_bad_commands_move_nothing(small, delta):
    before, _ = small.joints()
    with pytest.raises(DenseVSError, match="delta"):
        small.step(delta)
    assert small.time == 0.0
    small.step()
    np.testing.assert_allclose(small.joints()[0], before, atol=1e-12)


def test_bad_reset_changes_nothing(small):
    image = small.frame().rgb
    for seed in (-1, 1.5, "x", True):
        with pytest.raises(DenseVSError, match="seed"):
            small.reset(seed=seed)
    np.testing.assert_array_equal(small.frame().rgb, image)


@pytest.mark.parametrize("entry", ["qpos", "qvel"])
def test_unstable_simulation_is_an_error_that_leaves_the_world(small, entry):
    home, _ = small.joints()
    small.step([0.02, -0.03, 0.01])
    state = small.physics.host_state(0)
    joints, time = state.qpos.copy(), state.time
    kept = getattr(state, entry)[1]
    getattr(state, entry)[1] = np.nan
    with pytest.raises(DenseVSError, match=r"unstable after 0\.033 s"):
        small.step([0.02, -0.03, 0.01])
    assert np.isnan(getattr(state, entry)[1])
    getattr(state, entry)[1] = kept
    assert state.time == time
    np.testing.assert_array_equal(state.qpos, joints)
    assert small.time == pytest.approx(1 / 30)
    for _ in range(10):
        small.step()
    np.testing.assert_allclose(small.joints()[0] - home, [0.02, -0.03, 0.01], atol=1e-4)


def test_a_randomization_of_another_kind_is_refused():
    with pytest.raises(DenseVSError, match="randomization is '1'; expected a DomainRandomization"):
        SimWorld("planar", randomization="1", height=8, width=8, device="cpu")


@pytest.mark.parametrize("camera", [np.array(["a", "b"]), ["front"], 0])
def test_a_camera_that_is_no_name_is_refused(camera):
    with pytest.raises(DenseVSError, match="is not in the model; expected one of"):
        SimWorld("planar", camera=camera, height=8, width=8, device="cpu")
