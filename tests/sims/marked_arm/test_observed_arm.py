from dataclasses import replace

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.observed_arm import PinholeCamera, _placed_camera, _seen_by, make_observed_arm


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
    with pytest.raises(DenseVSError, match="cameras is 0"):
        make_observed_arm("ur5", seed=0, cameras=0)
    with pytest.raises(DenseVSError, match="features is 3"):
        make_observed_arm("ur5", seed=0, features=3)


@pytest.mark.parametrize("name", ["ur5", "baxter"])
def test_features_face_the_cameras_within_sixty_degrees(name):
    """At home; the cosine of what is drawn evenly over a cap of a sphere is even between that of 60 degrees and 1."""
    arm = make_observed_arm(name, seed=3, cameras=3, features=400)
    home = arm.chain.flange_pose(arm.chain.home)
    center = home[:3, 3] + 0.06 * home[:3, 2]
    ways = [camera.center - center for camera in arm.cameras]
    toward = np.sum([way / np.linalg.norm(way) for way in ways], axis=0)
    cosines = arm.normals @ home[:3, :3].T @ toward / np.linalg.norm(toward)
    assert 0.5 < cosines.min() < 0.51
    assert np.median(cosines) == pytest.approx(0.75, abs=0.03)
    np.testing.assert_allclose(np.linalg.norm(arm.normals, axis=1), 1.0)
    size = np.linalg.norm(arm.features - [0.0, 0.0, 0.06], axis=1)
    assert 0.042 <= size.min() < 0.043
    assert 0.083 < size.max() <= 0.084


@pytest.mark.parametrize(("cameras", "arc"), [(1, [0.0]), (2, [-0.7, 0.7]), (3, [-0.7, 0.0, 0.7])])
def test_cameras_stand_on_an_arc_within_a_tenth_of_a_radian(cameras, arc):
    off = []
    for seed in range(60):
        arm = make_observed_arm("ur5", seed=seed, cameras=cameras, features=4)
        home = arm.chain.flange_pose(arm.chain.home)
        ways = np.array([camera.center for camera in arm.cameras]) - home[:3, 3] - 0.06 * home[:3, 2]
        off.append(np.arctan2(ways[:, 1], ways[:, 0]) - arc)
    off = np.array(off)
    assert np.abs(off).max() <= 0.1 + 1e-9
    assert (off.max(axis=0) > 0.085).all()
    assert (off.min(axis=0) < -0.085).all()


class Middle:
    """Draws the middle of every range, or a share of it; a turn about the optical axis as told."""

    def __init__(self, roll=0.0, share=0.5):
        self.roll, self.share = roll, share

    def uniform(self, low, high, size=None):
        return np.full(() if size is None else size, low + self.share * (high - low))

    def normal(self, mean, sigma, size=None):
        return mean + self.roll if size is None else np.full(size, mean)


@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.0])
def test_a_camera_stands_upright_and_looks_at_the_hand(azimuth):
    center = np.array([0.5, 0.1, 0.3])
    camera = _placed_camera(Middle(), center, azimuth)
    way = camera.center - center
    assert np.linalg.norm(way) == pytest.approx(1.7)
    assert np.arctan2(way[1], way[0]) == pytest.approx(azimuth)
    assert np.arcsin(way[2] / 1.7) == pytest.approx(0.425)  # between 0.25 and 0.6
    np.testing.assert_allclose(camera.project(center), [319.5, 239.5], atol=1e-9)
    # A point above the hand is above it in the image, one on the camera's right to the right.
    beside = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    above = camera.project(center + np.array([0.0, 0.0, 0.1]))
    assert above[0] == pytest.approx(319.5)
    assert above[1] < 220
    right = camera.project(center + 0.1 * beside)
    np.testing.assert_allclose(right, [319.5 + 620 * 0.1 / 1.7, 239.5], atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(camera.T_camera_world[:3, :3]), 1.0)


@pytest.mark.parametrize(
    ("share", "distance", "elevation", "focal", "off"),
    [(0.0, 1.53, 0.25, 620 * 0.95 * 0.998, -6.0), (1.0, 1.87, 0.6, 620 * 1.05 * 1.002, 6.0)],
)
def test_the_ends_of_what_is_drawn_of_a_camera(share, distance, elevation, focal, off):
    center = np.array([0.5, 0.1, 0.3])
    camera = _placed_camera(Middle(share=share), center, 0.0)
    way = camera.center - center
    assert np.linalg.norm(way) == pytest.approx(distance)
    assert np.arcsin(way[2] / distance) == pytest.approx(elevation)
    np.testing.assert_allclose(camera.intrinsics, [focal, focal, 319.5 + off, 239.5 + off])


def test_a_camera_is_turned_about_its_axis():
    center = np.array([0.5, 0.1, 0.3])
    turned = _placed_camera(Middle(0.1), center, 0.0)
    np.testing.assert_allclose(turned.project(center), [319.5, 239.5], atol=1e-9)
    x, y = turned.project(center + np.array([0.0, 0.1, 0.0])) - [319.5, 239.5]
    assert np.arctan2(y, x) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("pixel", "seen"),
    [
        ((0, 0), True),
        ((639, 479), True),
        ((-0.5, 0), False),
        ((639.5, 0), False),
        ((0, -0.5), False),
        ((0, 479.5), False),
    ],
)
def test_the_outermost_pixels_belong_to_the_image(pixel, seen):
    camera = PinholeCamera(np.array([512.0, 512.0, 320.0, 240.0]), np.eye(4))
    point = np.array([[*(np.array(pixel) - [320.0, 240.0]) / 512.0, 1.0]])
    assert np.isfinite(_seen_by(camera, point, -point)).all() == seen


def test_a_point_in_the_plane_of_the_lens_has_no_pixel():
    camera = PinholeCamera(np.array([512.0, 512.0, 320.0, 240.0]), np.eye(4))
    pixels = camera.project(np.array([[0.5, 0.25, 0.5], [0.5, 0.25, 0.0], [0.5, 0.25, -0.5]]))
    np.testing.assert_allclose(pixels, [[832.0, 496.0], [np.nan, np.nan], [np.nan, np.nan]])
