"""From clean images to what cameras deliver: exposure, blur, noise, sharpening and block compression."""

import math

import torch
from torch import Tensor
from torch.nn import functional

from dense_vs.sims.flow_training.scenes import Dice

BLOCK = 8  # px, of JPEG and its successors


def degrade(dice: Dice, previous: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
    """Two images ``(B, H, W)``, mostly 0 to 1, as uint8; a pair shares its camera, not its noise."""
    B, H, W = present.shape
    pair = torch.stack([previous, present], 1)
    gain = dice.uniform(0.2, 0.6, B, 1, 1, 1) / pair.mean((1, 2, 3), keepdim=True).clamp_min(0.01)
    pair = (pair * gain).clamp_min(1e-4) ** dice.uniform(0.6, 1.1, B, 1, 1, 1)
    flicker = dice.chance(0.4, B, 1, 1, 1) * dice.log_uniform(0.003, 0.05, B, 1, 1, 1)
    pair = pair * (1 + flicker * dice.normal(B, 2, 1, 1)) + 0.3 * flicker * dice.normal(B, 2, 1, 1)
    pair = pair * _vignette(dice, B, H, W)
    pair = _blurred(pair, dice.chance(0.6, B) * dice.uniform(0.2, 1.3, B))
    level = dice.chance(0.7, B, 1, 1, 1) * dice.log_uniform(0.3, 6.0, B, 1, 1, 1) / 255
    noise = dice.normal(B, 2, H, W)
    # A camera's own noise filter leaves it coarse.
    noise = torch.where(dice.chance(0.3, B, 1, 1, 1), 1.7 * _blurred(noise, dice.uniform(0.5, 1.0, B)), noise)
    pair = pair + level * noise * (0.5 + pair.clamp(0, 1)).sqrt()
    sharper = dice.chance(0.25, B, 1, 1, 1) * dice.uniform(0, 1.0, B, 1, 1, 1)
    pair = pair + sharper * (pair - _blurred(pair, torch.full((B,), 1.0, device=pair.device)))
    pair = _compressed(dice, pair.clamp(0, 1) * 255)
    both = pair.round().clamp(0, 255).to(torch.uint8)
    return both[:, 0].contiguous(), both[:, 1].contiguous()


def _vignette(dice: Dice, B: int, H: int, W: int) -> Tensor:
    y = torch.linspace(-1, 1, H, device=dice.device)[:, None]
    x = torch.linspace(-1, 1, W, device=dice.device)
    return 1 - dice.chance(0.4, B, 1, 1, 1) * dice.uniform(0, 0.25, B, 1, 1, 1) * (x**2 + y**2)


def _blurred(pair: Tensor, sigma: Tensor) -> Tensor:
    """Gaussian blur of ``(B, 2, H, W)`` by ``(B,)`` px, 0 for none."""
    B, _, H, W = pair.shape
    at = torch.arange(-3, 4, device=pair.device)
    kernel = (-(at**2) / (2 * sigma[:, None].clamp_min(0.05) ** 2)).exp()
    kernel = (kernel / kernel.sum(1, keepdim=True)).repeat_interleave(2, 0)
    flat = functional.pad(pair.reshape(1, 2 * B, H, W), (3, 3, 3, 3), mode="replicate")
    flat = functional.conv2d(flat, kernel[:, None, None, :], groups=2 * B)
    return functional.conv2d(flat, kernel[:, None, :, None], groups=2 * B).reshape(B, 2, H, W)


def _cosines(device: torch.device) -> Tensor:
    k = torch.arange(BLOCK, device=device, dtype=torch.float32)
    basis = torch.cos(math.pi * (k[None] + 0.5) * k[:, None] / BLOCK) * math.sqrt(2 / BLOCK)
    basis[0] /= math.sqrt(2)
    return basis


def _compressed(dice: Dice, pair: Tensor) -> Tensor:
    """Block-wise cosine coefficients rounded, coarser at high frequencies: each image alone as JPEG does, or the
    second by its difference from the first as video does, where small differences vanish."""
    B, _, H, W = pair.shape
    C = _cosines(pair.device)
    padded = functional.pad(pair, (0, -W % BLOCK, 0, -H % BLOCK), mode="replicate")
    blocks = padded.unflatten(2, (-1, BLOCK)).unflatten(4, (-1, BLOCK))  # B, 2, rows, 8, columns, 8
    coded = torch.einsum("ui,bnricj,vj->bnrucv", C, blocks, C)
    k = torch.arange(BLOCK, device=pair.device, dtype=torch.float32)
    step = (1 + 0.35 * (k[:, None] + k))[None, :, None, :] * dice.log_uniform(1.0, 10.0, B, 1, 1, 1, 1)
    first = (coded[:, 0] / step).round() * step
    alone = (coded[:, 1] / step).round() * step
    change = (coded[:, 1] - first) / step
    change = torch.where(change.abs() < 0.65, torch.zeros_like(change), change.round()) * step
    video = dice.chance(0.25, B, 1, 1, 1, 1)
    second = torch.where(video, first + change, alone)
    decoded = torch.einsum("ui,bnrucv,vj->bnricj", C, torch.stack([first, second], 1), C)
    decoded = decoded.flatten(4, 5).flatten(2, 3)[..., :H, :W]
    return torch.where(dice.chance(0.5, B, 1, 1, 1), decoded, pair)
