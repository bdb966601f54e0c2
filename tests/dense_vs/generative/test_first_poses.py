"""First poses of cameras and hand where they are hard to tell: few matches, mistakes, samples the wrong way round."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.reconstruction.pose_reversal import better_poses, reversed_state, settle_poses
from dense_vs.generative.reconstruction.relative_pose import relative_poses
from dense_vs.generative.reconstruction.triangulation import rays

FOCAL = 620.0


def two_views(rng, matches, noise_px, mistaken):
    """Normalized coordinates of a small cloud before two cameras, and the second one's pose in the first's axes."""
    rotation = Rotation.from_rotvec([0.1, 1.2, -0.2]).as_matrix()
    points = rng.normal([0, 0, 2.0], 0.25, (matches, 3))
    shift = -rotation @ [0, 0, 2.0] + [0.1, -0.1, 2.2]
    moved = points @ rotation.T + shift
    first, second = points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:]
    second[:mistaken] = rng.permutation(second[:mistaken])
    noise = noise_px / FOCAL
    return (
        first + rng.normal(0, noise, first.shape),
        second + rng.normal(0, noise, first.shape),
        rotation,
        shift / np.linalg.norm(shift),
    )


@pytest.mark.parametrize(("matches", "mistaken"), [(30, 0), (300, 0), (100, 20)])
def test_relative_pose(matches, mistaken):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        first, second, rotation, baseline = two_views(rng, matches, 0.5, mistaken)
        errors = [
            max(
                np.linalg.norm(Rotation.from_matrix(turned @ rotation.T).as_rotvec()),
                np.linalg.norm(moved - baseline),
            )
            for turned, moved in relative_poses(first, second, FOCAL, rng)
        ]
        assert min(errors) < 0.06


def test_samples_the_wrong_way_round():
    rng = np.random.default_rng(3)
    samples, features = 12, 10
    structure = rng.normal(0, 0.07, (features, 3)) * [1, 1, 0.4]
    rotation = Rotation.random(samples, random_state=3).as_matrix()
    translation = np.array([0, 0, 1.5]) + rng.normal(0, 0.1, (samples, 3))
    parameters = ModelParameters(
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros(0),
        structure,
        np.zeros(features, int),
        np.eye(3)[None],
        np.zeros((1, 3)),
        np.array([[FOCAL, FOCAL, 320.0, 240.0, 0.0, 0.0]]),
    )
    places = np.einsum("tij,mj->tmi", rotation, structure) + translation[:, None]
    pixels = FOCAL * places[..., :2] / places[..., 2:] + [320, 240] + rng.normal(0, 0.3, (samples, features, 2))
    problem = PixelProblem(pixels[:, None], np.zeros(features, int), 0, Free(), "pose")
    true = PixelState(parameters, np.zeros((samples, 0)), rotation, translation)
    wrong = reversed_state(problem, true)
    turned = np.arange(samples) % 3 == 0
    start = PixelState(
        parameters,
        true.joints,
        np.where(turned[:, None, None], wrong.rotation, rotation),
        np.where(turned[:, None], wrong.translation, translation),
    )
    settled, _ = settle_poses(problem, start)
    assert settled.rotation is not None
    assert (rotation_errors(settled.rotation, rotation) > 0.5).sum() >= 2  # other minima, not just far starts
    found, _ = better_poses(problem, settled)
    assert found.rotation is not None
    assert rotation_errors(found.rotation, rotation).max() < 0.1


def rotation_errors(found, true):
    """Angles (T,) [rad]."""
    return np.linalg.norm(Rotation.from_matrix(found @ true.swapaxes(1, 2)).as_rotvec(), axis=1)


@pytest.mark.parametrize("distortion", [(0.0, 0.0), (0.1, -0.05), (-0.2, 0.1)])
def test_rays_undo_the_lens(distortion):
    rng = np.random.default_rng(4)
    intrinsics = np.array([[620.0, 610.0, 320.0, 240.0, *distortion], [500.0, 505.0, 300.0, 250.0, *distortion]])
    exact = rng.uniform(-0.4, 0.4, (3, 2, 5, 2))
    squared = (exact**2).sum(axis=-1, keepdims=True)
    distorted = exact * (1 + squared * (distortion[0] + squared * distortion[1]))
    pixels = distorted * intrinsics[:, None, :2] + intrinsics[:, None, 2:4]
    pixels[1, 0, 2] = exact[1, 0, 2] = np.nan
    # OpenCV stops after a few steps: within a hundredth of a pixel, as first poses need it.
    np.testing.assert_allclose(rays(pixels, intrinsics), exact, atol=0.01 / 620)
