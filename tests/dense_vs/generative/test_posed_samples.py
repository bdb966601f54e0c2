"""Samples posed one by one by two cameras, and all together by one, from exact pixels of an arm."""

from dataclasses import replace

import numpy as np
import pytest
from exact_arm import carried, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative.reconstruction.factorization import factorize
from dense_vs.generative.reconstruction.sample_alignment import align_samples


@pytest.fixture(scope="module")
def arm():
    return exact_arm()


def rays_of(arm):
    center, focal = arm.parameters.intrinsics[:, None, 2:4], arm.parameters.intrinsics[:, None, :2]
    return (arm.pixels[:, :, :8] - center) / focal


def apart(one, other, structure, truth):
    """Largest distance of the posed structures, each after the rigid motion of the hand's axes to the true ones."""
    middle, goal = structure.mean(axis=0), truth.mean(axis=0)
    turn, _ = Rotation.align_vectors(truth - goal, structure - middle)
    assert np.abs(turn.apply(structure - middle) + goal - truth).max() < 1e-3
    return np.abs(one - other).max()


@pytest.mark.parametrize("hidden", ["nothing", "one camera in some samples", "single features", "gross"])
def test_every_sample_is_posed_by_what_the_cameras_see(arm, hidden):
    p, flat = arm.parameters, rays_of(arm)
    seen = np.ones(flat.shape[:3], bool)
    if hidden == "one camera in some samples":
        seen[3:9, 1] = False  # these are resected
    elif hidden == "single features":
        seen[:, 0, 6], seen[2:5, :, 1] = False, False
    elif hidden == "gross":
        flat = flat.copy()
        flat[5, 0, 2] += 0.05
    rotation, shift, structure, posed = align_samples(
        flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation
    )
    assert posed.all()
    true = np.array([[carried(p, q, 3, feature) for feature in p.features[:8]] for q in arm.joints])
    found = np.einsum("tij,mj->tmi", rotation, structure) + shift[:, None]
    assert apart(found, true, structure, p.features[:8]) < (0.02 if hidden == "gross" else 1e-3)


def test_samples_without_three_features_off_a_line_cannot_be_aligned(arm):
    p, flat = arm.parameters, rays_of(arm)
    seen = np.zeros(flat.shape[:3], bool)
    seen[:, :, :2] = True
    with pytest.raises(DenseVSError, match="three features, off a line"):
        align_samples(flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation)
    seen[4, :, :4] = True  # one sample is enough, for itself
    _, _, structure, posed = align_samples(flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation)
    assert posed.tolist() == [t == 4 for t in range(14)]
    assert np.isfinite(structure[:, 0]).tolist() == [True] * 4 + [False] * 4


def far_arm(times=30, **changes):
    """The hand so far away that its picture is nearly a scaled orthographic one."""
    arm = exact_arm(**changes)
    p = replace(arm.parameters, camera_translation=arm.parameters.camera_translation + np.array([0, 0, 2.0 * times]))
    p.intrinsics[:, :2] *= times
    arm.parameters, arm.pixels = p, project(p, arm.joints)
    return arm


@pytest.mark.parametrize("hidden", [False, True])
def test_one_camera_tells_structure_and_motion_up_to_size_and_depth_reversal(hidden):
    arm = far_arm(samples=12)
    pixels = arm.pixels[:, :, :8].copy()
    if hidden:
        pixels[::3, 0, 5] = np.nan
        pixels[4, 0, 4:] = np.nan  # four are enough for a frame,
        pixels[7, 0, 3:] = np.nan  # three are not
    found = factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))
    truth = arm.parameters.features[:8] - arm.parameters.features[:8].mean(axis=0)
    off = []
    for one in found:
        assert one.posed.tolist() == [not (hidden and t == 7) for t in range(12)]
        assert one.placed_cameras.tolist() == [True, False]
        structure = one.structure - one.structure.mean(axis=0)
        structure = structure * np.linalg.norm(truth) / np.linalg.norm(structure)
        turn, _ = Rotation.align_vectors(truth, structure)
        off.append(np.abs(turn.apply(structure) - truth).max())
        here = np.einsum("tij,mj->tmi", one.rotation, one.structure) + one.translation[:, None]
        seen = np.isfinite(pixels[:, 0, :, 0]) & one.posed[:, None]
        picture = arm.parameters.intrinsics[0, :2] * here[..., :2] / here[..., 2:] + arm.parameters.intrinsics[0, 2:4]
        assert np.abs(picture - pixels[:, 0])[seen].max() < 8.0  # of a picture of some 300 px
    assert min(off) < 0.02  # of 0.5
    assert max(off) > 0.02  # the other one is its mirror image


@pytest.mark.parametrize(("frames", "features", "enough"), [(2, 8, False), (12, 3, False), (12, 4, True)])
def test_one_camera_needs_three_frames_of_four_features(frames, features, enough):
    arm = far_arm(samples=12)
    pixels = np.full_like(arm.pixels[:, :, :8], np.nan)
    pixels[:frames, :, :features] = arm.pixels[:frames, :, :features]
    if enough:
        assert len(factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))) == 2
    else:
        with pytest.raises(DenseVSError, match="structure and motion from one camera"):
            factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))


def test_features_in_a_plane_are_refused():
    arm = far_arm(3000, samples=12)
    p = replace(arm.parameters, features=arm.parameters.features * [1, 1, 0] + [0, 0, 0.5])
    with pytest.raises(DenseVSError, match="plane or line"):
        factorize(project(p, arm.joints)[:, :, :8], p.intrinsics, 0, np.random.default_rng(0))
