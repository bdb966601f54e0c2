"""Wide images are labeled in smaller ones."""

import cv2
import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError, FlowEstimator, FramePipeline, SelfBody
from dense_vs.pipeline.frame_pipeline import BODY_FLOW


def test_a_pipeline_labels_wide_images_in_smaller_ones(scene, postures):
    """As a body does that is given the smaller images; the labels come back in the wide images' size."""
    estimator = DenseJacobian(height=scene.height, width=scene.width, joints=4, device="cpu")
    pipeline = FramePipeline(estimator, body=SelfBody(synchronous=True, device="cpu"), baseline=0.0, body_step=2)
    half = scene.height // 2, scene.width // 2
    by_hand = SelfBody(synchronous=True, device="cpu", height=half[0], width=half[1], joints=4)
    flow = FlowEstimator(BODY_FLOW, *half)
    images = [scene.image(q) for q in postures[:30]]
    small = [cv2.resize(image, half[::-1], interpolation=cv2.INTER_AREA) for image in images]
    for k, image in enumerate(images):
        pipeline.process(image, k / 30, postures[k])
        if k:
            by_hand.observe(flow(small[k - 1], small[k]), postures[k] - postures[k - 1], small[k])
    own = pipeline.labels()
    assert own.shape == (scene.height, scene.width)
    assert own.mean() > 0.8
    expected = by_hand.labels(estimator.to_numpy()[1::2, 1::2] / 2)
    assert np.mean(own[1::2, 1::2] == expected) > 0.98
    with pytest.raises(DenseVSError, match="body_step is 0"):
        FramePipeline(estimator, body_step=0)
