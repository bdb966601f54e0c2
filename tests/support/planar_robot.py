"""A robot of four joints and a camera that sees the plane that it moves, with faults that a test sets."""

import numpy as np
from planar_scene import PlanarScene

FRAME = 1 / 30  # s


class PlanarRobot:
    """Follows its commands before the next image is taken.

    Attributes:
        q: where the joints truly are.
        sent: every command.
        reads: what the encoders make of a position and its stamp; the identity unless set.
        follows: (4,) bool, joints that move when commanded.
    """

    joint_names = PlanarScene.joint_names

    def __init__(self, limit=0.5):
        self.joint_limits = np.array([[-limit, limit]] * 4)
        self.q = np.zeros(4)
        self.time = 0.0
        self.sent = []
        self.reads = lambda q, time: (q, time)
        self.follows = np.ones(4, dtype=bool)

    def joints(self):
        q, time = self.reads(self.q.copy(), self.time)
        return q, time

    def command(self, delta):
        self.sent.append(np.array(delta))
        self.q = self.q + delta * self.follows
        self.time += FRAME


class PlaneCamera:
    """Looks at the plane; ``sees`` is what the sensor makes of an image and its stamp."""

    def __init__(self, robot, scene):
        self.robot, self.scene = robot, scene
        self.sees = lambda image, time: (image, time)

    def read(self):
        return self.sees(self.scene.image(self.robot.q), self.robot.time)
