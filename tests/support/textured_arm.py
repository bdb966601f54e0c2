"""An arm of three textured plates before a camera: exact images by rays, and the body model that is right of it."""

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface

SIZE = (150, 200)
FOCAL, CENTER = 200.0, (99.5, 74.5)
ANCHORS = np.array([[-0.35, 0.1, 1.0], [-0.1, 0.05, 1.0], [0.1, -0.05, 1.05]])
AXES = np.array([[0.1, 0.2, 1.0], [0.6, 0.1, 0.8], [-0.3, 0.4, 0.9]])
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
LONG, WIDE = 0.24, 0.16
SPACING = 0.8  # px between surface points


class TexturedArm:
    """Three plates on three hinges, of which the last may slide instead, along its axis."""

    def __init__(self, slides=False, seed=0):
        rng = np.random.default_rng(seed)
        self.slides = slides
        self._waves = rng.uniform(-1, 1, (4, 16, 2)) * 2 * np.pi / rng.uniform(0.012, 0.06, (4, 16, 1))
        self._phases = rng.uniform(0, 2 * np.pi, (4, 16))

    def shade(self, plate, u, v):
        """Gray levels of a plate at its own coordinates; plate 3 is the wall behind."""
        waves = np.multiply.outer(u, self._waves[plate, :, 0]) + np.multiply.outer(v, self._waves[plate, :, 1])
        return 128 + 22 * np.sin(waves + self._phases[plate]).sum(axis=-1) / 2

    def poses(self, q):
        """Rotation and shift of every plate since the home posture, by 4 x 4 matrices."""
        whole, found = np.eye(4), []
        for n in range(3):
            joint = np.eye(4)
            if n == 2 and self.slides:
                joint[:3, 3] = q[n] * AXES[n]
            else:
                joint[:3, :3] = Rotation.from_rotvec(q[n] * AXES[n]).as_matrix()
                joint[:3, 3] = ANCHORS[n] - joint[:3, :3] @ ANCHORS[n]
            whole = whole @ joint
            found.append((whole[:3, :3], whole[:3, 3]))
        return found

    def image(self, q, turn=(0, 0, 0), shift=(0, 0, 0), samples=2):
        """What a camera sees that has been moved: X is seen at R X + shift."""
        height, width = SIZE
        step = (np.arange(samples) + 0.5) / samples - 0.5
        x, y = np.meshgrid((np.arange(width)[:, None] + step).ravel(), (np.arange(height)[:, None] + step).ravel())
        rays = np.dstack([(x - CENTER[0]) / FOCAL, (y - CENTER[1]) / FOCAL, np.ones_like(x)])
        moved = Rotation.from_rotvec(turn).as_matrix()
        origin, rays = -moved.T @ np.array(shift), rays @ moved
        shown = self.shade(3, 2 * rays[..., 0] / rays[..., 2], 2 * rays[..., 1] / rays[..., 2])
        nearest = np.full(x.shape, np.inf)
        for k, (rotation, place) in enumerate(self.poses(q)):
            ray, start = rays @ rotation, rotation.T @ (origin - place) - ANCHORS[k]
            with np.errstate(divide="ignore"):
                away = -start[2] / ray[..., 2]
            u, v = start[0] + away * ray[..., 0], start[1] + away * ray[..., 1]
            hit = (u >= 0) & (u <= LONG) & (np.abs(v) <= WIDE / 2) & (away > 0) & (away < nearest)
            nearest[hit] = away[hit]
            shown[hit] = self.shade(k, u[hit], v[hit])
        whole = shown.reshape(height, samples, width, samples).mean(axis=(1, 3))
        return np.clip(np.rint(whole), 0, 255).astype(np.uint8)

    def model(self):
        """What a perfect learner would know of it."""
        u, v = np.meshgrid(np.arange(0, LONG, SPACING / FOCAL), np.arange(-WIDE / 2, WIDE / 2, SPACING / FOCAL))
        flat = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
        points = np.concatenate([anchor + flat for anchor in ANCHORS])
        gray = np.concatenate([self.shade(k, u.ravel(), v.ravel()) for k in range(3)])
        count, links = len(points), np.repeat(np.arange(3), u.size)
        surface = Surface(points, links, np.ones(count), np.clip(np.rint(gray), 0, 255).astype(np.uint8))
        axes, travel = AXES.copy(), np.zeros((3, 3))
        if self.slides:
            axes[2], travel[2] = 0, AXES[2]
        chain = Chain(axes, ANCHORS, np.zeros(3), np.array([-1, 0, 1]), travel)
        limits = np.tile([-0.4, 0.4], (3, 1))
        return BodyModel(ModelContent(chain, FOCAL, CENTER, SIZE, surface, np.ones(3, bool), limits, 0.3))

    def pixels(self, points, links, q, turn=(0, 0, 0), shift=(0, 0, 0)):
        """Where points in the home posture are seen ``(P, 2)``."""
        poses = self.poses(q)
        there = np.array([poses[k][0] @ p + poses[k][1] for p, k in zip(points, links, strict=True)])
        there = there @ Rotation.from_rotvec(turn).as_matrix().T + shift
        return FOCAL * there[:, :2] / there[:, 2:] + CENTER


def postures(count=8, seed=1):
    """Postures ``(count, 3)`` [rad]."""
    return np.random.default_rng(seed).uniform(-0.25, 0.25, (count, 3)) * [1.0, 1.0, 0.8]
