"""A textured plane moved by four joints before a camera: images, Jacobian and flow in closed form.

Joints 0 and 1 shift the plane along x and y, joint 2 turns it and joint 3 scales it about a center c. With M the
rotation by 0.8 q2 and scaling by exp(0.8 q3), a plane point t is seen at

    x = c + G (q0, q1) + M (t - c).

The texture is a sum of sinusoids, so it has a value at every sub-pixel place and no image is ever resampled.
"""

import numpy as np

SHIFT = 60.0  # px/rad
TURN = 0.8  # rad of image rotation, and of log scale, a rad of joint


class PlanarScene:
    joint_names = ("x", "y", "turn", "zoom")

    def __init__(self, height=96, width=128, seed=0):
        rng = np.random.default_rng(seed)
        self.height, self.width = height, width
        self.center = np.array([(width - 1) / 2, (height - 1) / 2])
        angle, wavelength = rng.uniform(0, np.pi, 24), rng.uniform(7, 30, 24)
        self._waves = 2 * np.pi / wavelength * np.array([np.cos(angle), np.sin(angle)])
        self._phases = rng.uniform(0, 2 * np.pi, 24)
        y, x = np.mgrid[:height, :width].astype(float)
        self.pixels = np.stack([x, y], axis=-1)

    def texture(self, places):
        """Gray values, float64 (...), at plane points (..., 2)."""
        waves = np.cos(places @ self._waves + self._phases).sum(axis=-1)
        return np.clip(127 + 14 * waves, 0, 255)

    def image(self, q):
        """uint8 (H, W)."""
        return np.rint(self.texture(self.to_plane(self.pixels, q))).astype(np.uint8)

    def to_image(self, places, q):
        """Where plane points (..., 2) are seen."""
        return self.center + SHIFT * q[:2] + (places - self.center) @ self._linear(q).T

    def to_plane(self, pixels, q):
        """What plane points are seen at (..., 2)."""
        return self.center + (pixels - self.center - SHIFT * q[:2]) @ np.linalg.inv(self._linear(q)).T

    def jacobian(self, q, pixels=None):
        """dx/dq at pixels (..., 2), every pixel's unless given; float64 (..., 2, 4)."""
        arm = (self.pixels if pixels is None else pixels) - self.center - SHIFT * q[:2]
        J = np.zeros((*arm.shape, 4))
        J[..., 0, 0] = J[..., 1, 1] = SHIFT
        J[..., 0, 2], J[..., 1, 2] = -TURN * arm[..., 1], TURN * arm[..., 0]
        J[..., 3] = TURN * arm
        return J

    def flow(self, q_before, q):
        """Exact flow between two postures: x - u(x) is the old place; float32 (H, W, 2)."""
        return (self.pixels - self.to_image(self.to_plane(self.pixels, q), q_before)).astype(np.float32)

    @staticmethod
    def _linear(q):
        a, s = TURN * q[2], np.exp(TURN * q[3])
        return s * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
