"""What the estimator takes and refuses, and that a refusal leaves it as it was."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.jacobian.options import JacobianOptions

HEIGHT, WIDTH, JOINTS = 10, 13, 4
FORMS = [("shared", 2), ("shared", 1), ("diagonal", 1), ("fixed", 1), ("full", 1)]


def make(**options):
    return DenseJacobian(**{"height": HEIGHT, "width": WIDTH, "joints": JOINTS, "device": "cpu", **options})


def random_frame(seed, worlds=None):
    rng = np.random.default_rng(seed)
    lead = () if worlds is None else (worlds,)
    flow = rng.normal(0, 1, (*lead, HEIGHT, WIDTH, 2)).astype(np.float32)
    return flow, rng.normal(0, 0.03, (*lead, JOINTS)).astype(np.float32)


FLOW, DQ = random_frame(0)


def snapshot(estimator) -> list[Any]:
    arrays = estimator.jacobian, estimator.variance, estimator.covariance, estimator.skipped_pixels
    return [np.array(a) for a in arrays] + [estimator.updates]


def assert_same(before, after):
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)


def changed(array, index, value):
    copy = array.copy()
    copy[index] = value
    return copy


class InterfaceOnly:
    """Nothing but ``__array_interface__``."""

    def __init__(self, array):
        self._array = array
        self.__array_interface__ = array.__array_interface__


class DlpackOnly:
    """Nothing but dlpack, as a tensor of a library that NumPy does not know."""

    def __init__(self, array):
        self._array = array

    def __dlpack__(self, **options):
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self._array.__dlpack_device__()


def read_only(array):
    copy = array.copy()
    copy.flags.writeable = False
    return copy


def strided(array):
    twice = np.full([2 * n for n in array.shape], np.nan, dtype=array.dtype)
    view = twice[tuple(slice(None, None, 2) for _ in array.shape)]
    view[...] = array
    assert not view.flags.c_contiguous
    return view


SAME_NUMBERS = {
    "strided": strided,
    "reversed": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "fortran": np.asfortranarray,
    "read-only": read_only,
    "warp": lambda a: wp.array(a, dtype=wp.float32, device="cpu"),
    "__array_interface__": InterfaceOnly,
    "__dlpack__": DlpackOnly,
    "big-endian": lambda a: a.astype(">f4"),
}


@pytest.mark.parametrize("kind", SAME_NUMBERS)
def test_takes_arrays_of_every_kind(kind):
    plain, other = make(), make()
    for seed in range(2):
        flow, dq = random_frame(seed)
        plain.update(flow, dq)
        other.update(SAME_NUMBERS[kind](flow), SAME_NUMBERS[kind](dq))
    assert_same(snapshot(plain), snapshot(other))


@pytest.mark.parametrize("worlds", [1, 3])
def test_takes_warp_vectors(worlds):
    plain, other = make(worlds=worlds), make(worlds=worlds)
    flow, dq = random_frame(1, worlds)
    if worlds == 1:
        flow, dq = flow[0], dq[0]
    plain.update(flow, dq)
    other.update(wp.array(flow, dtype=wp.vec2, device="cpu"), dq)
    assert_same(snapshot(plain), snapshot(other))


@pytest.mark.parametrize("library", ["torch", "jax.numpy"])
def test_takes_arrays_of_other_libraries(library):
    module = pytest.importorskip(library, reason=f"{library} is not installed")
    plain, other = make(), make()
    plain.update(FLOW, DQ)
    other.update(module.asarray(FLOW), module.asarray(DQ))
    assert_same(snapshot(plain), snapshot(other))


def test_takes_joint_steps_as_float64_and_as_lists():
    plain, double, listed = make(), make(), make()
    plain.update(FLOW, DQ)
    double.update(FLOW, DQ.astype(np.float64))
    listed.update(FLOW, DQ.astype(float).tolist())
    assert_same(snapshot(plain), snapshot(double))
    assert_same(snapshot(plain), snapshot(listed))


def test_takes_one_world_with_its_leading_axis():
    plain, batched = make(), make()
    plain.update(FLOW, DQ)
    batched.update(FLOW[None], DQ)
    assert_same(snapshot(plain), snapshot(batched))


def test_never_writes_its_inputs():
    flow, dq = read_only(FLOW), read_only(DQ)
    estimator = make()
    estimator.update(flow, dq)
    estimator.predicted_flow(dq)
    estimator.at(read_only(np.array([[1.0, 2.0]])))
    np.testing.assert_array_equal(flow, FLOW)
    np.testing.assert_array_equal(dq, DQ)


def test_does_not_keep_hold_of_its_inputs():
    kept, overwritten = make(), make()
    flow, dq = FLOW.copy(), DQ.copy()
    kept.update(FLOW, DQ)
    overwritten.update(flow, dq)
    flow[...], dq[...] = 1e6, 1e6  # as a camera does that fills one buffer over and over
    assert_same(snapshot(kept), snapshot(overwritten))


def test_worlds_are_independent():
    together = make(worlds=3)
    alone = [make() for _ in range(3)]
    for seed in range(3):
        flow, dq = random_frame(seed, 3)
        together.update(flow, dq)
        for world, estimator in enumerate(alone):
            estimator.update(flow[world], dq[world])
    step = random_frame(9, 3)[1]
    points = np.random.default_rng(0).uniform(-2, 15, (3, 5, 2))
    for world, estimator in enumerate(alone):
        assert_same([a[world] for a in snapshot(together)[:4]], snapshot(estimator)[:4])
        np.testing.assert_array_equal(together.predicted_flow(step)[world], estimator.predicted_flow(step[world]))
        np.testing.assert_array_equal(together.at(points)[world], estimator.at(points[world]))


@pytest.mark.parametrize("view", ["jacobian", "variance"])
@pytest.mark.parametrize("form", ["shared", "diagonal", "full"])
def test_results_cannot_be_written(view, form):
    array = getattr(make(covariance=form, order=1), view)
    with pytest.raises(ValueError, match="read-only"):
        array[...] = 1


@pytest.mark.parametrize(("worlds", "shape"), [(1, (HEIGHT, WIDTH, 2, JOINTS)), (3, (3, HEIGHT, WIDTH, 2, JOINTS))])
def test_shapes_and_dtypes(worlds, shape):
    estimator = make(worlds=worlds)
    dq = np.zeros((JOINTS,) if worlds == 1 else (worlds, JOINTS))
    lead = shape[:-2]
    assert (estimator.jacobian.shape, estimator.jacobian.dtype) == (shape, np.float32)
    assert (estimator.variance.shape, estimator.variance.dtype) == ((*lead, JOINTS), np.float32)
    predicted = estimator.predicted_flow(dq)
    assert (predicted.shape, predicted.dtype) == ((*lead, 2), np.float32)
    at = estimator.at(np.zeros((7, 2) if worlds == 1 else (worlds, 7, 2)))
    assert (at.shape, at.dtype) == ((*lead[:-2], 7, 2, JOINTS), np.float32)


BAD_FLOW = {
    "transposed": (FLOW.transpose(1, 0, 2), r"flow has shape \(13, 10, 2\) and dtype float32; .*\(10, 13, 2\)"),
    "flat": (FLOW[..., 0], r"shape \(10, 13\)"),
    "three components": (np.zeros((HEIGHT, WIDTH, 3), np.float32), r"shape \(10, 13, 3\)"),
    "two worlds": (np.zeros((2, HEIGHT, WIDTH, 2), np.float32), r"shape \(2, 10, 13, 2\)"),
    "empty": (np.zeros((0, 0, 2), np.float32), r"shape \(0, 0, 2\)"),
    "float64": (FLOW.astype(np.float64), "dtype float64; expected a float32"),
    "float16": (FLOW.astype(np.float16), "dtype float16; expected a float32"),
    "int": (FLOW.astype(np.int32), "dtype int32; expected a float32"),
    "complex": (FLOW.astype(np.complex64), "dtype complex64; expected a float32"),
    "list": (FLOW.tolist(), "dtype float64; expected a float32"),
    "ragged": ([[1.0], [1.0, 2.0]], "flow is a list; expected a float32"),
    "text": ("flow", "flow has .*expected a float32"),
    "none": (None, "flow has .*expected a float32"),
    "warp float64": (wp.array(FLOW, dtype=wp.float64, device="cpu"), "dtype float64; expected a float32"),
    "warp vec3": (wp.zeros((HEIGHT, WIDTH), dtype=wp.vec3, device="cpu"), r"shape \(10, 13, 3\)"),
    "nan": (changed(FLOW, (3, 4, 1), np.nan), "flow has 1 pixels that are not finite; expected finite"),
    "inf": (changed(FLOW, (slice(2), 0, 0), -np.inf), "flow has 2 pixels that are not finite.*on_bad_flow='skip'"),
}
BAD_DQ = {
    "short": (DQ[:3], r"dq has shape \(3,\) and dtype float32; expected finite floating-point numbers of shape \(4,\)"),
    "long": (np.zeros(5), r"dq has shape \(5,\)"),
    "column": (DQ[:, None], r"dq has shape \(4, 1\)"),
    "scalar": (0.1, r"dq has shape \(\)"),
    "int": (np.ones(JOINTS, dtype=np.int64), "dtype int64; expected finite floating-point"),
    "bool": (np.ones(JOINTS, dtype=bool), "dtype bool; expected finite floating-point"),
    "complex": (DQ.astype(np.complex128), "dtype complex128; expected finite floating-point"),
    "text": (["a", "b", "c", "d"], "dq has .*expected finite floating-point"),
    "ragged": ([[1.0], [1.0, 2.0]], "dq is a list; expected finite floating-point"),
    "none": (None, "dq has .*expected finite floating-point"),
    "nan": (changed(DQ, 2, np.nan), r"dq is \[.*nan.*\]; expected finite"),
    "inf": (changed(DQ, 0, np.inf), r"dq is \[inf.*\]; expected finite"),
    "beyond float32": (np.full(JOINTS, 1e300), r"dq is \[1e\+300.*\]; expected finite"),
}


@pytest.mark.parametrize("case", BAD_FLOW)
def test_refuses_a_flow(case):
    flow, message = BAD_FLOW[case]
    estimator = make()
    estimator.update(FLOW, DQ)
    before = snapshot(estimator)
    with pytest.raises(DenseVSError, match=message):
        estimator.update(flow, DQ)
    assert_same(before, snapshot(estimator))


@pytest.mark.parametrize("case", BAD_DQ)
def test_refuses_a_joint_step(case):
    dq, message = BAD_DQ[case]
    estimator = make()
    estimator.update(FLOW, DQ)
    before = snapshot(estimator)
    with pytest.raises(DenseVSError, match=message):
        estimator.update(FLOW, dq)
    with pytest.raises(DenseVSError, match=message):
        estimator.predicted_flow(dq)
    assert_same(before, snapshot(estimator))


def test_several_worlds_refuse_the_arrays_of_one():
    estimator = make(worlds=3)
    flow, dq = random_frame(0, 3)
    estimator.update(flow, dq)
    before = snapshot(estimator)
    for bad_flow, bad_dq in ((FLOW, dq), (flow, DQ), (flow[:2], dq), (flow, dq[:2]), (flow, [[1.0], [1.0, 2.0]])):
        with pytest.raises(DenseVSError, match="expected"):
            estimator.update(bad_flow, bad_dq)
    assert_same(before, snapshot(estimator))


@pytest.mark.parametrize(("form", "order"), FORMS)
def test_goes_on_after_a_refusal_as_if_it_had_not_been(form, order):
    undisturbed, refused = (make(covariance=form, order=order) for _ in range(2))
    for seed in range(3):
        flow, dq = random_frame(seed)
        undisturbed.update(flow, dq)
        with pytest.raises(DenseVSError, match="not finite"):
            refused.update(changed(flow, (5, 5), np.nan), dq)
        refused.update(flow, dq)
        assert_same(snapshot(undisturbed), snapshot(refused))


@pytest.mark.parametrize(("form", "order"), FORMS)
@pytest.mark.parametrize("prediction", ["model", "flow"])
def test_skipped_pixels_leave_their_neighbours_alone(form, order, prediction):
    """After a first frame the state is smooth and non-zero; one bad pixel then changes that pixel alone."""
    clean, holed = (make(covariance=form, order=order, prediction=prediction, on_bad_flow="skip") for _ in range(2))
    for estimator in (clean, holed):
        estimator.update(FLOW, DQ)
    flow, dq = random_frame(1)
    bad = np.zeros((HEIGHT, WIDTH), dtype=bool)
    bad[0, 0] = bad[4, 6] = bad[9, 12] = True
    clean.update(flow, dq)
    holed.update(changed(changed(flow, (bad, 0), np.nan), (4, 6), np.inf), dq)
    assert (clean.skipped_pixels, holed.skipped_pixels) == (0, 3)
    np.testing.assert_array_equal(np.array(holed.jacobian)[~bad], np.array(clean.jacobian)[~bad])
    np.testing.assert_array_equal(np.array(holed.variance)[~bad], np.array(clean.variance)[~bad])
    assert np.isfinite(holed.jacobian).all()
    assert (np.array(holed.jacobian)[bad] != np.array(clean.jacobian)[bad]).any(axis=(1, 2)).all()
    holed.update(*random_frame(2))
    assert holed.skipped_pixels == 0
    assert np.isfinite(holed.jacobian).all()


def test_skipped_pixels_are_counted_by_world():
    estimator = make(worlds=3, on_bad_flow="skip")
    flow, dq = random_frame(0, 3)
    flow[1, 2:4, 5] = np.nan
    flow[2, 0, 0, 1] = np.inf
    estimator.update(flow, dq)
    np.testing.assert_array_equal(estimator.skipped_pixels, [0, 2, 1])


BAD_OPTIONS = [
    ({"height": 1}, "height is 1; expected a whole number from 2 to"),
    ({"width": 20.0}, "width is 20.0; expected a whole number"),
    ({"height": "tall"}, "height is 'tall'; expected a whole number"),
    ({"joints": 0}, "joints is 0; expected a whole number from 1 to"),
    ({"joints": True}, "joints is True; expected a whole number"),
    ({"joints": 65}, "joints is 65; expected a whole number from 1 to 64"),
    ({"worlds": 0}, "worlds is 0; expected"),
    ({"worlds": -1}, "worlds is -1; expected"),
    ({"covariance": "Shared"}, "covariance is 'Shared'; expected one of shared, diagonal, fixed, full"),
    ({"covariance": ["full"]}, "covariance is .*expected one of"),
    ({"prediction": None}, "prediction is None; expected one of model, flow, none"),
    ({"on_bad_flow": "ignore"}, "on_bad_flow is 'ignore'; expected one of error, skip"),
    ({"prediction_iterations": 0}, "prediction_iterations is 0; expected"),
    ({"prediction_iterations": 11}, "prediction_iterations is 11; expected"),
    ({"order": 3}, "order is 3; expected 1 or 2"),
    ({"order": "2"}, "order is '2'; expected 1 or 2"),
    ({"order": True}, "order is True; expected 1 or 2"),
    ({"order": 2, "covariance": "diagonal"}, "order 2 with covariance 'diagonal'.*expected covariance 'shared'"),
    ({"order": 2, "joints": 9}, "order 2 with .*9 joints; expected .*at most 8 joints"),
    ({"covariance": "full", "joints": 9}, "'full' with 9 joints; expected at most 8"),
    ({"process_noise": -1.0}, "process_noise is -1.0; expected a finite number of at least 0"),
    ({"drift_noise": float("nan")}, "drift_noise is nan; expected a finite number"),
    ({"measurement_noise": 0.0}, "measurement_noise is 0.0; expected a finite number above 0"),
    ({"initial_variance": float("inf")}, "initial_variance is inf; expected a finite number above 0"),
    ({"initial_variance": "big"}, "initial_variance is 'big'; expected a finite number"),
    ({"hessian_noise": None}, "hessian_noise is None; expected a finite number"),
    ({"initial_hessian_variance": 0}, "initial_hessian_variance is 0; expected a finite number above 0"),
    ({"max_variance": -5}, "max_variance is -5; expected a finite number above 0"),
    ({"measurement_noise": True}, "measurement_noise is True; expected a finite number"),
    ({"colour": 1}, "unknown option 'colour'; expected device, threads or height, width, joints"),
    ({"device": "cuda:99"}, "device 'cuda:99' is not present; expected 'auto' or one of cpu"),
    ({"device": "gpu"}, "device 'gpu' is not present; expected 'auto' or one of cpu"),
    ({"device": 0}, "device 0 is not present; expected 'auto' or one of cpu"),
]


@pytest.mark.parametrize(("options", "message"), BAD_OPTIONS, ids=[str(options) for options, _ in BAD_OPTIONS])
def test_refuses_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        make(**options)


@pytest.mark.parametrize("missing", ["height", "width", "joints"])
def test_refuses_to_guess_a_size(missing):
    options: dict[str, Any] = {"height": 8, "width": 8, "joints": 4}
    del options[missing]
    with pytest.raises(DenseVSError, match=f"option '{missing}' is missing; height, width and joints are required"):
        DenseJacobian(**options)


def test_order_defaults_to_two_where_it_is_cheap():
    def order(**options):
        return JacobianOptions(**{"height": 8, "width": 8, **options}).order

    assert order(joints=4) == order(joints=6) == 2
    assert order(joints=7) == order(joints=4, covariance="diagonal") == 1
    assert order(joints=8, order=2) == 2
