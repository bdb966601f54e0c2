"""Where objects stand before the robot at the start of a servo run."""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.world import HEIGHT, WIDTH, MobileWorld
from dense_vs.sims.papers.vosvs.configurations import Configuration
from dense_vs.sims.papers.vosvs.true_jacobian import true_centroid

MARGIN = 12  # px, at least, between a whole object and the image border
# m from a camera to an object: the hand's images of objects reach no farther, nor does the arm's lift centre on more.
FARTHEST = {"head": 2.2, "grasp": 1.2}
CLEARANCE = 0.15  # m, more than from the middle of a part to its surface
ROOM = (-3.0, 2.5)  # clear floor, away from bins [m]


def start_posture(one: Configuration) -> np.ndarray:
    """Joint positions (10,) at the configuration's start."""
    return posture(one.posture, forward=ROOM[0], lateral=ROOM[1])


def put_in_view(
    world: MobileWorld,
    one: Configuration,
    name: str,
    rng: np.random.Generator,
    *,
    least: float = 70.0,
    border: float = 90.0,
    tries: int = 200,
) -> np.ndarray:
    """Put an object on the floor where the configuration's start shows it whole, near enough, and off its target.

    Args:
        least: smallest offset from the target along both image axes [px].
        border: about the smallest distance of the centroid from the image border [px].
        tries: places drawn before giving up.

    Returns:
        The centroid ``(2,)`` [px] by the renderer.

    Raises:
        DenseVSError: no such place found.
    """
    target, middle = np.array(one.target), np.array([WIDTH, HEIGHT]) / 2
    for _ in range(tries):
        pixel = middle + (middle - border) * rng.uniform(-1, 1, 2)
        if np.any(np.abs(pixel - target) < least):
            continue
        ground = floor_point(world, one.camera, pixel, 0.5 * world.objects[name].height)
        eye = world.camera_pose(one.camera)[:3, 3]
        if ground is None or np.linalg.norm(ground - eye) > FARTHEST[one.camera]:
            continue
        x, y, _ = ground
        if world.objects[name].links:
            world.lay_chain(name, (x, y, 0.0), rng)
        else:
            world.place(name, (x, y, 0.0), rng.uniform(-np.pi, np.pi))
        place = true_centroid(world, one.camera, name)
        inside = np.all(np.abs(place - middle) < middle - 0.7 * border)
        mask = world.true_mask(one.camera, name)
        mask[MARGIN:-MARGIN, MARGIN:-MARGIN] = False
        cut = mask.any()
        if (
            inside
            and not cut
            and not _hidden(world, one.camera, name)
            and np.all(np.abs(place - target) >= 0.7 * least)
        ):
            return place
    raise DenseVSError(f"found no place for {name!r} in {tries} tries; expected one in view of {one.name!r}")


def _hidden(world: MobileWorld, camera: str, name: str) -> bool:
    """Whether the robot stands before any part of the object."""
    pose, depth = world.camera_pose(camera), world.depth(camera)
    seen = (world.state.geom_xpos[world.geoms(name)] - pose[:3, 3]) @ pose[:3, :3]
    pixels = seen @ world.intrinsics(camera).T
    columns, rows = np.rint(pixels[:, :2] / pixels[:, 2:]).astype(int).T
    inside = (columns >= 0) & (columns < WIDTH) & (rows >= 0) & (rows < HEIGHT)
    nearest = depth[rows[inside], columns[inside]]
    return not inside.all() or bool(np.any(nearest < seen[inside, 2] - CLEARANCE))


def floor_point(world: MobileWorld, camera: str, pixel: np.ndarray, height: float = 0.0) -> np.ndarray | None:
    """Point (3,) at a height [m] over the floor that a camera shows at a pixel; None where it looks above it."""
    pose = world.camera_pose(camera)
    ray = pose[:3, :3] @ np.linalg.solve(world.intrinsics(camera), np.append(pixel, 1.0))
    if ray[2] > -1e-3:
        return None
    return pose[:3, 3] + ray * (height - pose[2, 3]) / ray[2]
