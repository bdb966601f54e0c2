"""Real cameras and robots behind the protocols: OpenCV cameras, LeRobot's robots, ROS 2, and a watchdog process.

May import: the ground and :mod:`dense_vs.robot`. Each driver needs its own library, imported when the driver is made.
"""
