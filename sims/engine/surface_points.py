"""Points fixed to the scene's surfaces: where they are in the image, exactly, and whether the camera sees them.

All in float64 on the host from MuJoCo's poses and ray caster, for a few points at a time: the yardstick of
trackers and servo laws.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError

_RENDERED_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)  # those that MuJoCo-Warp renders
_SITE, _BODY, _GEOM = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_GEOM
_SEE_THROUGH = 1e-9  # m, to go on behind a surface that the renderer culls


@dataclass(frozen=True)
class SurfacePoint:
    """A point fixed to a geom, one in each world."""

    geoms: np.ndarray  # (worlds,) geom ids
    local: np.ndarray  # (worlds, 3) in the geom's frame [m]


def check_point(point: SurfacePoint, worlds: int, geoms: int) -> None:
    """Refuse a point of another world: MuJoCo does not look whether it has the geom.

    Raises:
        DenseVSError: no point of a world with so many copies and geoms.
    """
    if not isinstance(point, SurfacePoint):
        raise DenseVSError(f"point is a {type(point).__name__}; expected a SurfacePoint, as track_point gives it")
    ids, local = np.asarray(point.geoms), np.asarray(point.local)
    fits = ids.shape == (worlds,) and ids.dtype.kind in "iu" and local.shape == (worlds, 3) and local.dtype.kind == "f"
    if not fits or (ids < 0).any() or (ids >= geoms).any() or not np.isfinite(local).all():
        raise DenseVSError(
            f"point has geoms {ids.tolist()} and local of shape {local.shape}; expected ({worlds},) ids below {geoms} "
            f"and finite ({worlds}, 3), as track_point gives them"
        )


def camera_pose(state: mujoco.MjData, camera: int) -> np.ndarray:
    """T_world_camera (4, 4); camera axes x right, y down, z forward."""
    pose = np.eye(4)
    pose[:3, :3] = state.cam_xmat[camera].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
    pose[:3, 3] = state.cam_xpos[camera]
    return pose


def world_point(state: mujoco.MjData, geom: int, local: np.ndarray) -> np.ndarray:
    """World position (3,) of a point given in a geom's frame."""
    return state.geom_xpos[geom] + state.geom_xmat[geom].reshape(3, 3) @ local


def surface_point(
    model: mujoco.MjModel, state: mujoco.MjData, origin: np.ndarray, ray: np.ndarray
) -> tuple[int, np.ndarray]:
    """Geom that a ray (3,) from a point (3,) meets first, and where, in the geom's frame; geom -1 for none."""
    geom, distance = _first_hit(model, state, origin, ray)
    if geom < 0:
        return -1, np.zeros(3)
    hit = origin + distance * ray
    return geom, state.geom_xmat[geom].reshape(3, 3).T @ (hit - state.geom_xpos[geom])


def is_seen(model: mujoco.MjModel, state: mujoco.MjData, pose: np.ndarray, geom: int, point: np.ndarray) -> bool:
    """Whether nothing lies between the camera and a world point on the surface of a geom.

    A point on the far side of its own geom is not seen.
    """
    ray = point - pose[:3, 3]
    hit, distance = _first_hit(model, state, pose[:3, 3], ray)
    # A micrometer at a meter: the ray caster and the poses are float64.
    return hit == geom and abs(distance - 1.0) < 1e-6


def named_point(model: mujoco.MjModel, state: mujoco.MjData, name: str) -> np.ndarray:
    """World position (3,) of the site, else body, else geom of that name.

    Raises:
        DenseVSError: no such name, or no text (which MuJoCo does not survive); the message lists the sites.
    """
    kind, index = _named(model, name)
    return {_SITE: state.site_xpos, _BODY: state.xpos, _GEOM: state.geom_xpos}[kind][index]


def named_body(model: mujoco.MjModel, name: str) -> int:
    """Id of the body that the site, else body, else geom of that name is fixed to; errors as :func:`named_point`."""
    kind, index = _named(model, name)
    return index if kind == _BODY else int((model.site_bodyid if kind == _SITE else model.geom_bodyid)[index])


def moved_by(model: mujoco.MjModel, body: int) -> set[int]:
    """Ids of the joints that move a body: its own and those of the bodies that it hangs on."""
    joints: set[int] = set()
    while body:
        first = int(model.body_jntadr[body])
        joints |= set(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return joints


def _named(model: mujoco.MjModel, name: str) -> tuple[mujoco.mjtObj, int]:
    """Kind and id of the site, else body, else geom of that name."""
    if not isinstance(name, str) or not name.isprintable():
        raise DenseVSError(f"point is {name!r}; expected the name of a site, body or geom")
    for kind in (_SITE, _BODY, _GEOM):
        index = mujoco.mj_name2id(model, kind, name)
        if index >= 0:
            return kind, index
    sites = ", ".join(repr(model.site(i).name) for i in range(model.nsite)) or "none"
    bodies = ", ".join(repr(model.body(i).name) for i in range(1, model.nbody))
    raise DenseVSError(f"point {name!r} is not in the model; expected a site ({sites}), body ({bodies}) or geom")


def _first_hit(model: mujoco.MjModel, state: mujoco.MjData, origin: np.ndarray, ray: np.ndarray) -> tuple[int, float]:
    """First geom on a ray, and its distance in lengths of the ray, by the renderer's rule.

    The renderer does not draw a surface seen from its inside, so a camera inside a geom looks out of it.
    """
    geom = np.array([-1], dtype=np.int32)
    normal = np.zeros(3)
    traveled = 0.0
    length = float(np.linalg.norm(ray))
    for _ in range(2 * model.ngeom + 1):
        start = origin + traveled * ray
        distance = mujoco.mj_ray(model, state, start, ray, _RENDERED_GROUPS, True, -1, geom, normal)
        if distance < 0.0:
            return -1, np.inf
        traveled += distance
        if np.dot(normal, ray) <= 0.0:
            return int(geom[0]), traveled
        traveled += _SEE_THROUGH / length
    return -1, np.inf
