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
    return [*_sagging(scene), *_drawn_collision(scene.model)]


def _sagging(scene: "Scene") -> list[str]:
    """Joints that leave their place while their target stands still."""
    model, state = scene.model, mujoco.MjData(scene.model)
    state.qpos[:], state.ctrl[:] = scene.home_qpos, scene.home_ctrl
    places = model.jnt_qposadr[scene.joint_ids]
    moved = np.zeros(len(places))
    for _ in range(round(HELD_SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, state)
        change = state.qpos[places] - scene.home_qpos[places]
        moved = np.where(np.abs(change) > np.abs(moved), change, moved)
    return [
        f"joint {name!r} moves by {change:+.2f} within {HELD_SECONDS:g} s while its target stands still; "
        "expected a stiffer position actuator (kp), gravcomp on its bodies, or a posture without contact"
        for name, change in zip(scene.joint_names, moved, strict=True)
        if not abs(change) <= SAG
    ]


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
