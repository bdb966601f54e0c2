"""The filter's kernels against the equations in float64, through ``DenseJacobian``, on hostile input.

With ``"model"`` the estimate moves itself: where the flow jumps by hundreds of px from pixel to pixel, a rounding
error in J grows by that factor every frame, in any precision. White noise of that size is therefore given to
``"flow"`` and ``"none"``; ``"model"`` gets flows that are as large but smooth, and white noise of a fraction of a px.
"""

import numpy as np
import pytest
from reference_filters import ReferenceJacobian, SecondOrderModel

from dense_vs import DenseJacobian

# Of the largest |J|: float32 state, a few frames, and shifts of hundreds of px split into whole and fraction.
TOLERANCE = 1e-4
# Of the largest variance: a variance per pixel is float32, and what is left of it after an update a small difference.
VARIANCE_TOLERANCE = 1e-6

FORMS = [
    *[("shared", joints, 1) for joints in (1, 4, 7, 32)],
    *[("shared", joints, 2) for joints in (1, 4)],
    *[("diagonal", joints, 1) for joints in (1, 4, 7, 32)],
    *[("fixed", joints, 1) for joints in (1, 4, 7, 32)],
    *[("full", joints, 1) for joints in (1, 4, 7)],
]
NAMES = [f"{form}-{joints}-order{order}" for form, joints, order in FORMS]


def joint_steps(rng, joints, frames):
    """Lively steps of either sign, so that no frame asks for a J that is a thousand times another frame's."""
    return (rng.uniform(0.02, 0.05, (frames, joints)) * rng.choice([-1, 1], (frames, joints))).astype(np.float32)


def white(amplitude):
    def flow(rng, height, width):
        return rng.normal(0, amplitude, (height, width, 2))

    return flow


def smooth(amplitude):
    """A flow whose size reaches far beyond the image, but which changes slowly over it."""

    def flow(rng, height, width):
        y, x = np.mgrid[:height, :width]
        places = np.stack([x / width - 0.5, y / height - 0.5], axis=-1)
        return rng.choice([-1, 1], 2) * rng.uniform(0.5, 1, 2) * amplitude + places @ rng.normal(0, 3, (2, 2))

    return flow


def patchy(rng, height, width):
    """Still background, a block that leaves the image, and one row of noise at the border."""
    flow = np.zeros((height, width, 2))
    flow[height // 3 :, width // 2 :] = 3.3, -1.7
    flow[0] = rng.normal(0, 0.5, (width, 2))
    return flow


SCENARIOS = {
    # name: (height, width, worlds, flow, options)
    "noise": (19, 23, 1, white(0.3), {}),
    "worlds": (8, 21, 3, white(0.3), {"prediction_iterations": 3}),
    "as printed": (17, 12, 1, white(0.5), {"prediction_iterations": 1}),
    "far and smooth": (15, 26, 1, smooth(300), {}),
    "far and white": (13, 18, 1, white(400), {"prediction": "flow"}),
    "in place": (13, 18, 1, white(400), {"prediction": "none"}),
    "patches": (16, 9, 1, patchy, {}),
    "patches by flow": (9, 16, 3, patchy, {"prediction": "flow"}),
    "2 x 2": (2, 2, 3, white(0.4), {}),
    "2 px high": (2, 31, 1, smooth(40), {}),
    "2 px wide by flow": (31, 2, 1, white(40), {"prediction": "flow"}),
    "noises": (
        11,
        14,
        1,
        white(0.3),
        {
            "process_noise": 3e3,
            "drift_noise": 2.0,
            "measurement_noise": 0.2,
            "initial_variance": 500.0,
            "max_variance": 700.0,
        },
    ),
}


def make(form, joints, order, height, width, worlds=1, threads=2, **options):
    return DenseJacobian(
        height=height,
        width=width,
        joints=joints,
        worlds=worlds,
        covariance=form,
        order=order,
        threads=threads,
        device="cpu",
        **options,
    )


def poison_outputs(estimator):
    """Fill what the next update has to write, so that an element it leaves out shows."""
    arrays = estimator.filter
    arrays.state[1 - arrays.now].fill_(np.nan)
    if estimator.options.covariance != "fixed":
        arrays.covariance[1 - arrays.now].fill_(np.nan)
    arrays.model_flow.fill_(np.nan)
    for array in (arrays.gain, arrays.regressor, arrays.projected):
        array.fill_(np.nan)


def by_world(array, worlds):
    return np.asarray(array)[None] if worlds == 1 else np.asarray(array)


def assert_follows_reference(estimator, frames):
    """Run both over (flow, dq) frames, (worlds, H, W, 2) and (worlds, N)."""
    worlds = estimator.options.worlds
    variance_error = VARIANCE_TOLERANCE * max(estimator.options.max_variance, estimator.options.initial_variance)
    references = [ReferenceJacobian(estimator.options) for _ in range(worlds)]
    for flow, dq in frames:
        poison_outputs(estimator)
        estimator.update(flow[0], dq[0]) if worlds == 1 else estimator.update(flow, dq)
        for world, reference in enumerate(references):
            reference.update(flow[world], dq[world])
            J, variance = (by_world(a, worlds)[world] for a in (estimator.jacobian, estimator.variance))
            largest = np.abs(reference.jacobian).max()
            assert np.abs(J - reference.jacobian).max() <= TOLERANCE * largest
            np.testing.assert_allclose(variance, reference.variance, rtol=TOLERANCE, atol=variance_error)


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize(("form", "joints", "order"), FORMS, ids=NAMES)
def test_follows_the_equations(form, joints, order, scenario):
    height, width, worlds, flow, options = SCENARIOS[scenario]
    rng = np.random.default_rng([joints, order, len(scenario)])
    frames = []
    for _ in range(4):
        u = np.stack([flow(rng, height, width) for _ in range(worlds)]).astype(np.float32)
        frames.append((u, joint_steps(rng, joints, worlds)))
    assert_follows_reference(make(form, joints, order, height, width, worlds, **options), frames)


def test_variance_that_moves_with_the_image():
    rng = np.random.default_rng(3)
    estimator = make("diagonal", 4, 1, 14, 17, on_bad_flow="skip", move_variance=True)
    frames = [(white(0.4)(rng, 14, 17)[None].astype(np.float32), joint_steps(rng, 4, 1)) for _ in range(4)]
    frames[1][0][0, 5:9, 3:8] = np.nan  # leaves a patch of high variance for the next frames to move
    assert_follows_reference(estimator, frames)
    moved = np.array(estimator.variance)
    estimator = make("diagonal", 4, 1, 14, 17, on_bad_flow="skip")
    assert_follows_reference(estimator, frames)
    assert np.abs(moved - estimator.variance).max() > 0.01 * moved.max()


@pytest.mark.parametrize(("form", "order"), [("shared", 2), ("shared", 1), ("diagonal", 1), ("fixed", 1), ("full", 1)])
@pytest.mark.parametrize("prediction", ["model", "flow", "none"])
def test_bad_pixels_are_predicted_only(form, order, prediction):
    rng = np.random.default_rng(4)
    estimator = make(form, 4, order, 12, 13, prediction=prediction, on_bad_flow="skip")
    frames = [(white(0.4)(rng, 12, 13)[None].astype(np.float32), joint_steps(rng, 4, 1)) for _ in range(4)]
    frames[1][0][0, 0, 0] = np.nan
    frames[1][0][0, 5, 7, 1] = np.inf
    frames[2][0][0, 5:8, 6:] = -np.inf
    assert_follows_reference(estimator, frames)


@pytest.mark.parametrize(("form", "joints", "order"), FORMS, ids=NAMES)
def test_nothing_changes_a_bit_while_nothing_moves(form, joints, order):
    rng = np.random.default_rng(5)
    estimator = make(form, joints, order, 9, 14)
    for dq in joint_steps(rng, joints, 3):
        estimator.update(white(0.5)(rng, 9, 14).astype(np.float32), dq)
    J, variance = np.array(estimator.jacobian), np.array(estimator.variance)
    for _ in range(3):
        poison_outputs(estimator)
        estimator.update(np.zeros((9, 14, 2), np.float32), np.zeros(joints, np.float32))
    np.testing.assert_array_equal(estimator.jacobian, J)
    np.testing.assert_array_equal(estimator.variance, variance)
    assert np.abs(J).max() > 0


@pytest.mark.parametrize("joints", [1, 4])
def test_second_order_model_is_the_expansion_of_a_quadratic_posture(joints):
    """The reference itself: its F and h reproduce x(q) = J q + q^T H q / 2 without remainder."""
    rng = np.random.default_rng(6)
    J, H = rng.normal(size=joints), rng.normal(size=(joints, joints))
    H += H.T
    dq = rng.normal(size=joints)
    model = SecondOrderModel(joints)
    state = np.concatenate([J, [H[pair] for pair in model.pairs]])
    moved = model.transition(dq) @ state
    np.testing.assert_allclose(moved[:joints], J + H @ dq)
    np.testing.assert_allclose(moved[joints:], state[joints:])
    np.testing.assert_allclose(model.observation(dq) @ moved, J @ dq + 0.5 * dq @ H @ dq)
