"""Random jointed arms in random rooms: shapes, places, materials, lights and motions."""

import math

import torch
from torch import Tensor

from dense_vs.sims.flow_training.materials import random_materials
from dense_vs.sims.flow_training.scenes import (
    CLUTTER,
    FINGERS,
    JOINTS,
    MOVER,
    PER_LINK,
    PLANES,
    PRIMITIVES,
    STATIC,
    Dice,
    Scenes,
    rotations_of,
)


def random_scenes(dice: Dice, batch: int, height: int) -> Scenes:
    """Scenes whose arm stands about the middle of an image ``height`` pixels high; materials and motion come later."""
    B, J = batch, JOINTS
    radius = dice.log_uniform(0.04, 0.1, B, 1) * dice.uniform(0.7, 1.3, B, J)  # of a link [m]
    length = dice.uniform(0.08, 0.42, B, J) * dice.uniform(0.5, 1.2, B, 1)
    bend = torch.cat([dice.normal(B, J, 2) * radius[..., None] * 0.7, length[..., None]], -1)
    turning = dice.chance(0.35, B, J, 1)  # about the link's own axis, else across it
    across = torch.nn.functional.normalize(torch.cat([dice.normal(B, J, 2), 0.05 * dice.normal(B, J, 1)], -1), dim=-1)
    axis = torch.where(turning, torch.tensor([0.0, 0.0, 1.0], device=dice.device), across)
    link, rotation, center, half, quadric, offset = _arm_primitives(dice, B, radius, length)
    focal = dice.log_uniform(0.8, 2.2, B) * height
    scenes = Scenes(
        focal=focal, link=link, rotation=rotation, center=center, half=half, quadric=quadric, offset=offset,
        axis=axis, length=length, bend=bend, angles=dice.uniform(-1.3, 1.3, B, J),
        base=(rotations_of(dice.direction(B) * dice.uniform(0, math.pi, B, 1)), torch.zeros(B, 3, device=dice.device)),
        plane=torch.zeros(B, PLANES, 4, device=dice.device), material=torch.empty(0), light=torch.empty(0),
        strength=torch.empty(0), joint_step=torch.zeros(B, J, device=dice.device),
        sway=torch.zeros(B, 6, device=dice.device), own=torch.zeros(B, 6, device=dice.device),
    )  # fmt: skip
    depth = _place(dice, scenes, height)
    _furnish(dice, scenes, depth, height)
    scenes.material = random_materials(dice, scenes, depth)
    light = dice.direction(B)
    light[:, 2] = -light[:, 2].abs()  # from the camera's side
    scenes.light = light
    scenes.strength = torch.stack([dice.uniform(0.15, 0.5, B), dice.uniform(0.1, 0.7, B), dice.uniform(0, 0.4, B)], -1)
    _move(dice, scenes, depth)
    return scenes


def _arm_primitives(dice: Dice, B: int, radius: Tensor, length: Tensor) -> tuple[Tensor, ...]:
    """Body, housing and an attachment a link, three more on the last one; the room's primitives are left empty."""
    J, K, device = JOINTS, PRIMITIVES, dice.device
    link = [j for j in range(J) for _ in range(PER_LINK)] + [J - 1] * FINGERS + [STATIC] * CLUTTER + [MOVER, STATIC]
    rotation = torch.eye(3, device=device).repeat(B, K, 1, 1)
    center = torch.zeros(B, K, 3, device=device)
    half = torch.full((B, K, 3), 0.05, device=device)
    quadric = torch.zeros(B, K, 3, device=device)
    offset = torch.zeros(B, K, device=device)
    body, housing, extra = (torch.arange(k, J * PER_LINK, PER_LINK) for k in range(PER_LINK))
    r = radius[..., None]
    round_ = dice.chance(0.75, B, J, 1)
    width = r * dice.uniform(0.7, 1.1, B, J, 2)
    half[:, body] = torch.cat([width * torch.where(round_, dice.uniform(0.8, 1.5, B, J, 1), 1.0),
                               0.5 * length[..., None] + 0.3 * r], -1)  # fmt: skip
    center[:, body, 2] = 0.5 * length
    taper = torch.where(dice.chance(0.5, B, J), dice.uniform(0.1, 0.9, B, J), 0.0)  # 0: a cylinder
    long = (taper / (0.5 * length + 0.3 * radius)) ** 2
    quadric[:, body] = torch.where(round_, torch.cat([1 / width**2, long[..., None]], -1), 0.0)
    offset[:, body] = 0.5 * length * dice.uniform(-1, 1, B, J)
    ball = dice.chance(0.3, B, J, 1)
    size = r * dice.uniform(1.0, 1.5, B, J, 1)
    half[:, housing] = size * torch.cat([torch.ones(B, J, 2, device=device), dice.uniform(0.7, 1.4, B, J, 1)], -1)
    along = torch.where(ball, 1 / size**2, torch.where(dice.chance(0.3, B, J, 1), 0.3 / size**2, 0.0))
    quadric[:, housing] = torch.cat([(1 / size**2).expand(B, J, 2), along], -1)
    rotation[:, housing] = rotations_of(dice.normal(B, J, 3) * dice.chance(0.8, B, J, 1) * 1.5)
    thin = r * dice.uniform(0.15, 0.8, B, J, 3)
    half[:, extra] = thin
    quadric[:, extra] = torch.where(dice.chance(0.5, B, J, 1), 1 / thin**2 * dice.uniform(0.3, 1, B, J, 3), 0.0)
    rotation[:, extra] = rotations_of(dice.normal(B, J, 3))
    side = dice.direction(B, J) * r * 0.9
    side[..., 2] = dice.uniform(0, 1, B, J) * length
    center[:, extra] = side
    last = torch.arange(J * PER_LINK, J * PER_LINK + FINGERS)
    end, thick = length[:, -1:], radius[:, -1:]
    half[:, last] = thick[..., None] * torch.cat([dice.uniform(0.15, 0.4, B, FINGERS, 2),
                                                  dice.uniform(0.5, 1.1, B, FINGERS, 1)], -1)  # fmt: skip
    center[:, last] = torch.stack([dice.uniform(-0.9, 0.9, B, FINGERS) * thick, 0.3 * thick * dice.normal(B, FINGERS),
                                   end + thick * dice.uniform(0.6, 1.2, B, FINGERS)], -1)  # fmt: skip
    return torch.tensor(link, device=device), rotation, center, half, quadric, offset


def _place(dice: Dice, scenes: Scenes, height: int) -> Tensor:
    """Move the chain before the camera so that it fills part of the image; returns its depth ``(B,)`` [m]."""
    B = scenes.focal.shape[0]
    _, origins = scenes.link_poses(0.0)
    joints = origins[:, :JOINTS]
    at = joints[torch.arange(B, device=dice.device), dice.uniform(1, JOINTS - 0.01, B).long()]
    reach = (joints - at[:, None]).norm(dim=-1).amax(1)
    depth = (scenes.focal * reach / (dice.log_uniform(0.5, 2.0, B) * height)).clamp(0.4, 6.0)
    depth = torch.maximum(depth, 0.5 * reach + 0.2)
    aside = dice.uniform(-0.35, 0.35, B, 2) * (depth * height / scenes.focal)[:, None]
    scenes.base = (scenes.base[0], torch.cat([aside, depth[:, None]], 1) - at)
    return depth


def _furnish(dice: Dice, scenes: Scenes, depth: Tensor, height: int) -> None:
    """Wall, floor, clutter behind and sometimes before the arm, and a thing that may move by itself."""
    B, device = depth.shape[0], dice.device
    wide = depth * height / scenes.focal  # the image's height at the arm's depth [m]
    normal = torch.nn.functional.normalize(
        torch.cat([0.5 * dice.normal(B, 2), torch.ones(B, 1, device=device)], 1), dim=1
    )
    behind = depth + wide * dice.uniform(0.2, 1.2, B)
    scenes.plane[:, 0] = torch.cat([normal, (normal[:, 2] * behind)[:, None]], 1)
    turn = dice.uniform(-0.5, 0.5, B) + math.pi * dice.chance(0.15, B)
    floor = torch.stack([turn.sin(), turn.cos(), dice.uniform(0.05, 1.2, B)], 1)
    floor = floor / floor.norm(dim=1, keepdim=True)
    below = floor[:, 2] * depth + wide * dice.uniform(0.3, 0.7, B)
    scenes.plane[:, 1] = torch.cat([floor, below[:, None]], 1)
    room = torch.arange(PRIMITIVES - CLUTTER - 2, PRIMITIVES, device=device)
    n = len(room)
    far = depth[:, None] + wide[:, None] * dice.uniform(-0.1, 0.9, B, n)
    far[:, -1] = depth * dice.uniform(0.45, 0.75, B)
    aside = dice.uniform(-0.75, 0.75, B, n, 2) * (far * height / scenes.focal[:, None])[..., None]
    hidden = dice.chance(0.4, B, n)
    hidden[:, -1] = dice.chance(0.88, B)
    hidden[:, -2] = dice.chance(0.8, B)
    scenes.center[:, room] = torch.cat([aside, torch.where(hidden, -9.0, far)[..., None]], -1)
    size = wide[:, None, None] * dice.log_uniform(0.03, 0.25, B, n, 3)
    size[:, -1] *= 0.5
    scenes.half[:, room] = size
    scenes.quadric[:, room] = torch.where(
        dice.chance(0.4, B, n, 1), 1 / size**2 * torch.where(dice.chance(0.5, B, n, 3), 1.0, 0.1), 0.0
    )
    scenes.rotation[:, room] = rotations_of(dice.normal(B, n, 3))


def _move(dice: Dice, scenes: Scenes, depth: Tensor) -> None:
    """Random motions of unit size; the renderer scales the joints' to the image speed asked for."""
    B = depth.shape[0]
    moving = dice.chance(0.7, B, JOINTS) & dice.chance(0.9, B, 1)
    # Joints far from the hand move more of the image: fewer radians there.
    size = dice.log_uniform(0.1, 1.0, B, JOINTS)
    scenes.joint_step = dice.normal(B, JOINTS) * moving * size
    pixel = (depth / scenes.focal)[:, None]  # [m]
    sways = dice.chance(0.25, B, 1) * dice.log_uniform(0.05, 1.5, B, 1)
    scenes.sway = torch.cat([dice.normal(B, 3) / scenes.focal[:, None], dice.normal(B, 3) * pixel * 0.5], 1) * sways
    own = dice.log_uniform(0.3, 4.0, B, 1)
    scenes.own = torch.cat([dice.normal(B, 3) * 0.01, dice.normal(B, 3) * pixel], 1) * own
