"""What covers a known body is told by motion, and J behind it is kept; flow and bodies are made by hand."""

import cv2
import numpy as np
import pytest

from dense_vs.jacobian import DenseJacobian
from dense_vs.pipeline import BodyPrior, FramePipeline
from dense_vs.pipeline.occlusion import LATELY, LONGEST, PATIENCE, WINDOW, Occlusion

SIZE = (64, 80)
MOVED = np.array([3.0, -1.0], np.float32)
COVER = np.s_[20:40, 25:45]


def body():
    mask = np.zeros(SIZE, bool)
    mask[10:50, 10:60] = True
    return mask


def motion(by=MOVED):
    return np.where(body()[..., None], by, 0).astype(np.float32)


def covered_flow(by):
    flow = motion()
    flow[COVER] = by
    return flow


@pytest.mark.parametrize("by", [(0.0, 0.0), (-2.0, 1.0), (0.0, 5.0)])
def test_what_stands_still_or_moves_by_itself_in_front_is_found_at_once(by):
    occlusion = Occlusion(SIZE)
    for _ in range(3):
        assert not occlusion.observe(body(), motion(), motion(), motion()).any()
    assert occlusion.observe(body(), covered_flow(by), motion(), motion())[COVER].mean() > 0.4
    hidden = occlusion.observe(body(), covered_flow(by), motion(), motion())
    truth = np.zeros(SIZE, bool)
    truth[COVER] = True
    wide = cv2.dilate(truth.astype(np.uint8), np.ones((WINDOW + 2, WINDOW + 2), np.uint8)) > 0
    assert not hidden[~wide].any()
    assert hidden[truth].mean() > 0.7
    assert not hidden[~body()].any()
    assert occlusion.around[truth].all()
    for _ in range(LATELY):
        hidden = occlusion.observe(body(), motion(), motion(), motion())
    assert not hidden.any()
    assert occlusion.lately[truth].all()
    for _ in range(4):
        occlusion.observe(body(), motion(), motion(), motion())
    assert not occlusion.lately.any()


def test_what_is_in_front_goes_on_beside_the_body():
    flow = covered_flow((0.0, 5.0))
    flow[20:60, 50:70] = (0.0, 5.0)  # over the body's corner, and beside it
    flow[55:62, 2:9] = (0.0, 5.0)  # on the background alone
    occlusion = Occlusion(SIZE)
    for _ in range(2):
        hidden = occlusion.observe(body(), flow, motion(), motion())
    assert occlusion.cover[25:55, 62:68].all()
    assert not hidden[25:55, 62:68].any()
    assert not occlusion.cover[55:62, 2:9].any()


def test_what_is_covered_stays_so_while_nothing_moves():
    occlusion = Occlusion(SIZE)
    for _ in range(2):
        occlusion.observe(body(), covered_flow(0.0), motion(), motion())
    still = np.zeros((*SIZE, 2), np.float32)
    for _ in range(20):
        hidden = occlusion.observe(body(), still, still, still)
    assert hidden[COVER].mean() > 0.8


def test_a_model_that_is_wrong_throughout_covers_nothing():
    occlusion = Occlusion(SIZE)
    for _ in range(PATIENCE):  # flow may have failed
        occlusion.observe(body(), motion(), motion(-MOVED), motion(-MOVED))
    assert not occlusion.observe(body(), motion(), motion(-MOVED), motion(-MOVED)).any()


def test_where_j_explains_what_the_model_does_not_nothing_is_covered():
    flow = covered_flow((0.0, 4.0))
    occlusion = Occlusion(SIZE)
    assert occlusion.observe(body(), flow, motion(), motion()).any()
    occlusion = Occlusion(SIZE)
    assert not occlusion.observe(body(), flow, motion(), flow).any()


def test_flow_that_is_not_finite_and_small_parts_say_nothing():
    occlusion = Occlusion(SIZE)
    flow = covered_flow(np.nan)
    flow[12:17, 50:55] = 0.0
    assert not occlusion.observe(body(), flow, motion(), motion()).any()


def test_a_body_that_has_changed_is_seen_in_the_end():
    occlusion = Occlusion(SIZE)
    flow = covered_flow((0.0, 0.0))
    for _ in range(LONGEST):
        assert occlusion.observe(body(), flow, motion(), motion())[COVER].any()
    for _ in range(3):
        hidden = occlusion.observe(body(), flow, motion(), motion())
    assert not hidden.any()


def test_labels_are_the_models_to_the_images_edges_and_whole_behind_what_is_in_front():
    estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=1, device="cpu", on_bad_flow="skip")
    J = np.where(body()[..., None, None], MOVED[:, None], np.float32(0))
    wide = cv2.dilate(body().astype(np.uint8), np.ones((5, 5))) > 0  # the model's outline is 2 px outside
    prior = BodyPrior(lambda q: (J, wide))
    image = np.where(body(), 200, 40).astype(np.uint8)
    seen = np.zeros(SIZE, bool)
    seen[0, 0] = True
    one = np.ones(1, np.float32)
    labels = prior.labels(seen, one, image)
    assert labels[0, 0]
    assert np.count_nonzero(labels != (body() | seen)) < 0.25 * np.count_nonzero(wide != body())
    prior = BodyPrior(lambda q: (J, body()))
    for _ in range(2):
        flow = prior.uncovered(estimator, one, covered_flow((0.0, 5.0)), one)
    assert np.isnan(flow[COVER]).all()
    assert np.isfinite(flow[12:14, 12:14]).all()
    image[COVER] = 40  # what is in front looks as the background
    labels = prior.labels(seen, one, image)
    assert labels[COVER].all()
    assert labels[0, 0]
    prior.agreement = 0.0  # the model has no say any more
    assert np.isfinite(prior.uncovered(estimator, one, covered_flow((0.0, 5.0)), one)).all()
    np.testing.assert_array_equal(prior.labels(seen, one, image), seen)
    assert prior.hidden is None
    remembered = BodyPrior(lambda q: (J, body()), told=lambda q: np.eye(1))  # too coarse for outlines
    np.testing.assert_array_equal(remembered.labels(seen, one, image), seen)
