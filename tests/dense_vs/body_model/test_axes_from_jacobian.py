"""Where the fit starts, by itself: lines and inverse depths from an exact J, before any adjustment could mend them."""

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, serial_body

from dense_vs.body_model.axes_from_jacobian import AxesProblem, AxesState, axes_from_jacobian
from dense_vs.body_model.chain import Chain, ancestors
from dense_vs.body_model.track_jacobian import TrackJacobians

JOINTS = 4


@pytest.fixture(scope="module")
def problem_and_state():
    """Four random lines and a random J, with residuals that are large beside the pull on the depths and not."""
    rng = np.random.default_rng(5)
    count = 9
    axes = rng.normal(size=(JOINTS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    normal = rng.uniform(-0.5, 0.5, (count, 2))
    moved = rng.random((count, JOINTS)) < 0.8
    target = rng.normal(size=(count, 2, JOINTS))
    problem = AxesProblem(normal, target, moved, rng.uniform(0.2, 3.0, moved.shape))
    state = AxesState(
        Chain(axes, rng.normal(size=(JOINTS, 3)), np.zeros(JOINTS), np.arange(JOINTS) - 1),
        rng.uniform(0.6, 1.7, count),
    )
    return problem, state, normal, moved, target


def test_residuals_are_the_velocities_of_points_less_j(problem_and_state):
    """Each column once more from the velocity w x (X - c) of the point, projected."""
    problem, state, normal, moved, target = problem_and_state
    places = np.column_stack([normal, np.ones(len(normal))]) / state.inverse_depths[:, None]
    for n in range(JOINTS):
        velocity = np.cross(state.chain.axes[n], places - state.chain.points[n])
        column = (velocity[:, :2] - normal * velocity[:, 2:]) / places[:, 2:]
        expected = np.where(moved[:, [n]], (column - target[:, :, n]) * problem.root[:, [n]], 0.0)
        np.testing.assert_allclose(problem.residuals(state)[:, :, n], expected, atol=1e-12)


def test_normal_equations_are_those_of_the_derivatives_of_the_residuals(problem_and_state):
    problem, state, *_ = problem_and_state
    count, step = len(state.inverse_depths), 1e-6
    equations = problem.linearize(state)
    residual = problem.residuals(state).ravel()
    shared = np.empty((len(residual), 4 * JOINTS))
    for k in range(4 * JOINTS):
        d = np.zeros(4 * JOINTS)
        d[k] = step
        up, down = (problem.residuals(problem.move(state, sign * d)).ravel() for sign in (1, -1))
        shared[:, k] = (up - down) / (2 * step)
    np.testing.assert_allclose(equations.shared, shared.T @ shared, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(equations.shared_gradient, shared.T @ residual, rtol=1e-6, atol=1e-6)
    for m in range(count):
        d = np.zeros((count, 1))
        d[m] = step
        up, down = (problem.residuals(problem.move(state, np.zeros(4 * JOINTS), sign * d)).ravel() for sign in (1, -1))
        own = (up - down) / (2 * step)
        # The pull p (rho - 1)^2 adds p to half the curvature and p (rho - 1) to half the slope.
        pull = problem.pull
        assert equations.local[m, 0, 0] == pytest.approx(own @ own + pull, abs=0.01 * pull)
        off = state.inverse_depths[m] - 1
        assert equations.local_gradient[m, 0] == pytest.approx(own @ residual + pull * off, abs=0.01 * abs(pull * off))
        np.testing.assert_allclose(equations.coupling[m, 0], own @ shared, atol=1e-6)


def test_one_depth_out_of_bounds_costs_infinitely_much_and_a_step_stays_inside(problem_and_state):
    problem, state, *_ = problem_and_state
    for wrong in (0.19, 5.1):
        depths = state.inverse_depths.copy()
        depths[3] = wrong
        assert problem.cost(AxesState(state.chain, depths)) == np.inf
    for wrong, limit in ((-10.0, 0.2), (10.0, 5.0)):
        d = np.zeros((len(state.inverse_depths), 1))
        d[3] = wrong
        moved = problem.move(state, np.zeros(4 * JOINTS), d)
        assert moved.inverse_depths[3] == limit
        assert np.isfinite(problem.cost(moved))  # the bound itself is inside
        np.testing.assert_array_equal(np.delete(moved.inverse_depths, 3), np.delete(state.inverse_depths, 3))


def test_the_line_for_a_direction_is_the_weighted_least_squares_solution(problem_and_state):
    """Moments across each direction, where all depths are 1, by constrained least squares over three unknowns."""
    problem, state, _, moved, _ = problem_and_state
    found = problem.chain_for(state.chain.axes, state.chain.home, state.chain.parents).points
    for n, axis in enumerate(state.chain.axes):
        weight = problem.root[:, n].repeat(2)
        A = problem.shift.reshape(-1, 3) * weight[:, None]
        b = (problem.target[:, :, n] - problem.turn @ axis).ravel() * weight
        assert moved[:, n].sum() > 3
        kkt = np.block([[A.T @ A, axis[:, None]], [axis[None], np.zeros((1, 1))]])
        moment = np.linalg.solve(kkt, np.append(A.T @ b, 0.0))[:3]
        np.testing.assert_allclose(np.cross(found[n], axis), moment, atol=1e-9)
        assert found[n] @ axis == pytest.approx(0.0, abs=1e-9)


def measured_of(body, posture, variance):
    J = body.jacobians(posture)
    moved = ancestors(body.parents)[body.links]
    count, joints = moved.shape
    covariances = variance * np.broadcast_to(np.eye(joints), (count, joints, joints))
    found = TrackJacobians(
        posture, body.pixels(posture), J * moved[:, None, :], covariances, moved, np.ones(count), np.ones(count, bool)
    )
    return found, moved


@pytest.fixture(scope="module")
def found_axes():
    body = serial_body(2, per_link=15, seed=4)
    posture = np.array([0.2, -0.3])
    measured, moved = measured_of(body, posture, variance=30.0)
    return body, posture, axes_from_jacobian(measured, moved, body.parents, FOCAL, CENTER, starts=12, keep=5, seed=1)


def test_lines_and_depths_follow_from_an_exact_j(found_axes):
    """They are those of the posture, up to the unit of length; the others are no better."""
    body, posture, found = found_axes
    assert len(found) == 5
    costs = [cost for cost, _ in found]
    assert costs == sorted(costs)
    _, state = found[0]
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    axes, moments = chain.screws(posture)
    depth = body.place(posture)[:, 2]
    np.testing.assert_array_equal(state.chain.home, posture)
    np.testing.assert_array_equal(state.chain.parents, body.parents)
    np.testing.assert_allclose(state.chain.axes, axes, atol=0.02)
    unit = np.median(state.inverse_depths * depth)
    np.testing.assert_allclose(state.inverse_depths * depth / unit, 1.0, atol=0.02)
    np.testing.assert_allclose(np.cross(state.chain.points, state.chain.axes) * unit, moments, atol=0.02)


@pytest.mark.parametrize("variance", [0.3, 30.0])
def test_an_error_counts_by_the_deviation_of_j_and_a_twentieth_of_its_length(variance):
    """The cost of the solution, from the velocities of its points and weights worked out once more.

    J of a third of the points is a hundredth of what it was, which no lines explain; the least deviation is 1 px/rad.
    """
    body = serial_body(2, per_link=8, seed=4)
    posture = np.zeros(2)
    measured, moved = measured_of(body, posture, variance)
    measured.jacobians[::3] *= 0.01
    (cost, state), *others = axes_from_jacobian(measured, moved, body.parents, FOCAL, CENTER, starts=4, keep=2, seed=1)
    assert len(others) == 1
    normal = (body.pixels(posture) - CENTER) / FOCAL
    places = np.column_stack([normal, np.ones(len(normal))]) / state.inverse_depths[:, None]
    expected = weights = 0.0
    for n in range(2):
        velocity = np.cross(state.chain.axes[n], places - state.chain.points[n])
        column = FOCAL * (velocity[:, :2] - normal * velocity[:, 2:]) / places[:, 2:]
        length = np.hypot(*measured.jacobians[:, :, n].T)
        weight = np.where(moved[:, n], 1 / np.maximum(variance + (0.05 * length) ** 2, 1.0), 0.0)
        expected += np.sum(weight[:, None] * (column - measured.jacobians[:, :, n]) ** 2) / FOCAL**2
        weights += weight.sum()
    pull = 1e-3 * weights / moved.size * np.mean(measured.jacobians**2) / FOCAL**2
    assert cost == pytest.approx(expected + pull * np.sum((state.inverse_depths - 1) ** 2), rel=1e-6)
