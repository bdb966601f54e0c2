"""The calls of ``rclpy`` and of the messages that the ROS 2 driver uses, without ROS: topics within this process."""

import threading
from types import SimpleNamespace


class FakeRos:
    """Modules by name, as ``import_module`` gives them.

    Attributes:
        published: every message that was published, by topic.
    """

    def __init__(self):
        self.published: dict[str, list] = {}
        self._callbacks: dict[str, list] = {}
        self._up = False
        self._end = threading.Event()

        def record(**fields):
            return SimpleNamespace(**fields)

        executor = record(add_node=lambda node: None, spin=lambda: self._end.wait(20), shutdown=self._end.set)

        def init():
            self._up = True

        self._modules = {
            "rclpy": SimpleNamespace(ok=lambda: self._up, init=init, create_node=lambda name: self),
            "rclpy.qos": SimpleNamespace(qos_profile_sensor_data="newest"),
            "rclpy.executors": SimpleNamespace(SingleThreadedExecutor=lambda: executor),
            "sensor_msgs.msg": SimpleNamespace(Image="Image", JointState="JointState"),
            "std_msgs.msg": SimpleNamespace(Float64MultiArray=record),
            "trajectory_msgs.msg": SimpleNamespace(JointTrajectory=record, JointTrajectoryPoint=record),
            "builtin_interfaces.msg": SimpleNamespace(Duration=record),
        }

    def __call__(self, name):
        return self._modules[name]

    def create_subscription(self, kind, topic, callback, profile):
        assert profile == "newest"
        self._callbacks.setdefault(topic, []).append(callback)

    def create_publisher(self, kind, topic, depth):
        return SimpleNamespace(publish=self.published.setdefault(topic, []).append)

    def destroy_node(self):
        self._callbacks.clear()

    def send(self, topic, message):
        """Deliver a message, as the executor's thread would."""
        for callback in self._callbacks.get(topic, ()):
            callback(message)
