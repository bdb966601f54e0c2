"""Gradients of the buffer's loss beside differences of an arm's own projection, and what an observation leads to."""

from dataclasses import replace

import numpy as np
import pytest
from exact_arm import SIZES, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.generative.report import FitReport, Stage

SIGMA = 0.4


def watched(arm, sigma=SIGMA, **report):
    p = arm.parameters.copy()
    return GenerativeModel(p, arm.joints, FitReport(pixel_sigma=sigma, **report), image_sizes=SIZES)


def filled(arm, pixels, **options):
    watch = watched(arm).online(**options)
    changes = [watch.add(q, x) for q, x in zip(arm.joints, pixels, strict=True)]
    return watch, changes


def off(arm, size=0.3):
    return arm.pixels + size * np.random.default_rng(3).normal(size=arm.pixels.shape)


def across(axis):
    """Two directions at right angles to a line."""
    return np.linalg.svd(axis[None])[2][1:]


def directions(p):
    """Each unknown as a function of a step: of every camera's pose and lens, then of the arm and its features."""

    def changed(name, place, value):
        array = getattr(p, name).copy()
        array[place] = value
        return replace(p, **{name: array})

    cameras = []
    for c in range(len(p.intrinsics)):
        own = []
        for k in range(3):
            turn = np.eye(3)[k]
            own.append(lambda h, c=c, turn=turn: changed(
                "camera_rotation", c, Rotation.from_rotvec(h * turn).as_matrix() @ p.camera_rotation[c]))  # fmt: skip
            own.append(lambda h, c=c, k=k: changed("camera_translation", (c, k), p.camera_translation[c, k] + h))
        own += [lambda h, c=c, k=k: changed("intrinsics", (c, k), p.intrinsics[c, k] + h) for k in range(4)]
        cameras.append(own)
    rest = []
    for n, axis in enumerate(p.axes):
        for side in across(axis):
            rest.append(lambda h, n=n, side=side, axis=axis: changed(
                "axes", n, Rotation.from_rotvec(h * side).apply(axis)))  # fmt: skip
            rest.append(lambda h, n=n, side=side: changed("points", n, p.points[n] + h * side))
    for m in np.flatnonzero(np.isfinite(p.features[:, 0])):
        rest += [lambda h, m=m, k=k: changed("features", (m, k), p.features[m, k] + h) for k in range(3)]
    return cameras, rest


def slopes(p, joints, pixels, ways):
    """Of the residuals by each way, by central differences, and the residuals."""
    step = 1e-5
    seen = np.isfinite(pixels)
    J = np.stack(
        [((project(way(step), joints) - project(way(-step), joints)) / (2 * step))[seen] for way in ways], axis=1
    )
    return J, (project(p, joints) - pixels)[seen]


@pytest.mark.parametrize("hidden", [False, True])
def test_gradients_are_those_of_the_sum_of_squares(hidden):
    arm = exact_arm(samples=6)
    pixels = off(arm)
    if hidden:
        pixels[1, 0, 2] = pixels[2, 1] = np.nan
    watch, changes = filled(arm, pixels)
    norms, ratios = watch.gradient_norms()
    cameras, rest = directions(arm.parameters)
    for c, ways in enumerate(cameras):
        J, r = slopes(arm.parameters, arm.joints, pixels, ways)
        g = J.T @ r
        assert norms[c] == pytest.approx(np.linalg.norm(2 * g), rel=1e-4)
        expected = g @ np.linalg.solve(J.T @ J, g) / (SIGMA**2 * len(ways))
        assert ratios[c] == pytest.approx(expected, rel=1e-3)
    J, r = slopes(arm.parameters, arm.joints, pixels, rest)
    assert norms[2] == pytest.approx(np.linalg.norm(2 * J.T @ r), rel=1e-4)
    assert changes[-1].gradient_norm == pytest.approx(np.linalg.norm(norms))
    np.testing.assert_array_equal(changes[-1].camera_gradient_norms, norms[:2])
    np.testing.assert_array_equal(changes[-1].camera_gradient_ratios, ratios)


def test_a_feature_that_is_unknown_counts_for_nothing():
    arm = exact_arm(samples=6)
    pixels = off(arm)
    arm.parameters.features[4] = np.nan
    watch, _ = filled(arm, pixels)
    norms, _ = watch.gradient_norms()
    without = pixels.copy()
    without[:, :, 4] = np.nan
    cameras, rest = directions(arm.parameters)
    for ways, norm in zip([*cameras, rest], norms, strict=True):
        known = replace(arm.parameters, features=np.nan_to_num(arm.parameters.features))
        J, r = slopes(known, arm.joints, without, [lambda h, way=way: filled_in(way(h)) for way in ways])
        assert norm == pytest.approx(np.linalg.norm(2 * J.T @ r), rel=1e-4)


def filled_in(p):
    return replace(p, features=np.nan_to_num(p.features))


def test_the_buffer_holds_the_latest():
    arm = exact_arm(samples=6)
    pixels = off(arm)
    few, _ = filled(arm, pixels, capacity=2)
    later, _ = filled(exact_arm(samples=6), pixels)
    later.buffer.popleft(), later.buffer.popleft(), later.buffer.popleft(), later.buffer.popleft()
    assert len(few.buffer) == 2
    np.testing.assert_allclose(few.gradient_norms()[0], later.gradient_norms()[0])


@pytest.mark.parametrize("given", [(1.0,), (0.25,), ()])
@pytest.mark.parametrize("what", ["structure", "camera:1"])
def test_a_part_follows_by_a_gauss_newton_step(what, given):
    rate = given[0] if given else 0.5
    arm = exact_arm(samples=6)
    moved = replace(arm.parameters, features=np.add(arm.parameters.features, [0.004, -0.003, 0.002]))
    if what == "camera:1":
        moved = replace(
            arm.parameters, camera_translation=np.add(arm.parameters.camera_translation, [[0] * 3, [0.01, 0, 0]])
        )
    pixels = project(moved, arm.joints)
    watch, _ = filled(arm, pixels)
    watch.ignored.clear()
    cameras, rest = directions(arm.parameters)
    ways = cameras[1] if what == "camera:1" else rest[12:]
    J, r = slopes(arm.parameters, arm.joints, pixels, ways)
    g = J.T @ r
    step = np.linalg.lstsq(J.T @ J, g, rcond=1e-9)[0]
    assert watch.follow(what, *given) == pytest.approx(g @ step / (SIGMA**2 * len(ways)), rel=1e-3)
    now = watch.model.parameters
    if what == "structure":
        np.testing.assert_allclose(now.features, arm.parameters.features - rate * step.reshape(10, 3), atol=1e-6)
        np.testing.assert_array_equal(now.intrinsics, arm.parameters.intrinsics)
    else:
        np.testing.assert_allclose(
            now.camera_translation[1], arm.parameters.camera_translation[1] - rate * step[[1, 3, 5]], atol=1e-6
        )
        np.testing.assert_allclose(now.intrinsics[1, :4], arm.parameters.intrinsics[1, :4] - rate * step[6:], rtol=1e-4)
        np.testing.assert_array_equal(now.camera_translation[0], arm.parameters.camera_translation[0])
        np.testing.assert_array_equal(now.features, arm.parameters.features)
    np.testing.assert_array_equal(now.axes, arm.parameters.axes)


def test_a_camera_alone_contradicts_the_model_or_nobody_does():
    """With one camera a change is the camera's: there is no other that could agree."""
    arm = exact_arm(samples=4)
    p = arm.parameters
    one = replace(p, camera_rotation=p.camera_rotation[:1], camera_translation=p.camera_translation[:1],
                  intrinsics=p.intrinsics[:1])  # fmt: skip
    model = GenerativeModel(one, arm.joints, FitReport(pixel_sigma=SIGMA), image_sizes=SIZES[:1])
    change = model.online().add(arm.joints[0], arm.pixels[0, :1] + 20.0)
    assert (change.moved_cameras, change.everything_moved) == ((0,), False)
    unseen = np.full((1, 10, 2), np.nan)
    nothing = model.online().add(arm.joints[0], unseen)
    assert np.isnan(nothing.camera_errors_px).all()
    assert (nothing.moved_cameras, nothing.everything_moved) == ((), False)


@pytest.mark.parametrize(
    ("first", "second", "moved", "everything"),
    [(0.0, 20.0, (1,), False), (20.0, 20.0, (), True), (20.0, None, (), True), (None, 0.0, (), False)],
)
def test_cameras_that_contradict_the_model_and_those_that_agree(first, second, moved, everything):
    """By how much each camera's image is off; None where it shows nothing."""
    arm = exact_arm(samples=2)
    pixels = arm.pixels[0].copy()
    for c, one in enumerate((first, second)):
        pixels[c] += np.nan if one is None else one
    watch = watched(arm).online(capacity=10**6)
    change = watch.add(arm.joints[0].tolist(), pixels.tolist())
    assert (change.moved_cameras, change.everything_moved) == (moved, everything)
    assert watch.ignored == set(moved)


def test_a_feature_that_the_model_has_behind_a_camera_is_left_out():
    arm = exact_arm(samples=6)
    pixels = off(arm)
    arm.parameters.features[8] = [0.0, 0.0, -30.0]
    watch, _ = filled(arm, pixels)
    without = pixels.copy()
    without[:, :, 8] = np.nan
    norms, _ = watch.gradient_norms()
    np.testing.assert_allclose(norms, filled(arm, without)[0].gradient_norms()[0])
    assert (norms > 0).all()


def stage(name, rms):
    return Stage(name, 9.0, 4.0, rms, 7, True, 0.1)


@pytest.mark.parametrize(
    ("sigma", "joint_sigma", "stages", "expected"),
    [
        (0.4, None, [stage("end to end", 9.0)], 0.4),  # exact readings: the pixels' noise alone
        (0.4, 0.01, [stage("kinematics", 9.0)], 0.4),
        (0.4, 0.01, [stage("end to end", 2.0), stage("end to end", 3.0)], 3.0),
        (0.4, 0.01, [stage("end to end", 0.3)], 0.4),
        (None, None, [], 0.5),
        (0.01, None, [], 0.3),
    ],
)
def test_the_limit_of_an_error_by_the_noise_that_is_expected(sigma, joint_sigma, stages, expected):
    arm = exact_arm(samples=2)
    model = watched(arm, sigma, joint_sigma=joint_sigma, stages=stages)
    limit = 4.0 * 1.1774 * expected
    for factor, named in ((0.98, ()), (1.02, (1,))):
        pixels = arm.pixels[0].copy()
        pixels[1, :, 1] += factor * limit
        change = model.online().add(arm.joints[0], pixels)
        assert change.moved_cameras == named
    assert change.camera_errors_px == pytest.approx([0.0, 1.02 * limit], abs=1e-6)


def test_a_median_is_of_what_was_seen():
    arm = exact_arm(samples=2)
    pixels = arm.pixels[0].copy()
    pixels[0, 5:] = np.nan
    pixels[0, :2, 0] += 50.0
    pixels[0, 2, 0] += 0.25
    change = watched(arm).online().add(arm.joints[0], pixels)
    assert change.camera_errors_px == pytest.approx([0.25, 0.0], abs=1e-6)


def test_samples_of_a_moved_camera_are_counted_from_when_it_moved():
    """Those in which it sees four known features, and only since then."""
    arm = exact_arm(samples=9)
    model = watched(arm)
    watch = model.online(relearn_after=3)
    asked = []
    model.relearn = lambda obs, what: asked.append((what, obs))
    pixels = arm.pixels.copy()
    pixels[2:, 1] += 30.0
    pixels[3, 1, 3:] = np.nan  # three features place no camera
    pixels[5, 1, 4:] = np.nan
    for t in range(6):
        assert not asked
        watch.add(arm.joints[t], pixels[t])
        assert watch.ignored == ({1} if 2 <= t < 5 else set())
    what, obs = asked[0]
    assert what == "camera:1"
    np.testing.assert_array_equal(obs.joints, arm.joints[2:6])
    np.testing.assert_array_equal(obs.pixels, pixels[2:6])
    np.testing.assert_array_equal(obs.feature_link, arm.parameters.links)
    assert obs.image_sizes == SIZES
    with pytest.raises(DenseVSError, match="camera 1 has not moved"):
        watch.relearn(1)
    never = model.online()
    for t in range(2, 9):
        never.add(arm.joints[t], pixels[t])
    assert len(asked) == 1
    assert never.ignored == {1}


@pytest.mark.parametrize("wrong", [{"capacity": 0}, {"capacity": 10**6 + 1}, {"relearn_after": -1}])
def test_sizes_that_are_none(wrong):
    with pytest.raises(DenseVSError, match=next(iter(wrong))):
        watched(exact_arm(samples=2)).online(**wrong)


def test_an_observation_that_is_none():
    arm = exact_arm(samples=2)
    watch = watched(arm).online()
    for joints, pixels in ((arm.joints[0] * [1.0, np.nan, 1.0], arm.pixels[0]), (arm.joints[0, :2], arm.pixels[0]),
                           (arm.joints[0], arm.pixels[0, :1])):  # fmt: skip
        with pytest.raises(DenseVSError, match="joints and pixels have shapes"):
            watch.add(joints, pixels)
    assert len(watch.buffer) == 0
