"""The fit finds lines, links and points from tracks alone; bodies are placed by plain matrices."""

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, SIZE, SyntheticBody, postures, serial_body

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import Chain, ancestors, tree_order
from dense_vs.body_model.fit import BodyFitOptions, fit_body
from dense_vs.body_model.joint_tree import joint_parents
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.track_problem import BodyState, TrackProblem
from dense_vs.body_model.tracks import PointTracks
from dense_vs.errors import DenseVSError


def modeled(fit, q):
    """J (M, 2, N) of the fit's points by central differences of its chain."""
    state = fit.state

    def pixels(posture):
        rotation, translation = state.chain.link_poses(posture[None])
        p = np.einsum("mij,mj->mi", rotation[0, fit.links], state.points) + translation[0, fit.links]
        return state.focal * p[:, :2] / p[:, 2:] + fit.center

    columns = []
    for n in range(len(q)):
        d = np.zeros(len(q))
        d[n] = 1e-6
        columns.append((pixels(q + d) - pixels(q - d)) / 2e-6)
    return np.stack(columns, axis=2)


def relative_error(found, true):
    return np.linalg.norm(found - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))


def chain_of(body):
    return Chain(body.axes, body.anchors, np.zeros(len(body.axes)), body.parents)


def believed(fit, tracks):
    """Which of the given tracks the fit believed, by their pixels."""
    given = np.nan_to_num(tracks.pixels).transpose(1, 0, 2).reshape(tracks.pixels.shape[1], -1)
    kept = np.nan_to_num(fit.tracks.pixels).transpose(1, 0, 2).reshape(fit.tracks.pixels.shape[1], -1)
    return np.array([np.flatnonzero((given == row).all(axis=1))[0] for row in kept])


@pytest.mark.parametrize("seed", [0, 1])
def test_exact_tracks_give_the_exact_jacobian_at_unseen_postures(seed):
    body = serial_body(3, seed=seed)
    tracks = body.tracks(postures(3))
    fit = fit_body(tracks, BodyFitOptions(focal_length=FOCAL))
    np.testing.assert_array_equal(fit.state.chain.parents, body.parents)
    index = believed(fit, tracks)
    assert len(index) > 75
    assert np.mean(fit.links == body.links[index]) > 0.97  # a point on the next joint's line is on both links
    q = np.array([0.5, -0.45, 0.4])
    assert np.median(relative_error(modeled(fit, q), body.jacobians(q)[index])) < 1e-3


def test_noise_and_gross_errors_and_an_unknown_focal_length():
    body = serial_body(4, seed=3)
    tracks = body.tracks(postures(4), noise=0.3, outliers=0.05)
    fit = fit_body(tracks)
    index = believed(fit, tracks)
    assert np.mean(fit.links == body.links[index]) > 0.9
    q = np.array([0.2, -0.1, 0.25, 0.3])
    assert np.median(relative_error(modeled(fit, q), body.jacobians(q)[index])) < 0.05
    assert fit.error < 0.6


def test_the_background_is_told_from_the_body():
    body = serial_body(3, seed=0)
    rng = np.random.default_rng(5)
    still = np.column_stack([rng.uniform(-0.4, 0.4, 30), rng.uniform(-0.3, 0.3, 30), rng.uniform(1, 3, 30)])
    both = SyntheticBody(
        body.axes,
        body.anchors,
        body.parents,
        np.concatenate([body.points, still]),
        np.concatenate([body.links, np.full(30, -1)]),
    )
    fit = fit_body(both.tracks(postures(3), noise=0.2), BodyFitOptions(focal_length=FOCAL))
    assert (fit.all_links[-30:] == -1).all()
    assert np.mean(fit.all_links[:-30] == both.links[:-30]) > 0.9


def test_joints_in_another_order_and_a_joint_that_moves_nothing():
    body = serial_body(3, seed=1)
    order = [2, 0, 3, 1]  # column of each joint in the log; column 3 moves nothing
    motion = postures(4, seed=2)
    tracks = body.tracks(motion[:, [1, 3, 0]], noise=0.1)
    logged = PointTracks(motion, tracks.pixels, tracks.references, SIZE)
    fit = fit_body(logged, BodyFitOptions(focal_length=FOCAL))
    assert len(order) == 4
    np.testing.assert_array_equal(fit.learned, [True, True, False, True])
    np.testing.assert_array_equal(fit.state.chain.parents[[1, 3, 0]], [-1, 1, 3])


def test_parents_from_which_points_each_joint_moves():
    two_arms = ancestors(np.array([-1, 0, 1, -1, 3]))[:-1]
    moved_by = np.repeat(two_arms, 20, axis=0)
    moved_by ^= np.random.default_rng(0).random(moved_by.shape) < 0.1
    parents, learned = joint_parents(moved_by)
    np.testing.assert_array_equal(parents, [-1, 0, 1, -1, 3])
    assert learned.all()


def test_parents_are_a_tree_whatever_the_points_say():
    # Joint 2 surely moves more than joint 0; the others are too alike to tell and keep their order: 0, 1, 2, 0.
    round_trip = np.arange(116)[:, None] < [100, 108, 116]
    parents, _ = joint_parents(round_trip)
    np.testing.assert_array_equal(parents, [2, 0, -1])
    rng = np.random.default_rng(0)
    for _ in range(200):
        joints = int(rng.integers(2, 9))
        parents, learned = joint_parents(rng.random((60, joints)) < rng.uniform(0.3, 1.0, joints))
        assert sorted(tree_order(parents)) == list(range(joints))
        assert (parents[~learned] == -1).all()


@pytest.mark.parametrize(("bend", "deviation"), [(0.0, 0.0), (-0.06, 0.0), (-0.06, 0.03), (0.1, 0.002)])
def test_the_normal_equations_are_the_gradient_of_the_cost(bend, deviation):
    body = serial_body(3, seed=4)
    joints = postures(3, 12)
    tracks = body.tracks(joints, noise=3.0)
    weights = np.random.default_rng(0).random(tracks.pixels.shape[:2])
    problem = TrackProblem(joints, tracks.pixels, body.links, CENTER, weights, (280.0, 0.1), 0.5, deviation)
    state = BodyState(chain_of(body), body.points, FOCAL, bend)
    equations = problem.linearize(state)
    assert equations.cost == pytest.approx(problem.cost(state))
    none = np.zeros((len(body.links), 3))
    count = 13 + (deviation > 0)
    assert equations.shared.shape == (count, count)
    for column in range(count):
        step = np.zeros(count)
        step[column] = 1e-6
        slope = (problem.cost(problem.move(state, step, none)) - problem.cost(problem.move(state, -step, none))) / 4e-6
        assert slope == pytest.approx(equations.shared_gradient[column], rel=1e-4, abs=1e-3)
    for point in (0, 50):
        step = none.copy()
        step[point, 2] = 1e-6
        shared = np.zeros(count)
        slope = (
            problem.cost(problem.move(state, shared, step)) - problem.cost(problem.move(state, shared, -step))
        ) / 4e-6
        assert slope == pytest.approx(equations.local_gradient[point, 2], rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("bend", [-0.05, 0.0, 0.04])
def test_a_bent_lens_is_found_beside_the_focal_length(bend):
    body = serial_body(3, seed=4)
    joints = postures(3, 30)
    tracks = body.tracks(joints, noise=0.2)
    seen = Lens.of_center(np.array(CENTER), bend).bent(tracks.pixels)
    state = BodyState(chain_of(body), body.points, 1.03 * FOCAL)
    arguments = state, joints, seen, body.links, CENTER, (FOCAL, 0.15), 0.5, 2, 12
    found, _, error = adjust(*arguments, 0.05)
    assert found.bend == pytest.approx(bend, abs=0.004)
    assert found.focal == pytest.approx(FOCAL, rel=0.01)
    assert error < 0.3
    held, _, _ = adjust(*arguments)
    assert held.bend == 0.0
    if bend:  # what is left open by the tracks takes the bend on, and is off where they do not lead
        assert abs(np.log(held.focal / FOCAL)) > 5 * abs(np.log(found.focal / FOCAL))


def test_a_bend_is_drawn_to_none_by_its_prior():
    """What the adjustment minimizes is the squares over the noise, and the bend over its deviation."""
    body = serial_body(3, seed=4)
    joints = postures(3, 12)
    tracks = body.tracks(joints, noise=0.5)
    problem = TrackProblem(
        joints, tracks.pixels, body.links, CENTER, np.ones(tracks.pixels.shape[:2]), (FOCAL, 0.1), 0.5, 0.01
    )
    state = BodyState(chain_of(body), body.points, FOCAL, 0.02)
    squares = float((problem.errors(state) ** 2).sum())
    assert problem.cost(state) == pytest.approx(squares + 0.5**2 * (0.02 / 0.01) ** 2)
    far = problem.move(state, np.append(np.zeros(13), 9.0))
    assert far.bend == 0.15  # no lens bends more


def test_link_poses_are_those_of_plain_matrices():
    body = serial_body(3, seed=6)
    body.parents = np.array([-1, 0, 0])
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    q = np.array([0.4, -0.3, 0.7])
    rotation, translation = chain.link_poses(q[None])
    placed = np.einsum("mij,mj->mi", rotation[0, body.links], body.points) + translation[0, body.links]
    np.testing.assert_allclose(placed, body.place(q), atol=1e-12)
    axes, moments = chain.screws(q)
    on_last = body.links == 2
    velocity = np.cross(axes[2], placed[on_last]) + moments[2]
    d = np.array([0, 0, 1e-6])
    np.testing.assert_allclose(velocity, (body.place(q + d) - body.place(q - d))[on_last] / 2e-6, atol=1e-7)


def test_too_little_is_refused():
    body = serial_body(3)
    still = body.tracks(np.zeros((20, 3)))
    with pytest.raises(DenseVSError, match="0 tracks move"):
        fit_body(still)
    with pytest.raises(DenseVSError, match="one a joint"):
        fit_body(body.tracks(postures(3)), BodyFitOptions(parents=(-1, 0)))
    with pytest.raises(DenseVSError, match="tree"):
        fit_body(body.tracks(postures(3)), BodyFitOptions(parents=(1, 0, 1)))
    with pytest.raises(DenseVSError, match="focal_length"):
        BodyFitOptions(focal_length=0)


def test_tracks_of_wrong_shapes_are_refused():
    with pytest.raises(DenseVSError, match="rows of joints"):
        PointTracks(np.zeros((5, 2)), np.zeros((4, 3, 2)), np.zeros(3, int), SIZE)
    with pytest.raises(DenseVSError, match="infinite"):
        PointTracks(np.zeros((5, 2)), np.full((5, 3, 2), np.inf), np.zeros(3, int), SIZE)
    with pytest.raises(DenseVSError, match="references"):
        PointTracks(np.zeros((5, 2)), np.zeros((5, 3, 2)), np.zeros(4, int), SIZE)
