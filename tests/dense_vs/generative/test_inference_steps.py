"""Joints from images and the noise of states, step by step: what is chosen, how paths are found, variances in full."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.generative.inference import joint_inference
from dense_vs.generative.inference.joint_inference import JointInference, likely_paths
from dense_vs.generative.learning import state_noise
from dense_vs.generative.learning.cartesian import _carry_on, align_frames
from dense_vs.generative.learning.state_noise import fit_noisy_actions, fit_noisy_readings, neighbor_covariance
from dense_vs.generative.rotations import rotation_matrices


def bare(**given):
    one = object.__new__(JointInference)
    one.pixel_sigma, one.precision = 0.5, np.eye(2)
    one.parameters = SimpleNamespace(home=np.array([0.1, -0.1]))
    one.__dict__.update(given)
    return one


def test_postures_outside_of_those_learned_are_unlikely_and_the_nearest_images_begin(monkeypatch):
    rng = np.random.default_rng(0)
    asked = []
    monkeypatch.setattr(joint_inference, "predict", lambda p, memory: asked.append(memory) or "images")
    parameters = SimpleNamespace(home=np.array([0.1, -0.1]), joint_count=2)
    memory = rng.normal(size=(20, 2)) * [0.5, 0.2]
    one = JointInference(parameters, memory, 0.02, 8)
    np.testing.assert_array_equal(asked[0], np.vstack([parameters.home, memory]))
    assert (one.pixel_sigma, one.starts, one.images) == (0.1, 8, "images")
    np.testing.assert_allclose(one.precision @ (4 * np.cov(memory.T) + 0.01 * np.eye(2)), np.eye(2), atol=1e-9)
    few = JointInference(parameters, memory[:1], 0.7, 8)
    assert (few.starts, few.pixel_sigma) == (2, 0.7)
    np.testing.assert_allclose(few.precision, 100 * np.eye(2))
    assert JointInference(parameters, memory[:2], 0.5, 8).precision[0, 1] != 0
    alone = JointInference(SimpleNamespace(home=np.zeros(1), joint_count=1), rng.normal(size=(9, 1)))
    assert alone.precision.shape == (1, 1)


def test_starts_are_the_postures_whose_images_are_nearest_by_absolute_differences():
    memory = np.arange(10.0).reshape(5, 2)
    images = np.zeros((5, 1, 3, 2))
    images[:, 0, :, 0] = np.array([[0, 0, 0], [10, 0, 0], [3, 3, 0], [np.nan, 2, 0], [7, 7, 7]])
    one = bare(memory=memory, images=images, starts=3)
    pixels = np.zeros((2, 1, 3, 2))
    pixels[0, 0, 2] = np.nan  # not seen: then the last feature does not count
    pixels[1, 0, :, 0] = [9.0, 0.0, 0.0]
    pixels[1, 0, 0, 1] = 2.0
    chosen = one._nearest(pixels)
    # Mean differences of the first: 0, 5, 3, (1e4 + 2) / 2, 7; of the second 11, 3, 11, much, 18 (thirds).
    np.testing.assert_array_equal(chosen[0], memory[[0, 2, 1]])
    np.testing.assert_array_equal(chosen[1], memory[[1, 0, 2]])


def chosen(joints, costs, near=None, seen=4):
    pixels = np.full((1, 1, 6, 2), np.nan)
    pixels[0, 0, :seen] = 5.0
    one = bare()
    return one._choose(np.array([joints], float), np.array([costs], float), pixels,
                       None if near is None else np.array([near], float))  # fmt: skip


def test_distinct_postures_that_explain_an_image_are_candidates():
    """Costs up to four times the best one's and the noise, 0.25 px^2 a coordinate: 4 * (1 + 2) = 12 here."""
    joints = [[0, 0], [1, 1], [1.04, 1], [2, 2], [3, 3], [0, 1.06]]
    found = chosen(joints, [1.0, 3.0, 2.0, 11.9, 12.1, 5.0])
    np.testing.assert_array_equal(found.candidates[0], [[0, 0], [1.04, 1], [0, 1.06], [2, 2]])
    np.testing.assert_array_equal(found.joints[0], [0, 0])
    assert found.rms_px[0] == pytest.approx(np.sqrt(1.0 / 8))
    blind = chosen([[0, 0]], [0.5], seen=0)
    assert blind.rms_px[0] == pytest.approx(0.5)  # of two coordinates at least


def test_of_candidates_the_likely_one_is_taken_or_the_nearest():
    """Costs over the noise, 4 a px^2, beside the square of the distance from home (0.1, -0.1)."""
    joints, costs = [[3.1, -0.1], [1.1, -0.1], [-2.9, -0.1]], [1.0, 2.9, 3.0]
    assert chosen(joints, costs).joints[0].tolist() == [1.1, -0.1]  # 4 + 9, 11.6 + 1
    assert chosen(joints, [1.0, 3.1, 3.0]).joints[0].tolist() == [3.1, -0.1]  # 4 + 9, 12.4 + 1
    assert chosen(joints, costs, near=[-2.0, 0.0]).joints[0].tolist() == [-2.9, -0.1]
    found = chosen([[0.0, 3.0], [2.0, 2.0]], [1.0, 1.0], near=[0.0, 0.0])
    assert found.joints[0].tolist() == [2.0, 2.0]  # by the joint that is farthest


@pytest.mark.parametrize(
    ("sigma", "rms", "again"), [(0.4, 2.9, False), (0.4, 3.1, True), (1.0, 5.9, False), (1.0, 6.1, True)]
)
@pytest.mark.parametrize("robust", [False, True])
def test_an_image_that_is_not_explained_near_is_sought_anywhere(sigma, rms, again, robust):
    """Beyond six deviations of the noise, and 3 px at least."""
    calls = []

    def solve(pixels, starts, scale):
        calls.append((len(pixels), starts.copy(), scale))
        value = np.array([1.0, rms])[-len(pixels) :] if len(calls) == 1 else np.full(len(pixels), 0.1)
        return starts + 0.5, np.repeat((value**2)[:, None] * 4, starts.shape[1], axis=1)

    one = bare(pixel_sigma=sigma, _solve=solve, _nearest=lambda pixels: np.full((len(pixels), 3, 2), 7.0))
    pixels = np.full((2, 1, 2, 2), 5.0)
    near = np.array([[0.0, 0.0], [1.0, 1.0]])
    found = one(pixels, near, robust)
    assert len(calls) == 1 + again
    assert calls[0][2] == (4 * sigma if robust else 0.0)
    np.testing.assert_array_equal(calls[0][1], near[:, None])
    np.testing.assert_array_equal(found.joints, near + 0.5)
    np.testing.assert_allclose(found.rms_px, [1.0, 0.1 if again else rms])
    if again:
        assert calls[1][0] == 1
        np.testing.assert_array_equal(calls[1][1][0], [[1, 1], [7, 7], [7, 7], [7, 7]])
        assert [len(candidates) for candidates in found.candidates] == [1, 2]
    calls.clear()
    anywhere = one(pixels, None, robust)
    np.testing.assert_array_equal(calls[0][1], np.full((2, 3, 2), 7.0))
    assert anywhere.joints.shape == (2, 2)


def test_the_likely_path_is_the_least_of_all():
    """Every path through the candidates, tried."""
    rng = np.random.default_rng(1)
    candidates = [rng.normal(size=(k, 2)) for k in (3, 2, 4, 3)]
    penalties = [rng.uniform(0, 50, len(one)) for one in candidates]
    actions = rng.normal(size=(3, 2))

    def cost(path):
        total = sum(penalty[k] for penalty, k in zip(penalties, path, strict=True))
        for t in range(3):
            off = candidates[t + 1][path[t + 1]] - candidates[t][path[t]] - actions[t]
            total += (off @ off) / 0.3**2
        return total

    found = likely_paths(candidates, penalties, actions, 0.3)
    paths = [path for path in np.ndindex(3, 2, 4, 3)]
    best = [min((p for p in paths if p[-1] == last), key=cost) for last in range(3)]
    best.sort(key=cost)
    assert len(found) == 3
    for path, one in zip(best, found, strict=True):
        np.testing.assert_array_equal(one, [candidates[t][k] for t, k in enumerate(path)])


@pytest.mark.parametrize("robust", [False, True])
def test_a_sequence_begins_each_image_where_the_actions_lead(monkeypatch, robust):
    starts, smoothed = [], []
    one = bare(pixel_sigma=0.5)
    one._nearest = lambda pixels: np.full((1, 2, 2), 9.0)

    def solve(pixels, begin, scale):
        starts.append((begin.copy(), scale))
        return begin, np.arange(1.0, 1 + begin.shape[1])[None]

    one._solve = solve
    one._choose = lambda joints, costs, image, near: SimpleNamespace(candidates=[joints[0, -2:]])

    def paths(candidates, penalties, actions, tolerance):
        np.testing.assert_array_equal(penalties[0], np.array([1.0, 2.0]) / 0.25)
        assert tolerance == 0.1
        return [np.full((3, 2), k) for k in range(6)]

    monkeypatch.setattr(joint_inference, "likely_paths", paths)

    def smooth(parameters, pixels, path, actions, information):
        smoothed.append((path[0, 0], information))
        return path, abs(path[0, 0] - 2.2)

    monkeypatch.setattr(joint_inference, "smooth", smooth)
    actions = np.array([[1.0, 0.0], [0.0, 2.0]])
    found = one.sequence(np.zeros((3, 1, 4, 2)), actions, 7.0, robust)
    np.testing.assert_array_equal(found, np.full((3, 2), 2))  # the one of four that costs least
    assert smoothed == [(k, 7.0) for k in range(4)]
    assert {scale for _, scale in starts} == {2.0 if robust else 0.0}
    np.testing.assert_array_equal(starts[0][0][0], [[9, 9], [9, 9]])
    np.testing.assert_array_equal(starts[2][0][0], [[9, 9], [9, 9], [10, 9], [10, 9]])
    np.testing.assert_array_equal(starts[4][0][0], [[9, 9], [9, 9], [10, 11], [10, 11]])


# Noise of joints and actions.


def test_neighboring_blocks_are_those_of_the_whole_inverse():
    rng = np.random.default_rng(2)
    whole = np.zeros((12, 12))
    for t in range(4):
        rows = rng.normal(size=(8, 6))
        here = slice(3 * t, min(3 * t + 6, 12))
        whole[here, here] += (rows.T @ rows)[: here.stop - here.start, : here.stop - here.start]
    blocks = whole.reshape(4, 3, 4, 3).transpose(0, 2, 1, 3)
    own, across = neighbor_covariance(np.array([blocks[t, t] for t in range(4)]),
                                      np.array([blocks[t + 1, t] for t in range(3)]))  # fmt: skip
    inverse = np.linalg.inv(whole).reshape(4, 3, 4, 3).transpose(0, 2, 1, 3)
    for t in range(4):
        np.testing.assert_allclose(own[t], inverse[t, t], atol=1e-9)
    for t in range(3):
        np.testing.assert_allclose(across[t], inverse[t + 1, t], atol=1e-9)


@pytest.mark.parametrize("chained", [False, True])
def test_the_variance_of_a_joint_or_of_a_step(chained):
    """That of a difference of neighbors takes their covariance into account."""
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(40, 6))
    rows[:14, 4:] = rows[26:, :2] = 0.0
    rows[14:26, 2:4] *= 2
    whole = rows[:14].T @ rows[:14] + rows[26:].T @ rows[26:] + np.diag(rng.uniform(1, 2, 6))
    blocks = whole.reshape(3, 2, 3, 2).transpose(0, 2, 1, 3)
    local, below = np.array([blocks[t, t] for t in range(3)]), np.array([blocks[t + 1, t] for t in range(2)])
    problem = SimpleNamespace(linearize=lambda state: SimpleNamespace(local=local, chained=below if chained else None))
    found = state_noise._posterior_variance(problem, None, 0.3, chained)
    if not chained:
        np.testing.assert_allclose(found, 0.09 * np.array([np.linalg.inv(one).diagonal() for one in local]))
        return
    inverse = np.linalg.inv(whole)
    for t in range(2):
        for n in range(2):
            d = np.zeros(6)
            d[2 * (t + 1) + n], d[2 * t + n] = 1.0, -1.0
            assert found[t, n] == pytest.approx(0.09 * d @ inverse @ d)


@pytest.fixture
def rounds(monkeypatch):
    """Solutions whose joints deviate as told, one after the other, and the priors that they were found with."""
    given = SimpleNamespace(priors=[], states=[], variance=0.0)

    def minimize(problem, state, *, max_iterations, tolerance):
        given.priors.append(problem.prior)
        joints = given.states[min(len(given.priors), len(given.states)) - 1]
        return joint_solution(SimpleNamespace(joints=joints))

    monkeypatch.setattr(state_noise, "minimize", minimize)
    monkeypatch.setattr(state_noise, "_posterior_variance", lambda *_: given.variance)
    return given


def joint_solution(state):
    return state_noise.Solution(state, 1.0, 2.0, 3, True, 0.25)


@pytest.mark.parametrize("told", [None, 0.05])
def test_the_noise_of_readings_is_that_of_deviations_and_of_what_is_left_open(rounds, told):
    readings = np.zeros((4, 2))
    off = np.array([[0.1, -0.1], [0.1, 0.1], [-0.1, 0.1], [0.1, 0.1]])
    rounds.states, rounds.variance = [off], 0.03
    solution, sigma = fit_noisy_readings(SimpleNamespace(prior=None), None, readings, 0.5, told)
    information = [float(np.mean(prior.information)) for prior in rounds.priors]
    if told is not None:
        assert (sigma, len(information)) == (0.05, 1)
        assert information[0] == pytest.approx((0.5 / 0.05) ** 2)
        assert (solution.iterations, solution.seconds) == (3, 0.25)
        return
    assert sigma == pytest.approx(0.2)  # the root of 0.01 + 0.03
    np.testing.assert_allclose(information, [(0.5 / 0.02) ** 2, (0.5 / 0.2) ** 2])  # then it has settled
    assert (solution.iterations, solution.seconds) == (6, 0.5)


@pytest.mark.parametrize(("change", "count"), [(1.019, 2), (1.022, 3)])
def test_the_noise_has_settled_when_it_changes_by_less_than_two_percent(rounds, change, count):
    rounds.states = [np.full((3, 2), 0.1), np.full((3, 2), 0.1 * change)]
    _, sigma = fit_noisy_readings(SimpleNamespace(prior=None), None, np.zeros((3, 2)), 0.5, None)
    assert len(rounds.priors) == count
    assert sigma == pytest.approx(0.1 * change)


def test_noise_is_never_nothing_and_rounds_are_twelve_at_most(rounds):
    rounds.states = [np.zeros((3, 2))]
    assert fit_noisy_readings(SimpleNamespace(prior=None), None, np.zeros((3, 2)), 0.5, None)[1] == 1e-5
    rounds.priors.clear()
    rounds.states = [np.full((3, 2), 0.1 * 1.5**k) for k in range(30)]
    fit_noisy_readings(SimpleNamespace(prior=None), None, np.zeros((3, 2)), 0.5, None)
    assert len(rounds.priors) == 12


@pytest.mark.parametrize("proportional", [False, True])
def test_the_noise_of_actions_may_be_a_share_of_the_step(rounds, proportional):
    actions = np.array([[0.3, 0.0], [-0.4, 0.0]])
    spread = np.sqrt(actions**2 + (0.01 * np.sqrt(0.25 / 4)) ** 2) if proportional else np.ones((2, 2))
    off = 0.05 * spread * [[1, -1], [1, 1]]
    rounds.states = [np.vstack([np.zeros(2), np.cumsum(actions + off, axis=0)])]
    _, sigma = fit_noisy_actions(SimpleNamespace(prior=None), None, actions, 0.5, None, proportional)
    assert sigma == pytest.approx(0.05)
    first = 0.02 / np.sqrt(np.mean(spread**2))
    np.testing.assert_allclose(rounds.priors[0].information, (0.5 / (first * spread)) ** 2)
    np.testing.assert_allclose(rounds.priors[-1].information, (0.5 / (0.05 * spread)) ** 2)


# Frames of a Cartesian controller.


def moved(rng, count, outliers=0):
    """Poses by images, and the robot's motions between them, its frame another one in rotation, size and place."""
    turn = rotation_matrices(np.array([0.3, -0.4, 0.2]))
    scale, shift = 2.5, np.array([0.4, -0.2, 0.7])
    rotation = rotation_matrices(0.6 * rng.normal(size=(count, 3)))
    translation = rng.normal(size=(count, 3))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = turn @ rotation
    poses[:, :3, 3] = scale * translation @ turn.T + shift
    first, second = np.arange(count - 1), np.arange(1, count)
    motions = poses[second] @ np.linalg.inv(poses[first])
    wrong = rotation_matrices(rng.normal(size=(outliers, 3)))
    motions[:outliers, :3, :3] = wrong
    found = SimpleNamespace(posed=np.ones(count, bool), rotation=rotation, translation=translation)
    return found, first, second, motions, (turn, scale, shift)


@pytest.mark.parametrize("outliers", [0, 3])
def test_frames_are_aligned_by_relative_motions_despite_some_mistakes(outliers):
    found, first, second, motions, (turn, scale, shift) = moved(np.random.default_rng(4), 25, outliers)
    tolerance = 1e-6 if outliers == 0 else 0.02
    by_turn, by_scale, by_shift = align_frames(found, first, second, motions)
    np.testing.assert_allclose(by_turn, turn, atol=tolerance)
    assert by_scale == pytest.approx(scale, rel=tolerance)
    np.testing.assert_allclose(by_shift, shift, atol=5 * tolerance)
    found.posed[[3, 9]] = False  # samples without a pose say nothing
    found.rotation[[3, 9]] = np.eye(3)
    np.testing.assert_allclose(align_frames(found, first, second, motions)[0], turn, atol=tolerance)


def test_samples_without_a_pose_are_carried_on_from_their_neighbors():
    found, _, _, motions, _ = moved(np.random.default_rng(5), 7)
    rotation, translation = [found.rotation[0]], [found.translation[0]]
    for motion in motions:
        rotation.append(motion[:3, :3] @ rotation[-1])
        translation.append(motion[:3, :3] @ translation[-1] + motion[:3, 3])
    rotation, translation = np.array(rotation), np.array(translation)
    posed = np.array([False, False, True, False, False, True, False])
    begun, at = np.where(posed[:, None, None], rotation, np.eye(3)), np.where(posed[:, None], translation, 0.0)
    _carry_on(posed, motions, begun, at)
    np.testing.assert_allclose(begun, rotation, atol=1e-9)
    np.testing.assert_allclose(at, translation, atol=1e-9)
    assert posed.sum() == 2
    nothing = np.zeros((7, 3))
    _carry_on(np.zeros(7, bool), motions, begun, nothing)
    assert (nothing == 0).all()
