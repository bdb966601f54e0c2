"""What covers a known body is told by motion, and J behind it is kept; flow and bodies are made by hand."""

import cv2
import numpy as np
import pytest

from dense_vs.jacobian import DenseJacobian
from dense_vs.pipeline import BodyPrior, FramePipeline
from dense_vs.pipeline.occlusion import GRID, LATELY, LONGEST, PATIENCE, WINDOW, Occlusion

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
    wide = cv2.dilate(truth.astype(np.uint8), np.ones((GRID * WINDOW + 3, GRID * WINDOW + 3), np.uint8)) > 0
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
        assert occlusion.observe(body(), motion(), motion(-MOVED), motion(-MOVED)).any()
        assert occlusion.doubtful
    assert not occlusion.observe(body(), motion(), motion(-MOVED), motion(-MOVED)).any()
    assert occlusion.doubtful
    for _ in range(4):
        occlusion.observe(body(), covered_flow(0.0), motion(), motion())
    assert not occlusion.doubtful


def test_where_j_explains_what_the_model_does_not_nothing_is_covered():
    flow = covered_flow((0.0, 4.0))
    occlusion = Occlusion(SIZE)
    assert occlusion.observe(body(), flow, motion(), motion()).any()
    occlusion = Occlusion(SIZE)
    assert not occlusion.observe(body(), flow, motion(), flow).any()


def test_a_j_of_nothing_does_not_explain_what_stands_still():
    unlearned = motion()
    unlearned[COVER] = 0.1 * MOVED  # as the background's, where the body has just come to
    occlusion = Occlusion(SIZE)
    for _ in range(2):
        hidden = occlusion.observe(body(), covered_flow(0.0), motion(), unlearned)
    assert hidden[COVER].mean() > 0.7


def test_flow_that_is_not_finite_and_small_parts_say_nothing():
    occlusion = Occlusion(SIZE)
    flow = covered_flow(np.nan)
    flow[12:17, 50:55] = 0.0
    assert not occlusion.observe(body(), flow, motion(), motion()).any()


def test_a_body_that_has_changed_is_seen_in_the_end():
    occlusion = Occlusion(SIZE)
    flow = covered_flow((0.0, 0.0))
    for _ in range(LONGEST + 1):
        assert occlusion.observe(body(), flow, motion(), motion())[30, 35]
    assert not occlusion.observe(body(), flow, motion(), motion())[30, 35]
    for _ in range(2):
        hidden = occlusion.observe(body(), flow, motion(), motion())
    assert not hidden.any()


def test_labels_are_the_models_to_the_images_edges_and_whole_behind_what_is_in_front():
    estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=1, device="cpu", on_bad_flow="skip")
    J = np.where(body()[..., None, None], MOVED[:, None], np.float32(0))
    wide = cv2.dilate(body().astype(np.uint8), np.ones((5, 5))) > 0  # the model's outline is 2 px outside
    prior = BodyPrior(lambda q: (J, wide))
    image = np.where(body(), 200, 40).astype(np.uint8)
    seen = np.zeros(SIZE, bool)
    seen[8, 8] = True  # beside the model's outline; what is far from it is not the body's
    one = np.ones(1, np.float32)
    labels = prior.labels(seen, one, image)
    assert labels[8, 8]
    assert np.count_nonzero(labels != (body() | seen)) < 0.25 * np.count_nonzero(wide != body())
    prior = BodyPrior(lambda q: (J, body()))
    for _ in range(2):
        flow = prior.uncovered(estimator, one, covered_flow((0.0, 5.0)), one)
    assert np.isnan(flow[COVER]).all()
    assert np.isfinite(flow[12:14, 12:14]).all()
    image[COVER] = 40  # what is in front looks as the background
    labels = prior.labels(seen, one, image)
    assert labels[COVER].all()
    assert labels[8, 8]
    prior.agreement = 0.0  # the model has no say any more
    assert np.isfinite(prior.uncovered(estimator, one, covered_flow((0.0, 5.0)), one)).all()
    np.testing.assert_array_equal(prior.labels(seen, one, image), seen)
    assert prior.hidden is None
    remembered = BodyPrior(lambda q: (J, body()), told=lambda q: np.eye(1))  # too coarse for outlines
    np.testing.assert_array_equal(remembered.labels(seen, one, image), seen)


TRUE = np.array([[40.0, 10.0], [-20.0, 30.0]], np.float32)  # px/rad


def images(frames, covered):
    """A textured plane that two joints shift, and joints; a plate stands before it in some frames."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (220, 220)).astype(np.float32), (0, 0), 2.0)
    texture = (255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
    plate = cv2.resize(rng.integers(0, 255, (6, 6)).astype(np.uint8), (20, 20), interpolation=cv2.INTER_CUBIC)
    for k in range(frames):
        q = np.array([0.25 * np.sin(0.35 * k), 0.25 * np.sin(0.22 * k + 1.0)])
        x, y = TRUE @ q
        image = cv2.warpAffine(
            texture, np.array([[1, 0, x - 70], [0, 1, y - 70]], np.float32), SIZE[::-1], flags=cv2.INTER_CUBIC
        )
        if covered(k):
            image[COVER] = plate
        yield image, q


def j_behind_the_plate(prior):
    estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=2, device="cpu", threads=1, on_bad_flow="skip")
    pipeline = FramePipeline(estimator, prior=prior)
    hidden = []
    for k, (image, q) in enumerate(images(150, lambda k: k >= 60)):
        pipeline.process(image, k / 30, q)
        hidden.append(pipeline.hidden[COVER].mean())
    return pipeline, estimator.jacobian[25:35, 30:40], np.array(hidden)


def test_j_is_not_unlearned_behind_what_stands_in_front():
    def known(q):
        mask = body()
        J = np.zeros((*SIZE, 2, 2), np.float32)
        J[mask] = TRUE + 6.0  # a model that is somewhat wrong
        return J, mask

    pipeline, J, hidden = j_behind_the_plate(BodyPrior(known, share=0.02))
    off = np.linalg.norm(J - TRUE, axis=(2, 3)) / np.linalg.norm(TRUE)
    assert np.median(off) < 0.3  # the model's own error is 0.22
    assert np.mean(hidden[:60]) < 0.1
    assert np.median(hidden[65:]) > 0.8
    assert pipeline.hidden_at(np.array([35.0, 30.0]))
    assert not pipeline.hidden_at(np.array([15.0, 15.0]))
    assert not pipeline.hidden_at(np.array([-5.0, 30.0]))
    alone, unlearned, none = j_behind_the_plate(None)
    assert np.median(np.linalg.norm(unlearned - TRUE, axis=(2, 3))) > 0.7 * np.linalg.norm(TRUE)
    assert not none.any()
    assert not alone.hidden.any()


@pytest.mark.parametrize("size", [(64, 80), (63, 79)])
def test_sums_and_judgments_are_those_of_every_second_pixel_each_way(size):
    """Beside NumPy in float64, over motions of which some say nothing, with a body that moves."""
    rng = np.random.default_rng(0)
    occlusion = Occlusion(size)
    off_sum, moved_sum, since, cover = (np.zeros((32, 40)) for _ in range(4))
    for k in range(12):
        there = np.roll(body(), k, axis=1)[: size[0], : size[1]]
        by_model = np.where(there[..., None], MOVED * (k % 4), 0).astype(np.float32)
        flow = by_model + rng.normal(0, 0.2, (*size, 2)).astype(np.float32)
        flow[COVER] = (0.0, 3.0)
        flow[50:55, 5:20] = np.nan
        estimate = (0.5 * flow).astype(np.float32)
        u, p, e = (np.nan_to_num(field[::2, ::2].astype(np.float64)) for field in (flow, by_model, estimate))
        told, on_body = np.isfinite(flow[::2, ::2]).all(axis=2), there[::2, ::2]
        uu, pp, ee, up, ue = (np.sum(field**2, axis=2) for field in (u, p, e, u - p, u - e))
        off = np.where(ee > 0.25 * np.maximum(uu, pp), np.minimum(up, ue), up) * told
        moved = (uu + pp) * told
        off_sum = 0.3 * off_sum + cv2.blur(off, (WINDOW, WINDOW))
        moved_sum = 0.3 * moved_sum + cv2.blur(moved, (WINDOW, WINDOW))
        strange = (moved_sum > 0.05) & (off_sum > 0.35 * moved_sum)
        since[(moved_sum > 0.05) & ~strange] = 0
        candidates = strange | (~(moved_sum > 0.05) & (cover > 0))
        occlusion.observe(there, flow, by_model, estimate)
        assert not (occlusion.cover[::2, ::2] & ~candidates).any()
        parts, labels = cv2.connectedComponents(candidates.astype(np.uint8), connectivity=4)
        expected = np.zeros(candidates.shape, bool)
        for part in range(1, parts):
            if np.count_nonzero((labels == part) & on_body) >= 15:
                expected |= labels == part
        whole = np.kron(expected, np.ones((2, 2)))[: size[0], : size[1]]
        np.testing.assert_array_equal(occlusion.cover, whole)
        cover = expected
        since += cover
        np.testing.assert_array_equal(occlusion._since[0], since)
        assert occlusion.doubtful == (
            np.count_nonzero(strange & on_body) > 0.75 * np.count_nonzero((moved_sum > 0.05) & on_body)
        )
