"""The layout of the state that a GPU takes, tried on the CPU: same estimate as the other one."""

import numpy as np
import pytest
import warp as wp

from dense_vs.jacobian.blending import blending
from dense_vs.jacobian.filter import JacobianFilter, filter_bytes
from dense_vs.jacobian.options import JacobianOptions

HEIGHT, WIDTH, JOINTS, WORLDS = 21, 33, 2, 3
# Float32 sums in another order: J dq sampled, or sampled J times dq.
TOLERANCE = 2e-4  # of the largest entry

FORMS = [
    {"order": 1},
    {"order": 2},
    {"order": 1, "prediction_iterations": 3},
    {"order": 1, "prediction": "flow"},
    {"order": 1, "prediction": "none"},
    {"covariance": "fixed"},
    {"covariance": "diagonal", "move_variance": True},
    {"covariance": "diagonal", "prediction_iterations": 1},
    {"covariance": "diagonal", "prediction": "flow"},
    {"covariance": "diagonal", "prediction": "none"},
    {"covariance": "full"},
]


def filters(joints=JOINTS, **options):
    checked = JacobianOptions(height=HEIGHT, width=WIDTH, joints=joints, worlds=WORLDS, on_bad_flow="skip", **options)
    cpu = wp.get_device("cpu")
    return [JacobianFilter(checked, cpu, 2, layout=layout) for layout in ("matrices", "planes")]


def drive(both, frames, seed=0, hole=True):
    random = np.random.default_rng(seed)
    joints = both[0].options.joints
    smooth = np.kron(random.normal(0, 30, (WORLDS, 3, 3, 2, joints)), np.ones((1, 7, 11, 1, 1)))
    for _ in range(frames):
        dq = random.normal(0, 0.03, (WORLDS, joints)).astype(np.float32)
        flow = np.einsum("whxij,wj->whxi", smooth, dq).astype(np.float32)
        flow += random.normal(0, 0.05, flow.shape).astype(np.float32)
        if hole:
            flow[1, 4:6, 7:9] = np.nan
        for one in both:
            one.stage(wp.array(flow, dtype=wp.vec2, device="cpu"))
            one.advance(dq)


@pytest.mark.parametrize("options", FORMS, ids=str)
def test_planes_and_matrices_give_the_same_estimate(options):
    both = filters(**options)
    drive(both, 6)
    matrices, planes = (one.stored() for one in both)
    for name, expected in matrices.items():
        assert np.isfinite(expected).all()
        assert planes[name].shape == expected.shape
        np.testing.assert_allclose(planes[name], expected, atol=TOLERANCE * np.abs(expected).max(), rtol=0)
    jacobians = [one.present().numpy() for one in both]
    assert np.abs(jacobians[0]).max() > 10
    np.testing.assert_allclose(jacobians[1], jacobians[0], atol=TOLERANCE * np.abs(jacobians[0]).max(), rtol=0)
    points = np.random.default_rng(1).uniform(-2, WIDTH, (WORLDS, 5, 2))
    at = [one.at(points).numpy() for one in both]
    np.testing.assert_allclose(at[1], at[0], atol=TOLERANCE * np.abs(jacobians[0]).max(), rtol=0)
    step = np.full((WORLDS, JOINTS), 0.02, dtype=np.float32)
    flows = [one.predicted_flow(step).numpy() for one in both]
    np.testing.assert_allclose(flows[1], flows[0], atol=TOLERANCE * np.abs(flows[0]).max(), rtol=0)


@pytest.mark.parametrize(
    "options",
    [{"order": 1}, {"order": 2}, *({"covariance": "diagonal", "joints": joints} for joints in (1, 2, 3, 4, 7))],
)
def test_a_stored_state_goes_on_in_the_other_layout(options):
    matrices, planes = filters(**options)
    drive([matrices], 3)
    planes.restore(matrices.stored())
    for name, expected in matrices.stored().items():
        np.testing.assert_array_equal(planes.stored()[name], expected)
    drive([matrices, planes], 2)
    for name, expected in matrices.stored().items():
        np.testing.assert_allclose(planes.stored()[name], expected, atol=TOLERANCE * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize("order", [1, 2])
def test_forgetting_touches_the_chosen_worlds_only(order):
    both = filters(order=order)
    drive(both, 3)
    kept = [one.stored() | {"state": one.stored()["state"].copy()} for one in both]
    kept = [{name: np.array(array) for name, array in one.items()} for one in kept]
    fresh = filters(order=order)[0].stored()
    for one, before in zip(both, kept, strict=True):
        one.forget(wp.array([0, 1, 0], dtype=int, device="cpu"))
        for name, array in one.stored().items():
            np.testing.assert_array_equal(array[[0, 2]], before[name][[0, 2]])
            np.testing.assert_array_equal(array[1], fresh[name][1])
            assert name == "displacement" or not np.array_equal(before[name][1], fresh[name][1])


def test_a_filter_reads_the_flow_where_someone_else_wrote_it():
    options = JacobianOptions(height=HEIGHT, width=WIDTH, joints=JOINTS, worlds=1, order=1)
    flow = wp.zeros((1, HEIGHT, WIDTH), dtype=wp.vec2, device="cpu")
    bound = JacobianFilter(options, wp.get_device("cpu"), 1, flow=flow)
    own = JacobianFilter(options, wp.get_device("cpu"), 1)
    flow.fill_(wp.vec2(1.0, -2.0))
    own.stage(flow)
    dq = np.array([[0.02, 0.01]], dtype=np.float32)
    for one in (bound, own):
        one.advance(dq)
    np.testing.assert_array_equal(bound.stored()["state"], own.stored()["state"])
    assert np.abs(bound.stored()["state"]).max() > 1


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
@pytest.mark.parametrize("form", [{"order": 1}, {"order": 2}, {"covariance": "diagonal"}], ids=str)
def test_the_last_of_very_many_worlds_is_as_good_as_the_first(form):
    """More blocks than one axis of a grid holds, and an image that tiles do not divide."""
    height, width, worlds = 243, 325, 260
    rng = np.random.default_rng(0)
    options = {"height": height, "width": width, "joints": 4, "on_bad_flow": "skip", **form}
    many = JacobianFilter(JacobianOptions(worlds=worlds, **options), wp.get_device("cuda:0"), 1)
    one = JacobianFilter(JacobianOptions(**options), wp.get_device("cpu"), 2)
    for _ in range(3):
        flow = rng.normal(0, 1, (1, height, width, 2)).astype(np.float32)
        dq = rng.normal(0, 0.03, (1, 4)).astype(np.float32)
        one.stage(wp.array(flow, dtype=wp.vec2, device="cpu"))
        one.advance(dq)
        many.stage(wp.array(np.repeat(flow, worlds, axis=0), dtype=wp.vec2, device="cuda:0"))
        many.advance(np.repeat(dq, worlds, axis=0))
    expected, found = one.present().numpy()[0], many.present().numpy()
    for world in (0, 100, 201, 217, worlds - 1):
        np.testing.assert_allclose(found[world], expected, atol=TOLERANCE * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize("options", [{"order": 1}, {"order": 2}, {"covariance": "diagonal", "joints": 3}])
def test_j_is_drawn_by_a_share_in_either_layout_and_nothing_else_changes(options):
    both = filters(**options)
    joints = both[0].options.joints
    random = np.random.default_rng(3)
    other = random.normal(0, 100, (WORLDS, HEIGHT, WIDTH, 2, joints)).astype(np.float32)
    share = random.uniform(0, 1, (WORLDS, HEIGHT, WIDTH)).astype(np.float32)
    share[:, ::3] = 0
    drive(both, 4, hole=False)
    for one in both:
        before = one.present().numpy().astype(np.float64)
        stored = {name: array.copy() for name, array in one.stored().items()}
        one.change(lambda present: blending(other, 2)(present, share))
        expected = before + share[..., None, None] * (other - before)
        np.testing.assert_allclose(one.present().numpy(), expected, atol=1e-5 * np.abs(expected).max(), rtol=0)
        after = one.stored()
        np.testing.assert_array_equal(after["covariance"], stored["covariance"])
        np.testing.assert_array_equal(after["displacement"], stored["displacement"])
        np.testing.assert_array_equal(after["state"][..., joints:], stored["state"][..., joints:])  # H
        np.testing.assert_array_equal(after["state"][:, ::3], stored["state"][:, ::3])


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_the_memory_that_is_asked_for_is_that_of_its_images(form):
    one = filters(**form)[0]
    images = [*one.state, one.flow, one.model_flow]
    if form.get("covariance") in ("diagonal", "full"):
        images += one.covariance
    allocated = sum(array.capacity for array in images)
    assert WORLDS * filter_bytes(one.options) == pytest.approx(allocated, rel=0.01)
