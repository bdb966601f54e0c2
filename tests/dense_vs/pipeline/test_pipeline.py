"""A frame through the estimator: the right flow and joint step reach it, or nothing changes."""

from typing import Any

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


def test_color_images_count_as_their_gray(scene, postures):
    gray, color = make(scene), make(scene)
    for k in range(3):
        image = scene.image(postures[k])
        gray.process(image, k, postures[k])
        color.process(np.repeat(image[..., None], 3, axis=2), k, postures[k])
    np.testing.assert_array_equal(gray.estimator.jacobian, color.estimator.jacobian)


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
        ((image, np.nan, postures[1]), "image time stamp is nan; expected a finite number"),
        ((image, 1.0, postures[1][:3]), r"positions has shape \(3,\)"),
        ((image, 1.0, np.full(4, np.nan)), "positions is .*expected finite"),
        ((image, 1.0, postures[1], "late"), "faults are 'late'; expected a tuple of Fault"),
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
        with pytest.raises(DenseVSError, match=r"scale is .*expected a finite number above 0 and at most 1"):
            FramePipeline(estimator, scale=scale)
    with pytest.raises(DenseVSError, match="estimator has 3 worlds; a pipeline takes one"):
        FramePipeline(DenseJacobian(height=96, width=128, joints=4, worlds=3, device="cpu"))
    with pytest.raises(DenseVSError, match="estimator is a str without update, predict, at; expected methods"):
        FramePipeline("x")
    parts: list[tuple[str, Any]] = [("flow", "dis"), ("flow", len), ("body", True), ("prior", 3), ("watched", "no")]
    for name, part in [*parts, ("before_update", 1)]:
        with pytest.raises(DenseVSError, match=f"^{name} is "):
            FramePipeline(estimator, **{name: part})


@pytest.mark.parametrize("wrong", ["x", None, [1.0], 1j, [[1.0], [1.0, 2.0]], ["1"] * 4])
def test_steps_and_places_are_checked(wrong):
    pipeline = FramePipeline(DenseJacobian(height=96, width=128, joints=4, device="cpu"))
    with pytest.raises(DenseVSError, match=r"joint_step .*; expected"):
        pipeline.motion(wrong)
    with pytest.raises(DenseVSError, match=r"forget is .*; expected True or False"):
        pipeline.restart(forget=wrong)
    with pytest.raises(DenseVSError, match=r"point .*; expected"):
        pipeline.hidden_at(wrong)


def test_a_scale_that_leaves_no_pixel_is_refused():
    pipeline = FramePipeline(DenseJacobian(height=96, width=128, joints=4, device="cpu"), scale=1e-320)
    with pytest.raises(DenseVSError, match="expected one that leaves a pixel a side"):
        pipeline.process(np.zeros((96, 128), np.uint8), 0.0, np.zeros(4))
    assert pipeline.frame is None


def slow_postures(count):
    """Postures (count, 4) of a motion of a few tenths of a pixel a frame that excites all joints."""
    t = np.arange(count)[:, None] / 30
    return 0.03 * np.sin(2 * np.pi * t * (0.3 + 0.17 * np.arange(4)) + np.arange(4))


def test_slow_motion_is_measured_over_several_frames(scene):
    pipeline = make(scene)
    path = slow_postures(90)
    spans, since = [], path[0]
    for k, q in enumerate(path):
        frame = pipeline.process(scene.image(q), k / 30, q)
        if k == 0:
            continue
        assert frame.dq is not None
        np.testing.assert_allclose(frame.dq, q - path[k - 1])
        spans.append(0 if frame.measured is None else 1)
        if frame.measured is not None:
            flow, span = frame.measured
            np.testing.assert_allclose(span, q - since)
            error = np.linalg.norm(flow - scene.flow(since, q), axis=2)[16:-16, 16:-16]
            assert np.median(error) < 0.15
            since = q
    assert all(spans[:10])  # J is unknown
    assert 0.1 < np.mean(spans[20:]) < 0.8
    assert pipeline.estimator.updates == 89


def test_the_flow_of_a_frame_is_that_of_one_frame(scene):
    pipeline = make(scene)
    flow = FlowEstimator(height=scene.height, width=scene.width)
    path = slow_postures(24)
    for k, q in enumerate(path):
        frame = pipeline.process(scene.image(q), k / 30, q)
        if k:
            np.testing.assert_array_equal(frame.flow, flow(scene.image(path[k - 1]), scene.image(q)))


def test_longer_spans_make_slow_motion_say_more(scene):
    path = slow_postures(150)
    inner = (slice(16, -16), slice(16, -16))
    true = scene.jacobian(path[-1])[inner]
    errors = {}
    for baseline in (0.0, 3.0):
        pipeline = make(scene)
        pipeline.baseline = baseline
        rng = np.random.default_rng(0)
        for k, q in enumerate(path):
            noisy = scene.image(q) + rng.normal(0, 4, (scene.height, scene.width))
            pipeline.process(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), k / 30, q)
        relative = np.linalg.norm(pipeline.estimator.jacobian[inner] - true, axis=(2, 3))
        errors[baseline] = np.median(relative / np.linalg.norm(true, axis=(2, 3)))
    assert errors[3.0] < 0.8 * errors[0.0]


@pytest.mark.parametrize("options", [{"covariance": "diagonal"}, {"prediction": "flow"}])
def test_every_frame_corrects_an_estimator_that_takes_no_spans(scene, options):
    pipeline = make(scene, **options)
    for k, q in enumerate(slow_postures(20)):
        frame = pipeline.process(scene.image(q), k / 30, q)
        assert k == 0 or frame.measured is not None


@pytest.mark.parametrize("baseline", [-1.0, np.nan, np.inf])
def test_refuses_a_baseline(scene, baseline):
    estimator = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu")
    with pytest.raises(DenseVSError, match="baseline"):
        FramePipeline(estimator, baseline=baseline)


def learned_then_still(scene, postures, still):
    """J after motion, and after the robot has stood still for 40 frames with noisy readings of images and joints."""
    size = {"height": scene.height, "width": scene.width, "joints": 4}
    estimator = DenseJacobian(**size, device="cpu", order=1, rest=0.2, process_noise=1e4)
    pipeline, rng = FramePipeline(estimator, baseline=0.0, still=still), np.random.default_rng(0)
    for k in range(25):
        pipeline.process(scene.image(postures[k]), k / 30, postures[k])
    learned = estimator.to_numpy().copy()
    for k in range(25, 65):
        pipeline.process(scene.image(postures[24]), k / 30, postures[24] + rng.normal(0, 1e-4, 4) * np.ptp(postures, 0))
    rested = estimator.to_numpy().copy()
    for k in range(24, 30):
        pipeline.process(scene.image(postures[k]), (k + 42) / 30, postures[k])
    return learned, rested, estimator.to_numpy()


def test_a_robot_that_stands_still_keeps_its_jacobian(scene, postures):
    noise = 1e-4 * np.ptp(postures, 0)
    learned, rested, after = learned_then_still(scene, postures, 8 * noise)
    assert np.linalg.norm(learned) > 0
    np.testing.assert_array_equal(rested, learned)
    inner = (slice(16, -16), slice(16, -16))
    true = scene.jacobian(postures[29])[inner]
    assert np.median(np.linalg.norm(after[inner] - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))) < 0.5
    _, faded, _ = learned_then_still(scene, postures, None)
    assert np.linalg.norm(faded) < 0.5 * np.linalg.norm(learned)


def test_refuses_a_bad_bound_of_stillness(scene):
    estimator = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu")
    bad: Any
    for bad in (np.zeros(3), [1, 2], np.full(4, np.nan), "0.1"):
        with pytest.raises(DenseVSError, match="still "):
            FramePipeline(estimator, still=bad)
