"""Image targets that a simulated robot can reach: where a point of it is seen in random postures."""

import mujoco
import numpy as np

from dense_vs.checks import check_flag, check_number, check_seed, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.sims.engine import surface_points
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.sims.engine.world import SimWorld

ATTEMPTS = 2000
_CRITERIA = {
    "loop": "In {0} postures a loop of the chain cannot close",
    "outside": "in {0} the point is outside the image or less than {1:g} px from its border",
    "near": "in {0} it is less than {2:g} px from the target before",
    "hidden": "in {0} something covers it, or it is turned away",
}

_REMEDIES = {
    "loop": "expected joint ranges in which the chain closes",
    "outside": "expected a camera that sees more of where the point goes, or a smaller share of the joints' range",
    "near": "expected a point that the chosen joints move",
    "hidden": "expected a point on a side that stays in sight, or a smaller share of the joints' range",
}


def reachable_targets(
    world: SimWorld,
    point: SurfacePoint,
    count: int,
    seed: int,
    *,
    least_distance: float = 20.0,
    border: float = 20.0,
    share_of_range: float = 0.8,
    reach: float | None = None,
    depth: bool = False,
) -> np.ndarray:
    """Targets ``(count, 2)`` [px], ``(worlds, count, 2)`` for several worlds, each at least ``least_distance`` from
    the one before; with ``depth`` ``(count, 3)`` [px, px, m].

    A posture is drawn from the middle ``share_of_range`` of the joint ranges (from 0.5 rad about the present one
    where a joint has no limits), or from ``reach`` rad about the home posture where that is given; passive joints
    follow. It counts where the point is then seen, at least ``border`` px inside the image.

    Raises:
        DenseVSError: no such posture found in a world, or a number out of range.
    """
    depth = check_flag("depth", depth)
    count, seed = check_whole("count", count, least=1, most=ATTEMPTS), check_seed(seed)
    least_distance = check_number("least_distance", least_distance, least=0)
    border = check_number("border", border)
    share_of_range = check_number("share_of_range", share_of_range, above=0, most=1)
    reach = None if reach is None else check_number("reach", reach, above=0)
    worlds = world.shape[0]
    starts = np.asarray(world.project(point), dtype=np.float64).reshape(worlds, 2)
    found = []
    for number in range(worlds):
        # The first world's are those of a single one.
        index = world.first_world + number
        random = np.random.default_rng([seed, 7] if index == 0 else [seed, 7, index])
        found.append(
            _targets_of_world(
                world, point, number, count, random, starts[number], least_distance, border, share_of_range, reach
            )
        )
    found = [targets if depth else targets[:, :2] for targets in found]
    return found[0] if worlds == 1 else np.stack(found)


def _targets_of_world(
    world: SimWorld,
    point: SurfacePoint,
    number: int,
    count: int,
    random: np.random.Generator,
    previous: np.ndarray,
    least_distance: float,
    border: float,
    share_of_range: float,
    reach: float | None,
) -> np.ndarray:
    _, height, width = world.shape
    scene = world.scene
    present = world.physics.host_state(number)
    model = world.physics.models.host(number)
    data = mujoco.MjData(model)
    columns = model.jnt_qposadr[scene.joint_ids]
    low, high = scene.joint_limits.T
    q = present.qpos[columns]
    low, high = np.where(np.isfinite(low), low, q - 0.5), np.where(np.isfinite(high), high, q + 0.5)
    if reach is None:
        middle, half = (low + high) / 2, (high - low) / 2 * share_of_range
        low, high = middle - half, middle + half
    else:
        home = scene.home_qpos[columns]
        low, high = np.maximum(low, home - reach), np.minimum(high, home + reach)
    targets, refused = [], dict.fromkeys(_CRITERIA, 0)
    for _ in range(ATTEMPTS):
        if len(targets) == count:
            break
        posture = present.qpos.copy()
        posture[columns] = (low + high) / 2 + (high - low) / 2 * random.uniform(-1, 1, len(columns))
        data.qpos[:], closed = scene.chain.closed(model, posture)
        if not closed:
            refused["loop"] += 1
            continue
        data.mocap_pos[:] = present.mocap_pos
        data.mocap_quat[:] = present.mocap_quat
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        pose = world.viewpoint.pose(data, number)
        geom = int(point.geoms[number])
        position = surface_points.world_point(data, geom, point.local[number])
        pixel = world.viewpoint.project(position, pose)
        inside = np.all(pixel >= border) and np.all(pixel <= (width - 1 - border, height - 1 - border))
        near = np.hypot(*(pixel - previous)) < least_distance
        if not inside or near or not surface_points.is_seen(model, data, pose, geom, position):
            refused["outside" if not inside else "near" if near else "hidden"] += 1
            continue
        targets.append([*pixel, float(pose[:3, 2] @ (position - pose[:3, 3]))])
        previous = pixel
    if len(targets) < count:
        raise DenseVSError(
            f"found {len(targets)} targets in {ATTEMPTS} random postures in world {world.first_world + number}; "
            f"expected {count}. "
            + ", ".join(_CRITERIA[why].format(times, border, least_distance) for why, times in refused.items() if times)
            + f"; {_REMEDIES[max(refused, key=lambda why: refused[why])]}"
        )
    return np.array(targets).reshape(count, 3)
