"""A textured plate that three joints turn in space before a camera."""

import numpy as np
from planar_scene import PlanarScene

from dense_vs.body_model.chain import Chain

START = np.array([60.0, 50.0])  # px, of the point that tests follow


class Plate:
    """The plane Z = 1 of the reference posture, carried by a chain of three joints, before a camera."""

    focal = 115.0

    def __init__(self):
        self.scene = PlanarScene()
        axes = np.array([[0.2, 0.1, -0.97], [0.9, 0.3, 0.3], [-0.2, 0.95, 0.2]])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        places = np.array([[-0.15, 0.1, 1.1], [0.05, 0.2, 1.2], [0.2, 0.0, 1.15]])
        self.center = self.scene.center
        self.chain = Chain(axes, places, np.zeros(3), np.array([-1, 0, 1]))

    def image(self, q):
        rotation, shift = (value[0, 2] for value in self.chain.link_poses(np.atleast_2d(q)))
        rays = np.dstack([(self.scene.pixels - self.center) / self.focal, np.ones(self.scene.pixels.shape[:2])])
        normal = rotation[:, 2]
        depth = normal @ (normal + shift) / (rays @ normal)
        local = (depth[..., None] * rays - shift) @ rotation
        return np.rint(self.scene.texture(self.center + self.focal * local[..., :2])).astype(np.uint8)

    def place(self, q):
        rotation, shift = (value[0, 2] for value in self.chain.link_poses(np.atleast_2d(q)))
        here = rotation @ np.append((START - self.center) / self.focal, 1.0) + shift
        return self.center + self.focal * here[:2] / here[2]
