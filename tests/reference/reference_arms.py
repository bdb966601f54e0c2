"""Arms with published DH tables, features on their hands and cameras that look at them, in plain float64 NumPy.

What a camera sees here is computed from DH matrices and a pinhole, never from the code under test. A feature stands on
the surface of a body in the gripper and is hidden where its surface faces away or where it leaves the image.
"""

from dataclasses import dataclass

import numpy as np

# (omega, d, a, alpha) of each joint.
UR5 = np.array(
    [
        [0, 0.089159, 0, np.pi / 2],
        [0, 0, -0.425, 0],
        [0, 0, -0.39225, 0],
        [0, 0.10915, 0, np.pi / 2],
        [0, 0.09465, 0, -np.pi / 2],
        [0, 0.0823, 0, 0],
    ]
)
BAXTER = np.array(
    [
        [0, 0.27035, 0.069, -np.pi / 2],
        [np.pi / 2, 0, 0, np.pi / 2],
        [0, 0.36435, 0.069, -np.pi / 2],
        [0, 0, 0, np.pi / 2],
        [0, 0.37429, 0.010, -np.pi / 2],
        [0, 0, 0, np.pi / 2],
        [0, 0.229525, 0, 0],
    ]
)
HOMES = {
    "ur5": np.array([0.3, -1.3, 1.5, -1.4, -1.3, 0.4]),
    "baxter": np.array([0.2, -0.5, 0.3, 1.1, -0.3, 0.9, 0.2]),
}
TABLES = {"ur5": UR5, "baxter": BAXTER}


def dh_matrix(omega, d, a, alpha, angle):
    """The paper's T(j) of one joint."""
    c, s, ca, sa = np.cos(omega + angle), np.sin(omega + angle), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def link_poses(table, joints):
    """Pose of every link, (n + 1, 4, 4), the base first."""
    poses = [np.eye(4)]
    for row, angle in zip(table, joints, strict=True):
        poses.append(poses[-1] @ dh_matrix(*row, angle))
    return np.array(poses)


@dataclass
class Camera:
    rotation: np.ndarray  # world to camera
    translation: np.ndarray
    intrinsics: np.ndarray  # fx, fy, cx, cy
    size: tuple[int, int] = (480, 640)
    distortion: float = 0.0  # k1

    def pixels(self, points):
        """(..., 3) to (..., 2); also whether in front and inside."""
        p = points @ self.rotation.T + self.translation
        with np.errstate(divide="ignore", invalid="ignore"):
            ab = p[..., :2] / p[..., 2:]
        ab = ab * (1 + self.distortion * (ab**2).sum(-1, keepdims=True))
        x = ab * self.intrinsics[:2] + self.intrinsics[2:]
        inside = (p[..., 2] > 0.05) & (x >= 0).all(-1) & (x[..., 0] < self.size[1]) & (x[..., 1] < self.size[0])
        return x, inside

    @property
    def center(self):
        return -self.rotation.T @ self.translation


def look_at(center, target, roll=0.0):
    """World-to-camera rotation of a camera at ``center`` that looks at ``target``."""
    z = (target - center) / np.linalg.norm(target - center)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    rotation = np.array([x, y, z])
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ rotation


class Arm:
    """An arm, its features and its cameras, different for every seed."""

    def __init__(self, name="ur5", seed=0, cameras=2, features=12, spread=0.3, distortion=0.0, links=None, facing=1.0):
        rng = np.random.default_rng([seed, 17])
        self.table, self.home, self.spread = TABLES[name], HOMES[name], spread
        self.joints = len(self.table)
        hand = link_poses(self.table, self.home)[-1]
        self.links = np.full(features, self.joints) if links is None else np.asarray(links)
        distance = 1.3 if spread <= 0.5 else 2.2
        self.cameras = []
        start = rng.uniform(0, 2 * np.pi)
        for index in range(cameras):
            azimuth = start + index * rng.uniform(0.5, 1.1)
            elevation = rng.uniform(0.1, 0.8)
            away = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
            center = hand[:3, 3] + distance * rng.uniform(0.85, 1.15) * np.array(away)
            rotation = look_at(center, hand[:3, 3] + rng.normal(0, 0.03, 3), rng.normal(0, 0.1))
            focal = rng.uniform(560, 640)
            intrinsics = np.array(
                [focal, focal * rng.uniform(0.99, 1.01), *(np.array([320, 240]) + rng.uniform(-8, 8, 2))]
            )
            self.cameras.append(Camera(rotation, -rotation @ center, intrinsics, distortion=distortion))

        # On a ball-like body of 5 to 9 cm before the flange, normals outwards; ``facing`` leaves more of them on the
        # side towards the cameras, 0 spreads them all around.
        middle = np.mean([c.center for c in self.cameras], axis=0) - hand[:3, 3]
        direction = rng.normal(size=(features, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        direction += facing * hand[:3, :3].T @ middle / np.linalg.norm(middle)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        self.normals = direction
        self.features = direction * rng.uniform(0.05, 0.09, (features, 1)) + [0, 0, 0.06]

    def guesses(self, rng, focal=0.01):
        """Intrinsics as a user knows them: focal lengths off by a share, principal point in the middle."""
        signs = rng.choice([-1, 1], (len(self.cameras), 1))
        return np.array(
            [
                [*(c.intrinsics[:2] * (1 + sign * focal)), 320, 240]
                for c, sign in zip(self.cameras, signs[:, 0], strict=True)
            ]
        )

    def draw(self, rng, count):
        if self.spread <= 0.5:
            return self.home + rng.normal(0, self.spread, (count, self.joints))
        return self.home + rng.uniform(-self.spread, self.spread, (count, self.joints))

    def see(self, joints, rng=None, noise=0.0, hide=True):
        """Pixels (T, c, m, 2) at joints (T, n), NaN where hidden."""
        joints = np.atleast_2d(joints)
        poses = np.array([link_poses(self.table, q) for q in joints])[:, self.links]
        points = np.einsum("tmij,mj->tmi", poses[..., :3, :3], self.features) + poses[..., :3, 3]
        normals = np.einsum("tmij,mj->tmi", poses[..., :3, :3], self.normals)
        images = []
        for camera in self.cameras:
            x, inside = camera.pixels(points)
            if hide:
                facing = ((camera.center - points) * normals).sum(-1) > 0
                x = np.where((inside & facing)[..., None], x, np.nan)
            images.append(x)
        pixels = np.stack(images, axis=1)
        return pixels if rng is None else pixels + rng.normal(0, noise, pixels.shape)

    def record(self, rng, count, noise=0.5):
        """Joints (T, n) and pixels (T, c, m, 2); postures in which no camera sees 3 features are passed over."""
        joints, pixels = [], []
        while len(joints) < count:
            q = self.draw(rng, 1)[0]
            x = self.see(q, rng, noise)[0]
            if np.isfinite(x[..., 0]).sum(1).max() >= 3:
                joints.append(q)
                pixels.append(x)
        return np.array(joints), np.array(pixels)
