"""Scenes in which a robot is hidden: a plate drawn before what the camera sees, and a camera that sees a part only."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine import surface_points
from dense_vs.sims.engine.faults import FaultInjector
from dense_vs.sims.engine.frames import Frame
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.surface_points import SurfacePoint

WIDTH, HEIGHT = 320, 240  # px, of the images
MAGNIFIED = 1.5  # by the camera that sees a part only
SECONDS = 3.0  # that the plate is in front when it passes
COMING = 0.5  # s of these to come, and to go
PASSING, STANDING = 84, 64  # px, sides of the plates
CIRCLE = 12.0  # px, radius of the passing plate's way
CLEAR = 25.0  # px that the standing plate keeps from the ends of the way
BORDER = 15.0  # px inside the image that ends of the way keep; at least so far outside where it leads out
FAR = 60.0  # px outside of the image at most
ATTEMPTS = 4000


class NarrowWorld(SimWorld):
    """A simulated arm whose camera sees the middle of what it did, magnified, so that the arm's tip leaves the image.

    Pixels, here and in truth, are those of the part that is seen.
    """

    def __init__(self, robot: str, **options: Any):
        super().__init__(robot, height=round(MAGNIFIED * HEIGHT), width=round(MAGNIFIED * WIDTH), **options)
        _, height, width = self.shape
        self.offset = np.array([(width - WIDTH) / 2, (height - HEIGHT) / 2])
        left, top = self.offset.astype(int)
        self._part = slice(top, top + HEIGHT), slice(left, left + WIDTH)

    def frame(self) -> Frame:
        """The present image."""
        whole = super().frame()
        return replace(
            whole, rgb=whole.rgb[self._part].copy(), depth=whole.depth[self._part], ids=whole.ids[self._part]
        )

    def true_jacobian(self) -> np.ndarray:
        """J (H, W, 2, N) of the image."""
        return super().true_jacobian()[self._part]

    def robot_mask(self) -> np.ndarray:
        """The robot's pixels (H, W)."""
        return super().robot_mask()[self._part]

    def project(self, point: str | SurfacePoint) -> np.ndarray:
        """Pixel (2,), which may lie outside of the image."""
        return super().project(point) - self.offset

    def track_point(self, pixel: Any) -> SurfacePoint:
        """The surface point at a pixel (2,)."""
        return super().track_point(np.asarray(pixel) + self.offset)


class Covering(FaultInjector):
    """Camera and robot of a simulated world before which a textured plate passes or stands.

    Attributes:
        plate: bool ``(H, W)``, its pixels in the last image.
    """

    def __init__(self, world: SimWorld, *, seed: int = 0):
        super().__init__(world, seed=seed)
        coarse = np.random.default_rng([seed, 23]).integers(20, 236, (14, 14, 3), dtype=np.uint8)
        self._texture = np.kron(coarse, np.ones((6, 6, 1), np.uint8))
        self.plate = np.zeros((HEIGHT, WIDTH), bool)
        self._passes: tuple[np.ndarray, float] | None = None
        self._stands: np.ndarray | None = None

    def pass_by(self, place: np.ndarray) -> None:
        """Let the plate come, circle about a place ``(2,)`` [px] and go, from now on."""
        self._passes, self._stands = (np.asarray(place, float), self.world.time), None

    def stand(self, place: np.ndarray | None) -> None:
        """Let the plate stand at a place ``(2,)`` [px] from now on, or nowhere."""
        self._passes, self._stands = None, None if place is None else np.asarray(place, float)

    def read(self) -> tuple[np.ndarray, float]:
        """Image (H, W, 3) uint8 RGB with the plate in it and its time [s]."""
        image, time = super().read()
        self.plate = np.zeros(image.shape[:2], bool)
        if self._stands is not None:
            return self._with_plate(image, self._stands, STANDING), time
        if self._passes is not None and (at := self._on_the_way(time)) is not None:
            return self._with_plate(image, at, PASSING), time
        return image, time

    def _on_the_way(self, time: float) -> np.ndarray | None:
        """The plate's middle [px]; None where it has gone."""
        assert self._passes is not None
        place, begun = self._passes
        since = time - begun
        if since > SECONDS - 0.5 * FRAME_SECONDS:
            return None
        turn = 2 * np.pi * since / 1.5
        outside = WIDTH + PASSING / 2 - place[0]
        away = max(COMING - since, since - (SECONDS - COMING), 0.0) / COMING
        return place + CIRCLE * np.array([np.cos(turn), np.sin(turn)]) + np.array([outside * away, 0.0])

    def _with_plate(self, image: np.ndarray, middle: np.ndarray, side: int) -> np.ndarray:
        x, y = np.rint(middle - side / 2).astype(int)
        rows, columns = slice(max(0, y), min(HEIGHT, y + side)), slice(max(0, x), min(WIDTH, x + side))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return image
        self.plate[rows, columns] = True
        shown = image.copy()
        shown[rows, columns] = self._texture[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]
        return shown


def places_out_of_sight(
    world: SimWorld, point: SurfacePoint, start: np.ndarray, where: str, seed: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """A place ``(2,)`` [px] where a point is to be hidden, and one where it is seen, in postures that the arm can take.

    Args:
        world, point: whose point.
        start: ``(2,)`` where it is now [px], which no plate may cover.
        where: ``"behind"`` a plate in the middle of the first place, or ``"outside"`` of the image.
        seed: of the postures.

    Raises:
        DenseVSError: none was found.
    """
    random = np.random.default_rng([*seed, 29])
    size = np.array([WIDTH, HEIGHT])
    away: np.ndarray | None = None
    for _ in range(ATTEMPTS):
        pixel, turned_here = _drawn(world, point, random)
        shown = turned_here and bool((pixel >= BORDER).all() and (pixel <= size - 1 - BORDER).all())
        outside = float(np.max(np.concatenate([-pixel, pixel - (size - 1)])))
        if away is None:
            covers = shown and np.abs(pixel - start).max() > STANDING / 2 + CLEAR
            if covers if where == "behind" else BORDER <= outside <= FAR:
                away = pixel
        elif shown and (where == "outside" or np.abs(pixel - away).max() > STANDING / 2 + CLEAR):
            return away, pixel
    raise DenseVSError(f"no way {where} and back was found in {ATTEMPTS} random postures")


def _drawn(world: SimWorld, point: SurfacePoint, random: np.random.Generator) -> tuple[np.ndarray, bool]:
    """Where a point is in a posture from the middle 90 % of the joints' ranges, and whether it faces the camera."""
    model, scene = world.physics.models.host(0), world.scene
    data = mujoco.MjData(model)
    data.qpos[:] = world.physics.host_state(0).qpos
    low, high = scene.joint_limits.T
    share = 0.45 * random.uniform(-1, 1, len(low))
    data.qpos[model.jnt_qposadr[scene.joint_ids]] = (low + high) / 2 + share * (high - low)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    pose, geom = world.viewpoint.pose(data, 0), int(point.geoms[0])
    position = surface_points.world_point(data, geom, point.local[0])
    offset = world.offset if isinstance(world, NarrowWorld) else 0.0
    seen = surface_points.is_seen(model, data, pose, geom, position)
    return world.viewpoint.project(position, pose) - offset, seen
