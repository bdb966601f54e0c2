"""J of a surface whose depth another J corrects: beside least squares in float64, and what it is to do."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.errors import DenseVSError
from dense_vs.jacobian import DenseJacobian, jacobian_error

SIZE, FOCAL, CENTER, N = (48, 64), 70.0, (30.5, 22.0), 3
DEVIATION, NOISE, LEAST = 0.03, 2.0, 0.1


def model(bend=0.0, learned=(True, True, True), closer=0.0):
    """A hinge, a slide on it and a hinge on another branch; their surface, or one nearer to the camera by a share."""
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(N, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes[1] = 0.0
    travel = np.zeros((N, 3))
    travel[1] = [0.3, 0.9, -0.1]
    chain = Chain(axes, rng.normal(size=(N, 3)) * 0.3 + [0, 0, 2], np.zeros(N), np.array([-1, 0, -1]), travel)
    points = rng.uniform([-0.9, -0.7, 1.4], [0.9, 0.7, 2.6], size=(1500, 3)) * (1 - closer)
    surface = Surface(points, rng.integers(-1, N, size=1500), np.ones(1500), np.zeros(1500, np.uint8))
    ends = np.array([[-1.0, 1.0]] * N)
    return BodyModel(ModelContent(chain, FOCAL, CENTER, SIZE, surface, np.array(learned), ends, 0.1, None, bend))


def exact(body, q, scale=1.0):
    """J ``(K, 2, N)`` in float64 of the points in front, their depths times a factor."""
    seen = body.image(q)
    index = seen.points[seen.body]
    rotation, translation = body.chain.link_poses(q[None])
    links, points = body.surface.links[index], body.surface.points[index]
    there = scale * (np.einsum("pij,pj->pi", rotation[0, links], points) + translation[0, links])
    velocity = body.chain.velocities(q, there, links) * body.learned[:, None]
    lens = Lens.of_center(np.array(CENTER), body.lens.bend)
    moved = []
    for n in range(N):
        ahead, behind = (there + h * velocity[:, n] for h in (1e-5, -1e-5))
        moved.append(
            (lens.bent(FOCAL * ahead[:, :2] / ahead[:, 2:] + CENTER)
             - lens.bent(FOCAL * behind[:, :2] / behind[:, 2:] + CENTER)) / 2e-5
        )  # fmt: skip
    return np.stack(moved, axis=2)


@pytest.mark.parametrize(("bend", "learned"), [(0.0, (True,) * 3), (-0.1, (True,) * 3), (0.0, (True, True, False))])
def test_it_is_the_mean_of_two_depths_by_least_squares(bend, learned):
    """Residuals of the other J by its noise and of the depth by its deviation, least of all inverse depths."""
    body, q, rng = model(bend, learned), np.array([0.2, -0.15, 0.3]), np.random.default_rng(1)
    there, J = body.image(q).body, exact(body, q)
    part = exact(body, q, 0.5) - J  # what is added by as much inverse depth again
    size = np.linalg.norm(J, axis=(1, 2))
    other = J + 0.1 * rng.normal(size=(len(J), 1, 1)) * part + 0.03 * size[:, None, None] * rng.normal(size=J.shape)
    measured = rng.normal(size=(*SIZE, 2, N)).astype(np.float32)  # off the body it is no matter
    measured[there] = other
    corrected = body.corrected_jacobian(q, measured)
    assert corrected.dtype == np.float32
    assert corrected.shape == (*SIZE, 2, N)
    assert not corrected[~there].any()
    changed = 0
    for found, j, d, o in zip(corrected[there], J, part, other, strict=True):
        expected = j
        if np.linalg.norm(d) > 0:
            best = np.linalg.lstsq(d.reshape(-1, 1), (o - j).ravel(), rcond=None)[0][0]
            noise = np.hypot(NOISE * np.linalg.norm(o - j - best * d), LEAST * np.linalg.norm(j))
            rows = np.append(d.ravel() / noise, 1 / DEVIATION)[:, None]
            change = np.linalg.lstsq(rows, np.append((o - j).ravel() / noise, 0), rcond=None)[0][0]
            expected = j + change * d
            changed += abs(change) > 0.01
        np.testing.assert_allclose(found, expected, atol=5e-3 * max(1.0, np.linalg.norm(j)))
    assert changed > 100


@pytest.mark.parametrize(("bend", "learned"), [(0.0, (True,) * 3), (-0.1, (True,) * 3), (0.0, (True, True, False))])
def test_what_moves_by_a_joint_step_is_j_times_it(bend, learned):
    body, step = model(bend, learned), np.array([0.02, -0.03, 0.05])
    for q in (np.array([0.2, -0.15, 0.3]), np.array([0.0, 0.1, -0.1])):
        motion, there = body.moved(q, step)
        assert (motion.dtype, motion.shape) == (np.float32, (*SIZE, 2))
        np.testing.assert_array_equal(there, body.known(q)[1])
        moving = body.image(q).body
        np.testing.assert_allclose(motion[moving], exact(body, q) @ step, atol=1e-4)
        assert not motion[~moving].any()
        assert np.linalg.norm(motion[moving], axis=1).max() > 1.0


def test_an_exact_j_of_a_body_closer_by_takes_it_there():
    q = np.array([0.2, -0.15, 0.3])
    body = model()
    seen = body.image(q).body
    closer = np.zeros((*SIZE, 2, N), np.float32)
    closer[seen] = exact(body, q, 0.95)
    before = jacobian_error(body.jacobian(q), closer, seen)
    after = jacobian_error(body.corrected_jacobian(q, closer), closer, seen)
    assert before.p90 > 0.1
    assert after.p90 < 0.55 * before.p90
    far = body.corrected_jacobian(q, -4 * body.jacobian(q))  # no depth gives that: as of something in front
    assert jacobian_error(far, body.jacobian(q), seen).p90 < 0.1


def test_the_same_j_changes_nothing():
    body, q = model(bend=0.05), np.array([0.1, 0.1, -0.2])
    J = body.jacobian(q)
    np.testing.assert_array_equal(body.corrected_jacobian(q, J), J)
    still = body.corrected_jacobian(q, np.zeros_like(J))  # a filter that has learned nothing yet
    assert jacobian_error(still, J, body.image(q).body).p90 < 0.1


def test_what_was_asked_before_and_is_handed_out_changes_nothing():
    body, other = model(), np.random.default_rng(0).normal(size=(*SIZE, 2, N)).astype(np.float32)
    postures = [np.array([0.2, -0.15, 0.3]), np.array([0.0, 0.1, -0.1])]
    fresh = [model().corrected_jacobian(q, other) for q in postures]
    for _ in range(2):
        for q, expected in zip(postures, fresh, strict=True):
            body.image(q).points[...] = 3
            body.known(q)[1][...] = True
            np.testing.assert_array_equal(body.corrected_jacobian(q, other), expected)
            np.testing.assert_array_equal(body.jacobian(q), model().jacobian(q))


def test_what_is_in_front_at_another_posture_meanwhile_changes_nothing():
    body, other = model(), np.random.default_rng(0).normal(size=(*SIZE, 2, N)).astype(np.float32)
    q, elsewhere, all_joints = np.array([0.2, -0.15, 0.3]), np.array([0.0, 0.1, -0.1]), np.ones(N, bool)
    drawing, front = body._drawing, body._drawing.front(q)
    drawing.jacobian(q, all_joints, front)
    drawing.front(elsewhere)
    corrected = drawing.jacobian(q, all_joints, front, other)
    np.testing.assert_array_equal(corrected, model().corrected_jacobian(q, other))
    step = np.array([0.02, -0.03, 0.05])
    drawing.front(elsewhere)
    np.testing.assert_array_equal(drawing.motion(q, all_joints, front, step), model().moved(q, step)[0])
    assert drawing.front(elsewhere).index is not front.index
    np.testing.assert_array_equal(drawing.front(elsewhere).index, model()._drawing.front(elsewhere).index)
    fewer = np.arange(N) > 0
    assert not drawing.jacobian(q, fewer, front)[..., 0].any()


def test_a_body_without_points_has_no_j():
    body = model()
    none = replace(body.surface, points=body.surface.points[:0], links=body.surface.links[:0],
                   support=body.surface.support[:0], gray=body.surface.gray[:0])  # fmt: skip
    empty = BodyModel(replace(body._content(), surface=none))
    assert not empty.corrected_jacobian(np.zeros(N), np.ones((*SIZE, 2, N))).any()
    assert not empty.moved(np.zeros(N), np.ones(N))[0].any()


@pytest.mark.parametrize("huge", [1e15, -1e25, 3e38])
def test_a_j_beyond_all_bounds_changes_nothing(huge):
    body, q = model(), np.array([0.2, -0.15, 0.3])
    corrected = body.corrected_jacobian(q, np.full((*SIZE, 2, N), huge))
    assert np.isfinite(corrected).all()
    assert jacobian_error(corrected, body.jacobian(q), body.image(q).body).p90 < 0.1


def test_bad_input_is_refused():
    body, right = model(), np.zeros((*SIZE, 2, N))
    with pytest.raises(DenseVSError, match=r"measured has shape .* expected .*\(48, 64, 2, 3\)"):
        body.corrected_jacobian(np.zeros(N), right[1:])
    with pytest.raises(DenseVSError, match=r"measured is .* finite"):
        body.corrected_jacobian(np.zeros(N), np.full_like(right, np.nan))
    with pytest.raises(DenseVSError, match="q has"):
        body.corrected_jacobian(np.zeros(N - 1), right)
    with pytest.raises(DenseVSError, match="q has"):
        body.moved(np.zeros(N - 1), np.zeros(N))
    with pytest.raises(DenseVSError, match=r"dq is .* finite"):
        body.moved(np.zeros(N), np.full(N, np.nan))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("bend", "learned"), [(0.0, (True,) * 3), (-0.1, (True, True, False))])
def test_a_filter_is_drawn_to_the_corrected_j_by_the_shares(order, bend, learned):
    """In one pass as by J made whole and blended after; off the body it goes to 0, and where no share is it stays."""
    body, rng = model(bend, learned), np.random.default_rng(order)
    options = {"height": SIZE[0], "width": SIZE[1], "joints": N, "order": order, "device": "cpu"}
    whole, one_pass = DenseJacobian(**options), DenseJacobian(**options)
    for k in range(4):
        flow, step = rng.normal(0, 2, (*SIZE, 2)).astype(np.float32), rng.normal(0, 0.05, N)
        q = np.array([0.2, -0.15, 0.3]) - 0.1 * k
        share = np.where(rng.uniform(size=SIZE) < 0.6, rng.uniform(size=SIZE), 0).astype(np.float32)
        for estimator in (whole, one_pass):
            estimator.update(flow, step)
        before = one_pass.to_numpy().copy()
        whole.blend(body.corrected_jacobian(q, whole.to_numpy()), share)
        one_pass.blend(partial(body.blend, q), share)
        found = one_pass.to_numpy()
        np.testing.assert_allclose(found, whole.to_numpy(), rtol=1e-4, atol=1e-3)
        np.testing.assert_array_equal(found[share == 0], before[share == 0])
        assert np.abs(found - before)[share > 0.5].max() > 1


def test_two_filters_take_turns():
    body, q = model(), np.array([0.2, -0.15, 0.3])
    ones = np.ones(SIZE, np.float32)
    filters = [DenseJacobian(height=SIZE[0], width=SIZE[1], joints=N, device="cpu") for _ in range(3)]
    for _ in range(2):
        for estimator in filters:
            estimator.blend(partial(body.blend, q), ones)
            still = body.corrected_jacobian(q, estimator.to_numpy())
            estimator.reset()
            estimator.blend(partial(body.blend, q), 0 * ones)
            assert not estimator.to_numpy().any()
            assert still.any()


def test_what_does_not_fit_is_not_drawn():
    body, q, ones = model(), np.array([0.2, -0.15, 0.3]), np.ones(SIZE, np.float32)
    options = {"height": SIZE[0], "width": SIZE[1], "joints": N, "device": "cpu"}
    estimator = DenseJacobian(**options)
    for wrong in ({"joints": 2}, {"height": 32}, {"width": 96}):
        other = DenseJacobian(**{**options, **wrong})
        size = other.options.height, other.options.width
        with pytest.raises(DenseVSError, match="present is of"):
            other.blend(lambda present, share: body.blend(q, present, ones), np.ones(size, np.float32))
        assert not other.to_numpy().any()
    with pytest.raises(DenseVSError, match="q has shape"):
        estimator.blend(partial(body.blend, q[:2]), ones)
    with pytest.raises(DenseVSError, match="present is None; expected a PresentState"):
        body.blend(q, None, ones)
    for share in (ones[1:], np.where(ones > 0, np.nan, 0), 1.01 * ones, -0.01 * ones):
        with pytest.raises(DenseVSError, match="share "):
            estimator.blend(lambda present, _, share=share: body.blend(q, present, share), ones)
    with pytest.raises(DenseVSError, match="share is from"):
        estimator.blend(partial(body.blend, q), 1.5 * ones)
    assert not estimator.to_numpy().any()
