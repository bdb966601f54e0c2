"""A frame through the estimator: the right flow and joint step reach it, or nothing changes."""

import cv2
import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError, FlowEstimator, FramePipeline


def make(scene, scale=1.0, **options):
    height, width = round(scene.height * scale), round(scene.width * scale)
    estimator = DenseJacobian(height=height, width=width, joints=4, device="cpu", **options)
    return FramePipeline(estimator, scale=scale)


def test_feeds_flow_and_joint_step(scene, postures):
    pipeline = make(scene)
    by_hand = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu")
    flow = FlowEstimator(height=scene.height, width=scene.width)
    for k in range(4):
        frame = pipeline.process(scene.image(postures[k]), 0.1 * k, postures[k])
        assert frame is pipeline.frame
        assert frame.time == 0.1 * k
        np.testing.assert_array_equal(frame.positions, postures[k])
        if k == 0:
            assert frame.flow is None
            assert frame.dq is None
            continue
        assert frame.dq is not None
        np.testing.assert_allclose(frame.dq, postures[k] - postures[k - 1])
        expected = flow(scene.image(postures[k - 1]), scene.image(postures[k]))
        np.testing.assert_array_equal(frame.flow, expected)
        by_hand.update(expected, postures[k] - postures[k - 1])
    assert pipeline.estimator.updates == 3
    np.testing.assert_array_equal(pipeline.estimator.jacobian, by_hand.jacobian)


def test_colour_images_count_as_their_grey(scene, postures):
    grey, colour = make(scene), make(scene)
    for k in range(3):
        image = scene.image(postures[k])
        grey.process(image, k, postures[k])
        colour.process(np.repeat(image[..., None], 3, axis=2), k, postures[k])
    np.testing.assert_array_equal(grey.estimator.jacobian, colour.estimator.jacobian)


def test_scale(scene, postures):
    pipeline = make(scene, scale=0.5)
    for k in range(2):
        image = scene.image(postures[k])
        frame = pipeline.process(image, k, postures[k])
        small = cv2.resize(image, (scene.width // 2, scene.height // 2), interpolation=cv2.INTER_AREA)
        np.testing.assert_array_equal(frame.gray, small)
    halved = scene.flow(postures[0], postures[1])[::2, ::2] / 2
    assert np.median(np.linalg.norm(frame.flow - halved, axis=2)[8:-8, 8:-8]) < 0.15


def test_a_camera_may_reuse_its_buffer(scene, postures):
    """Cameras often hand out one buffer over and over."""
    fresh, reused, buffer = make(scene), make(scene), np.empty((scene.height, scene.width), np.uint8)
    for k in range(3):
        buffer[...] = scene.image(postures[k])
        reused.process(buffer, k, postures[k])
        fresh.process(scene.image(postures[k]), k, postures[k])
    np.testing.assert_array_equal(fresh.estimator.jacobian, reused.estimator.jacobian)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_refusals_change_nothing(scene, postures, scale):
    disturbed, undisturbed = make(scene, scale), make(scene, scale)
    image = scene.image(postures[1])
    size = rf"expected {round(128 * scale)} x {round(96 * scale)}"
    bad = [
        ((image[:80], 1.0, postures[1]), size),
        ((np.zeros((48, 64), np.uint8) if scale == 1 else np.zeros((48, 64, 3), np.uint8), 1.0, postures[1]), size),
        ((image.astype(float), 1.0, postures[1]), "dtype float64; expected uint8"),
        ((image.astype(np.int64), 1.0, postures[1]), "dtype int64; expected uint8"),
        ((image > 3, 1.0, postures[1]), "dtype bool; expected uint8"),
        ((np.zeros((96, 128, 4), np.uint8), 1.0, postures[1]), r"shape \(96, 128, 4\).*expected uint8 of shape"),
        ((np.zeros((0, 0), np.uint8), 1.0, postures[1]), "image .*expected"),
        ((None, 1.0, postures[1]), "image has .*expected uint8"),
        ((image, 0.0, postures[1]), "image time stamp is 0.0 s after 0.0; expected increasing finite seconds"),
        ((image, -1.0, postures[1]), "image time stamp is -1.0 s after 0.0"),
        ((image, np.nan, postures[1]), "image time stamp is nan s"),
        ((image, 1.0, postures[1][:3]), r"positions has shape \(3,\)"),
        ((image, 1.0, np.full(4, np.nan)), "positions is .*expected finite"),
    ]
    for pipeline in (disturbed, undisturbed):
        pipeline.process(scene.image(postures[0]), 0.0, postures[0])
    for arguments, message in bad:
        before = disturbed.frame
        with pytest.raises(DenseVSError, match=message):
            disturbed.process(*arguments)
        assert disturbed.frame is before
    for pipeline in (disturbed, undisturbed):
        pipeline.process(image, 1.0, postures[1])
    assert disturbed.estimator.updates == 1
    np.testing.assert_array_equal(disturbed.estimator.jacobian, undisturbed.estimator.jacobian)


def test_refuses_parts_that_do_not_fit(scene):
    estimator = DenseJacobian(height=96, width=128, joints=4, device="cpu")
    with pytest.raises(DenseVSError, match=r"flow is for images of \(48, 64\); the estimator has \(96, 128\)"):
        FramePipeline(estimator, FlowEstimator(height=48, width=64))
    for scale in (0, -1, 1.5, float("nan")):
        with pytest.raises(DenseVSError, match=r"scale is .*expected a number above 0 and at most 1"):
            FramePipeline(estimator, scale=scale)
    with pytest.raises(DenseVSError, match="estimator has 3 worlds; a pipeline takes one"):
        FramePipeline(DenseJacobian(height=96, width=128, joints=4, worlds=3, device="cpu"))
