"""Lines of joints from places of the hand, exactly, however the samples are weighted; and how a solver is damped."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.kinematics.axis_points import fit_axis_points
from dense_vs.generative.least_squares import levenberg_marquardt
from dense_vs.generative.least_squares.pixel_problem import NormalEquations


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_lines_are_found_from_where_the_hand_was(weighted, offset):
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    anchors, hand = rng.normal(size=(3, 3)) + offset, rng.normal(size=3) + offset
    joints = rng.uniform(-1, 1, (30, 3))
    places = []
    for q in joints:
        place = hand
        for axis, anchor, angle in [*zip(axes, anchors, q, strict=True)][::-1]:
            place = Rotation.from_rotvec(angle * axis).apply(place - anchor) + anchor
        places.append(place)
    weights = rng.uniform(0.1, 3.0, 30) if weighted else None
    points, home = fit_axis_points(joints, axes, np.array(places), weights)
    np.testing.assert_allclose(home, hand, atol=1e-8)
    np.testing.assert_allclose(np.cross(points, axes), np.cross(anchors, axes), atol=1e-8)


class Stuck:
    """Costs more wherever it goes, the first few times."""

    def __init__(self, worse):
        self.worse, self.dampings = worse, []

    def cost(self, state):
        self.worse -= 1
        return 9.0 if self.worse >= 0 else 1.0

    def linearize(self, state):
        return NormalEquations(4.0, np.eye(1), np.array([1.0]))

    def move(self, state, shared, local=None):
        # A step of -1 / (1 + damping) says what the damping was.
        self.dampings.append(-1 / float(shared[0]) - 1)
        return state + shared


def test_steps_that_fail_are_damped_ever_more():
    """By 2, 4, 8 ... (Nielsen), and after one that is as good as foretold less by a third."""
    problem = Stuck(3)
    levenberg_marquardt.minimize(problem, np.zeros(1), 5, damping=0.01)
    np.testing.assert_allclose(problem.dampings[:4], [0.01, 0.02, 0.08, 0.64])
    assert problem.dampings[4] < problem.dampings[3]


def test_a_matrix_that_has_no_step_is_damped_alike(monkeypatch):
    asked = []

    def step(equations, damping):
        asked.append(damping)
        return None if len(asked) < 4 else (np.array([-0.1]), None, 0.0)

    monkeypatch.setattr(levenberg_marquardt, "_step", step)
    levenberg_marquardt.minimize(Stuck(0), np.zeros(1), 9, damping=0.01)
    np.testing.assert_allclose(asked, [0.01, 0.02, 0.08, 0.64])
