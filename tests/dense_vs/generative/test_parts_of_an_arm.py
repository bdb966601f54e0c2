"""Parts of a model from exact pixels: DH parameters, one part relearned, what stays open, samples posed one by one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exact_arm import SIZES, carried, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.kinematics.denavit_hartenberg import DHProblem, from_lines, to_lines, transforms, with_dh
from dense_vs.generative.kinematics.placement import place_cameras, place_features
from dense_vs.generative.learning import fitting, relearning
from dense_vs.generative.learning.relearning import relearn
from dense_vs.generative.least_squares.observability import describe_unobservable
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.reconstruction.factorization import factorize
from dense_vs.generative.reconstruction.sample_alignment import align_samples


@pytest.fixture(scope="module")
def arm():
    return exact_arm()


# Denavit and Hartenberg's parameters.


def test_a_transform_is_four_plain_motions():
    """Turn about z, shift along it, shift along x, turn about x."""
    omega, d, a, alpha, q = 0.3, 0.2, -0.4, 0.7, np.array([0.5, -1.1])
    for angle, found in zip(q, transforms(np.array([omega, d, a, alpha]), q), strict=True):
        turn = Rotation.from_euler("z", omega + angle).as_matrix()
        expected = np.eye(4)
        expected[:3, :3] = turn @ Rotation.from_euler("x", alpha).as_matrix()
        expected[:3, 3] = turn @ [a, 0, 0] + [0, 0, d]
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["skew", "parallel", "same line", "crossing"])
def test_lines_become_parameters_and_lines_again(kind):
    """Also where two axes are parallel, where d is not determined and taken as 0."""
    axes = np.array([[0.0, 0.0, 1.0], [0.8, 0.6, 0.0], [0.0, 0.6, 0.8]])
    points = np.array([[0.05, 0.0, 0.0], [0.0, 0.1, 0.2], [0.1, 0.0, 0.4]])
    if kind == "parallel":
        axes[1] = axes[0]
    elif kind == "same line":
        axes[1], points[1] = axes[0], points[0] + [0, 0, 0.7]
    elif kind == "crossing":
        points[1] = points[0] + 0.3 * axes[0]
    home = np.array([0.2, -0.5, 0.9])
    dh = from_lines(axes, points, home)
    near = np.array([0.3, -0.2, 0.6])
    found, at = to_lines(dh, home, near)
    np.testing.assert_allclose(found, axes, atol=1e-9)
    np.testing.assert_allclose(np.cross(at - points, axes), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ni,ni->n", at - near, axes), 0.0, atol=1e-9)
    if kind in ("parallel", "same line"):
        assert dh.table[0, 1] == 0.0
    # The links move as turns about the lines say.
    q = home + np.array([0.4, -0.3, 0.2])
    before, after = dh.frames(home[None])[0], dh.frames(q[None])[0]
    none = {"base_rotation": np.eye(3), "base_translation": np.zeros(3)}
    arm = SimpleNamespace(axes=axes, points=points, home=home, **none)
    for link in range(4):
        inside = np.linalg.inv(before[link]) @ [0.1, 0.2, 0.3, 1.0]
        np.testing.assert_allclose((after[link] @ inside)[:3], carried(arm, q, link, [0.1, 0.2, 0.3]), atol=1e-9)


@pytest.mark.parametrize("local", ["none", "joints"])
def test_the_gradient_in_these_parameters_is_that_of_the_cost(arm, local):
    p = arm.parameters
    rng = np.random.default_rng(1)
    cameras = np.array([False, True])
    free = Free(kinematics=True, features=True, cameras=cameras, intrinsics=cameras)
    problem = PixelProblem(arm.pixels + rng.normal(size=arm.pixels.shape), p.links, 3, free, local)
    dh = DHProblem(problem)
    state = with_dh(PixelState(p.copy(), arm.joints.copy()), from_lines(p.axes, p.points, p.home))
    equations = dh.linearize(state)
    assert equations.cost == pytest.approx(dh.cost(state))
    count = len(equations.shared_gradient)
    assert (dh.lines, dh.own) == (12, 14)
    assert count == 14 + problem.count - 12
    blocks = None if equations.local is None else np.zeros((len(arm.joints), equations.local.shape[1]))

    def residual(step):
        return problem.residuals(dh.move(state, step, blocks)).ravel().copy()

    J = np.stack([(residual(1e-6 * d) - residual(-1e-6 * d)) / 2e-6 for d in np.eye(count)], axis=1)
    here = residual(np.zeros(count))
    scale = np.sqrt((J**2).sum(axis=0))
    np.testing.assert_allclose(equations.shared_gradient / scale, J.T @ here / scale, atol=1e-2)
    np.testing.assert_allclose(equations.shared / np.outer(scale, scale), J.T @ J / np.outer(scale, scale), atol=1e-5)
    if local == "joints":
        for t, n in ((0, 0), (5, 2)):
            own = np.zeros_like(blocks)
            own[t, n] = 1e-6
            still = np.zeros(count)
            up, down = (problem.residuals(dh.move(state, still, s * own)).ravel().copy() for s in (1, -1))
            column = (up - down) / 2e-6
            np.testing.assert_allclose(equations.coupling[t, n] / scale, column @ J / scale, rtol=1e-4, atol=1e-2)


def test_kinematics_that_are_known_have_no_such_parameters(arm):
    with pytest.raises(ValueError, match="not free"):
        DHProblem(PixelProblem(arm.pixels, arm.parameters.links, 3, Free(features=True)))


# One part from a few samples.


def turned(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def given(p, joints, cameras=2, **changes):
    return Observations(joints=joints, pixels=project(p, joints)[:, :cameras], image_sizes=SIZES[:1] * cameras,
                        **changes)  # fmt: skip


def learned(before, observations, what):
    return relearn(before, observations, what, 0.2, exact_arm().joints)


@pytest.mark.parametrize("gross", [0, 3])
def test_a_moved_camera_is_found_and_keeps_its_lens(arm, gross):
    p, joints = arm.parameters, arm.joints[:4]
    now = replace(p, camera_rotation=p.camera_rotation.copy(), camera_translation=p.camera_translation.copy())
    now.camera_rotation[1], now.camera_translation[1] = turned([0.0, -0.3, 0.1]), [0.5, 0.0, 2.4]
    observations = given(now, joints)
    observations.pixels[0, 1, :gross] += 40.0
    found, report = learned(p, observations, "camera:1")
    np.testing.assert_allclose(found.camera_rotation, now.camera_rotation, atol=2e-3)
    np.testing.assert_allclose(found.camera_translation, now.camera_translation, atol=1e-2)
    np.testing.assert_allclose(found.intrinsics, p.intrinsics, rtol=5e-3, atol=1e-2)
    np.testing.assert_array_equal(found.camera_rotation[0], p.camera_rotation[0])
    assert (found.axes is p.axes, found.features is p.features) == (True, True)
    assert report.rms_px < 0.05
    assert report.mean_error_px < 0.05
    assert report.stages[0].name == "camera:1"
    assert report.pixel_sigma == 0.2
    assert np.isfinite(report.expected_error_px)
    assert gross == 0 or report.stages[0].rms == report.rms_px


@pytest.mark.parametrize("told", [False, True])
def test_a_new_camera_is_added(arm, told):
    p, joints = arm.parameters, arm.joints
    third = np.array([[620.0, 620, 330, 235, 0, 0]])
    more = replace(p, camera_rotation=np.concatenate([p.camera_rotation, turned([0.2, 0.6, 0.0])[None]]),
                   camera_translation=np.vstack([p.camera_translation, [-0.8, 0.2, 2.1]]),
                   intrinsics=np.vstack([p.intrinsics, third]))  # fmt: skip
    changes = {"intrinsics": more.intrinsics[:, :4] + 5.0} if told else {}
    found, _ = learned(p, given(more, joints, 3, **changes), "camera:2")
    assert len(found.intrinsics) == 3
    np.testing.assert_allclose(found.camera_rotation[2], more.camera_rotation[2], atol=5e-3)
    np.testing.assert_allclose(found.camera_translation[2], more.camera_translation[2], atol=0.03)
    np.testing.assert_allclose(found.intrinsics[2, :4], third[0, :4], rtol=0.02)
    np.testing.assert_array_equal(found.intrinsics[:2], p.intrinsics)


def test_a_new_structure_is_found_whole_or_in_part(arm):
    p, joints = arm.parameters, arm.joints[:6]
    now = replace(p, features=p.features + np.random.default_rng(2).normal(0, 0.1, p.features.shape))
    some = replace(p, features=np.where(np.isin(np.arange(10), [1, 8])[:, None], now.features, p.features))
    found, report = learned(p, given(some, joints), "structure:1,8")
    np.testing.assert_allclose(found.features, some.features, atol=1e-4)
    np.testing.assert_array_equal(found.features[0], p.features[0])
    np.testing.assert_array_equal(found.links, p.links)
    assert report.rms_px < 0.01
    whole, _ = learned(p, given(now, joints, feature_link=p.links), "structure")
    np.testing.assert_allclose(whole.features, now.features, atol=1e-4)
    hand = replace(now, links=np.full(10, 3))
    all_on_hand, _ = learned(p, given(hand, joints), "structure")  # unless told, features are the hand's
    np.testing.assert_allclose(all_on_hand.features, now.features, atol=1e-4)
    assert (all_on_hand.links == 3).all()
    pixels = project(now, joints)
    pixels[:, :, 4] = np.nan
    pixels[0, 0, 4] = 100.0
    once = Observations(joints=joints, pixels=pixels, image_sizes=SIZES, feature_link=p.links)
    partly, _ = learned(p, once, "structure")
    assert np.isnan(partly.features[4]).all()
    np.testing.assert_allclose(np.delete(partly.features, 4, axis=0), np.delete(now.features, 4, axis=0), atol=1e-4)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_moved_base_is_found(arm, samples):
    p = arm.parameters
    now = replace(p, base_rotation=turned([0.2, -0.1, 0.3]), base_translation=np.array([0.1, -0.2, 0.3]))
    found, report = learned(p, given(now, arm.joints[:samples]), "base")
    np.testing.assert_allclose(found.base_rotation, now.base_rotation, atol=1e-4)
    np.testing.assert_allclose(found.base_translation, now.base_translation, atol=1e-4)
    assert report.rms_px < 0.01
    again, _ = learned(found, given(now, arm.joints[samples : samples + 2]), "base")  # from a base that moved already
    np.testing.assert_allclose(again.base_translation, now.base_translation, atol=1e-4)


def test_new_kinematics_are_found(arm):
    p = arm.parameters
    axes = p.axes + np.array([[0.1, 0, 0], [0, 0, 0.3], [0.2, 0, 0]])
    now = replace(p, axes=axes / np.linalg.norm(axes, axis=1, keepdims=True), points=p.points + 0.03)
    found, report = learned(p, given(now, arm.joints), "kinematics")
    assert report.rms_px < 0.02
    other = arm.joints.mean(axis=0) + np.random.default_rng(3).uniform(-0.3, 0.3, (5, 3))
    np.testing.assert_allclose(project(found, other), project(now, other), atol=0.2)
    with pytest.raises(DenseVSError, match=r"known in 2 samples; 3 joints need 3"):
        learned(p, given(now, arm.joints[:2]), "kinematics")


@pytest.mark.parametrize(("what", "message"), [
    ("camera:3", "camera:0 to camera:1"), ("camera:x", "camera:0 to camera:1"), ("camera:2", "camera:0 to camera:1"),
    ("structure:10", "below 10"), ("structure:1,x", "below 10"), ("base:1", "what is 'base:1'"),
    ("kinematics:1", "what is 'kinematics:1'"), ("hand", "what is 'hand'"),
])  # fmt: skip
def test_what_is_no_part_of_a_model(arm, what, message):
    with pytest.raises(DenseVSError, match=message):
        learned(arm.parameters, arm.observations, what)


def test_samples_that_cannot_tell_a_part(arm):
    p = arm.parameters
    with pytest.raises(DenseVSError, match=r"joints have shape \(14, 2\)"):
        learned(p, Observations(joints=arm.joints[:, :2], pixels=arm.pixels, image_sizes=SIZES), "base")
    few = arm.pixels[:1].copy()
    few[:, 1, 3:] = np.nan
    with pytest.raises(DenseVSError, match="camera 1 saw 3 features"):
        learned(p, Observations(joints=arm.joints[:1], pixels=few, image_sizes=SIZES), "camera:1")
    with pytest.raises(DenseVSError, match="at least the model's 10"):
        learned(p, Observations(joints=arm.joints, pixels=arm.pixels[:, :, :9], image_sizes=SIZES), "structure:1")
    alone = np.full_like(arm.pixels, np.nan)
    alone[0, 0] = arm.pixels[0, 0]
    with pytest.raises(DenseVSError, match="no feature was seen from two directions"):
        learned(p, Observations(joints=arm.joints, pixels=alone, image_sizes=SIZES), "structure")
    hidden = arm.pixels.copy()
    hidden[:, :, 3:8] = np.nan
    with pytest.raises(DenseVSError, match="no sample shows 4 features"):
        learned(p, Observations(joints=arm.joints, pixels=hidden, image_sizes=SIZES), "base")


def test_features_and_cameras_are_placed_through_the_chain(arm):
    p = arm.parameters
    lost = p.copy()
    lost.features[[2, 9]] = np.nan
    pixels = arm.pixels.copy()
    pixels[0, 0, 2] += 30.0  # a mistaken label loses its weight
    found = place_features(lost, pixels, arm.joints)
    np.testing.assert_allclose(found.features, p.features, atol=2e-3)
    assert place_features(p, pixels, arm.joints) is p
    moved = place_features(p, pixels, arm.joints, np.arange(10) == 5)
    np.testing.assert_allclose(moved.features[5], p.features[5], atol=1e-6)
    blind = p.copy()
    blind.camera_translation[1] = np.nan
    placed = place_cameras(blind, arm.pixels, arm.joints, p.intrinsics)
    np.testing.assert_allclose(placed.camera_rotation, p.camera_rotation, atol=1e-5)
    np.testing.assert_allclose(placed.camera_translation, p.camera_translation, atol=1e-5)
    one = place_features(blind, arm.pixels, arm.joints, np.ones(10, bool))  # by the camera that is left
    np.testing.assert_allclose(one.features, p.features, atol=1e-5)
    for count in (3, 4):
        some = arm.pixels[:1].copy()
        some[:, 1, count:] = np.nan
        placed = place_cameras(blind, some, arm.joints[:1], p.intrinsics)
        assert np.isfinite(placed.camera_translation[1]).all() == (count == 4)


# What observations leave open.


def opened(arm, free=None, weights=None, offsets=False, still=(), local="none"):
    p = arm.parameters
    free = free or Free(kinematics=True, features=True, cameras=np.array([False, True]), intrinsics=False)
    problem = PixelProblem(arm.pixels, p.links, 3, free, local, weights=weights)
    return describe_unobservable(problem, PixelState(p, arm.joints), offsets, list(still))


def test_what_is_seen_well_leaves_nothing_open(arm):
    assert opened(arm) == []
    assert opened(arm, offsets=True) == []
    assert opened(arm, still=[2]) == ["joint 2 did not move: its axis is unknown"]


def test_a_joint_that_does_not_move_is_named_once():
    assert opened(exact_arm(still=[2]), still=[3]) == ["joint 3 did not move: its axis is unknown"]


def test_features_that_are_seen_once_or_never_are_named(arm):
    weights = np.ones(arm.pixels.shape[:3])
    weights[:, :, 4] = 0.0
    weights[1:, :, 6] = 0.0
    weights[0, 0, 6] = 0.0
    weights[2:, :, 7] = 0.0
    weights[:2, 1, 7] = 0.0
    words = opened(arm, weights=0.3 * weights)
    assert words[:2] == [
        "feature 4 was seen in 0 usable images: its place is unknown",
        "feature 6 was seen in 1 usable images: its place is unknown",
    ]
    assert not any("feature 7 was" in word for word in words)
    assert "feature 6 is not determined by these observations" in words
    free = Free(kinematics=True, features=np.arange(10) != 0, cameras=np.array([False, True]), intrinsics=False)
    assert opened(arm, free)[0] == "feature 0 was seen in 28 usable images: its place is unknown"


def test_a_camera_that_sees_too_little_is_named(arm):
    weights = np.ones(arm.pixels.shape[:3])
    weights[:, 1, 2:] = 0.0
    weights[1:, 1] = 0.0
    words = opened(arm, weights=weights)
    assert "pose of camera 1 is not determined by these observations" in words
    assert not any("feature" in word for word in words)
    lens = Free(cameras=np.array([False, True]), intrinsics=np.array([False, True]), kinematics=True, features=True)
    assert "intrinsics of camera 1 is not determined by these observations" in opened(arm, lens, weights)


# Samples posed one by one, and from one camera.


def rays_of(arm):
    center, focal = arm.parameters.intrinsics[:, None, 2:4], arm.parameters.intrinsics[:, None, :2]
    return (arm.pixels[:, :, :8] - center) / focal


def apart(one, other, structure, truth):
    """Largest distance of the posed structures, each after the rigid motion of the hand's axes to the true ones."""
    middle, goal = structure.mean(axis=0), truth.mean(axis=0)
    turn, _ = Rotation.align_vectors(truth - goal, structure - middle)
    assert np.abs(turn.apply(structure - middle) + goal - truth).max() < 1e-3
    return np.abs(one - other).max()


@pytest.mark.parametrize("hidden", ["nothing", "one camera in some samples", "single features", "gross"])
def test_every_sample_is_posed_by_what_the_cameras_see(arm, hidden):
    p, flat = arm.parameters, rays_of(arm)
    seen = np.ones(flat.shape[:3], bool)
    if hidden == "one camera in some samples":
        seen[3:9, 1] = False  # these are resected
    elif hidden == "single features":
        seen[:, 0, 6], seen[2:5, :, 1] = False, False
    elif hidden == "gross":
        flat = flat.copy()
        flat[5, 0, 2] += 0.05
    rotation, shift, structure, posed = align_samples(
        flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation
    )
    assert posed.all()
    true = np.array([[carried(p, q, 3, feature) for feature in p.features[:8]] for q in arm.joints])
    found = np.einsum("tij,mj->tmi", rotation, structure) + shift[:, None]
    assert apart(found, true, structure, p.features[:8]) < (0.02 if hidden == "gross" else 1e-3)


def test_samples_without_three_features_off_a_line_cannot_be_aligned(arm):
    p, flat = arm.parameters, rays_of(arm)
    seen = np.zeros(flat.shape[:3], bool)
    seen[:, :, :2] = True
    with pytest.raises(DenseVSError, match="three features, off a line"):
        align_samples(flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation)
    seen[4, :, :4] = True  # one sample is enough, for itself
    _, _, structure, posed = align_samples(flat, seen, np.ones(2, bool), p.camera_rotation, p.camera_translation)
    assert posed.tolist() == [t == 4 for t in range(14)]
    assert np.isfinite(structure[:, 0]).tolist() == [True] * 4 + [False] * 4


def far_arm(times=30, **changes):
    """The hand so far away that its picture is nearly a scaled orthographic one."""
    arm = exact_arm(**changes)
    p = replace(arm.parameters, camera_translation=arm.parameters.camera_translation + np.array([0, 0, 2.0 * times]))
    p.intrinsics[:, :2] *= times
    arm.parameters, arm.pixels = p, project(p, arm.joints)
    return arm


@pytest.mark.parametrize("hidden", [False, True])
def test_one_camera_tells_structure_and_motion_up_to_size_and_depth_reversal(hidden):
    arm = far_arm(samples=12)
    pixels = arm.pixels[:, :, :8].copy()
    if hidden:
        pixels[::3, 0, 5] = np.nan
        pixels[4, 0, 4:] = np.nan  # four are enough for a frame,
        pixels[7, 0, 3:] = np.nan  # three are not
    found = factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))
    truth = arm.parameters.features[:8] - arm.parameters.features[:8].mean(axis=0)
    off = []
    for one in found:
        assert one.posed.tolist() == [not (hidden and t == 7) for t in range(12)]
        assert one.placed_cameras.tolist() == [True, False]
        structure = one.structure - one.structure.mean(axis=0)
        structure = structure * np.linalg.norm(truth) / np.linalg.norm(structure)
        turn, _ = Rotation.align_vectors(truth, structure)
        off.append(np.abs(turn.apply(structure) - truth).max())
        here = np.einsum("tij,mj->tmi", one.rotation, one.structure) + one.translation[:, None]
        seen = np.isfinite(pixels[:, 0, :, 0]) & one.posed[:, None]
        picture = arm.parameters.intrinsics[0, :2] * here[..., :2] / here[..., 2:] + arm.parameters.intrinsics[0, 2:4]
        assert np.abs(picture - pixels[:, 0])[seen].max() < 8.0  # of a picture of some 300 px
    assert min(off) < 0.02  # of 0.5
    assert max(off) > 0.02  # the other one is its mirror image


@pytest.mark.parametrize(("frames", "features", "enough"), [(2, 8, False), (12, 3, False), (12, 4, True)])
def test_one_camera_needs_three_frames_of_four_features(frames, features, enough):
    arm = far_arm(samples=12)
    pixels = np.full_like(arm.pixels[:, :, :8], np.nan)
    pixels[:frames, :, :features] = arm.pixels[:frames, :, :features]
    if enough:
        assert len(factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))) == 2
    else:
        with pytest.raises(DenseVSError, match="structure and motion from one camera"):
            factorize(pixels, arm.parameters.intrinsics, 0, np.random.default_rng(0))


def test_features_in_a_plane_are_refused():
    arm = far_arm(3000, samples=12)
    p = replace(arm.parameters, features=arm.parameters.features * [1, 1, 0] + [0, 0, 0.5])
    with pytest.raises(DenseVSError, match="plane or line"):
        factorize(project(p, arm.joints)[:, :, :8], p.intrinsics, 0, np.random.default_rng(0))


# Rejection, figures and unknown features of a fit.


def test_mistaken_detections_lose_all_weight_and_the_others_get_theirs_back(arm):
    p = arm.parameters
    pixels = arm.pixels + 0.1 * np.random.default_rng(4).normal(size=arm.pixels.shape)
    pixels[2, 0, 3] += [30.0, -20.0]
    pixels[7, 1, 5] += [5.0, 5.0]
    weights = np.random.default_rng(5).uniform(0.3, 0.9, pixels.shape[:3])
    problem = PixelProblem(pixels, p.links, 3, Free(features=True), weights=weights)
    start = fitting.minimize(problem, PixelState(p, arm.joints), 20)
    found = fitting._reject(problem, start, fitting.FitOptions())
    assert problem.weights[2, 0, 3] == problem.weights[7, 1, 5] == 0.0
    kept = problem.weights > 0
    assert kept.sum() >= kept.size - 8
    assert (problem.weights[kept] == 1.0).all()
    np.testing.assert_allclose(found.state.parameters.features, p.features, atol=1e-3)
    assert found.iterations > start.iterations
    robust = relearning._robust(problem, PixelState(p, arm.joints))
    np.testing.assert_allclose(robust.state.parameters.features, p.features, atol=1e-3)
    assert problem.weights[2, 0, 3] == 0.0
    stage = fitting._stage("one", found, problem, 0.0, start)
    errors = problem.pixel_errors(found.state)[problem.weights > 0]
    assert stage.rms == pytest.approx(np.sqrt(np.mean(errors**2) / 2))
    assert (stage.initial_cost if hasattr(stage, "initial_cost") else start.initial_cost) == start.initial_cost
    assert stage.iterations == found.iterations + start.iterations
    assert fitting._stage("one", found, problem, 0.0).iterations == found.iterations


def test_features_that_are_seen_once_are_unknown(arm):
    weights = np.zeros(arm.pixels.shape[:3])
    weights[:, :, :4] = 0.5
    weights[0, 0, 4] = weights[0, 0, 5] = weights[1, 0, 5] = 0.5
    problem = PixelProblem(arm.pixels, arm.parameters.links, 3, Free(features=np.arange(10) > 0), weights=weights)
    found = fitting._without_unseen(arm.parameters, problem)
    assert np.isfinite(found.features[:, 0]).tolist() == [False, True, True, True, False, True] + [False] * 4
    assert np.isfinite(arm.parameters.features).all()
