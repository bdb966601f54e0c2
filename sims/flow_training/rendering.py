"""Images of random scenes one frame apart and the exact flow between them, by casting rays, on a CPU or a GPU."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from dense_vs.sims.flow_training.materials import albedo_at, shade
from dense_vs.sims.flow_training.random_scenes import random_scenes
from dense_vs.sims.flow_training.scenes import PRIMITIVES, STATIC, Dice, Scenes

NEAR, FAR = 0.05, 1e4  # [m]
PIECE = 2048  # rays


@dataclass(frozen=True)
class Pairs:
    """Images before degradation and the truth between them.

    Attributes:
        previous, present: ``(B, H, W)`` gray values, mostly 0 to 1.
        flow: ``(B, 2, H, W)`` at the present pixels [px], from the old place to the new one.
        moving: bool ``(B, H, W)``, pixels of links that a joint or an own motion moves.
    """

    previous: Tensor
    present: Tensor
    flow: Tensor
    moving: Tensor


class Renderer:
    """Renders random pairs.

    Args:
        height, width: of the images [px].
        samples: rays a pixel along each side; 2 smooths edges as a camera does.
        compiled: fuse the ray casting by ``torch.compile``; for long runs on a GPU.
    """

    def __init__(self, height: int, width: int, *, samples: int = 2, compiled: bool = False):
        self.height, self.width, self.samples = height, width, samples
        fuse = partial(torch.compile, dynamic=False) if compiled else lambda function: function
        self._cast: Callable = fuse(cast_rays) if compiled else _in_pieces
        self._hit_shade: Callable = fuse(_shade_hits)
        self._hit_point: Callable = fuse(_hit_points)

    def pairs(self, dice: Dice, batch: int) -> Pairs:
        """``batch`` new scenes, each two frames."""
        return self.render(dice, random_scenes(dice, batch, self.height))

    def render(self, dice: Dice, scenes: Scenes) -> Pairs:
        """Two frames of each scene, its joints' steps scaled to a drawn image speed."""
        batch = len(scenes.focal)
        centers = self._rays(scenes, 1)
        hit, distance = self._first(scenes, 0.0, centers)
        still = hit >= PRIMITIVES
        link = scenes.link[hit.clamp_max(PRIMITIVES - 1)]
        self._set_speed(dice, scenes, centers, hit, distance, ~still & (link < STATIC))
        flow = self._flow(scenes, centers, hit, distance)
        shadows = bool(torch.rand((), generator=dice.generator, device=dice.device) < 0.6)
        # Some cameras and renderers do not smooth edges.
        aliased = dice.chance(0.15, batch, 1, 1)
        previous, present = (self._image(scenes, step, shadows, aliased) for step in (-1.0, 0.0))
        moving = ~still & (link != STATIC)
        size = (batch, self.height, self.width)
        return Pairs(previous, present, flow.reshape(*size, 2).permute(0, 3, 1, 2).contiguous(), moving.reshape(size))

    def _rays(self, scenes: Scenes, samples: int) -> Tensor:
        """Unit directions ``(B, P, 3)`` through the pixels' middles or ``samples`` squared points of each."""
        device, H, W = scenes.focal.device, self.height, self.width
        y = (torch.arange(H * samples, device=device) + 0.5) / samples - 0.5
        x = (torch.arange(W * samples, device=device) + 0.5) / samples - 0.5
        grid = torch.stack(torch.meshgrid(y - (H - 1) / 2, x - (W - 1) / 2, indexing="ij"), -1).reshape(1, -1, 2)
        grid = grid / scenes.focal[:, None, None]
        rays = torch.stack([grid[..., 1], grid[..., 0], torch.ones_like(grid[..., 0])], -1)
        return rays / rays.norm(dim=-1, keepdim=True)

    def _poses(self, scenes: Scenes, step: float) -> tuple[Tensor, Tensor]:
        """Rotations ``(B, K + 2, 3, 3)`` and centers of all primitives, then of wall and floor, in the camera."""
        R, t = scenes.link_poses(step)
        link = scenes.link
        rotation = R[:, link] @ scenes.rotation
        center = t[:, link] + (R[:, link] @ scenes.center[..., None])[..., 0]
        planes = [R[:, STATIC : STATIC + 1].expand(-1, 2, -1, -1), t[:, STATIC : STATIC + 1].expand(-1, 2, -1)]
        return torch.cat([rotation, planes[0]], 1), torch.cat([center, planes[1]], 1)

    def _first(self, scenes: Scenes, step: float, rays: Tensor, origins: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Index of the primitive that each ray meets first, int64 ``(B, P)``, and how far away it is [m]."""
        R, t = self._poses(scenes, step)
        K = PRIMITIVES
        o = torch.zeros_like(rays[:, :1]) if origins is None else origins
        to_local = R[:, :K].transpose(2, 3)
        shift = -(to_local @ t[:, :K, :, None])[..., 0]
        distance, hit = self._cast(o, rays, to_local, shift, scenes.half, scenes.quadric, scenes.offset)
        n = (R[:, K:] @ scenes.plane[..., :3, None])[..., 0]
        d = scenes.plane[..., 3] + (n * t[:, K:]).sum(-1)
        for k in range(2):
            toward = (rays * n[:, k : k + 1]).sum(-1)
            there = (d[:, k : k + 1] - (o * n[:, k : k + 1]).sum(-1)) / torch.where(toward.abs() < 1e-6, 1e-6, toward)
            nearer = (there > NEAR) & (there < distance)
            distance, hit = torch.where(nearer, there, distance), torch.where(nearer, K + k, hit)
        return torch.where(distance < FAR, hit, K), distance.clamp_max(FAR)

    def _flow(self, scenes: Scenes, rays: Tensor, hit: Tensor, distance: Tensor) -> Tensor:
        """Exact flow ``(B, P, 2)`` at the present pixels [px]."""
        (R, t), (R0, t0) = self._poses(scenes, 0.0), self._poses(scenes, -1.0)
        back = R0 @ R.transpose(2, 3)  # present camera coordinates to those of a frame ago, a primitive each
        shift = t0 - (back @ t[..., None])[..., 0]
        point = rays * distance[..., None]
        index = hit[..., None]
        old = rotate(gather(back.flatten(2), index).unflatten(-1, (3, 3)), point) + gather(shift, index)
        return scenes.focal[:, None, None] * (_projected(point) - _projected(old))

    def _set_speed(self, dice: Dice, scenes: Scenes, rays: Tensor, hit: Tensor, distance: Tensor, arm: Tensor) -> None:
        """Scale the joints' steps so that the arm's fast pixels move as fast as drawn: 0.3 to 8 px, some not at all."""
        B = rays.shape[0]
        sway, own = scenes.sway, scenes.own
        scenes.sway, scenes.own = torch.zeros_like(sway), torch.zeros_like(own)
        scenes.joint_step = scenes.joint_step * 0.01
        speed = self._flow(scenes, rays, hit, distance).norm(dim=-1)
        scenes.sway, scenes.own = sway, own
        ordered = torch.where(arm, speed, -1.0).sort(dim=1).values
        fast = ordered.gather(1, ordered.shape[1] - 1 - (0.1 * arm.sum(1, keepdim=True)).long())[:, 0].clamp_min(1e-2)
        asked = dice.log_uniform(0.3, 8.0, B) * ~dice.chance(0.04, B)
        step = scenes.joint_step * (asked / fast)[:, None]
        scenes.joint_step = step.clamp(-0.25, 0.25)

    def _image(self, scenes: Scenes, step: float, shadows: bool, aliased: Tensor) -> Tensor:
        """Gray image ``(B, H, W)``."""
        s = self.samples
        rays = self._rays(scenes, s)
        hit, distance = self._first(scenes, step, rays)
        R, t = self._poses(scenes, step)
        point, local, normal = self._hit_point(
            rays, distance, hit, R, t, scenes.half, scenes.quadric, scenes.offset, scenes.plane
        )
        lit = torch.ones_like(distance)
        if shadows:
            _, blocked = self._first(scenes, step, scenes.light[:, None].expand_as(rays), point + 2e-3 * normal)
            lit = torch.where(blocked < FAR, 0.15, 1.0)
        value = self._hit_shade(rays, hit, local, normal, lit, scenes.material, scenes.light, scenes.strength)
        image = value.unflatten(1, (self.height * s, self.width * s))
        return torch.where(aliased, image[:, ::s, ::s], torch.nn.functional.avg_pool2d(image[:, None], s)[:, 0])


def _hit_points(
    rays: Tensor, distance: Tensor, hit: Tensor, R: Tensor, t: Tensor, half: Tensor, quadric: Tensor, offset: Tensor,
    plane: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    """Where rays end ``(B, P, 3)``: in the camera, in the primitive's frame, and the normal toward the camera.

    The normal is that of the face or quadric that the point lies on, edges beveled.
    """
    index = hit[..., None]
    point = rays * distance[..., None]
    rotation = gather(R.flatten(2), index).unflatten(-1, (3, 3))
    local = rotate_back(rotation, point - gather(t, index))
    index = hit.clamp_max(PRIMITIVES - 1)[..., None]
    half, quadric = gather(half, index), gather(quadric, index)
    shift = gather(offset[..., None], index)
    from_middle = local - torch.cat([0 * shift, 0 * shift, shift], -1)
    gradient = quadric * from_middle
    length = (gradient * gradient).sum(-1, keepdim=True).sqrt()
    curved = (from_middle * gradient).sum(-1, keepdim=True) - 1
    curved = torch.where(length > 1e-6, curved / (2 * length.clamp_min(1e-6)), -1.0)
    bevel = 0.03 * torch.minimum(torch.minimum(half[..., :1], half[..., 1:2]), half[..., 2:])
    residual = torch.cat([local.abs() - half, curved], -1) / bevel
    highest = torch.maximum(torch.maximum(residual[..., :1], residual[..., 1:2]),
                            torch.maximum(residual[..., 2:3], residual[..., 3:]))  # fmt: skip
    weight = (residual - highest).exp()
    normal = rotate(rotation, weight[..., :3] * local.sign() + weight[..., 3:] * gradient / length.clamp_min(1e-6))
    normal = normal / (normal * normal).sum(-1, keepdim=True).sqrt().clamp_min(1e-6)
    flat = gather(plane[..., :3], (hit - PRIMITIVES).clamp_min(0)[..., None])
    normal = torch.where((hit >= PRIMITIVES)[..., None], flat, normal)
    away = (normal * rays).sum(-1, keepdim=True) > 0
    return point, local, torch.where(away, -normal, normal)


def _shade_hits(
    rays: Tensor, hit: Tensor, local: Tensor, normal: Tensor, lit: Tensor, material: Tensor, light: Tensor,
    strength: Tensor,
) -> Tensor:  # fmt: skip
    m = gather(material, hit[..., None])
    return shade(m, albedo_at(m, local), normal, rays, lit, light[:, None], strength[:, None])


def rotate(R: Tensor, v: Tensor) -> Tensor:
    """R v of ``(..., 3, 3)`` and ``(..., 3)``, summed out: a GPU is slow at many tiny matrix products."""
    return R[..., 0] * v[..., :1] + R[..., 1] * v[..., 1:2] + R[..., 2] * v[..., 2:]


def rotate_back(R: Tensor, v: Tensor) -> Tensor:
    """R^T v."""
    return R[..., 0, :] * v[..., :1] + R[..., 1, :] * v[..., 1:2] + R[..., 2, :] * v[..., 2:]


def gather(values: Tensor, index: Tensor) -> Tensor:
    """Rows ``(B, P, F)`` of ``(B, K, F)`` by ``(B, P, 1)``."""
    return values.gather(1, index.expand(-1, -1, values.shape[2]))


def _in_pieces(o: Tensor, d: Tensor, *primitives: Tensor) -> tuple[Tensor, Tensor]:
    """As :func:`cast_rays`, few rays at a time, so that a CPU's cache holds what lies between."""
    pieces = [
        cast_rays(o[:, k : k + PIECE] if o.shape[1] > 1 else o, d[:, k : k + PIECE], *primitives)
        for k in range(0, d.shape[1], PIECE)
    ]
    return torch.cat([t for t, _ in pieces], 1), torch.cat([k for _, k in pieces], 1)


def cast_rays(
    o: Tensor, d: Tensor, rotation: Tensor, shift: Tensor, half: Tensor, quadric: Tensor, offset: Tensor
) -> tuple[Tensor, Tensor]:
    """Distance to the nearest primitive, inf without one, and which it is, each ``(B, P)``.

    A box is the overlap of three slabs and a quadric's inside is one interval of the ray, so a ray is inside of the
    primitive between the last entry and the first exit.
    """
    enter = torch.full((), -1e9, device=d.device)
    leave = torch.full((), 1e9, device=d.device)
    a, b, c = (torch.full((), value, device=d.device) for value in (0.0, 0.0, -1.0))
    for i in range(3):
        row = rotation[:, None, :, i]
        along = (d[:, :, None, 0] * row[..., 0] + d[:, :, None, 1] * row[..., 1]) + d[:, :, None, 2] * row[..., 2]
        start = (o[:, :, None, 0] * row[..., 0] + o[:, :, None, 1] * row[..., 1]) + o[:, :, None, 2] * row[..., 2]
        start = start + shift[:, None, :, i]
        safe = torch.where(along.abs() < 1e-7, 1e-7, along)
        side = half[:, None, :, i]
        near, far = (-side - start) / safe, (side - start) / safe
        enter, leave = torch.maximum(enter, torch.minimum(near, far)), torch.minimum(leave, torch.maximum(near, far))
        q = quadric[:, None, :, i]
        middle = start - offset[:, None, :] if i == 2 else start
        a, b, c = a + q * along * along, b + q * middle * along, c + q * middle * middle
    flat = a < 1e-9
    safe_a = torch.where(flat, 1.0, a)
    inner = b * b - a * c
    root = inner.clamp_min(0).sqrt()
    first = torch.where(flat, torch.where(c < 0, -1e9, 1e9), torch.where(inner > 0, (-b - root) / safe_a, 1e9))
    last = torch.where(flat, 1e9, (-b + root) / safe_a)
    enter, leave = torch.maximum(enter, first), torch.minimum(leave, last)
    met = torch.where((enter < leave) & (enter > NEAR), enter, torch.inf)
    return met.amin(-1), met.argmin(-1)


def _projected(points: Tensor) -> Tensor:
    """Image places ``(..., 2)`` of camera coordinates ``(..., 3)`` for a focal length of 1."""
    return points[..., :2] / points[..., 2:].clamp_min(NEAR)
