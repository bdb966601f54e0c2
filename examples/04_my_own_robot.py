"""Your own robot: a camera with ``read`` and a robot with ``joints`` and ``command``; here a simulated driver.

Replace the bodies of the two classes by calls of your driver. Nothing needs to be inherited.
"""

import numpy as np

from dense_vs import Camera, Robot, ServoLoop
from dense_vs.sims import SimWorld

driver = SimWorld("arm", seed=3)  # stands in for the real driver


class MyCamera:
    def read(self) -> tuple[np.ndarray, float]:
        """Blocks for the next image: RGB uint8 (H, W, 3), and when it was taken [s]."""
        frame = driver.frame()
        return frame.rgb, frame.time


class MyRobot:
    joint_names = driver.joint_names
    joint_limits = driver.joint_limits  # (N, 2) [rad]; commands never leave them

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (N,) [rad] and when they were read [s], on the camera's clock."""
        return driver.joints()

    def command(self, delta: np.ndarray) -> None:
        """Change the joint targets by delta (N,) [rad], and return."""
        driver.step(delta)


camera, robot = MyCamera(), MyRobot()
assert isinstance(camera, Camera)
assert isinstance(robot, Robot)

loop = ServoLoop(camera, robot)
loop.babble(10.0)  # seconds of small random motion: clear the space around the robot first
loop.define_point(driver.project("tip"))  # where you would click
start = loop.point
for offset in ([25, -15], [-20, 10]):
    reach = loop.reach(start + offset)
    true_error = np.hypot(*(driver.project("tip") - reach.target))
    print(f"target {np.round(reach.target)}: reached {reach.reached} in {reach.frames} frames, {true_error:.2f} px off")
    assert reach.reached
    assert true_error < 2.0
