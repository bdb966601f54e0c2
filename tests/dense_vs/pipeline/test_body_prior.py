"""J is drawn to a known body's where the two agree; the images are a textured plane that one joint shifts."""

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.jacobian import DenseJacobian
from dense_vs.pipeline import BodyPrior, FramePipeline

SIZE = (64, 80)
TRUE = np.array([[40.0], [-20.0]], np.float32)  # px/rad


def known(J):
    body = np.zeros(SIZE, bool)
    body[10:50, 10:60] = True
    image = np.zeros((*SIZE, 2, 1), np.float32)
    image[body] = J
    return lambda q: (image, body)


def run(pipeline, frames=30):
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (200, 200)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 2.0)
    texture = (255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
    for k in range(frames):
        q = np.array([0.25 * np.sin(0.35 * k)])
        x, y = TRUE[:, 0] * q
        move = np.float32([[1, 0, x - 60], [0, 1, y - 60]])
        image = cv2.warpAffine(texture, move, SIZE[::-1], flags=cv2.INTER_CUBIC)
        pipeline.process(image, k / 30, q)


def pipeline_with(prior):
    estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=1, device="cpu", threads=1, on_bad_flow="skip")
    return FramePipeline(estimator, prior=prior)


def test_the_first_frame_starts_from_the_model():
    pipeline = pipeline_with(BodyPrior(known(TRUE)))
    pipeline.process(np.zeros(SIZE, np.uint8), 0.0, [0.0])
    J = pipeline.estimator.jacobian
    np.testing.assert_array_equal(J[20, 20], TRUE)
    assert (J[0, 0] == 0).all()


def test_a_model_that_is_right_keeps_its_say():
    prior = BodyPrior(known(TRUE))
    pipeline = pipeline_with(prior)
    run(pipeline)
    assert prior.agreement > 0.8
    np.testing.assert_allclose(pipeline.estimator.jacobian[30, 30], TRUE, atol=0.5)


def test_a_model_that_is_wrong_loses_its_say():
    prior = BodyPrior(known(-TRUE))
    pipeline = pipeline_with(prior)
    run(pipeline, 60)  # J is relearned once the model is out
    assert not prior.agrees
    alone = pipeline_with(None)
    run(alone, 60)
    found, expected = pipeline.estimator.jacobian[15:45, 15:55], alone.estimator.jacobian[15:45, 15:55]
    assert np.median(np.linalg.norm(found - expected, axis=(2, 3))) < 0.1 * np.linalg.norm(TRUE)


def test_blend_draws_by_its_share_and_refuses_what_does_not_fit():
    estimator = DenseJacobian(height=4, width=5, joints=2, device="cpu", threads=1)
    other = np.ones((4, 5, 2, 2), np.float32)
    share = np.zeros((4, 5), np.float32)
    share[1, 2] = 0.25
    estimator.blend(other, share)
    assert (estimator.jacobian[1, 2] == 0.25).all()
    assert estimator.to_numpy().sum() == 1.0
    for bad, message in (
        ((other, share + 1), "share is from"),
        ((other[:2], share), "jacobian"),
        ((other, 0.5), "share"),
    ):
        with pytest.raises(DenseVSError, match=message):
            estimator.blend(*bad)
    assert estimator.to_numpy().sum() == 1.0
    with pytest.raises(DenseVSError, match="worlds"):
        DenseJacobian(height=4, width=5, joints=2, worlds=2, device="cpu").blend(other, share)
    with pytest.raises(DenseVSError, match="share"):
        BodyPrior(known(TRUE), share=0)


def two_joints():
    """An estimator whose J is 1 everywhere, and a body that knows J to be 5 on half of the image."""
    estimator = DenseJacobian(height=4, width=6, joints=2, device="cpu", threads=1)
    estimator.blend(np.ones((4, 6, 2, 2), np.float32), np.ones((4, 6), np.float32))
    body = np.zeros((4, 6), bool)
    body[:, 3:] = True
    return estimator, lambda q: (np.where(body[..., None, None], np.float32(5), 0) * np.ones((2, 2), np.float32), body)


def test_what_the_model_does_not_speak_of_stays():
    # It speaks of both joints moving alike only: of a step's part along (1, 1).
    told = np.full((2, 2), 0.5, np.float32)
    estimator, model = two_joints()
    J, body = model(None)
    BodyPrior(lambda q: (J @ told, body), told=lambda q: told).begin(estimator, np.zeros(2))
    found = estimator.to_numpy()
    assert (found[:, :3] == 1).all()
    np.testing.assert_allclose(found[:, 3:] @ np.array([1.0, 1.0]), 10, rtol=1e-6)  # the model's
    np.testing.assert_allclose(found[:, 3:] @ np.array([1.0, -1.0]), 0, atol=1e-6)  # as it was
    before = np.array([[3.0, 1.0], [2.0, 2.0]], np.float32)
    estimator.blend(np.broadcast_to(before, (4, 6, 2, 2)), np.ones((4, 6), np.float32))
    BodyPrior(lambda q: (J @ told, body), told=lambda q: told).begin(estimator, np.zeros(2))
    np.testing.assert_allclose(estimator.to_numpy()[0, 4] @ np.array([1.0, -1.0]), [2, 0], atol=1e-6)


class Known:
    size = (4, 6)
    joint_count = 2

    def known(self, q):
        return two_joints()[1](q)


class Remembered(Known):
    def told(self, q):
        return np.eye(2, dtype=np.float32)


def test_a_body_serves_images_of_any_scale():
    estimator = DenseJacobian(height=8, width=12, joints=2, device="cpu", threads=1)
    prior = BodyPrior.of(Known(), (8, 12), 2)
    prior.begin(estimator, np.zeros(2))
    J = estimator.to_numpy()
    assert (J[:, 8:] == 10).all()  # as many px/rad as there are more pixels
    assert (J[:, :4] == 0).all()
    assert prior.told is None
    remembered = BodyPrior.of(Remembered(), (4, 6), 2)
    assert remembered.told is not None
    assert remembered.share < prior.share
    for size, joints in (((4, 6), 3), ((4, 8), 2)):
        with pytest.raises(DenseVSError, match="the body is of 6 x 4 px and 2 joints; expected"):
            BodyPrior.of(Known(), size, joints)
