"""The robots that a world can be asked for by name: a model of ``sims/models``, its home posture, where it looks."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from dense_vs.sims.engine.surface_points import named_point


@dataclass(frozen=True)
class Tool:
    """A tool in the hands; it counts as part of the robot.

    Attributes:
        bodies: its bodies in the model.
        constraint: the equality constraint that closes the loop.
        relaxed: joints that give way to it: their actuators are left out.
    """

    bodies: tuple[str, ...]
    constraint: str
    relaxed: tuple[str, ...] = ()


# The wrist of the hand that the rake is fixed to gives way, so that the other hand can steer the shaft; the vacuum
# cleaner turns in its grip, and its end stands on a head that rolls along y.
TOOLS = {
    "rake": Tool(("rake",), "rake", ("right-wrist-p", "right-wrist-r")),
    "vacuum": Tool(("vacuum", "vacuum-head"), "vacuum"),
}


@dataclass(frozen=True)
class RobotModel:
    """A robot of ours: ``sims/models/<file>``.

    Attributes:
        file: MJCF.
        texel: side of a texel on its surfaces [m]; about a pixel at the robot's distance.
        posture_range: the seed moves each chosen joint at most this far from home [rad].
        home: home posture by joint [rad]; zero for the others.
        looks_at: site that the camera is turned to at home; None leaves the camera as it is in the file.
        tool: of :data:`TOOLS`, what it holds; None for empty hands.
        plain: wears the materials of its file and casts shadows, in place of noise on every surface; ``texel`` is of no
            use then.
    """

    file: str
    texel: float
    posture_range: float
    home: Mapping[str, float] = field(default_factory=dict)
    looks_at: str | None = None
    tool: str | None = None
    plain: bool = False


# Elbow out and bent: the arm comes into the image from below and crosses its middle.
_REACHING = {
    "left-shoulder-p": 0.95,
    "left-shoulder-r": 0.4,
    "left-shoulder-y": 0.5,
    "left-elbow-p": 1.15,
    "right-shoulder-r": 0.2,
}

# Elbows bent, so that the three joints of the rake's experiment move its tip in two dimensions.
_RAKING = {
    "left-shoulder-p": 0.39,
    "left-shoulder-r": 0.32,
    "left-shoulder-y": 0.72,
    "left-elbow-p": 0.86,
    "right-shoulder-p": 0.04,
    "right-shoulder-r": 0.23,
    "right-shoulder-y": 1.13,
    "right-elbow-p": 1.81,
    "right-wrist-p": -0.07,
    "right-wrist-r": 0.31,
    "rake-slide": 0.316,
}
# The arm low, so that it pushes along the line on which the head rolls.
_VACUUMING = {
    "left-shoulder-p": -0.35,
    "left-shoulder-r": 0.07,
    "left-elbow-p": 0.75,
    "right-shoulder-r": 0.2,
    "vacuum-pitch": -1.0,
    "vacuum-roll": -0.1,
}
ROBOTS = {
    "arm": RobotModel("arm.xml", texel=0.0038, posture_range=0.08),
    "painted": RobotModel("painted.xml", texel=0.0038, posture_range=0.08, plain=True),
    "planar": RobotModel("planar.xml", texel=0.0038, posture_range=0.08),
    "upper-body": RobotModel(
        "upper_body.xml", texel=0.002, posture_range=0.08, home=_REACHING, looks_at="left-forearm"
    ),
    "upper-body-rake": RobotModel(
        "upper_body.xml", texel=0.0025, posture_range=0.08, home=_RAKING, looks_at="rake-tip", tool="rake"
    ),
    "upper-body-vacuum": RobotModel(
        "upper_body.xml", texel=0.003, posture_range=0.08, home=_VACUUMING, looks_at="vacuum-head", tool="vacuum"
    ),
}


def hold_tool(spec: mujoco.MjSpec, tool: str | None) -> None:
    """Leave out of a specification, in place, the tools that the hands do not hold, and close the loop of the held one.

    A specification without tools stays as it is.
    """
    for name, parts in TOOLS.items():
        if spec.body(parts.bodies[0]) is None:
            continue
        if name != tool:
            spec.delete(spec.equality(parts.constraint))
            for body in parts.bodies:
                spec.delete(spec.body(body))
            continue
        for joint in parts.relaxed:
            spec.delete(spec.actuator(joint))
        # Only what ties the tool: limits bound the commands, and nothing touches.
        kept = mujoco.mjtDisableBit
        spec.option.disableflags &= ~int(kept.mjDSBL_CONSTRAINT)
        spec.option.disableflags |= int(kept.mjDSBL_LIMIT) | int(kept.mjDSBL_FRICTIONLOSS) | int(kept.mjDSBL_CONTACT)


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
