"""What the fit counts, solves and refuses on the way, beside dense algebra and on cases made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.learning.end_to_end import coordinate_rms
from dense_vs.generative.learning.fitting import _bundle_sigma, _check_sufficient, first_joints
from dense_vs.generative.least_squares.levenberg_marquardt import _scale, _solve_blocks, _step, minimize
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.generative.reconstruction.initialization import (
    _refuse_a_line,
    _sound,
    guessed_intrinsics,
    intrinsics_prior,
)
from dense_vs.generative.report import FitReport, Outlier, Stage


def seen(samples, cameras, features):
    return np.full((samples, cameras, features, 2), 5.0)


def given(pixels=None, **changes):
    pixels = seen(4, 2, 5) if pixels is None else pixels
    sizes = [(480, 640)] * pixels.shape[1]
    return Observations(**{"joints": np.zeros((len(pixels), 3)), "pixels": pixels, "image_sizes": sizes, **changes})


def equations(rng, samples, width, shared, chained=False):
    """Normal equations of random rows: shared unknowns, and those of each sample and, chained, of the next."""
    total = shared + samples * width
    rows = []
    for t in range(samples):
        row = np.zeros((9, total))
        row[:, :shared] = rng.normal(size=(9, shared))
        row[:, shared + t * width : shared + (t + 1) * width] = rng.normal(size=(9, width))
        if chained and t + 1 < samples:
            row[:, shared + (t + 1) * width : shared + (t + 2) * width] = rng.normal(size=(9, width))
        rows.append(row)
    J, r = np.concatenate(rows), rng.normal(size=9 * samples)
    matrix, gradient = J.T @ J, J.T @ r
    found = NormalEquations(float(r @ r), matrix[:shared, :shared], gradient[:shared])
    block = matrix[shared:, shared:].reshape(samples, width, samples, width).transpose(0, 2, 1, 3)
    found.local = np.array([block[t, t] for t in range(samples)])
    found.local_gradient = gradient[shared:].reshape(samples, width)
    found.coupling = matrix[shared:, :shared].reshape(samples, width, shared)
    found.chained = np.array([block[t + 1, t] for t in range(samples - 1)]) if chained else None
    return found, matrix, gradient


@pytest.mark.parametrize("chained", [False, True])
@pytest.mark.parametrize("shared", [0, 5])
def test_a_step_is_that_of_the_whole_damped_matrix(chained, shared):
    found, matrix, gradient = equations(np.random.default_rng(0), 6, 3, shared, chained)
    damping = 0.3
    whole = matrix + damping * np.diag(matrix.diagonal())
    expected = -np.linalg.solve(whole, gradient)
    step, local, predicted = _step(found, damping)
    np.testing.assert_allclose(step, expected[:shared], atol=1e-9)
    np.testing.assert_allclose(local.ravel(), expected[shared:], atol=1e-9)
    # What the linear model says that the cost falls by: |r|^2 - |r + J d|^2.
    assert predicted == pytest.approx(-2 * gradient @ expected - expected @ matrix @ expected)


def test_a_step_of_shared_unknowns_alone():
    found, matrix, gradient = equations(np.random.default_rng(1), 4, 2, 3)
    found.local = None
    own, right = matrix[:3, :3], gradient[:3]
    expected = -np.linalg.solve(own + 0.1 * np.diag(own.diagonal()), right)
    step, local, predicted = _step(found, 0.1)
    np.testing.assert_allclose(step, expected)
    assert local is None
    assert predicted == pytest.approx(-2 * right @ expected - expected @ own @ expected)


def test_a_matrix_that_is_not_definite_has_no_step():
    found, _, _ = equations(np.random.default_rng(2), 4, 2, 3)
    found.local, found.shared = None, -found.shared
    assert _step(found, 0.0) is None
    whole, _, _ = equations(np.random.default_rng(2), 4, 2, 3)
    whole.local = np.zeros_like(whole.local)
    assert _step(whole, 0.0) is None


def test_unknowns_without_influence_stand_still():
    assert _scale(np.array([4.0, 0.0, 1e-13, 1e-11])).tolist() == [4.0, 1.0, 1.0, 1e-11]
    np.testing.assert_allclose(_scale(np.array([4e13, 0.0])), [4e13, 40.0])
    assert _scale(np.zeros(0)).size == 0


def test_chained_blocks_are_solved_as_the_whole():
    rng = np.random.default_rng(3)
    found, matrix, _ = equations(rng, 5, 2, 0, chained=True)
    right = rng.normal(size=(5, 2, 4))
    solved = _solve_blocks(found.local, found.chained, right)
    np.testing.assert_allclose(solved.reshape(10, 4), np.linalg.solve(matrix, right.reshape(10, 4)))
    np.testing.assert_allclose(_solve_blocks(found.local, None, right), np.linalg.solve(found.local, right))
    assert _solve_blocks(0 * found.local, None, right) is None
    assert _solve_blocks(-found.local, found.chained, right) is None


class Valley:
    """A curved valley, Rosenbrock's, with its least at (1, 1)."""

    def __init__(self):
        self.costs = []

    def residuals(self, state):
        return np.array([10 * (state[1] - state[0] ** 2), 1 - state[0]])

    def cost(self, state):
        self.costs.append(float((self.residuals(state) ** 2).sum()))
        return self.costs[-1]

    def linearize(self, state):
        J, r = np.array([[-20 * state[0], 10.0], [-1.0, 0.0]]), self.residuals(state)
        return NormalEquations(float(r @ r), J.T @ J, J.T @ r)

    def move(self, state, shared, local=None):
        return state + shared


def test_a_valley_is_walked_down_to_its_end():
    begin = np.array([-1.2, 1.0])
    solution = minimize(Valley(), begin, 60)
    np.testing.assert_allclose(solution.state, [1.0, 1.0], atol=1e-4)
    assert solution.converged
    assert solution.cost < 1e-8
    assert solution.initial_cost == pytest.approx(24.2)
    assert 5 < solution.iterations < 40
    short = minimize(Valley(), begin, 3)
    assert (short.iterations, short.converged) == (3, False)
    assert short.cost < short.initial_cost
    assert short.cost == pytest.approx((Valley().residuals(short.state) ** 2).sum())
    rough = minimize(Valley(), begin, 60, tolerance=0.5)
    assert rough.iterations <= solution.iterations
    damped = minimize(Valley(), begin, 60, damping=1e6)
    assert damped.iterations > solution.iterations
    there = minimize(Valley(), np.array([1.0, 1.0]))
    assert (there.iterations, there.converged) == (1, True)


def test_a_start_without_a_cost_is_left():
    valley = Valley()
    solution = minimize(valley, np.array([np.nan, 0.0]))
    assert (solution.cost, solution.iterations, solution.converged) == (np.inf, 0, False)


@pytest.mark.parametrize(("changed", "message"), [
    ({}, None),
    ({"blind": True}, "camera 1 saw no feature in any of the 12 samples"),
    ({"hand": 3}, "3 features of the last link"),
    ({"hand": 4}, None),
    ({"samples": 2}, "2 samples show 3 or more features of the hand to a camera; 3 joints need at least 3"),
    ({"samples": 3, "features": 40}, None),
    ({"shown": 3}, None),
    ({"shown": 2}, "0 samples show 3 or more features of the hand to a camera"),
])  # fmt: skip
def test_what_cannot_determine_a_model_by_counting(changed, message):
    samples, features = changed.get("samples", 12), changed.get("features", 8)
    pixels = seen(samples, 2, features)
    if changed.get("blind"):
        pixels[:, 1] = np.nan
    if "shown" in changed:  # other ones in each sample, and never more to a camera
        for sample in range(samples):
            of_sample = (np.arange(features) - sample) % features < changed["shown"]
            pixels[sample][:, ~of_sample] = np.nan
    links = np.full(features, 3)
    if "hand" in changed:
        links[changed["hand"] :] = 2
    observations = given(pixels)
    if message is None:
        _check_sufficient(observations, links, 3)
        return
    with pytest.raises(DenseVSError, match=message):
        _check_sufficient(observations, links, 3)


@pytest.mark.parametrize(("shown", "enough"), [(22, False), (23, True)])
def test_as_many_coordinates_as_unknowns(shown, enough):
    """Two joints, 8 features and two cameras are 4 * 2 + 3 * 8 + 6 + 4 * 2 - 1 = 45 unknowns."""
    pixels = np.full((6, 2, 8, 2), np.nan)
    pixels[0, 1, 0] = 5.0
    first = pixels[:, 0].copy().reshape(-1, 2)
    first[: shown - 1] = 5.0
    pixels[:, 0] = first.reshape(6, 8, 2)
    observations = given(pixels, joints=np.zeros((6, 2)))
    assert observations.seen.sum() == shown
    if enough:
        _check_sufficient(observations, np.full(8, 2), 2)
    else:
        with pytest.raises(DenseVSError, match="44 pixel coordinates were seen for 45 unknowns"):
            _check_sufficient(observations, np.full(8, 2), 2)


def test_joints_are_read_or_added_up():
    actions = np.array([[0.1, 0.0], [0.2, -0.1], [0.0, 0.3]])
    observed = Observations(actions=actions, pixels=seen(4, 1, 4), image_sizes=[(48, 64)])
    np.testing.assert_allclose(first_joints(observed, "actions"), [[0, 0], [0.1, 0], [0.3, -0.1], [0.3, 0.2]])
    with pytest.raises(DenseVSError, match=r"needs joints of shape \(T, n\); got None"):
        first_joints(observed, "observed")
    read = given()
    assert first_joints(read, "noisy") is read.joints
    with pytest.raises(DenseVSError, match=r"needs actions of shape \(T - 1, n\); got None"):
        first_joints(read, "actions")


@pytest.mark.parametrize(
    ("taken", "cost", "sigma"), [(50, 25.0, None), (50, 1e-9, 0.05), (50, 1e9, 5.0), (24, 25.0, 0.5)]
)
def test_the_noise_of_a_bundle(taken, cost, sigma):
    """Two poses, three points and one camera more: 27 unknowns."""
    found = SimpleNamespace(posed=np.array([True, True, False]), placed_cameras=np.array([True]),
                            structure=np.array([[1.0] * 3] * 3 + [[np.nan] * 3]))  # fmt: skip
    weights = np.zeros(80)
    weights[:taken] = 0.3
    candidate = SimpleNamespace(found=found, weights=weights, solution=SimpleNamespace(cost=cost))
    expected = np.sqrt(cost / (2 * taken - 27)) if sigma is None else sigma
    if taken == 24:
        assert 2 * taken - 27 >= 20  # 21 degrees of freedom are enough
        expected = np.sqrt(cost / 21)
    assert _bundle_sigma(candidate) == pytest.approx(expected)
    few = SimpleNamespace(found=found, weights=weights[:23], solution=SimpleNamespace(cost=cost))
    assert _bundle_sigma(few) == 0.5


def test_a_usual_lens_and_how_far_it_is_trusted():
    unknown = given(image_sizes=[(480, 640), (720, 500)])
    guess = guessed_intrinsics(unknown)
    np.testing.assert_allclose(guess, [[704, 704, 319.5, 239.5, 0, 0], [792, 792, 249.5, 359.5, 0, 0]])
    mean, information = intrinsics_prior(unknown, guess, 0.5)
    assert mean is guess
    np.testing.assert_allclose(0.5 / np.sqrt(information[1]), [0.4 * 792, 0.4 * 792, 21.6, 21.6, 0.2, 0.2])
    told = given(intrinsics=[[600.0, 610.0, 320.0, 240.0]] * 2)
    np.testing.assert_allclose(guessed_intrinsics(told)[0], [600, 610, 320, 240, 0, 0])
    _, information = intrinsics_prior(told, guessed_intrinsics(told), 0.5)
    np.testing.assert_allclose(0.5 / np.sqrt(information[0]), [60, 61, 19.2, 19.2, 0.2, 0.2])
    sure = given(intrinsics=[[600.0, 610.0, 320.0, 240.0]] * 2, intrinsics_sigma=(0.01, 3.0))
    _, information = intrinsics_prior(sure, guessed_intrinsics(sure), 0.5)
    np.testing.assert_allclose(0.5 / np.sqrt(information[0]), [6, 6.1, 3, 3, 0.2, 0.2])


def candidate(structure, rms=0.5, posed=1.0, cameras=(True, True)):
    poses = np.arange(20) < round(20 * posed)
    found = SimpleNamespace(structure=np.array(structure, float), posed=poses, placed_cameras=np.array(cameras))
    return SimpleNamespace(found=found, rms=rms)


def test_features_on_a_line_wherever_it_lies():
    along = np.arange(6.0)[:, None] * [0.6, 0.0, 0.8]
    bent = along.copy()
    bent[2, 1] = 0.5
    for offset in ([0.0, 0.0, 0.0], [50.0, -20.0, 9.0]):
        with pytest.raises(DenseVSError, match="lie on a line"):
            _refuse_a_line([candidate(along + offset)])
        _refuse_a_line([candidate(bent + offset)])
        _refuse_a_line([candidate(along + offset, rms=99.0)])  # what does not explain the pixels proves nothing
    some = np.vstack([along, np.full((2, 3), np.nan)])
    with pytest.raises(DenseVSError, match="lie on a line"):
        _refuse_a_line([candidate(bent), candidate(some)])


def test_a_sound_reconstruction_poses_most_samples_and_every_camera():
    points = np.eye(3)
    assert _sound(candidate(points))
    assert not _sound(candidate(points, cameras=(True, False)))
    assert not _sound(candidate(points, rms=99.0))
    assert not _sound(candidate(points, posed=0.05))


@pytest.mark.parametrize(("changes", "message"), [
    ({"image_sizes": [(480, 640)]}, "expected 2 pairs"),
    ({"image_sizes": [(0, 640)] * 2}, "whole numbers from 1"),
    ({"image_sizes": [(480.5, 640)] * 2}, "whole numbers from 1"),
    ({"intrinsics": [[0.0, 600, 320, 240]] * 2}, "fx, fy > 0"),
    ({"intrinsics": [[600.0, 600, 320]] * 2}, "rows fx, fy, cx, cy"),
    ({"intrinsics_sigma": (0.01, 3.0)}, "without intrinsics"),
    ({"intrinsics": [[600.0, 600, 320, 240]] * 2, "intrinsics_sigma": (0.0, 3.0)}, "two numbers above 0"),
    ({"feature_link": [0, 1, 2, 3, 4]}, "whole numbers from 0 to 3"),
    ({"feature_link": [-1, 1, 2, 3, 3]}, "whole numbers from 0 to 3"),
    ({"feature_link": [1.0, 1, 2, 3, 3]}, "whole numbers from 0 to 3"),
    ({"poses": np.tile(2 * np.eye(4), (4, 1, 1))}, "expected a rotation and a shift"),
    ({"poses": np.tile(np.diag([1.0, 1, -1, 1]), (4, 1, 1))}, "expected a rotation and a shift"),
    ({"joints": np.full((4, 3), 1e300)}, "expected at most"),
])  # fmt: skip
def test_observations_that_cannot_be(changes, message):
    with pytest.raises(DenseVSError, match=message):
        given(**changes)


def test_observations_at_the_border_are_welcome():
    observed = given(feature_link=[0, 1, 2, 3, 3], image_sizes=[(1, 1)] * 2, poses=np.tile(np.eye(4), (4, 1, 1)))
    assert observed.joint_count == 3
    assert observed.feature_link.tolist() == [0, 1, 2, 3, 3]
    assert observed.seen.all()
    assert len(observed) == 4
    acted = Observations(actions=np.arange(6.0).reshape(3, 2), pixels=seen(4, 1, 4), image_sizes=[(48, 64)])
    assert acted.joint_count == 2
    np.testing.assert_array_equal(acted[1:4].actions, [[2, 3], [4, 5]])
    assert acted[[0, 2]].actions is None  # what leads from one to the other is not one action
    assert acted[[3]].actions.shape == (0, 2)
    assert Observations(pixels=seen(2, 1, 4), image_sizes=[(48, 64)]).joint_count is None
    half = seen(2, 1, 4)
    half[0, 0, 0, 0] = np.nan
    with pytest.raises(DenseVSError, match="half a coordinate"):
        Observations(pixels=half, image_sizes=[(48, 64)])


@pytest.mark.parametrize(("misfit", "useless"), [(None, False), (1.0, False), (1e6, True)])
def test_a_report_comes_back_from_what_is_stored(misfit, useless):
    stages = [Stage("one", 9.0, 4.0, 0.5, 7, True, 0.1), Stage("two", 4.0, 1.0, 0.3, 5, False, 0.2)]
    report = FitReport(stages=stages, rms_px=0.4, outliers=[Outlier(1, 0, 3, 9.5)], swapped=[(1, 0, 2, 3)],
                       joint_sigma=0.01, pose_sigma=(0.1, 0.2), misfit=misfit)  # fmt: skip
    back = FitReport.from_dict(report.as_dict())
    assert repr(back) == repr(report)
    assert back.losses == [4.0, 1.0]
    assert back.iterations == 12
    assert back.useless == useless


@pytest.mark.parametrize(
    ("weights", "cost", "rms"), [([2.0, 3.0], 40.0, 2.0), ([0.1, 0.1], 4.0, 2.0), ([0.0], 9.0, 3.0)]
)
def test_the_mean_error_of_a_coordinate_is_over_two_of_each_pixel(weights, cost, rms):
    assert coordinate_rms(SimpleNamespace(weights=np.array(weights)), cost) == pytest.approx(rms)
