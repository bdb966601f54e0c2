from dataclasses import replace

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm


@pytest.fixture(scope="module")
def arm():
    return make_observed_arm("baxter", seed=2)


def test_projection_is_opencvs(arm):
    joints = arm.chain.home + 0.1
    pose = arm.chain.flange_pose(joints)
    points = arm.features @ pose[:3, :3].T + pose[:3, 3]
    for camera, pixels in zip(arm.cameras, arm.projections(pose[None])[0], strict=True):
        fx, fy, cx, cy = camera.intrinsics
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        rotation, shift = cv2.Rodrigues(camera.T_camera_world[:3, :3])[0], camera.T_camera_world[:3, 3]
        expected = cv2.projectPoints(points, rotation, shift, matrix, None)[0][:, 0]
        np.testing.assert_allclose(pixels, expected, atol=1e-6)


def test_a_feature_that_faces_away_is_hidden(arm):
    home = arm.chain.home[None]
    seen = np.isfinite(arm.pixels(home)[..., 0])
    turned = np.isfinite(replace(arm, normals=-arm.normals).pixels(home)[..., 0])
    assert seen.sum() >= 16
    assert not np.any(seen & turned)


def test_a_feature_outside_the_image_is_hidden(arm):
    small = tuple(replace(camera, size=(240, 320)) for camera in arm.cameras)
    pixels = replace(arm, cameras=small).pixels(arm.chain.home + np.random.default_rng(0).normal(0, 0.3, (50, 7)))
    shown = pixels[np.isfinite(pixels[..., 0])]
    assert np.all(shown >= 0)
    assert np.all(shown <= (319, 239))
    assert len(shown) < np.isfinite(arm.pixels(np.tile(arm.chain.home, (50, 1)))[..., 0]).sum()


def test_too_little_to_see_is_refused():
    with pytest.raises(DenseVSError, match="0 cameras and 12 features"):
        make_observed_arm("ur5", seed=0, cameras=0)
    with pytest.raises(DenseVSError, match="2 cameras and 3 features"):
        make_observed_arm("ur5", seed=0, features=3)
