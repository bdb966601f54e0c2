"""An arm whose hand carries point features, before pinhole cameras: exact pixels and which features can be seen.

Cameras stand where a person would put them, features where those cameras can see them when the arm is at home. The
seed draws both. A feature is hidden when its surface faces more than 78 degrees away or when it leaves the image.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.dh_chain import DHChain, find_arm

IMAGE_SIZE = (480, 640)
FOCAL_PX = 620.0

_DISTANCE = 1.7  # m from the hand at home to a camera
_TOOL_RADIUS = 0.07  # m
_TOOL_CENTRE = 0.06  # m beyond the flange
_FACING = np.cos(np.deg2rad(78.0))


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion."""

    intrinsics: np.ndarray  # (4,) fx, fy, cx, cy [px]
    T_camera_world: np.ndarray  # (4, 4); camera axes x right, y down, z forward
    size: tuple[int, int] = IMAGE_SIZE

    @property
    def centre(self) -> np.ndarray:
        """(3,) [m] in the world."""
        return -self.T_camera_world[:3, :3].T @ self.T_camera_world[:3, 3]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of world points (..., 3); NaN behind the camera."""
        local = points @ self.T_camera_world[:3, :3].T + self.T_camera_world[:3, 3]
        depth = np.where(local[..., 2:] > 1e-6, local[..., 2:], np.nan)
        return local[..., :2] / depth * self.intrinsics[:2] + self.intrinsics[2:]

    def shifted(self, rng: np.random.Generator, metres: float, radians: float) -> "PinholeCamera":
        """The camera after a knock: moved by ``metres`` and turned by ``radians``, in random directions."""
        turn = Rotation.from_rotvec(radians * _unit(rng.normal(size=3))).as_matrix()
        pose = self.T_camera_world.copy()
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] = turn @ pose[:3, 3] + metres * _unit(rng.normal(size=3))
        return replace(self, T_camera_world=pose)


@dataclass(frozen=True)
class ObservedArm:
    """The arm with m features and c cameras."""

    chain: DHChain
    features: np.ndarray  # (m, 3) [m] in the flange's frame
    normals: np.ndarray  # (m, 3) of the surfaces that they are on
    cameras: tuple[PinholeCamera, ...]

    @property
    def image_sizes(self) -> list[tuple[int, int]]:
        """(height, width) of each camera."""
        return [camera.size for camera in self.cameras]

    def pixels(self, joints: np.ndarray) -> np.ndarray:
        """Exact pixels (T, c, m, 2) for joints (T, n) [rad], NaN where a feature is hidden."""
        return self.pixels_of_poses(self.chain.flange_pose(joints))

    def projections(self, poses: np.ndarray) -> np.ndarray:
        """Where features are or would be, (T, c, m, 2) [px], for poses (T, 4, 4); NaN only behind a camera."""
        points = (poses[:, None, :3, :3] @ self.features[..., None])[..., 0] + poses[:, None, :3, 3]
        return np.stack([camera.project(points) for camera in self.cameras], axis=1)

    def pixels_of_poses(self, poses: np.ndarray) -> np.ndarray:
        """Exact pixels (T, c, m, 2) for poses (T, 4, 4) of the flange, NaN where a feature is hidden."""
        rotation, place = poses[:, None, :3, :3], poses[:, None, :3, 3]
        points = (rotation @ self.features[..., None])[..., 0] + place
        normals = (rotation @ self.normals[..., None])[..., 0]
        return np.stack([_seen_by(camera, points, normals) for camera in self.cameras], axis=1)


def make_observed_arm(
    arm: str, *, seed: int, cameras: int = 2, features: int = 12, feature_seed: int | None = None
) -> ObservedArm:
    """The arm of that name with cameras and features drawn from the seed.

    Args:
        arm: ``"ur5"`` or ``"baxter"``.
        seed: of cameras and features.
        cameras: c, at least 1, on an arc of 80 degrees before the arm.
        features: m, at least 4.
        feature_seed: of the features alone, to have others before the same cameras.

    Raises:
        DenseVSError: unknown arm, too few cameras or features.
    """
    chain = find_arm(arm)
    if cameras < 1 or features < 4:
        raise DenseVSError(f"got {cameras} cameras and {features} features; expected at least 1 and at least 4")
    rng = np.random.default_rng([seed, 21])
    home = chain.flange_pose(chain.home)
    centre = home[:3, 3] + _TOOL_CENTRE * home[:3, 2]
    placed = tuple(_placed_camera(rng, centre, azimuth) for azimuth in _arc(cameras) + rng.uniform(-0.1, 0.1, cameras))
    rng = np.random.default_rng([seed if feature_seed is None else feature_seed, 22])
    towards = home[:3, :3].T @ _unit(np.mean([_unit(camera.centre - centre) for camera in placed], axis=0))
    normals = []
    while len(normals) < features:
        normal = _unit(rng.normal(size=3))
        if normal @ towards > np.cos(np.deg2rad(60.0)):
            normals.append(normal)
    normals = np.array(normals)
    radius = _TOOL_RADIUS * rng.uniform(0.6, 1.2, (features, 1))  # a bumpy tool, no sphere
    return ObservedArm(chain, normals * radius + [0.0, 0.0, _TOOL_CENTRE], normals, placed)


def _seen_by(camera: PinholeCamera, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    rays = camera.centre - points
    facing = np.sum(rays * normals, axis=-1) > _FACING * np.linalg.norm(rays, axis=-1)
    pixels = camera.project(points)
    height, width = camera.size
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=-1)
    return np.where((facing & inside)[..., None], pixels, np.nan)


def _arc(count: int) -> np.ndarray:
    return np.linspace(-0.7, 0.7, count) if count > 1 else np.zeros(1)


def _placed_camera(rng: np.random.Generator, centre: np.ndarray, azimuth: float) -> PinholeCamera:
    elevation = rng.uniform(0.25, 0.6)
    ray = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    place = centre + _DISTANCE * rng.uniform(0.9, 1.1) * ray
    forward = _unit(centre + rng.normal(0.0, 0.05, 3) - place)
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    rotation = np.stack([right, np.cross(forward, right), forward])
    roll = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, 0.1)]).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = roll @ rotation
    pose[:3, 3] = -pose[:3, :3] @ place
    focal = FOCAL_PX * rng.uniform(0.95, 1.05) * rng.uniform(0.998, 1.002, 2)
    middle = np.array([(IMAGE_SIZE[1] - 1) / 2, (IMAGE_SIZE[0] - 1) / 2]) + rng.uniform(-6, 6, 2)
    return PinholeCamera(np.concatenate([focal, middle]), pose)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
