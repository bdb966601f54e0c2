"""A hand of known poses before two cameras: how a reconstruction is aligned with them, and what a fit makes of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.learning import cartesian
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.reconstruction import pose_reversal
from dense_vs.generative.reconstruction.pose_reversal import better_poses, reversed_state, settle_poses
from dense_vs.generative.reconstruction.stereo import Reconstruction

SIZES = [(480, 640), (480, 640)]
LENSES = np.array([[600.0, 600, 320, 240, 0, 0], [650.0, 650, 310, 250, 0, 0]])
TURNS = Rotation.from_rotvec([[0.1, 0.0, 0.0], [0.1, -0.5, 0.1]]).as_matrix()
SHIFTS = np.array([[0.0, 0.0, 2.0], [0.9, 0.1, 2.2]])


def turned(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def hand(samples=12, seed=0):
    """Poses, features on the hand, and their pixels."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3] = turned(0.5 * rng.normal(size=(samples, 3)))
    poses[:, :3, 3] = 0.15 * rng.normal(size=(samples, 3))
    features = rng.uniform(-0.2, 0.2, (8, 3))
    return poses, features, shown(poses[:, :3, :3], poses[:, :3, 3], features, TURNS, SHIFTS)


def shown(rotation, translation, features, turns, shifts):
    world = np.einsum("tij,mj->tmi", rotation, features) + translation[:, None]
    seen = np.einsum("cij,tmj->tcmi", turns, world) + shifts[:, None]
    return seen[..., :2] / seen[..., 2:] * LENSES[:, None, :2] + LENSES[:, None, 2:4]


def reconstructed(poses, features, scale=2.5, unposed=()):
    """The same scene in other axes, another unit, and about the features' middle, as images alone give it."""
    turn, shift = turned([0.4, -0.9, 0.3]), np.array([0.3, -0.2, 0.8])
    grip, middle = turned([-0.2, 0.5, 1.0]), features.mean(axis=0)
    rotation = turn @ poses[:, :3, :3] @ grip.T
    translation = (poses[:, :3, :3] @ middle + poses[:, :3, 3]) @ turn.T * scale + shift
    turns = TURNS @ turn.T
    posed = np.ones(len(poses), bool)
    posed[list(unposed)] = False
    rotation[~posed], translation[~posed] = np.eye(3), 0.0
    return Reconstruction(rotation, translation, scale * (features - middle) @ grip.T, turns,
                          scale * SHIFTS - turns @ shift, posed, np.ones(2, bool))  # fmt: skip


def observed(poses, pixels, state):
    actions = poses[1:] @ np.linalg.inv(poses[:-1])
    given = {"actions": actions} if state == "actions" else {"poses": poses}
    return Observations(pixels=pixels, image_sizes=SIZES, intrinsics=LENSES, **given)


@pytest.mark.parametrize("state", ["observed", "actions"])
@pytest.mark.parametrize("unposed", [(), (0, 5)])
def test_a_reconstruction_comes_into_the_robot_s_frame(state, unposed):
    poses, features, pixels = hand()
    found = reconstructed(poses, features, unposed=unposed)
    candidate = SimpleNamespace(found=found)
    parts, error, before = cartesian._aligned(candidate, observed(poses, pixels, state), state)
    np.testing.assert_allclose(shown(parts[0], parts[1], *parts[2:]), pixels, atol=1e-6)
    assert error == pytest.approx(0.0, abs=1e-6)
    pairs = list(zip(range(11), range(1, 12), strict=True))
    if state == "observed":
        pairs = [(t, (t + 1) % 12) for t in range(12)] + [(t, (t + 6) % 12) for t in range(12)]
        np.testing.assert_allclose(parts[0], poses[:, :3, :3], atol=1e-9)
        np.testing.assert_allclose(parts[1], poses[:, :3, 3], atol=1e-9)
        np.testing.assert_allclose(parts[2], features, atol=1e-9)
        np.testing.assert_allclose(parts[3], TURNS, atol=1e-9)
        np.testing.assert_allclose(parts[4], SHIFTS, atol=1e-9)
    angles = [Rotation.from_matrix(poses[b, :3, :3] @ poses[a, :3, :3].T).magnitude() for a, b in pairs]
    assert before == pytest.approx(np.median(angles))


def test_how_far_rotations_are_off_is_their_median():
    poses, features, pixels = hand()
    found = reconstructed(poses, features)
    noise = Rotation.from_rotvec(0.02 * np.random.default_rng(1).normal(size=(12, 3)))
    read = poses.copy()
    read[:, :3, :3] = poses[:, :3, :3] @ noise.as_matrix()
    parts, error, _ = cartesian._aligned(SimpleNamespace(found=found), observed(read, pixels, "noisy"), "noisy")
    off = Rotation.from_matrix(parts[0]) * Rotation.from_matrix(read[:, :3, :3]).inv()
    assert error == pytest.approx(np.median(off.magnitude()))
    assert 0.01 < error < 0.06


def test_a_mirrored_size_stays_above_nothing():
    """Motions that go the other way than the images say have a scale below 0; it is turned round."""
    poses, features, pixels = hand()
    found = reconstructed(poses, features)
    backward = found.translation.mean(axis=0) - (found.translation - found.translation.mean(axis=0))
    mirrored = Reconstruction(found.rotation, backward, found.structure, found.camera_rotation,
                              found.camera_translation, found.posed, found.placed_cameras)  # fmt: skip
    obs = observed(poses, pixels, "actions")
    scale = cartesian.align_frames(mirrored, np.arange(11), np.arange(1, 12), obs.actions)[1]
    assert scale < 0
    parts, _, _ = cartesian._aligned(SimpleNamespace(found=mirrored), obs, "actions")
    ratio = np.linalg.norm(parts[2][0] - parts[2][1]) / np.linalg.norm(found.structure[0] - found.structure[1])
    assert ratio == pytest.approx(-scale, abs=2e-6)
    assert np.sign(parts[2][0] @ found.structure[0]) > 0


@pytest.mark.parametrize("state", ["observed", "actions"])
def test_exact_images_give_back_what_they_were_made_of(state):
    poses, features, pixels = hand(14, 3)
    pixels[4, 1] = pixels[6] = np.nan
    pixels[2, 0, 3] += [25.0, -18.0]
    parameters, found, report = cartesian.fit_cartesian(
        observed(poses, pixels, state), 0, state, 0.1, (1e-4, 1e-4) if state == "actions" else None
    )
    made = shown(found[:, :3, :3], found[:, :3, 3], parameters.features, parameters.camera_rotation,
                 parameters.camera_translation)  # fmt: skip
    wrong = np.linalg.norm(made - pixels, axis=-1)
    wrong[2, 0, 3] = np.nan
    assert np.nanmax(wrong) < 1.0
    assert [(one.sample, one.camera, one.feature) for one in report.outliers] == [(2, 0, 3)]
    assert report.outliers[0].error_px == pytest.approx(np.hypot(25, 18), abs=1.0)
    assert report.swapped == []
    assert report.unused_samples == [6]
    assert report.unobservable == []
    assert report.rms_px == pytest.approx(np.sqrt(np.nanmean(wrong**2) / 2), rel=0.05)
    assert report.mean_error_px == pytest.approx(np.nanmean(wrong), rel=0.05)
    assert [stage.name for stage in report.stages] == ["cameras and structure", "alignment", "end to end"]
    assert report.converged
    assert report.pose_sigma == ((1e-6, 1e-6) if state == "observed" else (1e-4, 1e-4))
    if state == "observed":
        np.testing.assert_allclose(found, poses, atol=1e-4)
        np.testing.assert_allclose(parameters.features, features, atol=2e-3)


def test_a_feature_that_was_seen_once_is_unknown():
    poses, features, pixels = hand(12, 5)
    pixels[1:, :, 7] = pixels[0, 1, 7] = np.nan
    pixels[2:, :, 6] = np.nan
    parameters, _, report = cartesian.fit_cartesian(observed(poses, pixels, "observed"), 0, "observed", 0.1, None)
    assert np.isfinite(parameters.features[:, 0]).tolist() == [True] * 7 + [False]
    assert report.unobservable == ["feature 7 was seen in 0 usable images: its place is unknown"]
    np.testing.assert_allclose(parameters.features[:7], features[:7], atol=0.01)


def test_a_feature_of_two_usable_images_is_known_and_one_of_a_single_image_is_not(monkeypatch):
    poses, features, pixels = hand(12, 5)
    pixels[1:, :, 5] = pixels[0, 1, 5] = np.nan  # placed, in a single image
    pixels[1:, :, 6] = np.nan  # in two images
    _, at = problem_of(pixels, features, 12)
    placed = np.arange(8) != 7
    start = at(poses[:, :3, :3], poses[:, :3, 3]), placed
    monkeypatch.setattr(cartesian, "_aligned_start", lambda *_: start)
    parameters, _, report = cartesian.fit_cartesian(observed(poses, pixels, "observed"), 0, "observed", 0.1, None)
    assert np.isfinite(parameters.features).all(axis=1).tolist() == [True] * 5 + [False, True, False]
    assert np.isnan(parameters.features[[5, 7]]).all()
    assert report.unobservable == [f"feature {k} was seen in {count} usable images: its place is unknown"
                                   for k, count in ((5, 1), (7, 0))]  # fmt: skip


@pytest.mark.parametrize(
    ("state", "changes", "message"),
    [
        ("actions", {"actions": None}, "needs actions of shape .* got None"),
        ("actions", {"actions": np.zeros((11, 3))}, r"got shape \(11, 3\)"),
        ("observed", {"poses": None}, "'observed' of a Cartesian controller needs poses"),
        ("noisy", {"poses": None}, "'noisy' of a Cartesian controller needs poses"),
        ("observed", {"blind": 1}, "camera 1 saw no feature in any of the 12 samples"),
    ],
)
def test_what_a_state_needs(state, changes, message):
    poses, _, pixels = hand()
    pixels = pixels.copy()
    if "blind" in changes:
        pixels[:, changes.pop("blind")] = np.nan
    actions = poses[1:] @ np.linalg.inv(poses[:-1])
    obs = Observations(**{"pixels": pixels, "image_sizes": SIZES, "poses": poses, "actions": actions, **changes})
    with pytest.raises(DenseVSError, match=message):
        cartesian._check_given(obs, state)
    cartesian._check_given(observed(poses, hand()[2], "actions"), "actions")


# A sample's pose by itself.


def problem_of(pixels, features, samples, weights=None):
    p = ModelParameters(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), features, np.zeros(len(features), int), TURNS,
                        SHIFTS, LENSES)  # fmt: skip
    problem = PixelProblem(pixels, p.links, 0, Free(), "pose", weights=weights)
    return problem, lambda rotation, translation: PixelState(p, np.zeros((samples, 0)), rotation, translation)


def settled(pixels, weights, features, R, x, iterations):
    """One sample by itself: its damping falls to a third where a step is better and rises fourfold where it is not."""

    def residuals(R, x):
        off = shown(R[None], x[None], features, TURNS, SHIFTS)[0] - pixels
        return (np.sqrt(weights)[..., None] * np.where(np.isfinite(pixels), off, 0.0)).ravel()

    damping, cost, trace = 1e-3, np.sum(residuals(R, x) ** 2), []
    for _ in range(iterations):
        steps = 1e-6 * np.eye(6)
        J = np.stack([(residuals(turned(s[:3]) @ R, x + s[3:]) - residuals(turned(-s[:3]) @ R, x - s[3:])) / 2e-6
                      for s in steps], axis=1)  # fmt: skip
        A = J.T @ J
        step = -np.linalg.solve(A + damping * np.diag(A.diagonal()), J.T @ residuals(R, x))
        there = turned(step[:3]) @ R, x + step[3:]
        now = np.sum(residuals(*there) ** 2)
        better = now < cost
        trace.append((better, cost - now > 1e-3 * min(now, cost)))
        damping = np.clip(damping / 3 if better else 4 * damping, 1e-9, 1e9)
        if better:
            (R, x), cost = there, now
    return R, x, cost, trace


@pytest.mark.parametrize("iterations", [0, 1, 2, 3, 5])
def test_every_sample_s_pose_is_settled_by_itself(iterations):
    poses, features, pixels = hand(5, 7)
    rng = np.random.default_rng(2)
    pixels = pixels + 2.0 * rng.normal(size=pixels.shape)
    pixels[1, 0, 2:5] = np.nan
    weights = rng.uniform(0.3, 1.0, pixels.shape[:3])
    problem, state = problem_of(pixels, features, 5, weights)
    far = np.array([0.1, 0.4, 0.9, 1.3, 1.8])
    rotation = turned(far[:, None] * [0.6, -0.64, 0.48]) @ poses[:, :3, :3]
    translation = poses[:, :3, 3] + 0.1 * rng.normal(size=(5, 3))
    found, cost = settle_poses(problem, state(rotation, translation), iterations)
    for t in range(5):
        R, x, expected, _ = settled(pixels[t], weights[t], features, rotation[t], translation[t], iterations)
        np.testing.assert_allclose(found.rotation[t], R, atol=2e-3)
        np.testing.assert_allclose(found.translation[t], x, atol=2e-3)
        assert cost[t] == pytest.approx(expected, rel=5e-3)


def test_a_pose_behind_a_camera_costs_no_end_and_stays():
    poses, features, pixels = hand(3, 7)
    problem, state = problem_of(pixels, features, 3)
    translation = poses[:, :3, 3].copy()
    translation[1, 2] = -9.0
    found, cost = settle_poses(problem, state(poses[:, :3, :3], translation), 4)
    assert np.isinf(cost).tolist() == [False, True, False]
    np.testing.assert_array_equal(found.translation[1], translation[1])
    np.testing.assert_allclose(found.translation[[0, 2]], translation[[0, 2]], atol=1e-6)


def test_a_reversed_pose_shows_depths_mirrored():
    poses, features, pixels = hand(6, 9)
    pixels = pixels.copy()
    pixels[0, 0, 4:] = np.nan  # camera 1 sees more of it
    pixels[1, 0, 3:], pixels[1, 1] = np.nan, np.nan
    pixels[2, 0, 2:], pixels[2, 1] = np.nan, np.nan  # two features have no pose
    problem, state = problem_of(pixels, features, 6)
    start = state(poses[:, :3, :3], poses[:, :3, 3])
    found = reversed_state(problem, start)
    np.testing.assert_array_equal(start.rotation, poses[:, :3, :3])
    for t in range(6):
        if t == 2:
            np.testing.assert_array_equal(found.rotation[t], poses[t, :3, :3])
            np.testing.assert_array_equal(found.translation[t], poses[t, :3, 3])
            continue
        camera = 1 if t == 0 else 0
        seen = np.isfinite(pixels[t, camera, :, 0])
        view = TURNS[camera]
        places = features[seen] @ (view @ poses[t, :3, :3]).T
        mirrored = (places - places.mean(axis=0)) * [1, 1, -1] + places.mean(axis=0)
        turn, _ = Rotation.align_vectors(mirrored - mirrored.mean(axis=0), features[seen] - features[seen].mean(axis=0))
        np.testing.assert_allclose(view @ found.rotation[t], turn.as_matrix(), atol=1e-6)
        middle = mirrored.mean(axis=0) - turn.apply(features[seen].mean(axis=0))
        np.testing.assert_allclose(found.translation[t], poses[t, :3, 3] + view.T @ middle, atol=1e-6)


@pytest.mark.parametrize(("share", "taken"), [(0.94, True), (0.96, False)])
def test_the_other_pose_has_to_save_a_twentieth(monkeypatch, share, taken):
    poses, features, pixels = hand(2, 9)
    problem, state = problem_of(pixels, features, 2)
    start, other = state(poses[:, :3, :3], poses[:, :3, 3]), state(poses[::-1, :3, :3], poses[::-1, :3, 3])
    monkeypatch.setattr(pose_reversal, "reversed_state", lambda *_: other)

    def told(problem, state, iterations=12):
        assert (iterations == 0) == (state is start)
        return state, np.array([10.0, 10.0]) * (1.0 if state is start else np.array([share, 2.0]))

    monkeypatch.setattr(pose_reversal, "settle_poses", told)
    found, better = better_poses(problem, start)
    assert better.tolist() == [taken, False]
    np.testing.assert_array_equal(found.rotation[0], (other if taken else start).rotation[0])
    np.testing.assert_array_equal(found.rotation[1], poses[1, :3, :3])
    np.testing.assert_array_equal(found.translation[1], poses[1, :3, 3])


@pytest.mark.parametrize(("size", "enough"), [(0.019, False), (0.021, True)])
def test_turns_about_two_axes_tie_the_frames_together(size, enough):
    """About the second one by 0.02 rad in the root mean square."""
    rng = np.random.default_rng(0)
    count = 40
    vectors = np.stack([0.5 * np.sin(np.arange(count)), size * np.sqrt(2) * np.cos(7.7 * np.arange(count)),
                        np.zeros(count)], axis=1)  # fmt: skip
    vectors[:, 1] *= size * np.sqrt(count) / np.linalg.svd(vectors, compute_uv=False)[1]
    motions = np.tile(np.eye(4), (count, 1, 1))
    motions[:, :3, :3], motions[:, :3, 3] = turned(vectors), rng.normal(size=(count, 3))
    rotation, translation = np.tile(np.eye(3), (count + 1, 1, 1)), np.zeros((count + 1, 3))
    for k, motion in enumerate(motions):
        rotation[k + 1] = motion[:3, :3] @ rotation[k]
        translation[k + 1] = motion[:3, :3] @ translation[k] + motion[:3, 3]
    found = SimpleNamespace(rotation=rotation, translation=translation, posed=np.ones(count + 1, bool))
    first, second = np.arange(count), np.arange(1, count + 1)
    if enough:
        assert cartesian.align_frames(found, first, second, motions)[1] == pytest.approx(1.0)
        return
    with pytest.raises(DenseVSError, match="turned about one axis at most"):
        cartesian.align_frames(found, first, second, motions)
