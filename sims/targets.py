"""Image targets that a simulated robot can reach: where a point of it is seen in random postures."""

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims import surface_points
from dense_vs.sims.surface_points import SurfacePoint
from dense_vs.sims.world import SimWorld

ATTEMPTS = 2000


def reachable_targets(
    world: SimWorld,
    point: SurfacePoint,
    count: int,
    seed: int,
    *,
    least_distance: float = 20.0,
    border: float = 20.0,
    share_of_range: float = 0.8,
) -> np.ndarray:
    """Targets ``(count, 2)`` [px], each at least ``least_distance`` from the one before.

    A posture is drawn from the middle ``share_of_range`` of the joint ranges (from 0.5 rad about the present one
    where a joint has no limits); it counts where the point is then seen, at least ``border`` px inside the image.

    Raises:
        DenseVSError: several worlds, or no such posture found.
    """
    worlds, height, width = world.shape
    if worlds != 1:
        raise DenseVSError(f"the simulated world has {worlds} worlds; expected 1")
    random = np.random.default_rng([seed, 7])
    scene = world.scene
    model = scene.model
    data = mujoco.MjData(model)
    present = world.physics.host_state(0)
    columns = model.jnt_qposadr[scene.joints]
    low, high = scene.joint_limits.T
    q = present.qpos[columns]
    low, high = np.where(np.isfinite(low), low, q - 0.5), np.where(np.isfinite(high), high, q + 0.5)
    middle, half = (low + high) / 2, (high - low) / 2 * share_of_range
    previous = np.asarray(world.project(point), dtype=np.float64)
    targets = []
    for _ in range(ATTEMPTS):
        if len(targets) == count:
            break
        data.qpos[:] = present.qpos
        data.mocap_pos[:] = present.mocap_pos
        data.mocap_quat[:] = present.mocap_quat
        data.qpos[columns] = middle + half * random.uniform(-1, 1, len(columns))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        pose = surface_points.camera_pose(data, scene.camera)
        geom = int(point.geoms[0])
        position = surface_points.world_point(data, geom, point.local[0])
        pixel = surface_points.project(position, world.intrinsics, pose)
        inside = np.all(pixel >= border) and np.all(pixel <= (width - 1 - border, height - 1 - border))
        if not inside or np.hypot(*(pixel - previous)) < least_distance:
            continue
        if not surface_points.is_seen(model, data, pose, geom, position):
            continue
        targets.append(pixel)
        previous = pixel
    if len(targets) < count:
        raise DenseVSError(f"found {len(targets)} targets in {ATTEMPTS} random postures; expected {count}")
    return np.array(targets).reshape(count, 2)
