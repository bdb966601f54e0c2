"""Jointed bodies of random points, with exact tracks."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.body_model.tracks import PointTracks

SIZE = (240, 320)
FOCAL = 300.0
CENTER = (159.5, 119.5)


@dataclass
class SyntheticBody:
    """Lines, points on links and camera, placed by plain 4 x 4 matrices."""

    axes: np.ndarray
    anchors: np.ndarray
    parents: np.ndarray
    points: np.ndarray  # (M, 3) where all joints are 0
    links: np.ndarray  # (M,), -1 for the background
    slides: tuple[int, ...] = ()  # joints that slide along their axis, by a unit of length for one of the joint

    def place(self, q):
        """Positions (M, 3) at a posture, a joint after the other from the last to the first."""
        position = self.points.copy()
        for m, link in enumerate(self.links):
            joint = int(link)
            while joint >= 0:
                if joint in self.slides:
                    position[m] += q[joint] * self.axes[joint]
                    joint = int(self.parents[joint])
                    continue
                turn = Rotation.from_rotvec(q[joint] * self.axes[joint]).as_matrix()
                position[m] = turn @ (position[m] - self.anchors[joint]) + self.anchors[joint]
                joint = int(self.parents[joint])
        return position

    def pixels(self, q):
        position = self.place(q)
        return FOCAL * position[:, :2] / position[:, 2:] + CENTER

    def jacobians(self, q, step=1e-6):
        """J (M, 2, N) by central differences."""
        columns = []
        for n in range(len(self.axes)):
            d = np.zeros(len(self.axes))
            d[n] = step
            columns.append((self.pixels(q + d) - self.pixels(q - d)) / (2 * step))
        return np.stack(columns, axis=2)

    def tracks(self, joints, noise=0.0, outliers=0.0, seed=0):
        rng = np.random.default_rng(seed)
        pixels = np.stack([self.pixels(q) for q in joints])
        pixels += noise * rng.normal(size=pixels.shape)
        gross = rng.random(pixels.shape[:2]) < outliers
        pixels[gross] += rng.uniform(-20, 20, (int(gross.sum()), 2))
        hidden = rng.random(pixels.shape[:2]) < 0.2
        pixels[hidden] = np.nan
        return PointTracks(joints, pixels, np.zeros(len(self.links), int), SIZE)


def serial_body(joints=3, per_link=30, seed=0, slides=()):
    """Links one behind the other, from the lower left to the upper right of the image."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(joints, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    along = np.linspace(-0.3, 0.3, joints + 1)
    ends = np.stack([along, -0.6 * along, 1.0 + 0.1 * np.cos(np.arange(joints + 1))], axis=1)
    points, links = [], []
    for k in range(joints):
        share = rng.random((per_link, 1))
        points.append(ends[k] * (1 - share) + ends[k + 1] * share + 0.05 * rng.normal(size=(per_link, 3)))
        links += [k] * per_link
    return SyntheticBody(axes, ends[:joints], np.arange(joints) - 1, np.concatenate(points), np.array(links), slides)


def postures(joints, count=50, reach=0.3, seed=1):
    """A smooth way through postures (count, joints) [rad]."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, count)[:, None]
    speed, phase = rng.uniform(1, 4, joints), rng.uniform(0, 2 * np.pi, joints)
    return reach * np.sin(2 * np.pi * speed * t + phase)
