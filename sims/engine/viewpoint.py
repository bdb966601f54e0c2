"""Where points are seen and what pixels show, in float64 on the host: camera pose, its sway and its lens together."""

from typing import Any

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.engine import surface_points
from dense_vs.sims.engine.lens import Lens
from dense_vs.sims.engine.physics import Physics
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.sims.engine.swaying_camera import SwayingCamera


class Viewpoint:
    """The chosen camera of every world.

    Args:
        physics: poses and models.
        lens: of the camera.
        sway: how the camera moves by itself; it doesn't unless given.
    """

    def __init__(self, physics: Physics, lens: Lens, sway: SwayingCamera | None):
        self.lens = lens
        self._physics, self._sway, self._camera = physics, sway, physics.scene.camera

    def pose(self, state: mujoco.MjData, world: int) -> np.ndarray:
        """T_world_camera (4, 4) in the poses of ``state``, swayed as at the world's present time."""
        pose = surface_points.camera_pose(state, self._camera)
        if self._sway is not None:
            flip = np.array([1.0, -1.0, -1.0])  # between MuJoCo's camera axes and those of the image
            turn = self._sway.rotation(world, float(self._physics.data.time.numpy()[world]))
            pose[:3, :3] = pose[:3, :3] @ (flip[:, None] * turn * flip)
        return pose

    def project(self, point: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Pixel (2,) of a world point (3,); nan behind the camera and where its lens does not show it."""
        ray = pose[:3, :3].T @ (point - pose[:3, 3])
        return self.lens.pixels(ray[:2] / ray[2]) if ray[2] > 0.0 else np.full(2, np.nan)

    def located(self, point: str | SurfacePoint, world: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixel (2,) and world position (3,) of a surface point or of the site, body or geom of that name."""
        state, model = self._physics.host_state(world), self._physics.models.host(world)
        if isinstance(point, SurfacePoint):
            surface_points.check_point(point, self._physics.data.nworld, model.ngeom)
            position = surface_points.world_point(state, int(point.geoms[world]), point.local[world])
        else:
            position = surface_points.named_point(model, state, point)
        return self.project(position, self.pose(state, world)), position

    def shown(self, pixel: Any, world: int) -> tuple[int, np.ndarray]:
        """Geom, and point in its frame (3,), that a pixel (2,) shows; geom -1 where it shows none."""
        state, model = self._physics.host_state(world), self._physics.models.host(world)
        pose = self.pose(state, world)
        ray = pose[:3, :3] @ np.append(self.lens.directions(pixel), 1.0)
        return surface_points.surface_point(model, state, pose[:3, 3], ray)

    def track(self, pixels: np.ndarray, size: tuple[int, int]) -> SurfacePoint:
        """The surface point that the pixel (worlds, 2) of each world shows in an image of that height and width.

        Raises:
            DenseVSError: outside the image, or no surface there.
        """
        height, width = size
        told = pixels.tolist() if len(pixels) > 1 else pixels[0].tolist()
        if np.any(pixels < -0.5) or np.any(pixels > (width - 0.5, height - 0.5)):
            raise DenseVSError(f"pixel is {told}; expected inside the image of {width}x{height}")
        geoms, local = zip(*(self.shown(pixel, world) for world, pixel in enumerate(pixels)), strict=True)
        if min(geoms) < 0:
            raise DenseVSError(f"pixel {told} shows no surface; expected one that does")
        return SurfacePoint(np.array(geoms), np.array(local))

    def shows(self, name: str, world: int, size: tuple[int, int]) -> bool:
        """Whether the pixel of the site, body or geom of that name is inside the image and shows what moves with it."""
        height, width = size
        pixel, _ = self.located(name, world)
        if not (np.all(pixel > -0.5) and np.all(pixel < (width - 0.5, height - 0.5))):
            return False
        geom, _ = self.shown(pixel, world)
        model, chosen = self._physics.models.host(world), set(self._physics.scene.joint_ids.tolist())
        on, seen = surface_points.named_body(model, name), int(model.geom_bodyid[geom])
        same = surface_points.moved_by(model, on) & chosen == surface_points.moved_by(model, seen) & chosen
        return geom >= 0 and same

    def sees(self, point: SurfacePoint, world: int, size: tuple[int, int]) -> bool:
        """Whether a surface point is inside the image of that height and width and nothing covers it."""
        height, width = size
        pixel, position = self.located(point, world)
        state, model = self._physics.host_state(world), self._physics.models.host(world)
        inside = bool(np.all(pixel > -0.5) and np.all(pixel < (width - 0.5, height - 0.5)))
        pose = self.pose(state, world)
        return inside and surface_points.is_seen(model, state, pose, int(point.geoms[world]), position)
