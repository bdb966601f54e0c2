"""Errors of tracks, their normal equations and points placed by them, against differences and other solvers."""

import numpy as np
import pytest
from scipy.optimize import minimize
from synthetic_body import CENTER, FOCAL, postures, serial_body

from dense_vs.body_model import observed_places
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.track_problem import BodyState, TrackProblem

NOISE, GROSS = 0.5, 3.0


def problem_of(seed, bend=0.0, deviation=0.0, joint_count=3, directed=True, noise=2.0):
    """A problem with its state, some way from the tracks, and their pixels."""
    body = serial_body(joint_count, seed=seed)
    joints = postures(joint_count, 10)
    tracks = body.tracks(joints, noise=noise, seed=seed)
    rng = np.random.default_rng(seed)
    shape = tracks.pixels.shape[:2]
    turned = np.eye(2) + 0.3 * rng.normal(size=(*shape, 2, 2))
    weights = rng.uniform(0.1, 1, shape) * (rng.random(shape) < 0.9)
    options = ((280.0, 0.1), NOISE, deviation, turned if directed else None)
    problem = TrackProblem(joints, tracks.pixels, body.links, CENTER, weights, *options)
    chain = Chain(body.axes, body.anchors, np.zeros(joint_count), body.parents)
    return problem, BodyState(chain, body.points + 0.01 * rng.normal(size=body.points.shape), FOCAL, bend), tracks


@pytest.mark.parametrize("bend", [0.0, -0.06, 0.1])
def test_errors_are_those_of_the_projected_points(bend):
    problem, state, tracks = problem_of(3, bend)
    rotation, translation = state.chain.link_poses(problem.joints)
    links = problem.links[problem.point]
    p = np.einsum("oij,oj->oi", rotation[problem.image, links], state.points[problem.point])
    p += translation[problem.image, links]
    seen = Lens.of_center(np.array(CENTER), bend).bent(FOCAL * p[:, :2] / p[:, 2:] + CENTER)
    off = seen - tracks.pixels[problem.image, problem.point]
    expected = np.einsum("oij,oj->oi", problem.directions, off)
    np.testing.assert_allclose(problem.errors(state), expected, atol=1e-10)
    behind = BodyState(state.chain, state.points * [1, 1, -1], FOCAL, bend)
    assert np.isinf(problem.errors(behind)).all()
    assert problem.cost(behind) == np.inf


@pytest.mark.parametrize(("bend", "deviation"), [(0.0, 0.0), (-0.06, 0.03), (0.1, 0.0)])
def test_normal_equations_are_the_products_of_slopes_by_differences(bend, deviation):
    problem, state, _ = problem_of(4, bend, deviation)
    equations = problem.linearize(state)
    shared_count = 13 + (deviation > 0)
    assert equations.shared.shape == (shared_count, shared_count)
    none, still = np.zeros_like(state.points), np.zeros(shared_count)

    def slope(shared, local):
        ahead, behind = (problem.errors(problem.move(state, sign * shared, sign * local)) for sign in (1, -1))
        return ((ahead - behind) / 2e-6 * problem.root[:, None]).ravel()

    by_shared = np.stack([slope(step, none) for step in 1e-6 * np.eye(shared_count)], axis=1)
    by_axis = []
    for axis in range(3):
        step = none.copy()
        step[:, axis] = 1e-6  # all points at once: none is in another one's errors
        by_axis.append(slope(still, step))
    by_point = np.stack(by_axis, axis=1)
    error = (problem.errors(state) * problem.root[:, None]).ravel()
    products, gradient = by_shared.T @ by_shared, by_shared.T @ error
    for k in range(12, shared_count):  # priors of focal length and bend
        products[k, k] += (NOISE / [0.1, deviation][k - 12]) ** 2
    gradient[12] += (NOISE / 0.1) ** 2 * np.log(FOCAL / 280.0)
    if deviation:
        gradient[13] += (NOISE / deviation) ** 2 * bend
    np.testing.assert_allclose(equations.shared, products, rtol=1e-5, atol=1e-5 * products.max())
    np.testing.assert_allclose(equations.shared_gradient, gradient, rtol=1e-5, atol=1e-5 * np.abs(gradient).max())
    of_point = np.repeat(problem.point, 2)
    for m in range(0, len(state.points), 7):
        own, others, off = by_point[of_point == m], by_shared[of_point == m], error[of_point == m]
        np.testing.assert_allclose(equations.local[m], own.T @ own, rtol=1e-5, atol=1e-2)
        np.testing.assert_allclose(equations.coupling[m], own.T @ others, rtol=1e-4, atol=1e-5 * products.max())
        np.testing.assert_allclose(equations.local_gradient[m], own.T @ off, rtol=1e-5, atol=1e-2)


def test_the_number_of_threads_changes_no_bit(monkeypatch):
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setattr(observed_places, "resolve_threads", lambda count=threads: count)
        problem, state, _ = problem_of(5, -0.05, 0.03)
        equations = problem.linearize(state)
        found.append([problem.errors(state), equations.shared, equations.coupling, equations.local])
    for other in found[1:]:
        for one, same in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(one, same)


def test_any_number_of_shared_columns_is_summed():
    """600 columns beside the screws' own are the products of slopes that the first columns give."""
    problem, state, _ = problem_of(4)
    rng = np.random.default_rng(2)
    poses, count = state.chain.link_poses(problem.joints), len(state.points)
    of_point = rng.normal(size=(4, len(problem.joints), 6, 3))
    mixed = rng.normal(size=(3, 600))  # every shared column as some of the points' own
    screws = np.concatenate([of_point, of_point @ mixed], axis=3)
    camera = np.array([FOCAL, *CENTER, 0.0, 200.0])
    equations = problem._observed.equations(poses, state.points, camera, problem.root, screws, False)
    expected = mixed.T @ equations.local.sum(axis=0) @ mixed
    np.testing.assert_allclose(equations.shared[:600, :600], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    for m in range(0, count, 11):
        np.testing.assert_allclose(equations.coupling[m, :, :600], equations.local[m] @ mixed, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("directed", [False, True])
def test_points_are_placed_where_their_robust_error_is_least(directed):
    problem, state, tracks = problem_of(6, directed=directed, noise=0.3)
    turned = None
    if directed:
        turned = np.eye(2) + 0.3 * np.random.default_rng(8).normal(size=(*tracks.pixels.shape, 2))
    pixels = tracks.pixels.copy()
    pixels[2, :20] += 30.0  # gross errors
    given = state.chain, FOCAL, CENTER, problem.joints, pixels, problem.links
    placed = place_points(*given, state.points, NOISE, turned)
    rotation, translation = state.chain.link_poses(problem.joints)
    for m in range(0, len(state.points), 9):
        seen = np.flatnonzero(np.isfinite(pixels[:, m, 0]))

        def errors(point, m=m, seen=seen):
            p = rotation[seen, problem.links[m]] @ point + translation[seen, problem.links[m]]
            off = FOCAL * p[:, :2] / p[:, 2:] + CENTER - pixels[seen, m]
            return off if turned is None else np.einsum("tij,tj->ti", turned[seen, m], off)

        def robust(point, errors=errors):
            squared = (errors(point) ** 2).sum(axis=1) / NOISE**2 / GROSS**2
            return float(np.mean(squared / (1 + squared)))

        best = minimize(robust, state.points[m], method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-12})
        assert placed.cost[m] == pytest.approx(robust(placed.points[m]), abs=1e-9)
        assert placed.cost[m] <= best.fun + 0.01
        np.testing.assert_allclose(placed.errors[seen, m], np.linalg.norm(errors(placed.points[m]), axis=1), atol=1e-7)
        assert np.isnan(np.delete(placed.errors[:, m], seen)).all()


def test_points_that_are_seen_nowhere_or_behind_the_camera_stay_and_say_so(monkeypatch):
    problem, state, tracks = problem_of(7)
    pixels = tracks.pixels.copy()
    pixels[:, 0] = np.nan
    start = state.points.copy()
    start[1, 2] = -2.0
    given = state.chain, FOCAL, CENTER, problem.joints, pixels, problem.links, start, NOISE
    placed = place_points(*given)
    np.testing.assert_array_equal(placed.points[0], start[0])
    assert placed.cost[0] == 0.0
    assert placed.cost[1] == pytest.approx(1.0)
    for threads in (1, 3):
        monkeypatch.setattr(observed_places, "resolve_threads", lambda count=threads: count)
        again = place_points(*given)
        np.testing.assert_array_equal(again.points, placed.points)
    none = place_points(*given[:4], pixels[:, :0], problem.links[:0], start[:0], NOISE)
    assert none.points.shape == (0, 3)
