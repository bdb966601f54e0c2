"""Real cameras and robots behind the protocols: OpenCV cameras, LeRobot's robots, ROS 2, and a watchdog process.

May import: the ground and :mod:`dense_vs.robot`. Each driver needs its own library, imported when the driver is made.
"""

from typing import TYPE_CHECKING

from dense_vs.lazy_names import lazy_names

if TYPE_CHECKING:
    from dense_vs.drivers.lerobot_robot import LeRobotRobot as LeRobotRobot
    from dense_vs.drivers.opencv_camera import OpenCVCamera as OpenCVCamera
    from dense_vs.drivers.ros_robot import RosNode as RosNode
    from dense_vs.drivers.watchdog import Hold as Hold
    from dense_vs.drivers.watchdog import Watchdog as Watchdog

# Imported when first used: each module needs a library of its own, and the watchdog's process needs none.
_HOMES = {
    "Hold": "watchdog",
    "LeRobotRobot": "lerobot_robot",
    "OpenCVCamera": "opencv_camera",
    "RosNode": "ros_robot",
    "Watchdog": "watchdog",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]  # they come by __getattr__
__getattr__, __dir__ = lazy_names(__name__, _HOMES)
