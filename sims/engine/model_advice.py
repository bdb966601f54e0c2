"""What users of an MJCF file of their own stumble over, in words: drives, drawn geoms, joints that do not hold."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError

if TYPE_CHECKING:
    from dense_vs.sims.engine.scene import Scene

DRAWN_GROUPS = 3  # the renderer and the ray caster draw geoms of the groups below
HIDDEN_GROUP = 5
HELD_SECONDS = 1.0
STEP = 0.1  # rad or m, that a joint is told to go
LEAST_ROOM = 1e-4  # rad or m
FOLLOWED = 0.5  # share of it that the joint has to have gone by then
SAG = 0.05  # rad or m, that a joint moves by while its target stands still


def other_drives(model: mujoco.MjModel, joint: int | None = None) -> str:
    """What drives a joint, or any joint, in place of a position actuator; empty where nothing does."""
    found = []
    for actuator in range(model.nu):
        by_joint = mujoco.mjtTrn(model.actuator_trntype[actuator]) == mujoco.mjtTrn.mjTRN_JOINT
        driven = int(model.actuator_trnid[actuator, 0])
        if (joint is None or driven == joint) and by_joint:
            name = model.actuator(actuator).name or f"actuator{actuator}"
            found.append(f"{name!r} drives {model.joint(driven).name!r} by {_kind(model, actuator)}")
    return f" ({', '.join(found)})" if found else ""


def _kind(model: mujoco.MjModel, actuator: int) -> str:
    if mujoco.mjtBias(model.actuator_biastype[actuator]) == mujoco.mjtBias.mjBIAS_NONE:
        return "force"
    return "velocity" if model.actuator_biasprm[actuator, 1] == 0 else "a law of its own"


def draw_groups(model: mujoco.MjModel, groups: Sequence[int]) -> None:
    """Draw the geoms of these groups of a model, in place, and no others.

    Raises:
        DenseVSError: no geom is in any of them.
    """
    chosen = np.isin(model.geom_group, list(groups))
    if not chosen.any():
        there = ", ".join(str(group) for group in np.unique(model.geom_group))
        raise DenseVSError(
            f"geom_groups is {list(groups)!r}; expected some of {there}, the groups of the model's geoms"
        )
    model.geom_group[:] = np.where(chosen, np.minimum(model.geom_group, DRAWN_GROUPS - 1), HIDDEN_GROUP)


def advice(scene: "Scene") -> list[str]:
    """A sentence for everything about an MJCF scene that would spoil its images or its motion unnoticed."""
    return [*_sagging(scene), *_not_following(scene), *_drawn_collision(scene.model)]


def _sagging(scene: "Scene") -> list[str]:
    """Joints that leave their place while their target stands still."""
    moved = _motion(scene)
    farthest = np.take_along_axis(moved, np.abs(moved).argmax(axis=0)[None], axis=0)[0]
    return [
        f"joint {name!r} moves by {change:+.2f} within {HELD_SECONDS:g} s while its target stands still; "
        "expected a stiffer position actuator (kp), gravcomp on its bodies, or a posture without contact"
        for name, change in zip(scene.joint_names, farthest, strict=True)
        if not abs(change) <= SAG
    ]


def _not_following(scene: "Scene") -> list[str]:
    """Joints that do not go where they are told."""
    held, said = _motion(scene), []
    for number, name in enumerate(scene.joint_names):
        if not np.abs(held[:, number]).max() <= SAG:
            continue  # said already
        home = scene.home_qpos[scene.model.jnt_qposadr[scene.joint_ids[number]]]
        room = scene.joint_limits[number] - home  # below and above
        step = float(np.clip(STEP, 0.0, room[1])) if room[1] >= -room[0] else float(np.clip(-STEP, room[0], 0.0))
        if abs(step) < LEAST_ROOM:
            said.append(f"joint {name!r} has no room to move at the home posture; expected a wider range")
            continue
        gone = _motion(scene, number, step)[-1, number] - held[-1, number]
        if not FOLLOWED <= gone / step <= 2.0:
            said.append(
                f"joint {name!r}, told to go {step:+.2f}, has gone {gone:+.2f} after {HELD_SECONDS:g} s; expected a "
                "position actuator with a higher kp or forcerange, or less damping and friction"
            )
    return said


def _motion(scene: "Scene", joint: int | None = None, step: float = 0.0) -> np.ndarray:
    """How far the chosen joints are from home (steps, N) while all targets stand still but that of ``joint``."""
    model, state = scene.model, mujoco.MjData(scene.model)
    state.qpos[:], state.ctrl[:] = scene.home_qpos, scene.home_ctrl
    if joint is not None:
        state.ctrl[scene.actuators[joint]] += scene.ctrl_per_position[joint] * step
    places = model.jnt_qposadr[scene.joint_ids]
    moved = np.zeros((max(1, round(HELD_SECONDS / model.opt.timestep)), len(places)))
    for row in moved:
        mujoco.mj_step(model, state)
        row[:] = state.qpos[places] - scene.home_qpos[places]
    return moved


def _drawn_collision(model: mujoco.MjModel) -> list[str]:
    """Whether shapes for collision are drawn over the robot's looks."""
    drawn = model.geom_group < DRAWN_GROUPS
    touching: Any = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    moving = model.body_weldid[model.geom_bodyid] != 0
    groups = [set(model.geom_group[moving & drawn & kind].tolist()) for kind in (touching, ~touching)]
    only_collision = groups[0] - groups[1]
    if not only_collision or not groups[1]:
        return []
    drawn_now, alone = (", ".join(map(str, sorted(some))) for some in (only_collision, groups[1]))
    return [
        f"geoms of group {drawn_now} all take part in contacts and are drawn over the others; where they are collision "
        f"shapes, expected geom groups {alone} alone to be drawn"
    ]
