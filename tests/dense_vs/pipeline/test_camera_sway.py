"""A camera that sways by a motion that is known: it is found and taken out; a fixed one and one in the hand stay."""

import cv2
import numpy as np
import pytest

from dense_vs.body.self_body import SelfBody
from dense_vs.errors import DenseVSError
from dense_vs.jacobian import DenseJacobian
from dense_vs.pipeline import FramePipeline

HEIGHT, WIDTH = 120, 160
BODY = (slice(40, 90), slice(60, 120))
TRUE = np.array([[40.0, 5.0], [-8.0, 35.0]])  # px/rad
FRAMES = 90


def texture(seed):
    noise = np.random.default_rng(seed).standard_normal((HEIGHT + 80, WIDTH + 80)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(128 + 45 * smooth / smooth.std(), 0, 255).astype(np.float32)


def sway(k):
    """Shift [px] and turn [rad] of the camera's image at a frame."""
    return np.array([5 * np.sin(0.05 * k), 3 * np.cos(0.037 * k) - 3]), 0.01 * np.sin(0.06 * k)


def camera(k, swaying):
    shift, turn = sway(k) if swaying else (np.zeros(2), 0.0)
    matrix = cv2.getRotationMatrix2D((0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)), -np.degrees(turn), 1.0)
    matrix[:, 2] += shift
    return matrix


def posture(k):
    return np.array([0.15 * np.sin(0.21 * k), 0.15 * np.sin(0.29 * k + 1)])


def run(swaying, **options):
    """A plate that two joints shift before a wall, seen by a camera."""
    wall, plate = texture(0), texture(1)
    body = SelfBody(synchronous=True, device="cpu")
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=2, device="cpu", threads=1)
    pipeline = FramePipeline(estimator, body=body, baseline=0.0, **options)
    for k in range(FRAMES):
        x, y = TRUE @ (posture(k) - posture(0))
        to_view = camera(k, swaying)
        crop = to_view.copy()
        crop[:, 2] = to_view @ [-40.0, -40.0, 1.0]  # the wall goes on outside of the image
        image = cv2.warpAffine(wall, crop, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
        mask = np.zeros((HEIGHT, WIDTH), np.float32)
        mask[BODY] = 1
        moved = np.float32([[1, 0, x], [0, 1, y]])
        both = (np.vstack([to_view, [0, 0, 1]]) @ np.vstack([moved, [0, 0, 1]]))[:2]
        where = cv2.warpAffine(mask, both, (WIDTH, HEIGHT))
        of_plate = cv2.warpAffine(plate[40:-40, 40:-40], both, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
        shown = np.clip(image + where * (of_plate - image), 0, 255).astype(np.uint8)
        pipeline.process(np.repeat(shown[..., None], 3, axis=2), k / 30, posture(k))
    return pipeline, where > 0.5


def errors(pipeline, own):
    """Error of J on the plate away from its outline, and J's size on the wall, in medians over the pixels."""
    inner = cv2.erode(own.astype(np.uint8), np.ones((13, 13))) > 0
    wall = cv2.dilate(own.astype(np.uint8), np.ones((25, 25))) == 0
    J = pipeline.estimator.to_numpy()
    off = np.linalg.norm(J[inner] - TRUE, axis=(1, 2)) / np.linalg.norm(TRUE)
    return np.median(off), np.median(np.linalg.norm(J[wall], axis=(1, 2)))


def test_sway_is_found_and_taken_out():
    (plain, own), (steady, _) = run(True), run(True, sway=True)
    found = steady.camera_sway
    assert found is not None
    assert plain.camera_sway is None
    assert found.foretold < 0.5
    assert (found.unknown, found.taken) == (0, FRAMES - 1 - 19)  # 20 motions say whose they are
    went = sway(FRAMES - 1)[0] - sway(19)[0]
    np.testing.assert_allclose(found.traveled, went, atol=0.5)  # what is less than 0.35 px waits
    error, wall = errors(steady, own)
    error_before, wall_before = errors(plain, own)
    assert error < error_before
    assert wall < 0.5 * wall_before
    np.testing.assert_array_equal(steady.labels(), plain.labels())  # told from the flow as it is


def test_a_fixed_camera_changes_nothing():
    (plain, _), (steady, _) = run(False), run(False, sway=True)
    assert steady.camera_sway is not None
    assert np.abs(steady.camera_sway.traveled).max() == 0
    J, J_plain = steady.estimator.to_numpy(), plain.estimator.to_numpy()
    assert np.median(np.abs(J - J_plain)) < 0.2
    assert np.mean(steady.labels() == plain.labels()) > 0.995


def test_a_camera_that_the_joints_move_is_left_alone(scene, postures):
    """The whole image moves with the joints, as where the robot carries its camera: that motion is J's."""
    estimators = []
    for options in ({}, {"sway": True}):
        estimator = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu", threads=1)
        pipeline = FramePipeline(estimator, baseline=0.0, **options)
        for k in range(60):
            pipeline.process(scene.image(postures[k]), k / 30, postures[k])
        estimators.append(estimator)
    assert pipeline.camera_sway is not None
    assert pipeline.camera_sway.taken == 0
    np.testing.assert_array_equal(estimators[0].jacobian, estimators[1].jacobian)


def test_no_flag():
    estimator = DenseJacobian(height=48, width=64, joints=2, device="cpu")
    with pytest.raises(DenseVSError, match="sway is 'yes'"):
        FramePipeline(estimator, sway="yes")
