"""The steps from pixels to poses, each by itself on exact cases, before any adjustment could mend them."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.kinematics import rotation_fit
from dense_vs.generative.kinematics.axis_points import fit_axis_points
from dense_vs.generative.kinematics.rotation_fit import fit_rotations, fit_rotations_robustly, rotation_errors
from dense_vs.generative.reconstruction.factorization import _AffineProblem, _AffineState, _assemble, _form, _metric
from dense_vs.generative.reconstruction.sample_alignment import Views, robust_motions, spread
from dense_vs.generative.reconstruction.triangulation import rigid_motions, triangulate


def turns(rng, count, size=1.0):
    return Rotation.from_rotvec(size * rng.normal(size=(count, 3))).as_matrix()


# Factorization: x_tk = A_t F_k + b_t.


def test_the_affine_problem_has_the_normal_equations_of_its_errors():
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(4, 6, 2))
    flat[rng.random((4, 6)) < 0.25] = np.nan
    problem = _AffineProblem(flat)
    state = _AffineState(rng.normal(size=(6, 3)), rng.normal(size=(4, 2, 4)))

    def errors(step):
        moved = problem.move(state, step[:18], step[18:].reshape(4, 8))
        found = []
        for t in range(4):
            for k in range(6):
                if np.isfinite(flat[t, k, 0]):
                    found.append(moved.frames[t, :, :3] @ moved.structure[k] + moved.frames[t, :, 3] - flat[t, k])
        return np.concatenate(found)

    here = errors(np.zeros(50))
    J = np.stack([(errors(d) - errors(-d)) / 2e-5 for d in 1e-5 * np.eye(50)], axis=1)
    found = problem.linearize(state)
    assert problem.cost(state) == pytest.approx(here @ here)
    assert found.cost == pytest.approx(here @ here)
    np.testing.assert_allclose(found.shared, (J.T @ J)[:18, :18], atol=1e-6)
    np.testing.assert_allclose(found.shared_gradient, J.T[:18] @ here, atol=1e-6)
    for t in range(4):
        own = slice(18 + 8 * t, 26 + 8 * t)
        np.testing.assert_allclose(found.local[t], (J.T @ J)[own, own], atol=1e-6)
        np.testing.assert_allclose(found.local_gradient[t], J.T[own] @ here, atol=1e-6)
        np.testing.assert_allclose(found.coupling[t], (J.T @ J)[own, :18], atol=1e-6)


def test_a_form_is_that_of_a_symmetric_matrix():
    rng = np.random.default_rng(1)
    x, y, q = rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    matrix = np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
    assert _form(x, y) @ q == pytest.approx(x @ matrix @ y)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_metric_frame_has_orthogonal_rows_of_one_length(noise):
    """Rows of turns, near and far, seen through a wrong affine frame; with noise each frame counts alike."""
    rng = np.random.default_rng(2)
    scales = np.geomspace(0.01, 10.0, 30)
    true = scales[:, None, None] * (turns(rng, 30)[:, :2] + noise * rng.normal(size=(30, 2, 3)))
    wrong = np.array([[1.3, 0.4, -0.2], [0.0, 0.8, 0.3], [0.1, 0.0, 1.1]])
    upgraded = true @ wrong @ _metric(true @ wrong)
    lengths = np.linalg.norm(upgraded, axis=2)
    ratio = lengths[:, 0] / lengths[:, 1]
    cosine = np.einsum("ti,ti->t", upgraded[:, 0], upgraded[:, 1]) / lengths.prod(axis=1)
    tolerance = 1e-6 if noise == 0 else 5 * noise
    np.testing.assert_allclose(ratio, 1.0, atol=tolerance)
    np.testing.assert_allclose(cosine, 0.0, atol=tolerance)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_frames_are_assembled_into_poses_that_show_what_was_seen(mirror):
    """Scaled-orthographic views at depths of 5 to 6: the scale of a frame is its inverse depth."""
    rng = np.random.default_rng(3)
    rotation, depth = turns(rng, 7), rng.uniform(5, 6, 7)
    structure = rng.normal(size=(5, 3))
    structure -= structure.mean(axis=0)
    shifts = rng.normal(size=(7, 2)) / 10
    axes = rotation[:, :2] / depth[:, None, None]
    frames, features = np.ones(9, bool), np.ones(6, bool)
    frames[[1, 4]], features[2] = False, False
    found = _assemble(axes, shifts, structure, mirror, frames, features, (9, 2, 6, 2), 1)
    assert found.placed_cameras.tolist() == [False, True]
    assert found.posed.tolist() == frames.tolist()
    assert np.isnan(found.structure[2]).all()
    placed = np.einsum("tij,mj->tmi", found.rotation[frames], found.structure[features])
    placed = placed + found.translation[frames][:, None]
    unit = np.median(placed[..., 2].mean(axis=1)) / np.median(depth)
    np.testing.assert_allclose(placed[..., 2].mean(axis=1), unit * depth, rtol=1e-9)
    expected = np.einsum("txi,mi->tmx", axes, structure) + shifts[:, None]
    np.testing.assert_allclose(placed[..., :2] / (unit * depth[:, None, None]), expected, atol=1e-9)
    along = np.einsum("ti,mi->tm", rotation[:, 2], structure)
    deeper = placed[..., 2] / unit - depth[:, None]
    np.testing.assert_allclose(deeper, mirror * along, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found.rotation), 1.0)


# Directions of axes from rotations alone.


def chain(axes, home, joints):
    poses = []
    for q in joints:
        whole = np.eye(3)
        for axis, angle in zip(axes, q, strict=True):
            whole = whole @ Rotation.from_rotvec(angle * axis).as_matrix()
        poses.append(whole @ home)
    return np.array(poses)


AXES = np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
HOME = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()


def angles(one, other):
    return np.array(
        [np.linalg.norm(Rotation.from_matrix(a @ b.T).as_rotvec()) for a, b in zip(one, other, strict=True)]
    )


def test_rotation_errors_are_angles_between_rotations():
    rng = np.random.default_rng(4)
    joints = rng.uniform(-1, 1, (6, 2))
    off = turns(rng, 6, 0.3)
    found = rotation_errors(joints, off @ chain(AXES, HOME, joints), AXES, HOME)
    np.testing.assert_allclose(found, np.linalg.norm(Rotation.from_matrix(off).as_rotvec(), axis=1))


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_minima_told_are_weighted_errors_and_the_best_is_the_truth(noise):
    rng = np.random.default_rng(5)
    joints = rng.uniform(-0.9, 0.9, (40, 2))
    rotations = turns(rng, 40, noise) @ chain(AXES, HOME, joints)
    weights = rng.uniform(0.2, 2.0, 40)
    minima = fit_rotations(joints, rotations, np.random.default_rng(0), weights, starts=9)
    best = minima[0]
    np.testing.assert_allclose(best.axes, AXES, atol=1e-6 + 1.5 * noise)
    np.testing.assert_allclose(best.home, HOME, atol=1e-6 + noise)
    assert [one.rms for one in minima] == sorted(one.rms for one in minima)
    for one, following in pairwise(minima):
        assert following.rms > 1.001 * one.rms  # each is told once
    for one in minima:
        error = angles(rotations, chain(one.axes, one.home, joints))
        assert one.rms == pytest.approx(np.sqrt(np.sum(weights * error**2) / weights.sum()), rel=2e-2, abs=1e-6)
    if noise:  # a minimum: no small turn of an axis is better
        for n in range(2):
            for step in 0.01 * np.vstack([np.eye(3), -np.eye(3)]):
                moved = best.axes.copy()
                moved[n] += step
                moved[n] /= np.linalg.norm(moved[n])
                error = angles(rotations, chain(moved, best.home, joints))
                assert np.sqrt(np.sum(weights * error**2) / weights.sum()) > best.rms * (1 - 1e-3)


def test_given_starts_are_walked_down_too():
    rng = np.random.default_rng(6)
    joints = rng.uniform(-0.9, 0.9, (20, 2))
    rotations = chain(AXES, HOME, joints)
    near = AXES + 0.05 * rng.normal(size=(2, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    at_once = fit_rotations(joints, rotations, rng, starts=0, max_iterations=0, given=[(near, HOME)])
    error = angles(rotations, chain(near, HOME, joints))
    assert at_once[0].rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-2)
    (walked,) = fit_rotations(joints, rotations, rng, starts=0, given=[(near, HOME)])
    np.testing.assert_allclose(walked.axes, AXES, atol=1e-6)


@pytest.mark.parametrize(("apart", "told"), [(1.0008, 1), (1.0012, 2)])
def test_minima_are_two_that_differ_by_more_than_a_thousandth(apart, told):
    joints = np.random.default_rng(6).uniform(-0.9, 0.9, (20, 2))
    rotations = chain(AXES, HOME, joints)
    # Turned by an angle all samples are off by 2 sin(angle / 2).
    angles = [2 * np.arcsin(0.1 * scale) for scale in (apart, 1.0)]
    homes = [Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix() @ HOME for angle in angles]
    given = [(AXES, home) for home in homes]
    minima = fit_rotations(joints, rotations, np.random.default_rng(0), starts=0, max_iterations=0, given=given)
    assert len(minima) == told
    assert [one.rms for one in minima] == pytest.approx([0.2, 0.2 * apart][:told], rel=1e-5)


def test_a_third_of_the_starts_are_regressed_and_the_others_are_random():
    rng = np.random.default_rng(7)
    joints = rng.uniform(-0.02, 0.02, (30, 3))
    joints[:, 1] = 0.0  # which tells nothing of its axis
    axes = np.array([AXES[0], AXES[1], AXES[1]])
    rotations = chain(axes, HOME, joints)
    for starts, regressed in ((7, 3), (6, 2), (8, 3), (1, 1)):
        found, homes = rotation_fit._starts(joints, rotations, np.random.default_rng(0), starts)
        other, _ = rotation_fit._starts(joints, turns(rng, 30), np.random.default_rng(0), starts)
        np.testing.assert_allclose(found[0], [AXES[0], [0, 0, 1], AXES[1]], atol=0.02)
        np.testing.assert_allclose(np.linalg.norm(found, axis=2), 1.0)
        same = np.isclose(found, other).all(axis=(1, 2))
        assert same.tolist() == [False] * regressed + [True] * (starts - regressed)
        assert homes.shape == (starts, 3, 3)
        assert np.max(angles(homes, np.repeat(HOME[None], starts, axis=0))) < 0.02
    found, _ = rotation_fit._starts(joints, rotations, np.random.default_rng(1), 200)
    off = np.linalg.norm(found[:, 0] - AXES[0], axis=1)
    assert np.median(off[1:4]) < 1.2  # those that begin near lie near,
    assert off[0] < 0.02 < np.min(off[1:])  # each farther than the one before, and none at the same place


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_mistaken_samples_lose_their_weight(share):
    rng = np.random.default_rng(8)
    joints = rng.uniform(-0.9, 0.9, (60, 2))
    rotations = turns(rng, 60, 0.01) @ chain(AXES, HOME, joints)
    rotations[: round(60 * share)] = turns(rng, round(60 * share))
    found = fit_rotations_robustly(joints, rotations, np.random.default_rng(0), starts=9)
    np.testing.assert_allclose(found[0].axes, AXES, atol=0.02)
    error = angles(rotations, chain(found[0].axes, found[0].home, joints))
    assert found[0].rms == pytest.approx(np.median(error), rel=1e-6)
    assert [one.rms for one in found] == sorted(one.rms for one in found)
    assert len(found) <= 4


def test_the_best_four_minima_are_taken_up_again(monkeypatch):
    """Each three times, with less weight the more a sample is off half of them."""
    rng = np.random.default_rng(9)
    joints = rng.uniform(-0.9, 0.9, (15, 2))
    rotations = turns(rng, 15, 0.1) @ chain(AXES, HOME, joints)
    told = [rotation_fit.RotationMinimum(AXES, turns(rng, 1, 0.1)[0] @ HOME, 0.1 * k) for k in range(6)]
    asked = []

    def stub(joints, rotations, rng, weights=None, starts=24, max_iterations=100, given=None):
        if given is None:
            assert starts == 9
            return told
        assert (starts, max_iterations) == (0, 30)
        ((axes, home),) = given
        asked.append((home, weights))
        return [rotation_fit.RotationMinimum(axes, Rotation.from_rotvec([0.0, 0.0, 0.01]).as_matrix() @ home, 7.0)]

    monkeypatch.setattr(rotation_fit, "fit_rotations", stub)
    found = fit_rotations_robustly(joints, rotations, rng, starts=9)
    assert len(found) == 4
    assert len(asked) == 12
    for minimum, start in ((k // 3, asked[k][0]) for k in range(0, 12, 3)):
        np.testing.assert_array_equal(start, told[minimum].home)
    for home, weights in asked:
        error = angles(rotations, chain(AXES, home, joints))
        np.testing.assert_allclose(weights, (1 + (error / (2 * np.median(error))) ** 2) ** -2.0, rtol=1e-3)
    for one in found:
        assert one.rms == pytest.approx(np.median(angles(rotations, chain(AXES, one.home, joints))))


def test_points_of_axes_are_the_weighted_least_squares_solution():
    """No small change of any point or of the home place explains noisy places better."""
    rng = np.random.default_rng(9)
    joints = rng.uniform(-1, 1, (25, 2))
    places = rng.normal(size=(25, 3)) + np.array([3.0, -2.0, 5.0])
    weights = rng.uniform(0.1, 3.0, 25)
    points, home = fit_axis_points(joints, AXES, places, weights, cutoff=1e-12)

    def cost(points, home):
        total = 0.0
        for q, place, weight in zip(joints, places, weights, strict=True):
            here = home
            for axis, point, angle in reversed(list(zip(AXES, points, q, strict=True))):
                here = Rotation.from_rotvec(angle * axis).apply(here - point) + point
            total += weight * np.sum((here - place) ** 2)
        return total

    least = cost(points, home)
    for step in 1e-3 * np.vstack([np.eye(9), -np.eye(9)]):
        assert cost(points + step[:6].reshape(2, 3), home + step[6:]) >= least - 1e-9
    # Along its axis a point has no influence: it stays beside the middle of the places.
    np.testing.assert_allclose(np.einsum("ni,ni->n", points - np.median(places, axis=0), AXES), 0.0, atol=1e-6)


# Points and motions.


def test_rays_are_weighted_by_depth_and_by_what_they_are_told():
    """The second pass minimizes errors in the image: each equation over the depth, times the weights."""
    rng = np.random.default_rng(10)
    rotation, shift = turns(rng, 4, 0.2), rng.normal(0, 0.3, (4, 3)) + np.array([0, 0, 4.0])
    shift[0, 2] += 8.0
    point = np.array([0.2, -0.3, 0.4])
    here = rotation @ point + shift
    flat = here[:, :2] / here[:, 2:] + 0.02 * rng.normal(size=(4, 2))
    weights = np.array([1.0, 5.0, 0.3, 2.0])
    found = triangulate(flat, rotation, shift, weights)
    depths = np.ones(4)
    for _ in range(2):
        A = np.concatenate([(flat[k, i] * rotation[k, 2] - rotation[k, i])[None] * np.sqrt(weights[k]) / depths[k]
                            for k in range(4) for i in range(2)])  # fmt: skip
        b = np.array([(shift[k, i] - flat[k, i] * shift[k, 2]) * np.sqrt(weights[k]) / depths[k]
                      for k in range(4) for i in range(2)])  # fmt: skip
        reference = np.linalg.lstsq(A, b, rcond=None)[0]
        depths = rotation[:, 2] @ reference + shift[:, 2]
    np.testing.assert_allclose(found, reference, rtol=1e-9)
    one = np.where(np.arange(4)[:, None] == 1, flat, np.nan)
    assert np.isnan(triangulate(one, rotation, shift)).all()
    assert np.isnan(triangulate(flat, rotation, shift, np.array([1.0, 0, 0, 0]))).all()
    two = np.where(np.arange(4)[:, None] < 2, flat, np.nan)
    assert np.isfinite(triangulate(two, rotation, shift)).all()
    same = np.repeat(flat[:1], 2, axis=0)
    assert np.isnan(triangulate(same, rotation[[0, 0]], shift[[0, 0]])).all()  # twice the same ray


@pytest.mark.parametrize("planar", [False, True])
def test_a_rigid_motion_is_the_weighted_best(planar):
    """SciPy's alignment of the weighted points, in a plane as well."""
    rng = np.random.default_rng(11)
    source = rng.normal(size=(3, 6, 3))
    if planar:
        source[..., 2] = 0.0
    rotation, shift = turns(rng, 3), rng.normal(size=(3, 3))
    target = np.einsum("kij,kmj->kmi", rotation, source) + shift[:, None] + 0.1 * rng.normal(size=(3, 6, 3))
    weights = rng.uniform(0.1, 3, (3, 6))
    found, moved = rigid_motions(source, target, weights)
    for k in range(3):
        middle, goal = (np.average(one[k], axis=0, weights=weights[k]) for one in (source, target))
        best, _ = Rotation.align_vectors(target[k] - goal, source[k] - middle, weights[k])
        np.testing.assert_allclose(found[k], best.as_matrix(), atol=1e-6)
        np.testing.assert_allclose(moved[k], goal - found[k] @ middle, atol=1e-9)


def test_the_second_extent_of_points():
    square = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0], [np.nan] * 3], float)
    masks = np.array([[1, 1, 1, 1, 0], [1, 1, 0, 0, 0], [1, 1, 1, 0, 0], [0, 0, 0, 0, 0]], bool)
    found = spread(square + np.array([5.0, -3.0, 9.0]), masks)
    assert found[0] == pytest.approx(0.5)  # along the shorter side, standard deviation
    third = np.linalg.eigvalsh(np.cov(square[:3].T, bias=True))[1]
    np.testing.assert_allclose(found[1:], [0.0, np.sqrt(third), 0.0], atol=1e-9)
    line = np.arange(4.0)[:, None] * [[0.6, 0.0, 0.8]]
    assert spread(line, np.ones((1, 4), bool))[0] == pytest.approx(0.0, abs=1e-7)


def test_motions_lose_points_that_fit_badly():
    rng = np.random.default_rng(12)
    source = np.vstack([rng.normal(size=(8, 3)), [[np.nan] * 3]])
    rotation, shift = turns(rng, 2), rng.normal(size=(2, 3))
    targets = np.einsum("kij,mj->kmi", rotation, source) + shift[:, None]
    targets[0, 0] += [3.0, -2.0, 1.0]
    mask = np.ones((2, 9), bool)
    mask[:, 8] = False
    found, moved = robust_motions(source, targets, mask)
    np.testing.assert_allclose(found, rotation, atol=0.01)
    np.testing.assert_allclose(moved, shift, atol=0.01)
    plain, _ = rigid_motions(np.nan_to_num(source)[None], np.nan_to_num(targets), mask.astype(float))
    assert np.abs(plain[0] - rotation[0]).max() > 0.1
    # Of three points none can be told from the others: they count alike.
    three = np.arange(9) < 3
    few, at = robust_motions(source, targets, np.array([three, three]))
    plain, plain_at = rigid_motions(np.nan_to_num(source)[None], np.nan_to_num(targets), np.array([three, three]) * 1.0)
    np.testing.assert_allclose(few, plain, atol=1e-12)
    np.testing.assert_allclose(at, plain_at, atol=1e-12)


@pytest.fixture(scope="module")
def viewed():
    """Three cameras, two of them placed, five samples of six features that move rigidly before them."""
    rng = np.random.default_rng(13)
    camera = turns(rng, 3, 0.3)
    at = np.array([[0.0, 0.0, 4.0], [0.8, 0.0, 4.2], [-0.7, 0.3, 4.1]])
    structure = 0.4 * rng.normal(size=(6, 3))
    rotation, shift = turns(rng, 5, 0.4), 0.2 * rng.normal(size=(5, 3))
    places = np.einsum("tij,mj->tmi", rotation, structure) + shift[:, None]
    here = np.einsum("cij,tmj->tcmi", camera, places) + at[None, :, None]
    return SimpleNamespace(camera=camera, at=at, structure=structure, rotation=rotation, shift=shift, places=places,
                           flat=here[..., :2] / here[..., 2:])  # fmt: skip


def views(one, seen, placed=(True, True, False)):
    return Views(one.flat, seen, np.array(placed), one.camera, one.at)


def test_features_are_triangulated_where_two_placed_cameras_see_them(viewed):
    seen = np.ones((5, 3, 6), bool)
    seen[0, 0, 0] = False  # the second and the third see it, but the third is not placed
    found = views(viewed, seen)
    assert not found.known[0, 0]
    assert found.known.sum() == 29
    np.testing.assert_allclose(found.points[found.known], viewed.places[found.known], atol=1e-9)
    assert not found.seen[:, 2].any()
    behind = Views(-viewed.flat, seen, np.ones(3, bool), viewed.camera * [[[1], [1], [-1]]], -viewed.at)
    assert not behind.known.any() or (behind.points[..., 2] != 0).all()


def test_structure_is_of_single_samples_or_of_the_motion(viewed):
    """The last feature is never seen by both cameras in one sample: its place follows through the hand's motion."""
    seen = np.ones((5, 3, 6), bool)
    seen[::2, 0, 5] = False
    seen[1::2, 1, 5] = False
    found = views(viewed, seen)
    assert not found.known[:, 5].any()
    found.points[1, 2] += 9.0  # one gross place of five: the median leaves it
    structure = found.structure(viewed.rotation, viewed.shift, np.ones(5, bool))
    np.testing.assert_allclose(structure, viewed.structure, atol=1e-6)
    none = found.structure(viewed.rotation, viewed.shift, np.arange(5) == 0)
    assert np.isnan(none[5]).all()  # seen by one camera in the one sample that is posed
    np.testing.assert_allclose(none[:5], viewed.structure[:5], atol=1e-9)
