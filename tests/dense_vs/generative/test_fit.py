"""Learning from read joints, against pixels of postures that were not learned from."""

import numpy as np
import pytest
from arm_recordings import record

from dense_vs.generative import GenerativeModel

# 0.5 px of noise on each coordinate alone give a mean distance of 0.627 px.


def test_two_cameras(ur5, model):
    assert ur5.validation_error(model) < 0.7
    report = model.report
    assert report.converged
    assert [stage.name for stage in report.stages] == ["cameras and structure", "kinematics", "end to end"]
    assert report.losses[-1] < report.stages[-1].initial_loss
    assert report.pixel_sigma == pytest.approx(0.5, rel=0.1)
    assert not report.outliers
    assert not report.unobservable


@pytest.mark.parametrize(("name", "spread"), [("baxter", 0.3), ("ur5", 1.0)])
def test_other_arms_and_wider_motion(name, spread):
    case = record(name, 3, 30, spread=spread)
    assert case.validation_error(GenerativeModel.fit(case.observations())) < 0.75


def test_few_samples():
    case = record("ur5", 4, 15)
    assert case.validation_error(GenerativeModel.fit(case.observations())) < 0.9


def test_one_camera():
    case = record("ur5", 1, 40, cameras=1)
    assert case.validation_error(GenerativeModel.fit(case.observations())) < 0.8


def test_features_that_face_all_ways_and_markers_missing():
    case = record("ur5", 2, 50, facing=0.0)
    pixels = case.pixels.copy()
    pixels[np.random.default_rng(0).uniform(size=pixels.shape[:3]) < 0.2] = np.nan
    assert case.validation_error(GenerativeModel.fit(case.observations(pixels=pixels))) < 0.85


@pytest.mark.parametrize("intrinsics", ["off", "unknown"])
def test_poor_intrinsics(ur5, intrinsics):
    off = ur5.intrinsics * [[1.3, 1.3, 1, 1], [0.75, 0.75, 1, 1]]
    guess = off if intrinsics == "off" else None
    assert ur5.validation_error(GenerativeModel.fit(ur5.observations(intrinsics=guess))) < 0.72


def test_denavit_hartenberg(ur5):
    model = GenerativeModel.fit(ur5.observations(), kinematics="dh")
    assert ur5.validation_error(model) < 0.7
    dh = model.denavit_hartenberg
    hand = dh.frames(ur5.unseen_joints)[:, -1]
    at_home = dh.frames(model.parameters.home[None])[0, -1]
    motions = hand @ np.linalg.inv(at_home)
    world = np.einsum("tij,mj->tmi", motions[:, :3, :3], model.parameters.features) + motions[:, None, :3, 3]
    p = np.einsum("cij,tmj->tcmi", model.parameters.camera_rotation, world)
    p += model.parameters.camera_translation[:, None]
    pixels = p[..., :2] / p[..., 2:] * model.parameters.intrinsics[:, None, :2]
    np.testing.assert_allclose(
        pixels + model.parameters.intrinsics[:, None, 2:4], model.pixels(ur5.unseen_joints), atol=1e-6
    )


def test_distortion():
    case = record("ur5", 2, 40, distortion=-0.15)
    plain = case.validation_error(GenerativeModel.fit(case.observations()))
    model = GenerativeModel.fit(case.observations(), distortion=1)
    assert case.validation_error(model) < 0.7 < plain
    np.testing.assert_allclose(model.parameters.intrinsics[:, 4], -0.15, atol=0.05)


def test_features_on_earlier_links(ur5):
    links = np.array([6] * 8 + [4] * 2 + [5] * 2)
    case = record("ur5", 5, 50, links=links)
    model = GenerativeModel.fit(case.observations(feature_link=links))
    assert case.validation_error(model) < 0.75


def test_swapped_labels_are_named(ur5, model):
    pixels, swapped = ur5.pixels.copy(), []
    rng = np.random.default_rng(1)
    for sample in (3, 11, 20, 29, 37, 44):
        camera = int(rng.integers(2))
        seen = np.flatnonzero(np.isfinite(pixels[sample, camera, :, 0]))
        a, b = sorted(rng.choice(seen, 2, replace=False).tolist())
        if np.linalg.norm(pixels[sample, camera, a] - pixels[sample, camera, b]) > 10:
            pixels[sample, camera, [a, b]] = pixels[sample, camera, [b, a]]
            swapped.append((sample, camera, a, b))
    assert len(swapped) >= 3
    found = GenerativeModel.fit(ur5.observations(pixels=pixels))
    assert set(found.report.swapped) == set(swapped)
    assert len(found.report.outliers) == 2 * len(swapped)
    assert ur5.validation_error(found) < ur5.validation_error(model) + 0.02


def test_the_published_method(ur5):
    model = GenerativeModel.fit(ur5.observations(), kinematics="dh", method="paper")
    stages = model.report.stages
    assert [stage.name for stage in stages] == ["cameras and structure", "kinematics", "end to end"]
    assert stages[1].loss < 0.2 * stages[1].initial_loss
    assert stages[2].loss < 0.6 * stages[2].initial_loss
    assert ur5.validation_error(model) < 10.0
