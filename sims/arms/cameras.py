"""Cameras that see a whole arm: each as near as lets the arm, in its home posture, keep off the image's border."""

import mujoco
import numpy as np

FOV = 45.0  # deg, vertical
# Azimuth from the robot's front and elevation [deg]. Constants were found on views of A and B; the others are from
# where one may stand as well, behind the robot too, whose trunk hides some of its arm there.
VIEWS = {
    "A": (55.0, 18.0),
    "B": (-75.0, 38.0),
    "C": (20.0, 10.0),
    "D": (-35.0, 25.0),
    "E": (110.0, 30.0),
    "F": (-120.0, 15.0),
    "G": (0.0, 60.0),
    "H": (80.0, 48.0),
}
SIZE = (320, 240)  # px, that the border is measured in
BORDER = 14  # px
DISTANCES = np.arange(2.0, 0.6, -0.02)  # m
_VERTEX_STEP = 7  # of a mesh, every so many vertices
_DRAWN_GROUPS = 3  # the renderer draws geoms of the groups below


def add_cameras(spec: mujoco.MjSpec, points: np.ndarray) -> None:
    """Add a camera for each of :data:`VIEWS`, in place, that sees the points ``(K, 3)`` [m]."""
    center = (points.max(axis=0) + points.min(axis=0)) / 2
    focal = 0.5 * SIZE[1] / np.tan(np.deg2rad(FOV) / 2)
    for name, view in VIEWS.items():
        azimuth, elevation = np.deg2rad(view)
        level = np.cos(elevation)
        back = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(back, right), back], axis=1)
        distance = DISTANCES[0]
        for nearer in DISTANCES:
            seen = (points - center - nearer * back) @ axes
            depth = -seen[:, 2]
            places = focal * np.abs(seen[:, :2]) / depth[:, None]
            if depth.min() < 0.2 or np.any(places.max(axis=0) > np.array(SIZE) / 2 - BORDER):
                break
            distance = nearer
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
        spec.worldbody.add_camera(name=name, pos=center + distance * back, quat=quaternion, fovy=FOV)


def surface_points(model: mujoco.MjModel, data: mujoco.MjData, root: int) -> np.ndarray:
    """Points (K, 3) [m] on what is drawn of a body and of all that it carries, in the poses of ``data``."""
    clouds = []
    for geom in range(model.ngeom):
        if model.geom_group[geom] >= _DRAWN_GROUPS or not _carried(model, int(model.geom_bodyid[geom]), root):
            continue
        local = np.zeros((1, 3))
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]][::_VERTEX_STEP]
        clouds.append(local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(clouds)


def _carried(model: mujoco.MjModel, body: int, root: int) -> bool:
    while body > 0 and body != root:
        body = int(model.body_parentid[body])
    return body == root
