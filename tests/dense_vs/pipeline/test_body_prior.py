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
