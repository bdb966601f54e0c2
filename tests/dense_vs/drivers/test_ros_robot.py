"""The ROS 2 driver on a stand-in for rclpy."""

from types import SimpleNamespace

import numpy as np
import pytest
from fake_ros import FakeRos

from dense_vs import Camera, Robot
from dense_vs.drivers.ros_robot import RosNode
from dense_vs.errors import DenseVSError

TOPIC = "/joint_trajectory_controller/joint_trajectory"


@pytest.fixture
def ros():
    return FakeRos()


@pytest.fixture
def node(ros):
    node = RosNode(["a", "b"], ros=ros, timeout=0.1)
    yield node
    node.close()


def stamp(seconds):
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(seconds), nanosec=round(1e9 * (seconds % 1))))


def joints(seconds, **positions):
    return SimpleNamespace(header=stamp(seconds), name=list(positions), position=list(positions.values()))


def image(seconds, pixels, encoding, padding=0):
    height, width = pixels.shape[:2]
    rows = pixels.reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, padding))).tobytes()
    step = rows.shape[1] + padding
    return SimpleNamespace(header=stamp(seconds), height=height, width=width, encoding=encoding, step=step, data=data)


def test_joints_come_by_name_with_their_own_stamp(node, ros):
    assert isinstance(node, Robot)
    assert isinstance(node, Camera)
    ros.send("/joint_states", joints(5.25, b=2.0, gripper=0.1, a=1.0))
    ros.send("/joint_states", joints(6.0, gripper=0.2))  # of another part of the robot
    ros.send("/joint_states", joints(7.0, a=np.nan, b=1.0))
    positions, time = node.joints()
    np.testing.assert_array_equal(positions, [1.0, 2.0])
    assert time == 5.25
    assert node.dropped == 1


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "mono8"])
def test_images_come_in_rgb_whatever_their_encoding(node, ros, encoding):
    rgb = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    alpha = np.full((4, 6, 1), 9, np.uint8)
    sent = {
        "rgb8": rgb,
        "bgr8": rgb[..., ::-1],
        "rgba8": np.concatenate([rgb, alpha], axis=2),
        "bgra8": np.concatenate([rgb[..., ::-1], alpha], axis=2),
        "mono8": rgb[..., 0],
    }[encoding]
    ros.send("/camera/image_raw", image(1.5, np.ascontiguousarray(sent), encoding, padding=3))
    got, time = node.read()
    np.testing.assert_array_equal(got, rgb[..., 0] if encoding == "mono8" else rgb)
    assert time == 1.5


def test_an_image_is_given_once_and_a_stall_is_said(node, ros):
    ros.send("/camera/image_raw", image(1.0, np.zeros((2, 2), np.uint8), "mono8"))
    node.read()
    ros.send("/camera/image_raw", image(1.0, np.zeros((2, 2), np.uint8), "mono8"))  # an old one again
    ros.send("/camera/image_raw", image(2.0, np.zeros((2, 2, 2), np.uint8), "yuv422"))
    assert node.dropped == 1
    with pytest.raises(DenseVSError, match="no image"):
        node.read()


def test_no_joints_yet_is_said(node):
    with pytest.raises(DenseVSError, match="a, b"):
        node.joints()


def test_commands_go_out_as_a_trajectory(node, ros):
    ros.send("/joint_states", joints(1.0, a=0.5, b=-0.5))
    node.command(np.zeros(2))
    assert not ros.published[TOPIC]
    node.command(np.array([0.1, 0.2]))
    node.command(np.array([0.1, 0.0]))
    message = ros.published[TOPIC][-1]
    assert message.joint_names == ["a", "b"]
    np.testing.assert_allclose(message.points[0].positions, [0.7, -0.3])
    assert message.points[0].time_from_start.nanosec == 100_000_000
    node.hold()
    np.testing.assert_allclose(ros.published[TOPIC][-1].points[0].positions, [0.5, -0.5])
    node.command(np.array([0.1, 0.0]))  # from where it holds, not from the goal before
    np.testing.assert_allclose(ros.published[TOPIC][-1].points[0].positions, [0.6, -0.5])


def test_commands_go_out_as_positions(ros):
    node = RosNode(["a"], command="positions", command_topic="/go", ros=ros)
    ros.send("/joint_states", joints(1.0, a=0.5))
    node.command(np.array([0.25]))
    assert ros.published["/go"][-1].data == [0.75]
    assert node.watchdog.arguments["command_topic"] == "/go"
    node.close()


def test_wrong_options_are_refused(ros):
    with pytest.raises(DenseVSError, match="trajectory, positions"):
        RosNode(["a"], command="velocity", ros=ros)
    with pytest.raises(DenseVSError, match="joints"):
        RosNode([], ros=ros)
