"""The prior step by step with an estimator that keeps what it is told: agreement, shares, labels, what is hidden."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.pipeline import BodyPrior, body_prior

H, W, N = 12, 14, 2


class Estimator:
    """Keeps what J is drawn to, by which shares."""

    def __init__(self):
        self.blended = []
        self.J = np.random.default_rng(9).normal(size=(H, W, 2, N)).astype(np.float32)

    def blend(self, J, share):
        self.blended.append((J, share))

    def to_numpy(self):
        return self.J

    def predicted_flow(self, step):
        return self.J @ step


def of(body=None, seed=0, **options):
    rng = np.random.default_rng(seed)
    J = 10 * rng.normal(size=(H, W, 2, N)).astype(np.float32)
    if body is None:
        body = np.zeros((H, W), bool)
        body[2:10, 3:12] = True
    asked = []
    prior = BodyPrior(lambda q: asked.append(np.array(q)) or (J, body), **options)
    return prior, J, body, asked


def agreement(before, J, body, flow, span, told):
    """By definition, pixel by pixel: one less the share of the motion that is not explained, slowly forgotten."""
    off = moved = count = 0.0
    for y, x in np.argwhere(body):
        predicted, measured = J[y, x].astype(float) @ span, flow[y, x]
        if np.hypot(*predicted) <= 0.5 or not np.isfinite(measured).all():
            continue
        count += 1
        wrong = np.hypot(*(measured - predicted))
        size = max(np.hypot(*measured), 0.5) if told else np.hypot(*predicted)
        off += wrong if told else min(wrong, size)
        moved += size
    return before if count < 50 else 0.9 * before + 0.1 * (1 - off / moved)


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("noise", [0.3, 30.0])
def test_agreement_is_the_share_of_the_motion_that_is_explained(told, noise):
    options = {"told": lambda q: np.eye(N)} if told else {}
    prior, J, body, _ = of(share=0.3, **options)
    estimator, span, expected = Estimator(), np.array([0.1, -0.05]), 1.0
    rng = np.random.default_rng(1)
    for k in range(3):
        flow = J @ span + noise * rng.normal(size=(H, W, 2))
        flow[4, 5] = np.nan
        flow[5, 5, 1] = np.inf
        flow[6:8] *= 0.01
        prior.correct(estimator, np.array([0.1 * k, 0.0]), flow, span)
        expected = agreement(expected, J, body, flow, span, told)
        assert prior.agreement == pytest.approx(expected, rel=1e-5)
    assert expected < 1.0


@pytest.mark.parametrize(("count", "judged"), [(49, False), (50, True)])
@pytest.mark.parametrize(("size", "moves"), [(0.49, False), (0.51, True)])
def test_fifty_pixels_that_move_by_half_a_pixel_are_asked(count, judged, size, moves):
    body = np.zeros((H, W), bool)
    body.flat[:count] = True
    prior = BodyPrior(lambda q: (np.full((H, W, 2, 1), [[0.6], [0.8]], np.float32), body))
    prior.correct(Estimator(), np.zeros(1), np.zeros((H, W, 2)), np.array([size]))
    assert prior.agreement == pytest.approx(0.9 if judged and moves else 1.0)


def test_j_is_drawn_by_a_share_on_the_body_while_both_agree():
    prior, J, body, asked = of(share=0.3, least_agreement=0.6)
    estimator = Estimator()
    prior.begin(estimator, np.zeros(N))
    prior.begin(estimator, np.zeros(N), 0.25)
    prior.draw(estimator, np.zeros(N))
    assert len(asked) == 1  # one posture is asked for once
    for (to, share), expected in zip(estimator.blended, (1.0, 0.25, 0.3), strict=True):
        np.testing.assert_array_equal(to, J)
        np.testing.assert_array_equal(share, np.float32(expected) * body)
        assert share.dtype == np.float32
    prior.agreement = 0.6
    prior.draw(estimator, np.ones(N))
    assert len(asked) == 2
    assert prior.agrees
    prior.agreement = 0.599
    prior.draw(estimator, np.ones(N))
    assert not prior.agrees
    assert len(estimator.blended) == 4


@pytest.mark.parametrize(("share", "covered"), [(0.3, 0.5), (0.7, 0.7)])
def test_j_is_drawn_more_where_something_covers_the_body(share, covered):
    prior, _, body, _ = of(share=share)
    hidden = np.zeros((H, W), bool)
    hidden[:5, :6] = True
    assert prior.hidden is None
    prior._occlusion = SimpleNamespace(hidden=hidden)
    assert prior.hidden is hidden
    estimator = Estimator()
    prior.draw(estimator, np.zeros(N))
    expected = np.where(body & hidden, covered, np.where(body, share, 0.0))
    np.testing.assert_allclose(estimator.blended[0][1], expected)


def test_what_the_model_does_not_speak_of_is_the_estimator_s():
    spoken = np.array([[0.8, 0.4], [0.4, 0.2]])  # of steps along (2, 1) alone
    prior, J, _, _ = of(told=lambda q: spoken)
    estimator = Estimator()
    prior.draw(estimator, np.zeros(N))
    np.testing.assert_allclose(estimator.blended[0][0], J + estimator.J @ (np.eye(N) - spoken), atol=1e-5)


def test_labels_go_to_the_edges_of_the_image(monkeypatch):
    prior, _, body, _ = of()
    own = np.zeros((H, W), bool)
    own[0, 0] = own[2, 3] = True
    smooth = np.linspace(0, 1, H * W, dtype=np.float32).reshape(H, W)
    asked = []
    monkeypatch.setattr(body_prior, "guided_filter", lambda *given: asked.append(given) or smooth)
    image = np.zeros((H, W, 3), np.uint8)
    labels = prior.labels(own, np.zeros(N), image)
    np.testing.assert_array_equal(labels, own | (smooth > 0.7))
    assert asked[0][0] is image
    np.testing.assert_array_equal(asked[0][1], body.astype(np.float32))
    assert asked[0][2:] == (6, 1e-3)
    lately = np.zeros((H, W), bool)
    lately[8:] = True
    prior._occlusion = SimpleNamespace(lately=lately)
    np.testing.assert_array_equal(prior.labels(own, np.zeros(N), image), np.where(lately, body, labels))
    prior.agreement = 0.0
    assert prior.labels(own, np.zeros(N), image) is own
    remembered, _, _, _ = of(told=lambda q: np.eye(N))
    assert remembered.labels(own, np.zeros(N), image) is own


def test_what_was_seen_counts_up_to_three_pixels_beside_the_model(monkeypatch):
    """Flow takes the background along with the robot, and what looks like it is labeled with it."""
    body = np.zeros((30, 40), bool)
    body[10:16, 12:20] = True
    prior = BodyPrior(lambda q: (np.zeros((30, 40, 2, N)), body))
    monkeypatch.setattr(body_prior, "guided_filter", lambda *given: np.zeros((30, 40), np.float32))
    own = np.ones((30, 40), bool)
    own[12, 14] = own[8, 12] = False
    expected = np.zeros((30, 40), bool)
    expected[7:19, 9:23] = True
    expected[12, 14] = expected[8, 12] = False
    np.testing.assert_array_equal(prior.labels(own, np.zeros(N), np.zeros((30, 40), np.uint8)), expected)


def test_a_flow_without_what_covers_the_body(monkeypatch):
    observed, seen = [], np.zeros((H, W), bool)
    around = np.zeros((H, W), bool)
    around[3:7, 4:9] = True

    class Covering:
        def __init__(self, shape):
            self.around = around
            assert shape == (H, W)

        def observe(self, *given):
            observed.append(given)
            return seen

    monkeypatch.setattr(body_prior, "Occlusion", Covering)
    prior, J, body, _ = of()
    estimator, flow = Estimator(), np.random.default_rng(2).normal(size=(H, W, 2)).astype(np.float32)
    span = np.array([0.2, -0.1])
    assert prior.uncovered(estimator, np.zeros(N), flow, span) is flow
    first = prior._occlusion
    np.testing.assert_array_equal(observed[0][0], body)
    assert observed[0][1] is flow
    np.testing.assert_allclose(observed[0][2], J @ span, rtol=1e-5)
    np.testing.assert_allclose(observed[0][3], estimator.J @ span, rtol=1e-4, atol=1e-6)
    seen[4, 5] = True
    found = prior.uncovered(estimator, np.zeros(N), flow, span)
    assert prior._occlusion is first
    assert np.isnan(found[around]).all()
    np.testing.assert_array_equal(found[~around], flow[~around])
    prior.agreement = 0.0
    assert prior.uncovered(estimator, np.zeros(N), flow, span) is flow
    assert prior.hidden is None
    remembered, _, _, _ = of(told=lambda q: np.eye(N))
    assert remembered.uncovered(estimator, np.zeros(N), flow, span) is flow
    assert len(observed) == 2


class Body:
    size, joint_count = (6, 7), N

    def __init__(self):
        rng = np.random.default_rng(3)
        self.J, self.mask = rng.normal(size=(6, 7, 2, N)).astype(np.float32), rng.uniform(size=(6, 7)) > 0.5

    def known(self, q):
        return self.J, self.mask


def test_a_body_in_images_twice_as_large():
    body = Body()
    J, mask = BodyPrior.of(body, (12, 14), N).known(np.zeros(N))
    for n in range(N):
        for c in range(2):
            expected = 2 * cv2.resize(body.J[:, :, c, n], (14, 12), interpolation=cv2.INTER_LINEAR)
            np.testing.assert_allclose(J[:, :, c, n], expected, rtol=1e-6)
    np.testing.assert_array_equal(mask, np.kron(body.mask, np.ones((2, 2), bool)))
    same, there = BodyPrior.of(body, (6, 7), N).known(np.zeros(N))
    assert (same is body.J, there is body.mask) == (True, True)


@pytest.mark.parametrize(("height", "fits"), [(11, True), (12, True), (13, True), (10, False), (14, False)])
def test_an_image_of_another_shape(height, fits):
    """A pixel of rounding is welcome."""
    if fits:
        assert BodyPrior.of(Body(), (height, 14), N).known(np.zeros(N))[0].shape == (height, 14, 2, N)
        return
    with pytest.raises(DenseVSError, match="expected 14 x"):
        BodyPrior.of(Body(), (height, 14), N)


def test_how_much_a_chain_and_a_memory_have_to_say():
    chain = BodyPrior.of(Body(), (6, 7), N)
    assert (chain.share, chain.least_agreement, chain.agreement, chain.told) == (0.7, 0.5, 1.0, None)
    body = Body()
    body.told = lambda q: np.eye(N)
    memory = BodyPrior.of(body, (6, 7), N)
    assert (memory.share, memory.least_agreement, memory.told) == (0.2, 0.0, body.told)
    plain = BodyPrior(body.known)
    assert (plain.share, plain.least_agreement) == (1.0, 0.5)
    assert BodyPrior(body.known, share=1, least_agreement=1).agrees
    for wrong in ({"share": 0.0}, {"share": 1.01}, {"least_agreement": 1.01}):
        with pytest.raises(DenseVSError, match=next(iter(wrong))):
            BodyPrior(body.known, **wrong)


def test_j_is_drawn_to_what_the_estimator_s_own_j_makes_of_the_model_s():
    estimator, asked = Estimator(), []
    better = np.full((H, W, 2, N), 7.0, np.float32)
    prior, _, body, _ = of(share=0.6, corrected=lambda q, measured: asked.append((q.tolist(), measured)) or better)
    for draw in (prior.begin, prior.draw):
        draw(estimator, np.array([0.3, 0.1]))
        J, share = estimator.blended[-1]
        assert J is better
        np.testing.assert_array_equal(share, np.float32(1.0 if draw == prior.begin else 0.6) * body)
        assert asked[-1][0] == [0.3, 0.1]
        assert asked[-1][1] is estimator.J
    with pytest.raises(DenseVSError, match="corrected is"):
        BodyPrior(prior.known, corrected=3)


def test_what_moves_is_asked_of_the_model_itself_where_it_tells(monkeypatch):
    """Once a motion; J of what the model knows is then not asked for."""
    monkeypatch.setattr(body_prior, "Vacated", lambda shape: SimpleNamespace(observe=lambda *given: None))
    seen, times = [], []
    covering = SimpleNamespace(observe=lambda *given: seen.append(given) or np.zeros((H, W), bool), hidden=None)
    monkeypatch.setattr(body_prior, "Occlusion", lambda shape: covering)
    estimator, body = Estimator(), np.ones((H, W), bool)
    motion = np.tile(np.float32([3.0, -4.0]), (H, W, 1))

    def moved(q, step):
        times.append((q.tolist(), step.tolist()))
        return motion, body

    prior, _, _, asked = of(moved=moved, corrected=lambda q, measured: measured, share=0.6)
    for k, q in enumerate(np.array([[0.3, 0.1], [0.3, 0.2]])):
        prior.uncovered(estimator, q, motion, np.array([0.5, 0.25]))
        prior.correct(estimator, q, 0.5 * motion, np.array([0.5, 0.25]))
        assert times[k:] == [(q.tolist(), [0.5, 0.25])]
        assert seen[k][0] is body
        assert seen[k][2] is motion
        np.testing.assert_array_equal(estimator.blended[-1][1], np.full((H, W), 0.6, np.float32))
    assert prior.agreement == pytest.approx(0.9 * (0.9 + 0.1 * 0.5) + 0.1 * 0.5)
    prior.correct(estimator, q, motion, np.array([0.5, 0.3]))
    assert len(times) == 3
    assert not asked
    with pytest.raises(DenseVSError, match="moved is"):
        BodyPrior(prior.known, moved=3)


@pytest.mark.parametrize("size", [(6, 7), (12, 14)])
def test_a_motion_in_images_of_another_scale(size):
    body = Body()
    assert BodyPrior.of(body, size, N).moved is None
    motion, scale = np.random.default_rng(2).normal(size=(6, 7, 2)).astype(np.float32), size[0] // 6
    body.moved = lambda q, step: (motion * step[0], body.mask)
    found, mask = BodyPrior.of(body, size, N).moved(np.zeros(N), np.array([2.0, 0.0]))
    for c in range(2):
        expected = 2 * scale * cv2.resize(motion[..., c], size[::-1], interpolation=cv2.INTER_LINEAR)
        np.testing.assert_allclose(found[..., c], expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(mask, np.kron(body.mask, np.ones((scale, scale), bool)))


@pytest.mark.parametrize("size", [(6, 7), (12, 14)])
def test_a_correction_in_images_of_another_scale(size):
    """The measured J goes to the body's pixels, what comes of it back; both in pixels of their images."""
    body, asked = Body(), []
    assert BodyPrior.of(body, size, N).corrected is None
    body.corrected_jacobian = lambda q, measured: asked.append((q, measured)) or measured + body.J
    corrected = BodyPrior.of(body, size, N).corrected
    scale = size[0] // 6
    small = np.random.default_rng(2).normal(size=(6, 7, 2, N)).astype(np.float32)
    found = corrected(np.zeros(N), np.kron(scale * small, np.ones((scale, scale, 1, 1), np.float32)))
    np.testing.assert_allclose(asked[0][1], small, rtol=1e-6)
    assert found.shape == (*size, 2, N)
    for n in range(N):
        for c in range(2):
            expected = scale * cv2.resize((small + body.J)[:, :, c, n], size[::-1], interpolation=cv2.INTER_LINEAR)
            np.testing.assert_allclose(found[:, :, c, n], expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("on_cpu", [True, False])
def test_an_estimator_on_the_cpu_is_drawn_by_the_model_itself(on_cpu):
    estimator, asked = Estimator(), []
    estimator.device = SimpleNamespace(is_cpu=on_cpu)
    better = np.full((H, W, 2, N), 7.0, np.float32)
    prior, _, body, _ = of(share=0.6, corrected=lambda q, measured: better, blended=lambda *given: asked.append(given))
    for draw in (prior.begin, prior.draw):
        draw(estimator, np.array([0.3, 0.1]))
        to, share = estimator.blended[-1]
        np.testing.assert_array_equal(share, np.float32(1.0 if draw == prior.begin else 0.6) * body)
        if not on_cpu:
            assert to is better
            continue
        to("present", share)
        q, present, of_pixels = asked[-1]
        assert (q.tolist(), present, of_pixels is share) == ([0.3, 0.1], "present", True)
    with pytest.raises(DenseVSError, match="blended is"):
        BodyPrior(prior.known, blended=3)


@pytest.mark.parametrize(("size", "itself"), [((6, 7), True), ((12, 14), False)])
def test_a_body_draws_in_images_of_its_own_size(size, itself):
    body = Body()
    assert BodyPrior.of(body, size, N).blended is None
    body.blend = lambda q, present, share: None
    assert BodyPrior.of(body, size, N).blended is (body.blend if itself else None)
