"""Depth images on their way through the pipeline."""

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError, FlowEstimator, FramePipeline


def make(scene, scale=1.0, depth=True, **options):
    height, width = round(scene.height * scale), round(scene.width * scale)
    estimator = DenseJacobian(height=height, width=width, joints=4, device="cpu", depth=depth)
    return FramePipeline(estimator, scale=scale, **options)


def depth_at(scene, q):
    x = np.arange(scene.width) * np.ones((scene.height, 1))
    return 0.9 + 0.001 * x + 0.3 * q[0]


def test_every_frame_measures_depth_whether_j_is_corrected_or_not(scene, postures):
    pipeline = make(scene)
    by_hand = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu", depth=True)
    flow = FlowEstimator(height=scene.height, width=scene.width)
    slow = 0.2 * postures[:20]
    corrected, moved_since = 0, False
    for k, q in enumerate(slow):
        frame = pipeline.process(scene.image(q), 0.1 * k, q, depth=depth_at(scene, q))
        np.testing.assert_allclose(frame.depth, depth_at(scene, q), rtol=1e-6)
        if k == 0:
            continue
        if frame.measured is None:
            by_hand.predict(q - slow[k - 1], depth_at(scene, q))
            moved_since = True
            continue
        seen = flow(scene.image(slow[corrected]), scene.image(q))
        span = q - slow[corrected] if moved_since else None
        by_hand.update(seen, q - slow[k - 1], span, depth_at(scene, q))
        corrected, moved_since = k, False
    assert corrected < len(slow) - 1 or moved_since is False
    assert by_hand.updates == pipeline.estimator.updates == len(slow) - 1
    np.testing.assert_array_equal(pipeline.estimator.depth, by_hand.depth)
    np.testing.assert_array_equal(pipeline.estimator.depth_jacobian, by_hand.depth_jacobian)


def test_depth_is_scaled_by_taking_single_pixels(scene, postures):
    pipeline = make(scene, scale=0.5)
    jump = np.where(np.arange(scene.width) < 61, 0.7, 1.3) * np.ones((scene.height, 1))
    frame = pipeline.process(scene.image(postures[0]), 0.0, postures[0], depth=jump)
    assert frame.depth.shape == (scene.height // 2, scene.width // 2)
    assert set(np.unique(frame.depth)) == {np.float32(0.7), np.float32(1.3)}


def test_holes_in_a_depth_image_leave_the_rest(scene, postures):
    pipeline = make(scene)
    holed = np.full((scene.height, scene.width), 0.9)
    holed[3:9, 5:20] = np.nan
    frame = pipeline.process(scene.image(postures[0]), 0.0, postures[0], depth=holed)
    np.testing.assert_array_equal(frame.depth, np.nan_to_num(holed).astype(np.float32))


def test_a_later_image_without_any_depth_is_none(scene, postures):
    pipeline = make(scene)
    empty = np.full((scene.height, scene.width), np.nan)
    with pytest.raises(DenseVSError, match="no pixel that is known"):
        pipeline.process(scene.image(postures[0]), 0.0, postures[0], depth=empty)
    assert pipeline.frame is None
    for k in range(3):
        q = postures[k]
        frame = pipeline.process(scene.image(q), 0.1 * k, q, depth=empty if k == 2 else depth_at(scene, q))
    assert frame.depth is None
    assert np.isfinite(pipeline.estimator.depth).all()


def test_refusals_change_nothing(scene, postures):
    pipeline = make(scene)
    pipeline.process(scene.image(postures[0]), 0.0, postures[0], depth=depth_at(scene, postures[0]))
    before, frame = pipeline.estimator.depth.copy(), pipeline.frame
    for bad, said in (
        (np.ones((3, 4)), "depth has shape"),
        (np.ones((scene.height, scene.width), np.uint16), "divide by 1000"),
        (-np.ones((scene.height, scene.width)), "least value of -1"),
    ):
        with pytest.raises(DenseVSError, match=said):
            pipeline.process(scene.image(postures[1]), 0.1, postures[1], depth=bad)
    np.testing.assert_array_equal(pipeline.estimator.depth, before)
    assert pipeline.frame is frame
    plain = make(scene, depth=False)
    with pytest.raises(DenseVSError, match=r"expected DenseJacobian\(depth=True\)"):
        plain.process(scene.image(postures[0]), 0.0, postures[0], depth=depth_at(scene, postures[0]))
    with pytest.raises(DenseVSError, match="sway with an estimator of depth"):
        make(scene, sway=True)
