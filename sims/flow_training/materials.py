"""Materials of random surfaces: mostly plain paint and metal with seams, screws and labels; some patterns.

A material is a row of numbers, so that one function shades every pixel of a batch. The pattern is a function of the
point in the primitive's own frame and therefore moves with it; light, gloss and mirrored surroundings do not.
"""

import torch
from torch import Tensor

from dense_vs.sims.flow_training.scenes import CLUTTER, PLANES, PRIMITIVES, WAVES, Dice, Scenes

# Columns of a material.
ALBEDO, AMPLITUDE, SHARPNESS, SLOPE = 0, 1, 2, slice(3, 6)
SPECULAR, SHININESS, MIRROR = 6, 7, 8
SEAM = slice(9, 14)  # position, width, depth, second position, second depth [m, m, 1, m, 1]
SCREW = slice(14, 18)  # spacing, radius, depth, along which axis
LABEL = slice(18, 25)  # middle (2), half size (2), albedo, spacing of its print, on which side
CHECKER, WARP = 25, 26
WAVE = slice(27, 27 + 3 * WAVES)
PHASE = slice(27 + 3 * WAVES, 27 + 4 * WAVES)
WEIGHT = slice(27 + 4 * WAVES, 27 + 5 * WAVES)
COLUMNS = 27 + 5 * WAVES


def random_materials(dice: Dice, scenes: Scenes, depth: Tensor) -> Tensor:
    """Materials ``(B, K + 2, F)`` of all primitives, then of wall and floor."""
    B, M, device = depth.shape[0], PRIMITIVES + PLANES, dice.device
    arm = torch.zeros(M, dtype=torch.bool, device=device)
    arm[: PRIMITIVES - CLUTTER - 2] = True
    pixel = (depth / scenes.focal)[:, None]  # size of a pixel at the arm [m]
    m = torch.zeros(B, M, COLUMNS, device=device)
    # One or two paints an arm, as real ones have.
    paints = dice.uniform(0.04, 0.95, B, 3)
    paint = paints.gather(1, (dice.uniform(0, 1, B, M) ** 2 * 2.999).long()) * dice.uniform(0.92, 1.08, B, M)
    m[..., ALBEDO] = torch.where(arm & dice.chance(0.85, B, 1), paint, dice.uniform(0.04, 0.95, B, M))
    kind = dice.uniform(0, 1, B, 1)  # of the arm: plain, mixed, patterned
    patterned = torch.where(arm, dice.chance(0.5, B, M) & (kind > 0.75) | (kind > 0.9), dice.chance(0.75, B, M))
    # Even a plain surface has a little dirt.
    amplitude = torch.where(patterned, dice.log_uniform(0.05, 0.5, B, M), dice.log_uniform(0.0005, 0.02, B, M))
    m[..., AMPLITUDE] = amplitude
    m[..., SHARPNESS] = torch.where(dice.chance(0.3, B, M), dice.log_uniform(2, 20, B, M), 0.0)
    m[..., CHECKER] = (patterned & dice.chance(0.2, B, M)).float()
    m[..., WARP] = dice.chance(0.7, B, M) * dice.uniform(0, 5, B, M)
    m[..., SLOPE] = dice.normal(B, M, 3) * (0.15 / (40 * pixel))[..., None] * dice.chance(0.5, B, M, 1)
    m[..., SPECULAR] = dice.chance(0.6, B, M) * dice.uniform(0, 0.6, B, M)
    m[..., SHININESS] = dice.log_uniform(3, 60, B, M)
    m[..., MIRROR] = dice.chance(0.3, B, M) * dice.uniform(0, 0.35, B, M) * (arm | dice.chance(0.2, B, M))
    half = torch.cat([scenes.half, scenes.half.new_full((B, PLANES, 3), 0.5)], 1)
    seam = torch.stack([
        half[..., 2] * dice.uniform(-0.9, 0.9, B, M), pixel * dice.log_uniform(0.3, 2.5, B, M),
        dice.chance(0.35, B, M) * dice.uniform(-0.3, 0.8, B, M), half[..., 2] * dice.uniform(-0.9, 0.9, B, M),
        dice.chance(0.25, B, M) * dice.uniform(-0.3, 0.8, B, M),
    ], -1)  # fmt: skip
    m[..., SEAM] = seam
    radius = pixel * dice.log_uniform(0.5, 2.5, B, M)
    m[..., SCREW] = torch.stack([
        radius * dice.uniform(5, 16, B, M), radius, dice.chance(0.2, B, M) * arm * dice.uniform(-0.3, 0.8, B, M),
        dice.uniform(0, 1, B, M),
    ], -1)  # fmt: skip
    printed = dice.chance(0.15, B, M)
    m[..., LABEL] = torch.cat([
        half[..., 1:] * dice.uniform(-0.7, 0.7, B, M, 2),
        torch.where(printed[..., None], half[..., 1:] * dice.uniform(0.1, 0.45, B, M, 2), -1.0),
        dice.uniform(0.05, 0.95, B, M, 1), (pixel * dice.log_uniform(2, 8, B, M))[..., None],
        dice.chance(0.5, B, M, 1) * 2.0 - 1,
    ], -1)  # fmt: skip
    length = pixel[..., None] * dice.log_uniform(2.5, 40, B, M, WAVES)  # of a wave [m]
    wave = dice.direction(B, M, WAVES)
    grain = dice.direction(B, M, 1)  # wood and brushed metal: hardly any change along the grain
    grained = dice.chance(0.3, B, M, 1, 1)
    wave = torch.where(grained, wave - 0.95 * grain * (wave * grain).sum(-1, keepdim=True), wave)
    m[..., WAVE] = (wave * (6.283 / length)[..., None]).flatten(-2)
    m[..., PHASE] = dice.uniform(0, 6.283, B, M, WAVES)
    weight = dice.uniform(0.1, 1, B, M, WAVES)
    m[..., WEIGHT] = weight / weight.norm(dim=-1, keepdim=True)
    return m


def albedo_at(m: Tensor, point: Tensor) -> Tensor:
    """Reflected share ``(...)`` of materials ``(..., F)`` at points of the primitive's frame ``(..., 3)`` [m]."""
    x, y, z = point.unbind(-1)
    phase = (m[..., WAVE].unflatten(-1, (WAVES, 3)) * point[..., None, :]).sum(-1) + m[..., PHASE]
    warp = phase[..., 3:].sin() * m[..., WARP : WARP + 1]  # bends the waves, so that they do not repeat
    sines = (phase + torch.cat([warp[..., :1], warp[..., 1:], warp[..., :1], 0 * warp], -1)).sin()
    smooth = (sines * m[..., WEIGHT]).sum(-1)
    sharp = m[..., SHARPNESS]
    smooth = torch.where(sharp > 0, (sharp * smooth).tanh(), smooth)
    checker = (20 * phase[..., 0].sin() * phase[..., 1].sin()).tanh()
    pattern = torch.where(m[..., CHECKER] > 0, checker, smooth)
    albedo = m[..., ALBEDO] * (1 + m[..., AMPLITUDE] * pattern + (m[..., SLOPE] * point).sum(-1).clamp(-0.4, 0.4))
    first, width, depth, second, depth2 = m[..., SEAM].unbind(-1)
    for position, strength in ((first, depth), (second, depth2)):
        albedo = albedo * (1 - strength * (-(((z - position) / width) ** 2)).exp())
    spacing, radius, depth, which = m[..., SCREW].unbind(-1)
    across = torch.where(which > 0.5, y, x)
    lattice = [c - spacing * (c / spacing).round() for c in (across, z)]
    albedo = albedo * (1 - depth * (-(((lattice[0] ** 2 + lattice[1] ** 2) / radius**2) ** 2)).exp())
    my, mz, hy, hz, paint, print_, side = m[..., LABEL].unbind(-1)
    inside = ((y - my).abs() < hy) & ((z - mz).abs() < hz) & (x * side > 0)
    letters = torch.sin(6.283 * y / print_) * torch.sin(6.283 * z / print_ * 0.37 + 3 * torch.sin(4 * y / print_))
    albedo = torch.where(inside, paint * (1 - 0.5 * (letters > 0.35)), albedo)
    return albedo.clamp(0.01, 1.0)


def shade(
    m: Tensor, albedo: Tensor, normal: Tensor, ray: Tensor, lit: Tensor, light: Tensor, strength: Tensor
) -> Tensor:
    """Gray value ``(B, P)`` by ambient, directional and camera light, gloss and mirrored surroundings."""
    facing = (normal * light).sum(-1).clamp_min(0) * lit
    head = -(normal * ray).sum(-1)
    mirrored = ray + 2 * head[..., None] * normal
    gloss = (mirrored * light).sum(-1).clamp_min(0) ** m[..., SHININESS] * lit
    wave = m[..., WAVE.start : WAVE.start + 3]
    around = 9 * (mirrored * wave).sum(-1) / (wave * wave).sum(-1).sqrt()
    surroundings = 0.5 + 0.5 * torch.sin(around + m[..., PHASE.start])
    value = albedo * (strength[..., 0] + strength[..., 1] * facing + strength[..., 2] * head.clamp_min(0))
    return value + m[..., SPECULAR] * gloss * strength[..., 1] + m[..., MIRROR] * surroundings * strength[..., 0]
