"""ROS 2 behind the protocols, through ``rclpy`` where it is installed: JointState and Image in, commands out.

One node for both, spun by a thread of its own. Stamps are the messages' own, so camera and joints have to share a
clock, as they do on one computer and with time synchronization between several. Commands go out as a
``JointTrajectory`` of one point (ros2_control's joint trajectory controller) or as ``Float64MultiArray`` (its position
controllers).
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.checks import check_choice, check_number
from dense_vs.drivers.watchdog import Hold
from dense_vs.errors import DenseVSError

COMMANDS = ("trajectory", "positions")
CHANNELS = {"rgb8": (3, False), "bgr8": (3, True), "rgba8": (4, False), "bgra8": (4, True), "mono8": (1, False)}


class RosNode:
    """Camera and robot of one ROS 2 system, each behind its protocol by this one object.

    Not run with ROS here: tested with a stand-in that has the calls of ``rclpy`` and of its messages.

    Args:
        joints: names of the N joints, in the order wanted.
        image_topic, joint_topic, command_topic: names of the topics.
        command: ``"trajectory"`` or ``"positions"``.
        duration: time that a trajectory's point is to be reached in [s].
        joint_limits: ``(N, 2)`` [rad]; the controllers' own unless given.
        timeout: time without a message after which a reading raises [s].
        ros: where the modules come from; a function of a module's name, the import system unless given.

    Attributes:
        watchdog: how a process apart makes it hold.
        dropped: messages that could not be used.

    Raises:
        DenseVSError: an option out of range.
        ImportError: ``rclpy`` is not there; it comes with ROS 2, not from a package index.
    """

    def __init__(
        self,
        joints: Sequence[str],
        *,
        image_topic: str = "/camera/image_raw",
        joint_topic: str = "/joint_states",
        command_topic: str = "/joint_trajectory_controller/joint_trajectory",
        command: str = "trajectory",
        duration: float = 0.1,
        joint_limits: Any = None,
        timeout: float = 1.0,
        ros: Callable[[str], Any] | None = None,
    ):
        from importlib import import_module

        self._module = ros or import_module
        self.joint_names = tuple(joints)
        if not self.joint_names:
            raise DenseVSError("joints is empty; expected names as in the JointState messages")
        self._form = check_choice("command", command, COMMANDS)
        self._duration = check_number("duration", duration, above=0)
        self._timeout = check_number("timeout", timeout, above=0)
        count = len(self.joint_names)
        self.joint_limits = None if joint_limits is None else real_vector(joint_limits, "joint_limits", (count, 2))
        self._news = threading.Condition()
        self._image: tuple[np.ndarray, float] | None = None
        self._given = -np.inf
        self._reading: tuple[np.ndarray, float] | None = None
        self._goal: np.ndarray | None = None
        self.dropped = 0
        rclpy = self._module("rclpy")
        if not rclpy.ok():
            rclpy.init()
        self._node = rclpy.create_node("dense_vs")
        newest = self._module("rclpy.qos").qos_profile_sensor_data
        sensors = self._module("sensor_msgs.msg")
        self._node.create_subscription(sensors.Image, image_topic, self._take_image, newest)
        self._node.create_subscription(sensors.JointState, joint_topic, self._take_joints, newest)
        kind = self._message("JointTrajectory" if command == "trajectory" else "Float64MultiArray")
        self._publisher = self._node.create_publisher(kind, command_topic, 1)
        arguments = {"joints": list(self.joint_names), "joint_topic": joint_topic, "command_topic": command_topic}
        self.watchdog = Hold("dense_vs.drivers.ros_robot:hold", {**arguments, "command": command})
        self._executor = self._module("rclpy.executors").SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, name="ROS", daemon=True)
        self._thread.start()

    def read(self) -> tuple[np.ndarray, float]:
        """The newest image that was not given yet, RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``, and its stamp [s].

        Raises:
            DenseVSError: none came in time.
        """
        with self._news:
            if not self._news.wait_for(lambda: self._image is not None and self._image[1] > self._given, self._timeout):
                raise DenseVSError(f"no image came for {self._timeout:g} s; expected the camera's node to run")
            assert self._image is not None
            self._given = self._image[1]
            return self._image

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions ``(N,)`` [rad] and their stamp [s].

        Raises:
            DenseVSError: none came yet.
        """
        with self._news:
            if not self._news.wait_for(lambda: self._reading is not None, self._timeout):
                raise DenseVSError(f"no JointState with {', '.join(self.joint_names)} came for {self._timeout:g} s")
            assert self._reading is not None
            return self._reading[0].copy(), self._reading[1]

    def command(self, delta: np.ndarray) -> None:
        """Change the goals by ``delta`` ``(N,)`` [rad] and publish them; nothing for a step of zero.

        Raises:
            DenseVSError: not N finite numbers, or no joint reading yet.
        """
        step = real_vector(np.asarray(delta, dtype=np.float64), "delta", (len(self.joint_names),))
        if not step.any():
            return
        self._goal = (self.joints()[0] if self._goal is None else self._goal) + step
        self._publish(self._goal)

    def hold(self) -> None:
        """Make where the joints are their goal."""
        self._goal = self.joints()[0]
        self._publish(self._goal)

    def close(self) -> None:
        """End the node."""
        self._executor.shutdown()
        self._thread.join(timeout=2.0)
        self._node.destroy_node()

    def _take_image(self, message: Any) -> None:
        channels, turned = CHANNELS.get(message.encoding, (0, False))
        if not channels or message.step < message.width * channels:
            with self._news:
                self.dropped += 1
            return
        rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
        image = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
        image = image[..., 0] if channels == 1 else image[..., 2::-1] if turned else image[..., :3]
        with self._news:
            self._image = np.ascontiguousarray(image), _seconds(message.header.stamp)
            self._news.notify_all()

    def _take_joints(self, message: Any) -> None:
        places = {name: index for index, name in enumerate(message.name)}
        if any(name not in places or places[name] >= len(message.position) for name in self.joint_names):
            return  # the message is of other joints
        positions = np.array([message.position[places[name]] for name in self.joint_names])
        if not np.isfinite(positions).all():
            with self._news:
                self.dropped += 1
            return
        with self._news:
            self._reading = positions, _seconds(message.header.stamp)
            self._news.notify_all()

    def _publish(self, goal: np.ndarray) -> None:
        if self._form == "positions":
            message = self._message("Float64MultiArray")()
            message.data = goal.tolist()
        else:
            message = self._message("JointTrajectory")()
            message.joint_names = list(self.joint_names)
            point = self._message("JointTrajectoryPoint")()
            point.positions = goal.tolist()
            seconds = int(self._duration)
            nanoseconds = int(1e9 * (self._duration - seconds))
            point.time_from_start = self._module("builtin_interfaces.msg").Duration(sec=seconds, nanosec=nanoseconds)
            message.points = [point]
        self._publisher.publish(message)

    def _message(self, name: str) -> Any:
        home = "std_msgs.msg" if name == "Float64MultiArray" else "trajectory_msgs.msg"
        return getattr(self._module(home), name)


def hold(joints: Sequence[str], joint_topic: str, command_topic: str, command: str) -> None:
    """Publish where the joints are as their goal; for the watchdog."""
    node = RosNode(joints, joint_topic=joint_topic, command_topic=command_topic, command=command)
    try:
        node.hold()
    finally:
        node.close()


def _seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec
