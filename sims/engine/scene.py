"""The scene of a world, resolved once: MuJoCo model, camera, chosen joints and the actuators that move them.

A robot is a name of ours (``sims/engine/robots.py``, textured from the seed) or the path of an MJCF file, taken as it
is. Everything that the user names is looked up here, and every wrong name is answered with the valid ones.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import file_path
from dense_vs.robot.joint_group import joint_indices
from dense_vs.sims.engine.built_scenes import ARM_NAMES, scene_file
from dense_vs.sims.engine.closed_chain import ClosedChain
from dense_vs.sims.engine.compliance import Compliance, soften
from dense_vs.sims.engine.distractor import DISTRACTORS
from dense_vs.sims.engine.materials import dress
from dense_vs.sims.engine.model_advice import draw_groups, other_drives
from dense_vs.sims.engine.robots import ROBOTS, TOOLS, RobotModel, hold_tool, home_posture, turn_camera
from dense_vs.sims.engine.textures import paint_geoms

FRAME_SECONDS = 1.0 / 30.0

_UNITS = {mujoco.mjtJoint.mjJNT_HINGE: "rad", mujoco.mjtJoint.mjJNT_SLIDE: "m"}  # joints of one coordinate
_FOLLOWS_CONTROL = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)


@dataclass(frozen=True)
class Scene:
    """A compiled model and what was chosen in it. N chosen joints, P passive ones that follow them, G geoms."""

    model: mujoco.MjModel
    camera: int
    joint_ids: np.ndarray  # (N,) of the chosen joints
    joint_names: tuple[str, ...]
    joint_limits: np.ndarray  # (N, 2) float64, rad or m: commanded positions stay inside
    joint_units: tuple[str, ...]  # "rad" of a hinge, "m" of a slide
    actuators: np.ndarray  # (N,) actuator ids
    ctrl_per_position: np.ndarray  # (N,) actuator control that holds the joint at position 1
    home_qpos: np.ndarray  # (nq,)
    home_ctrl: np.ndarray  # (nu,)
    posture_range: float  # rad, 0 for an MJCF file
    substeps: int  # physics steps a frame
    chain: ClosedChain  # the passive joints
    moved: np.ndarray  # (G, N + P) bool: the joint moves the geom
    camera_moved: np.ndarray  # (N + P,) bool: the joint moves the camera
    distractor: int  # mocap id, -1 when there is none
    samples: int  # rays for a pixel's color along either side of it, unless told otherwise
    shadows: bool  # whether lights cast them, as a model of ours may ask for


def load_scene(
    robot: str | os.PathLike[str],
    joints: Sequence[str] | None,
    camera: str | None,
    seed: int,
    distractor: str,
    texture_sets: int = 1,
    compliance: Compliance | None = None,
    geom_groups: Sequence[int] | None = None,
) -> Scene:
    """Compile a robot's model and resolve the names in it.

    Raises:
        DenseVSError: unknown robot, joint or camera; a file that is missing or does not compile; a joint that
            cannot be commanded by position.
    """
    ours = ROBOTS.get(robot) if isinstance(robot, str) else None
    if ours:
        if geom_groups is not None:
            raise DenseVSError(f"geom_groups is {geom_groups!r}; expected None with a robot of ours")
        model = _our_model(ours, seed, distractor, texture_sets, compliance)
    else:
        path = scene_file(robot) if isinstance(robot, str) and robot in ARM_NAMES else robot
        model = _file_model(path, distractor, compliance)
        if geom_groups is not None:
            draw_groups(model, geom_groups)
    mocap = -1
    if distractor != "none":
        mocap = int(model.body_mocapid[model.body(DISTRACTORS[distractor].body).id])
    return resolve_scene(model, joints, camera, robot=ours, distractor=mocap)


def resolve_scene(
    model: mujoco.MjModel,
    joints: Sequence[str] | None,
    camera: str | None,
    *,
    robot: RobotModel | None = None,
    distractor: int = -1,
) -> Scene:
    """Resolve joints and camera of a compiled model, and bring its time step to whole parts of a frame.

    Raises:
        DenseVSError: unknown joint or camera; a joint that cannot be commanded by position.
    """
    # Frames are exactly FRAME_SECONDS apart; a step is never longer than the model's author chose.
    substeps = max(1, int(np.ceil(FRAME_SECONDS / model.opt.timestep - 1e-6)))
    model.opt.timestep = FRAME_SECONDS / substeps

    camera_id = _find_camera(model, camera)
    actuated = _position_actuators(model)
    joint_ids = _find_joints(model, joints, actuated)
    actuator_ids = np.array([actuated[j] for j in joint_ids])
    scale = np.array([_ctrl_per_position(model, a) for a in actuator_ids])
    limits = np.array([_limits(model, j, a, s) for j, a, s in zip(joint_ids, actuator_ids, scale, strict=True)])
    home_qpos, home_ctrl = _home(model, actuated, robot)
    if robot and robot.looks_at:
        turn_camera(model, camera_id, home_qpos, robot.looks_at)
    chain = ClosedChain(model, np.array(joint_ids), home_qpos)
    home_qpos = chain.closed(model, home_qpos)[0]
    moved_bodies = _moved_bodies(model, [*joint_ids, *chain.passive])
    return Scene(
        model=model,
        camera=camera_id,
        joint_ids=np.array(joint_ids),
        joint_names=tuple(_name(model, "joint", j) for j in joint_ids),
        joint_limits=limits,
        joint_units=tuple(_UNITS[mujoco.mjtJoint(model.jnt_type[j])] for j in joint_ids),
        actuators=actuator_ids,
        ctrl_per_position=scale,
        home_qpos=home_qpos,
        home_ctrl=home_ctrl,
        posture_range=robot.posture_range if robot else 0.0,
        substeps=substeps,
        chain=chain,
        moved=moved_bodies[model.geom_bodyid],
        camera_moved=moved_bodies[model.cam_bodyid[camera_id]],
        distractor=distractor,
        samples=2 if model.nmesh or (robot and robot.plain) else 1,
        shadows=bool(robot and robot.plain),
    )


def _our_model(
    robot: RobotModel, seed: int, distractor: str, texture_sets: int, compliance: Compliance | None
) -> mujoco.MjModel:
    text = resources.files("dense_vs.sims").joinpath("models", robot.file).read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text)
    kinds = {name: kind.body for name, kind in DISTRACTORS.items() if spec.body(kind.body) is not None}
    if distractor != "none" and distractor not in kinds:
        raise DenseVSError(f"distractor is {distractor!r}; expected one of {_listed(['none', *kinds])}")
    rng = np.random.default_rng([seed, 0])
    if robot.plain:
        dress(spec, rng, texture_sets)
    else:
        paint_geoms(spec, rng, robot.texel, texture_sets)
    hold_tool(spec, robot.tool)
    if compliance is not None:
        soften(spec, compliance, TOOLS[robot.tool].bodies if robot.tool else ())
    for body in sorted(set(kinds.values()) - {kinds.get(distractor)}):
        spec.delete(spec.body(body))
    if distractor != "none":
        for geom in DISTRACTORS[distractor].without:
            spec.delete(spec.geom(geom))
    return spec.compile()


def _file_model(robot: str | os.PathLike[str], distractor: str, compliance: Compliance | None) -> mujoco.MjModel:
    path = file_path(robot)
    if not path.is_file():
        raise DenseVSError(
            f"robot {str(robot)!r} is neither a robot of ours nor a file; "
            f"expected one of {_listed([*ROBOTS, *ARM_NAMES])} or the path of an MJCF file"
        )
    if distractor != "none":
        raise DenseVSError(f"distractor is {distractor!r}; expected 'none' with an MJCF file")
    if compliance is not None:
        raise DenseVSError(f"compliance is {compliance!r}; expected False with an MJCF file, which says it itself")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise DenseVSError(f"{path} does not compile as MJCF: {reason}") from error


def _find_camera(model: mujoco.MjModel, camera: str | None) -> int:
    names = [_name(model, "camera", c) for c in range(model.ncam)]
    if not names:
        raise DenseVSError("the model has no camera; expected at least one <camera>")
    if camera is not None and not (isinstance(camera, str) and camera in names):
        raise DenseVSError(f"camera {camera!r} is not in the model; expected one of {_listed(names)}")
    index = 0 if camera is None else names.index(camera)
    if mujoco.mjtCamLight(model.cam_mode[index]) != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        raise DenseVSError(f"camera {names[index]!r} turns by itself; expected one with mode='fixed'")
    if mujoco.mjtProjection(model.cam_projection[index]) != mujoco.mjtProjection.mjPROJ_PERSPECTIVE:
        raise DenseVSError(f"camera {names[index]!r} is orthographic; expected a perspective camera")
    return index


def _position_actuators(model: mujoco.MjModel) -> dict[int, int]:
    """Joint id -> its actuator, of the joints that a position actuator drives."""
    actuators: dict[int, int] = {}
    for a in range(model.nu):
        joint = int(model.actuator_trnid[a, 0])
        is_position = (
            mujoco.mjtTrn(model.actuator_trntype[a]) == mujoco.mjtTrn.mjTRN_JOINT
            and mujoco.mjtJoint(model.jnt_type[joint]) in _UNITS
            and mujoco.mjtGain(model.actuator_gaintype[a]) == mujoco.mjtGain.mjGAIN_FIXED
            and mujoco.mjtBias(model.actuator_biastype[a]) == mujoco.mjtBias.mjBIAS_AFFINE
            and mujoco.mjtDyn(model.actuator_dyntype[a]) in _FOLLOWS_CONTROL
            and model.actuator_gainprm[a, 0] > 0
            and model.actuator_biasprm[a, 1] < 0
        )
        if is_position:
            actuators.setdefault(joint, a)
    return actuators


def _find_joints(model: mujoco.MjModel, joints: Sequence[str] | None, actuated: dict[int, int]) -> list[int]:
    valid = [_name(model, "joint", j) for j in sorted(actuated)]
    if not valid:
        raise DenseVSError(
            f"no joint of the model has a position actuator{other_drives(model)}; expected at least one "
            "<position joint=...>"
        )
    if joints is None:
        return sorted(actuated)
    names = [_name(model, "joint", j) for j in range(model.njnt)]
    found = joint_indices(joints, names, "the model", valid=valid)
    for joint, index in zip(joints, found, strict=True):
        kind = mujoco.mjtJoint(model.jnt_type[index])
        if kind not in _UNITS:
            kind = kind.name.removeprefix("mjJNT_").lower()
            raise DenseVSError(f"joint {joint!r} is of type {kind}; expected a hinge or slide: {_listed(valid)}")
        if index not in actuated:
            drive = other_drives(model, index)
            raise DenseVSError(f"joint {joint!r} has no position actuator{drive}; expected one of {_listed(valid)}")
    return found


def _ctrl_per_position(model: mujoco.MjModel, actuator: int) -> float:
    """Control at which gain * ctrl + bias * gear * position = 0, for position 1."""
    gear = model.actuator_gear[actuator, 0]
    return float(-model.actuator_biasprm[actuator, 1] / model.actuator_gainprm[actuator, 0] * gear)


def _limits(model: mujoco.MjModel, joint: int, actuator: int, scale: float) -> tuple[float, float]:
    low, high = -np.inf, np.inf
    if model.jnt_limited[joint]:
        low, high = model.jnt_range[joint]
    if model.actuator_ctrllimited[actuator]:
        ends = sorted(model.actuator_ctrlrange[actuator] / scale)
        low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)


def _home(model: mujoco.MjModel, actuated: dict[int, int], ours: RobotModel | None) -> tuple[np.ndarray, np.ndarray]:
    """A robot's own home posture, or the first keyframe of a file if there is one, else the model's zero posture;
    position actuators hold it.
    """
    if ours:
        qpos, ctrl = home_posture(model, ours), np.zeros(model.nu)
    elif model.nkey:
        qpos, ctrl = model.key_qpos[0].copy(), model.key_ctrl[0].copy()
    else:
        qpos, ctrl = model.qpos0.copy(), np.zeros(model.nu)
    for joint, actuator in actuated.items():
        ctrl[actuator] = _ctrl_per_position(model, actuator) * qpos[model.jnt_qposadr[joint]]
    return qpos, ctrl


def _moved_bodies(model: mujoco.MjModel, joints: Iterable[int]) -> np.ndarray:
    """(bodies, joints) bool: the joint's body is the body or an ancestor of it."""
    owners = model.jnt_bodyid[list(joints)]
    moved = np.zeros((model.nbody, len(owners)), dtype=bool)
    for body in range(model.nbody):  # parents come first
        moved[body] = moved[model.body_parentid[body]] | (owners == body)
    return moved


def _name(model: mujoco.MjModel, kind: str, index: int) -> str:
    """An element's name, or kind and number for one that has none."""
    return getattr(model, kind)(index).name or f"{kind}{index}"


def _listed(names: Iterable[Any]) -> str:
    return ", ".join(repr(name) for name in names)
