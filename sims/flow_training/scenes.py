"""Jointed arms in rooms, as batches of convex primitives with materials, and the draws that random ones come from.

A primitive is a box cut by a quadric ``a x^2 + b y^2 + c (z - z0)^2 <= 1``: box, cylinder, ellipsoid, barrel, cone-like
taper or a housing with flats, by its numbers alone. Everything is in the camera's frame (x right, y down, z forward)
and every motion is a rigid motion of a primitive's link, so the flow that follows is exact.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

JOINTS = 7
STATIC = JOINTS  # link that nothing moves but the camera's own sway
MOVER = JOINTS + 1  # a rigid thing that moves by itself
LINKS = JOINTS + 2
PER_LINK = 3
FINGERS = 3
CLUTTER = 5
PRIMITIVES = JOINTS * PER_LINK + FINGERS + CLUTTER + 2  # one more that moves by itself, one before the arm
PLANES = 2  # wall and floor
WAVES = 5


@dataclass
class Scenes:
    """A batch of B scenes, K primitives, their links, materials, lights and motions.

    Attributes:
        focal: ``(B,)`` [px].
        link: ``(K,)`` int64, the link of each primitive.
        rotation, center: ``(B, K, 3, 3)`` and ``(B, K, 3)``, pose of a primitive in its link.
        half: ``(B, K, 3)`` half sides of the box [m]. quadric: ``(B, K, 3)`` [1/m^2]. offset: ``(B, K)`` z0 [m].
        axis, length, bend, angles: ``(B, J, 3)``, ``(B, J)``, ``(B, J, 3)``, ``(B, J)``: the chain.
        base: ``(B, 3, 3)`` and ``(B, 3)``, pose of the chain in the camera.
        plane: ``(B, 2, 4)`` normal n and distance d of wall and floor, n x = d.
        material: ``(B, K + 2, F)``, see materials.py.
        light: ``(B, 3)`` direction to the light. strength: ``(B, 3)`` ambient, directional, at the camera.
        joint_step: ``(B, J)`` [rad]. sway, own: ``(B, 6)``, rotation vector [rad] and translation [m] a frame of the
            camera and of the thing that moves by itself.
    """

    focal: Tensor
    link: Tensor
    rotation: Tensor
    center: Tensor
    half: Tensor
    quadric: Tensor
    offset: Tensor
    axis: Tensor
    length: Tensor
    bend: Tensor
    angles: Tensor
    base: tuple[Tensor, Tensor]
    plane: Tensor
    material: Tensor
    light: Tensor
    strength: Tensor
    joint_step: Tensor
    sway: Tensor
    own: Tensor

    def link_poses(self, step: float) -> tuple[Tensor, Tensor]:
        """Rotations ``(B, L, 3, 3)`` and origins ``(B, L, 3)`` of all links, ``step`` frames from the present."""
        rotation, origin = self.base
        rotations, origins = [], []
        turns = rotations_of((self.angles + step * self.joint_step)[..., None] * self.axis)
        for j in range(JOINTS):
            rotation = rotation @ turns[:, j]
            rotations.append(rotation)
            origins.append(origin)
            origin = origin + (rotation @ self.bend[:, j, :, None])[..., 0]
        sway, own = rotations_of(step * self.sway[:, :3]), rotations_of(step * self.own[:, :3])
        about = self.center[:, -2]  # the thing that moves by itself turns about its own middle
        rotations += [torch.eye(3, device=sway.device).expand_as(sway), own]
        origins += [torch.zeros_like(origin), about - (own @ about[..., None])[..., 0] + step * self.own[:, 3:]]
        R, t = torch.stack(rotations, 1), torch.stack(origins, 1)
        return sway[:, None] @ R, (sway[:, None] @ t[..., None])[..., 0] + step * self.sway[:, None, 3:]


def rotations_of(vectors: Tensor) -> Tensor:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` [rad], by Rodrigues' formula."""
    angle = vectors.norm(dim=-1, keepdim=True).clamp_min(1e-12)
    x, y, z = (vectors / angle).unbind(-1)
    zero = torch.zeros_like(x)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    angle = angle[..., None]
    return torch.eye(3, device=K.device) + angle.sin() * K + (1 - angle.cos()) * (K @ K)


class Dice:
    """Random draws on a device, all from one seeded generator."""

    def __init__(self, device: str | torch.device, seed: int):
        self.device = torch.device(device)
        self.generator = torch.Generator(self.device).manual_seed(seed)

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Between low and high."""
        return low + (high - low) * torch.rand(*shape, device=self.device, generator=self.generator)

    def log_uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Between low and high, evenly by their logarithm."""
        return self.uniform(math.log(low), math.log(high), *shape).exp()

    def normal(self, *shape: int) -> Tensor:
        """Standard normal."""
        return torch.randn(*shape, device=self.device, generator=self.generator)

    def chance(self, probability: float, *shape: int) -> Tensor:
        """True with a probability, bool."""
        return torch.rand(*shape, device=self.device, generator=self.generator) < probability

    def direction(self, *shape: int) -> Tensor:
        """Unit vectors ``(*shape, 3)``."""
        vector = self.normal(*shape, 3)
        return vector / vector.norm(dim=-1, keepdim=True).clamp_min(1e-6)
