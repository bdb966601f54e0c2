"""The robots that a world can be asked for by name: a model of ``sims/models``, its home posture, where it looks."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from dense_vs.sims.surface_points import named_point


@dataclass(frozen=True)
class RobotModel:
    """A robot of ours: ``sims/models/<file>``.

    Attributes:
        file: MJCF.
        texel: side of a texel on its surfaces [m]; about a pixel at the robot's distance.
        posture_range: the seed moves each chosen joint at most this far from home [rad].
        home: home posture by joint [rad]; zero for the others.
        looks_at: site that the camera is turned to at home; None leaves the camera as it is in the file.
    """

    file: str
    texel: float
    posture_range: float
    home: Mapping[str, float] = field(default_factory=dict)
    looks_at: str | None = None


# Elbow out and bent: the arm comes into the image from below and crosses its middle.
_REACHING = {
    "left-shoulder-p": 0.95,
    "left-shoulder-r": 0.4,
    "left-shoulder-y": 0.5,
    "left-elbow-p": 1.15,
    "right-shoulder-r": 0.2,
}

ROBOTS = {
    "arm": RobotModel("arm.xml", texel=0.0038, posture_range=0.08),
    "planar": RobotModel("planar.xml", texel=0.0038, posture_range=0.08),
    "upper-body": RobotModel(
        "upper_body.xml", texel=0.002, posture_range=0.08, home=_REACHING, looks_at="left-forearm"
    ),
}


def home_posture(model: mujoco.MjModel, robot: RobotModel) -> np.ndarray:
    """Joint positions (nq,) of a robot's home posture."""
    qpos = model.qpos0.copy()
    for joint, angle in robot.home.items():
        qpos[model.joint(joint).qposadr[0]] = angle
    return qpos


def turn_camera(model: mujoco.MjModel, camera: int, qpos: np.ndarray, site: str) -> None:
    """Turn a camera of a model, in place, towards a site in a posture; its x axis stays level."""
    state = mujoco.MjData(model)
    state.qpos[:] = qpos
    mujoco.mj_kinematics(model, state)
    mujoco.mj_camlight(model, state)
    backward = state.cam_xpos[camera] - named_point(model, state, site)
    backward /= np.linalg.norm(backward)
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(backward, right), backward], axis=1)
    body = state.xmat[model.cam_bodyid[camera]].reshape(3, 3)
    mujoco.mju_mat2Quat(model.cam_quat[camera], np.ascontiguousarray(body.T @ rotation).ravel())
    model.cam_mat0[camera] = rotation.ravel()
