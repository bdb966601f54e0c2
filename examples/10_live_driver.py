"""A robot of your own for the live page: dense-vs live --driver examples/10_live_driver.py:make

Replace the body of ``make`` by your camera and robot; here a simulated arm stands in for them, in real time.
"""

from dense_vs import Camera, Robot
from dense_vs.live.pacing import PacedCamera
from dense_vs.sims import SimCamera, SimRobot, SimWorld


class MyRobot:
    """Passes everything on to the driver, and holds when it is told to."""

    def __init__(self, driver: SimRobot):
        self._driver = driver
        self.joint_names = driver.joint_names
        self.joint_limits = driver.joint_limits  # (N, 2) [rad]
        # For a robot that goes on when its program dies, name what makes it hold:
        # self.watchdog = Hold("my_robot:hold", {"port": "/dev/ttyACM0"})  # from dense_vs.drivers.watchdog

    def joints(self):
        """Positions (N,) [rad] and when they were read [s]."""
        return self._driver.joints()

    def command(self, delta):
        """Change the joint targets by delta (N,) [rad]; zeros hold."""
        self._driver.command(delta)

    def hold(self):
        """Called when commands stop, from any thread; nothing to do here, as this robot holds its last target."""


def make() -> tuple[Camera, Robot]:
    """What dense-vs live calls."""
    world = SimWorld("arm", seed=3)
    return PacedCamera(SimCamera(world)), MyRobot(SimRobot(world))


if __name__ == "__main__":
    camera, robot = make()
    image, stamp = camera.read()
    print(f"{len(robot.joint_names)} joints, image of {image.shape[1]} x {image.shape[0]} px at {stamp:g} s")
    assert isinstance(camera, Camera)
    assert isinstance(robot, Robot)
