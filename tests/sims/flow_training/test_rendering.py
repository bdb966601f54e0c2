"""Rays against closed forms, and the exact flow against the images, which come by another way."""

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from dense_vs.sims.flow_training.network import warp
from dense_vs.sims.flow_training.random_scenes import random_scenes
from dense_vs.sims.flow_training.rendering import Renderer, cast_rays
from dense_vs.sims.flow_training.scenes import STATIC, Dice, rotations_of
from dense_vs.sims.flow_training.sensor import _cosines, degrade

HEIGHT, WIDTH = 64, 96


def cast(direction, half, quadric, center, rotation=None):
    """Distance along one ray from the origin to one primitive."""
    R = torch.eye(3) if rotation is None else rotation
    shift = -(R.T @ torch.tensor(center, dtype=torch.float32))
    primitive = [R.T, shift, torch.tensor(half), torch.tensor(quadric), torch.tensor(0.0)]
    distance, _ = cast_rays(torch.zeros(1, 1, 3), direction[None, None], *(p[None, None].float() for p in primitive))
    return float(distance[0, 0])


def test_a_ball_is_met_where_its_equation_says():
    rng = np.random.default_rng(0)
    for _ in range(20):
        center, radius = np.array([*rng.uniform(-0.3, 0.3, 2), 2.0]), rng.uniform(0.1, 0.5)
        d = np.array([*rng.uniform(-0.2, 0.2, 2), 1.0])
        d /= np.linalg.norm(d)
        inner = (d @ center) ** 2 - center @ center + radius**2
        expected = d @ center - np.sqrt(inner) if inner > 0 else np.inf
        half, quadric = [radius] * 3, [1 / radius**2] * 3
        assert cast(torch.tensor(d).float(), half, quadric, center) == pytest.approx(expected, abs=1e-4)


def test_a_turned_box_is_met_at_its_face():
    rotation = rotations_of(torch.tensor([0.0, 0.0, 0.7]))  # about the line of sight: its front stays
    ahead = torch.tensor([0.0, 0.0, 1.0])
    assert cast(ahead, [0.2, 0.1, 0.3], [0.0] * 3, [0.0, 0.0, 2.0], rotation) == pytest.approx(1.7, abs=1e-5)
    assert cast(torch.tensor([0.6, 0.0, 0.8]), [0.2, 0.1, 0.3], [0.0] * 3, [0.0, 0.0, 2.0]) == np.inf


def test_the_previous_image_moved_by_the_flow_is_the_present_one():
    pairs = Renderer(HEIGHT, WIDTH).pairs(Dice("cpu", 3), 12)
    moved = warp(pairs.previous[:, None], pairs.flow)[:, 0]
    fast = pairs.moving & (pairs.flow.norm(dim=1) > 0.7)
    assert int(fast.sum()) > 500
    away = warp(pairs.previous[:, None], -pairs.flow)[:, 0]
    left, before, wrong = ((image - pairs.present)[fast].abs().mean() for image in (moved, pairs.previous, away))
    # What is left: places that were hidden, gloss, and light that does not turn with a surface.
    assert left < 0.55 * before
    assert left < 0.4 * wrong


def test_what_does_not_move_has_no_flow():
    dice = Dice("cpu", 5)
    scenes = random_scenes(dice, 6, HEIGHT)
    scenes.sway.zero_()
    pairs = Renderer(HEIGHT, WIDTH).render(dice, scenes)
    assert pairs.flow.norm(dim=1)[~pairs.moving].max() < 2e-3  # float32 through the focal length
    assert pairs.flow.norm(dim=1)[pairs.moving].max() > 0.5
    assert STATIC in scenes.link


def test_the_same_seed_gives_the_same_pairs():
    first, second = (Renderer(32, 48).pairs(Dice("cpu", 8), 2) for _ in range(2))
    torch.testing.assert_close(first.present, second.present, rtol=0, atol=0)
    torch.testing.assert_close(first.flow, second.flow, rtol=0, atol=0)


def test_degraded_images_keep_what_they_show():
    dice = Dice("cpu", 1)
    pattern = 0.5 + 0.4 * torch.sin(torch.arange(WIDTH) / 4.0) * torch.cos(torch.arange(HEIGHT) / 5.0)[:, None]
    clean = pattern.expand(16, HEIGHT, WIDTH)
    previous, present = degrade(dice, clean, clean)
    assert previous.dtype == present.dtype == torch.uint8
    for image in (*previous, *present):
        assert np.corrcoef(image.flatten(), pattern.flatten())[0, 1] > 0.85
    assert (previous != present).any()
    C = _cosines(torch.device("cpu"))
    torch.testing.assert_close(C @ C.T, torch.eye(8), rtol=0, atol=1e-6)
