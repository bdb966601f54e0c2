"""A disc on the floor seen by a camera that looks down, carried by joints: a world whose every answer is known."""

from dataclasses import dataclass

import numpy as np

HEIGHT, WIDTH, FOCAL = 240, 320, 230.0


@dataclass
class Disc:
    place: np.ndarray  # (2,) m, forward and right of the origin
    radius: float = 0.05
    height: float = 0.0  # of its top, m


class FlatRoom:
    """Camera, robot, gripper and segmenter in one: joints forward, right [m], lift [m], wrist [rad].

    Image x is forward, image y is right; the camera stands ``lift`` above the floor and does not turn with the wrist.
    """

    joint_names = ("forward", "right", "lift", "wrist")

    def __init__(self, disc: Disc | None, start=(0.0, 0.0, 0.8, 0.0), limits=None):
        self.disc = disc
        self.q = np.array(start, dtype=float)
        self.commands: list[np.ndarray] = []
        self.joint_limits = None if limits is None else np.array(limits, dtype=float)
        self.before_look = lambda: None
        self.time = 0.0
        self.held = False
        self.grip = 0.0  # how far the fingertips reach below the camera [m]
        self.jams = False
        self.slack = 0.0  # how far the disc may be from the gripper's axis to be caught [m]
        self.axis = np.zeros(2)  # the gripper's axis from the camera's [m]

    def read(self):
        self.before_look()
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        if self.disc is not None:
            if self.held:
                offset, distance = self.axis, self.grip
            else:
                offset, distance = self.disc.place - self.q[:2], self.q[2] - self.disc.height
            scale = FOCAL / max(distance, 1e-3)
            center = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) + scale * offset
            x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
            image[np.hypot(x - center[0], y - center[1]) < scale * self.disc.radius] = 255
        return image, self.time

    def segment(self, image):
        return image[..., 0] > 128

    def joints(self):
        return self.q.copy(), self.time

    def command(self, delta):
        self.commands.append(np.array(delta))
        self.time += 0.1
        self.q = self.q + delta
        if self.joint_limits is not None:
            self.q = np.clip(self.q, *self.joint_limits.T)

    def open(self):
        self.held = False
        return Said(0.03 if self.jams else 0.135, self.jams)

    def close(self):
        tips = self.q[2] - self.grip
        near = np.hypot(*(self.disc.place - self.q[:2] - self.axis)) <= self.slack
        self.held = self.held or bool(near and tips <= self.disc.height + 1e-6)
        return Said(2 * self.disc.radius if self.held else 0.0, False)


@dataclass
class Said:
    opening: float
    jammed: bool
