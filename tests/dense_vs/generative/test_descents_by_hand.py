"""Every step of a descent beside Nielsen's rule in plain float64: damping, growth, refused steps, where it ends."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.kinematics.rotation_fit import fit_rotations
from dense_vs.generative.least_squares.levenberg_marquardt import minimize
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.generative.rotations import tangents


class Problem:
    """Squares of residuals whose slopes are told, in as many unknowns as they have."""

    def __init__(self, residuals, slopes):
        self.residuals, self.slopes = residuals, slopes

    def cost(self, x):
        return float(np.sum(np.square(self.residuals(x))))

    def linearize(self, x):
        J, r = self.slopes(x), self.residuals(x)
        return NormalEquations(float(r @ r), J.T @ J, J.T @ r)

    def move(self, x, step, local=None):
        return x + step


def valley():
    return Problem(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
        lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
    )


def curve():
    """An exponential through noisy places, whose slopes are taken too small: some steps are refused."""
    t = np.linspace(0, 2, 9)
    y = 2 * np.exp(-1.3 * t) + 0.05 * np.random.default_rng(0).normal(size=9)
    return Problem(
        lambda x: x[0] * np.exp(x[1] * t) - y,
        lambda x: np.stack([np.exp(x[1] * t), 0.3 * x[0] * t * np.exp(x[1] * t)], axis=1),
    )


def walked(problem, x, most, tolerance=1e-7, damping=1e-3):
    """Marquardt's steps with Nielsen's damping, one after the other; how many of them were refused."""
    x, growth, refused = np.array(x, float), 2.0, 0
    cost = problem.cost(x)
    for count in range(1, most + 1):
        J, r = problem.slopes(x), problem.residuals(x)
        A, g = J.T @ J, J.T @ r
        D = np.diag(A.diagonal())
        step = np.linalg.solve(A + damping * D, -g)
        expected = -2 * g @ step - step @ A @ step
        there = problem.cost(x + step)
        if expected <= tolerance * cost:
            return (x + step, there, count, True, refused) if there < cost else (x, cost, count, True, refused)
        gain = (cost - there) / expected
        if gain > 0:
            x, cost, growth = x + step, there, 2.0
            damping *= max(1 / 3, 1 - (2 * gain - 1) ** 3)
        else:
            damping, growth, refused = damping * growth, growth * 2, refused + 1
            if damping > 1e14:
                return x, cost, count, False, refused
    return x, cost, most, False, refused


@pytest.mark.parametrize(("problem", "begin"), [(valley(), (-1.2, 1.0)), (curve(), (1.0, 0.5)), (curve(), (4.0, -0.2))])
@pytest.mark.parametrize("options", [{}, {"damping": 10.0}, {"tolerance": 0.1}])
def test_every_step_is_nielsen_s(problem, begin, options):
    for most in (0, 1, 2, 3, 5, 8, 13, 60):
        found = minimize(problem, np.array(begin), most, **options)
        x, cost, count, converged, _ = walked(problem, begin, most, **options)
        np.testing.assert_allclose(found.state, x, rtol=1e-7, atol=1e-12)
        assert found.cost == pytest.approx(cost, rel=1e-6, abs=1e-20)
        assert (found.iterations, found.converged) == (count, converged)
        assert found.initial_cost == pytest.approx(problem.cost(np.array(begin)))
        assert 0 <= found.seconds < 1000


def test_some_steps_are_refused_on_the_way():
    assert walked(valley(), (-1.2, 1.0), 60)[4] > 0


def test_a_descent_that_finds_nothing_better_ends_after_eleven_steps():
    """Its damping is then 1e-3 * 2^(1 + 2 + ... + 11), above 1e14."""
    uphill = Problem(lambda x: np.array([1.0 + abs(x[0])]), lambda x: np.array([[1.0]]))
    found = minimize(uphill, np.zeros(1), tolerance=0.0)
    assert (found.iterations, found.converged, found.cost) == (11, False, 1.0)
    assert found.state.tolist() == [0.0]
    assert minimize(uphill, np.zeros(1), 7).iterations == 7


def test_a_matrix_that_is_not_definite_is_damped_until_it_is():
    """Off its diagonal it is too large until damping of 1e-3 * 2^(1 + 2 + 3 + 4) lifts it."""
    matrix, gradient = np.array([[1.0, 1.9], [1.9, 1.0]]), np.array([1.0, 1.0])

    class Saddle(Problem):
        def linearize(self, x):
            return NormalEquations(9.0, matrix, gradient)

        def cost(self, x):
            return 8.0 if x.any() else 9.0

    saddle = Saddle(None, None)
    for most in range(5):
        assert minimize(saddle, np.zeros(2), most).state.tolist() == [0.0, 0.0]
    damping = 1e-3 * 2.0**10
    step = np.linalg.solve(matrix + damping * np.eye(2), -gradient)
    np.testing.assert_allclose(minimize(saddle, np.zeros(2), 5).state, step, rtol=1e-9)


# Rotations by a chain of turns, the last joint's first.

AXES = np.array([[0.0, 0.6, 0.8], [0.8, 0.6, 0.0]])


def chained(axes, home, q):
    return Rotation.from_rotvec(q[0] * axes[0]) * Rotation.from_rotvec(q[1] * axes[1]) * Rotation.from_matrix(home)


def distance(axes, home, joints, rotations, weights):
    """Half the squared Frobenius distances."""
    off = [chained(axes, home, q).as_matrix() - R for q, R in zip(joints, rotations, strict=True)]
    return 0.5 * sum(w * np.sum(one**2) for w, one in zip(weights, off, strict=True))


def moved(axes, home, step):
    """Axes turned about two directions across them, and the home rotation."""
    turned = []
    for axis, (a, b) in zip(axes, step[:4].reshape(2, 2), strict=True):
        first, second = across(axis)
        turned.append(Rotation.from_rotvec(a * first + b * second).apply(axis))
    return np.array(turned), Rotation.from_rotvec(step[4:]).as_matrix() @ home


def across(axis):
    return tangents(axis[None])[0]


def walked_down(axes, home, joints, rotations, weights, most):
    """A trial's steps: damping of 1e-2 at first, by Nielsen's rule; ends where little is to be gained."""
    damping, growth = 1e-2, 2.0
    cost, refused = distance(axes, home, joints, rotations, weights), 0

    def residuals(step):
        now = moved(axes, home, step)
        off = [chained(*now, q).as_matrix() - R for q, R in zip(joints, rotations, strict=True)]
        return np.concatenate([np.sqrt(0.5 * w) * one.ravel() for w, one in zip(weights, off, strict=True)])

    for _ in range(most):
        small = 1e-6 * np.eye(7)
        J = np.stack([(residuals(one) - residuals(-one)) / 2e-6 for one in small], axis=1)
        A, g = J.T @ J, J.T @ residuals(np.zeros(7))
        scale = np.maximum(A.diagonal(), 1e-9)
        step = np.linalg.solve(A + damping * np.diag(scale), -g)
        predicted = step @ (damping * scale * step - g)
        now = moved(axes, home, step)
        there = distance(*now, joints, rotations, weights)
        gain, done = (cost - there) / predicted, predicted < 1e-8 * cost + 1e-16
        if gain > 0:
            (axes, home), cost, growth = now, there, 2.0
            damping *= max(1 / 3, 1 - (2 * min(gain, 2) - 1) ** 3)
        else:
            damping, growth, refused = damping * growth, growth * 2, refused + 1
        if done:
            break
    return axes, home, cost, refused


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("far", [0.1, 1.5, 2.5])
def test_every_step_of_a_chain_s_rotations_is_nielsen_s(weighted, far):
    rng = np.random.default_rng(2)
    joints = rng.uniform(-1.2, 1.2, (9, 2))
    home = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    rotations = [(Rotation.from_rotvec(0.1 * rng.normal(size=3)) * chained(AXES, home, q)).as_matrix() for q in joints]
    weights = rng.uniform(0.2, 2.0, 9) if weighted else np.ones(9)
    begin = np.array([Rotation.from_rotvec(far * np.cross(one, [0.0, 0.28, 0.96])).apply(one) for one in AXES])
    for most in (0, 1, 2, 3, 6):
        given = [(begin, np.eye(3))]
        (found,) = fit_rotations(joints, np.array(rotations), rng, weights if weighted else None, 0, most, given)
        axes, at, cost, _ = walked_down(begin, np.eye(3), joints, rotations, weights, most)
        np.testing.assert_allclose(found.axes, axes, atol=2e-4)
        np.testing.assert_allclose(found.home, at, atol=2e-4)
        assert found.rms == pytest.approx(np.sqrt(cost / weights.sum()), rel=1e-3)


def test_minima_a_thousandth_apart_count_as_one():
    joints = np.zeros((4, 2))
    rotations = np.array([np.eye(3)] * 4)

    def at(angle):
        return AXES, Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()

    def told(*angles):
        found = fit_rotations(joints, rotations, None, starts=0, max_iterations=0, given=[at(one) for one in angles])
        return [round(one.rms, 5) for one in found]

    assert told(0.2) == [round(2 * np.sqrt(1 - np.cos(0.2)) / np.sqrt(2), 5)]
    rms = [2 * np.sin(angle / 2) for angle in (0.2, 0.2001, 0.3)]
    assert told(0.3, 0.2001, 0.2) == [round(rms[0], 5), round(rms[2], 5)]
    assert len(told(0.2, 0.2003)) == 2
