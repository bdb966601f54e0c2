"""Pixels and Jacobian of features on a chain against SciPy's rotations and central differences."""

import numpy as np
import pytest
import warp as wp
from reference_kinematics import chain_pixels
from scipy.spatial.transform import Rotation

from dense_vs.kernels.arm.joint_inference import JointSolver
from dense_vs.kernels.arm.kinematics import FeatureProjection
from dense_vs.kernels.arm.rotation_chain import RotationChain

RUNS, SAMPLES, JOINTS, CAMERAS = 2, 2, 4, 2
LINKS = np.array([4, 4, 2, 0, 3])
# Central differences with a step of 1e-6 of columns of up to 1000 px.
DIFFERENCE = {"rtol": 1e-5, "atol": 2e-3}


def unit(rng, *shape):
    v = rng.normal(size=(*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_model(seed):
    rng = np.random.default_rng(seed)
    axes = unit(rng, JOINTS)
    first = np.cross(axes, unit(rng, JOINTS))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return {
        "axes": axes,
        "points": rng.normal(0, 0.3, (JOINTS, 3)),
        "tangents": np.stack([first, np.cross(axes, first)], axis=1),
        "features": rng.normal(0, 0.2, (len(LINKS), 3)),
        "camera_rotation": Rotation.from_rotvec(rng.normal(0, 0.2, (CAMERAS, 3))).as_matrix(),
        "camera_translation": rng.normal([0, 0, 3], 0.1, (CAMERAS, 3)),
        "intrinsics": np.column_stack(
            [rng.uniform(500, 700, (CAMERAS, 2)), rng.uniform(200, 300, (CAMERAS, 2)), rng.normal(0, 0.1, (CAMERAS, 2))]
        ),
        "links": LINKS,
    }


def random_state(seed):
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (SAMPLES, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.3, (SAMPLES, 3))).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 0.1, (SAMPLES, 3))
    return rng.normal(0, 0.7, (SAMPLES, JOINTS)), poses, rng.normal(250, 50, (SAMPLES, CAMERAS, len(LINKS), 2))


def loaded(local="none", device="cpu"):
    """A projection with two different runs, and the runs' models and states."""
    projection = FeatureProjection(RUNS, SAMPLES, LINKS, JOINTS, CAMERAS, 6, local, device)
    models, states = [random_model(k) for k in range(RUNS)], [random_state(10 + k) for k in range(RUNS)]
    projection.set(**{name: np.array([m[name] for m in models]) for name in models[0] if name != "links"})
    joints, poses, pixels = (np.array(part) for part in zip(*states, strict=True))
    projection.set(joints=joints, pixels=pixels, weights=np.ones((1,)))
    projection.set(pose_rotation=poses[..., :3, :3], pose_translation=poses[..., :3, 3])
    return projection, models, states


def reference(model, state):
    joints, poses, pixels = state
    return np.array([chain_pixels(model, q, p) for q, p in zip(joints, poses, strict=True)]) - pixels


def shifted(model, state, part, index, step):
    """Model and state after a step along one column."""
    model, (joints, poses, pixels) = {k: v.copy() for k, v in model.items()}, (a.copy() for a in state)
    if part == "axes":
        joint, tangent = index
        model["axes"][joint] = Rotation.from_rotvec(step * model["tangents"][joint, tangent]).apply(
            model["axes"][joint]
        )
    elif part == "points":
        model["points"][index[0]] += step * model["tangents"][index]
    elif part == "camera_turn":
        turn = Rotation.from_rotvec(step * np.eye(3)[index[1]]).as_matrix()
        model["camera_rotation"][index[0]] = turn @ model["camera_rotation"][index[0]]
    elif part == "joints":
        joints[index] += step
    elif part == "pose_turn":
        poses[index[0], :3, :3] = Rotation.from_rotvec(step * np.eye(3)[index[1]]).as_matrix() @ poses[index[0], :3, :3]
    elif part == "pose_shift":
        poses[index[0], index[1], 3] += step
    else:
        model[part][index] += step
    return model, (joints, poses, pixels)


def difference(model, state, part, index, step=1e-6):
    ahead = reference(*shifted(model, state, part, index, step))
    return (ahead - reference(*shifted(model, state, part, index, -step))) / (2 * step)


@pytest.mark.parametrize("jacobian", [False, True])
def test_residuals(jacobian):
    projection, models, states = loaded()
    projection.evaluate(jacobian)
    for run in range(RUNS):
        np.testing.assert_allclose(projection.residuals[run], reference(models[run], states[run]), atol=1e-9)


def test_shared_columns():
    projection, models, states = loaded()
    projection.evaluate()
    at_feature, at_camera, at_intrinsics = 4 * JOINTS, 4 * JOINTS + 3, 4 * JOINTS + 9
    for run in range(RUNS):
        got = projection.jacobian[run].transpose(2, 0, 1, 3, 4)  # (T, c, m, 2, w)
        for joint in range(JOINTS):
            for k in range(2):
                for part, first in (("axes", 0), ("points", 2 * JOINTS)):
                    expected = difference(models[run], states[run], part, (joint, k))
                    np.testing.assert_allclose(got[..., first + 2 * joint + k], expected, **DIFFERENCE)
        for feature in range(len(LINKS)):
            for k in range(3):
                expected = difference(models[run], states[run], "features", (feature, k))
                np.testing.assert_allclose(got[:, :, feature, :, at_feature + k], expected[:, :, feature], **DIFFERENCE)
        for camera in range(CAMERAS):
            for k in range(3):
                for part, first in (("camera_turn", at_camera), ("camera_translation", at_camera + 3)):
                    expected = difference(models[run], states[run], part, (camera, k))
                    np.testing.assert_allclose(got[:, camera, ..., first + k], expected[:, camera], **DIFFERENCE)
            for k in range(6):
                expected = difference(models[run], states[run], "intrinsics", (camera, k), 1e-4)
                np.testing.assert_allclose(got[:, camera, ..., at_intrinsics + k], expected[:, camera], **DIFFERENCE)


def test_columns_of_the_samples():
    for local, parts in (("joints", ("joints",)), ("pose", ("pose_turn", "pose_shift"))):
        projection, models, states = loaded(local)
        projection.evaluate()
        for run in range(RUNS):
            got = projection.local_jacobian[run].transpose(2, 0, 1, 3, 4)
            for number, part in enumerate(parts):
                for sample in range(SAMPLES):
                    for k in range(JOINTS if part == "joints" else 3):
                        expected = difference(models[run], states[run], part, (sample, k))
                        np.testing.assert_allclose(got[sample, ..., 3 * number + k], expected[sample], **DIFFERENCE)


def test_weights_and_what_is_not_seen_or_behind():
    projection, models, states = loaded("joints")
    whole = reference(models[0], states[0])
    weights = np.ones((RUNS, SAMPLES, CAMERAS, len(LINKS)))
    weights[:, 0, 1, 2] = 0.0
    weights[:, 1, 0, 0] = 0.25
    projection.set(weights=np.sqrt(weights))
    projection.evaluate()
    np.testing.assert_array_equal(projection.residuals[0, 0, 1, 2], 0)
    np.testing.assert_array_equal(projection.jacobian[0, 1, 2, 0], 0)
    np.testing.assert_array_equal(projection.local_jacobian[0, 1, 2, 0], 0)
    np.testing.assert_allclose(projection.residuals[0, 1, 0, 0], 0.5 * whole[1, 0, 0])
    projection.set(camera_translation=np.array([0.0, 0.0, -3.0]))
    projection.evaluate()
    seen = weights > 0
    assert np.isnan(projection.residuals[seen]).all()
    np.testing.assert_array_equal(projection.residuals[~seen], 0)
    np.testing.assert_array_equal(projection.jacobian[..., :-6], 0)


def test_rotation_errors_and_turns():
    rng = np.random.default_rng(3)
    joints, axes = rng.normal(0, 0.5, (5, JOINTS)), unit(rng, 2, JOINTS)
    across = np.array([random_model(k)["tangents"] for k in range(2)])
    axes = np.cross(across[:, :, 0], across[:, :, 1])
    home = Rotation.from_rotvec(rng.normal(size=(2, 3))).as_matrix()
    measured = Rotation.from_rotvec(rng.normal(size=(5, 3))).as_matrix()
    weights = rng.uniform(0.5, 2, 5)
    chain = RotationChain(3, joints, measured, weights)

    def cost(axes, home):
        total = 0.0
        for q, m, w in zip(joints, measured, weights, strict=True):
            r = np.eye(3)
            for axis, angle in zip(axes, q, strict=True):
                r = r @ Rotation.from_rotvec(angle * axis).as_matrix()
            total += w * ((r @ home - m) ** 2).sum() / 2
        return total

    costs, errors, turns = chain.evaluate(axes, across, home)
    for run in range(2):
        assert costs[run] == pytest.approx(cost(axes[run], home[run]))
        descent = np.einsum("tiu,ti->u", turns[run], errors[run])
        for column in range(2 * JOINTS + 3):
            ends = []
            for step in (1e-6, -1e-6):
                a, h = axes[run].copy(), home[run]
                if column < 2 * JOINTS:
                    joint, k = divmod(column, 2)
                    a[joint] = Rotation.from_rotvec(step * across[run, joint, k]).apply(a[joint])
                else:
                    h = Rotation.from_rotvec(step * np.eye(3)[column - 2 * JOINTS]).as_matrix() @ h
                ends.append(cost(a, h))
            # The gradient is -2 D^T e.
            assert -2 * descent[column] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-6)


def solver_for(model, device="cpu"):
    solver = JointSolver(8, 3, LINKS, JOINTS, CAMERAS, device)
    known = {k: v for k, v in model.items() if k not in ("links", "tangents")}
    solver.set_model(base_rotation=np.eye(3), base_translation=np.zeros(3), **known)
    return solver


def solver_case(images=5):
    model = random_model(1)
    rng = np.random.default_rng(0)
    truth = rng.normal(0, 0.4, (images, JOINTS))
    pixels = np.array([chain_pixels(model, q) for q in truth])
    pixels[0, 1, 2] = np.nan
    starts = truth[:, None] + rng.normal(0, 0.1, (images, 3, JOINTS))
    return model, truth, pixels, starts


def test_joints_from_exact_pixels():
    model, truth, pixels, starts = solver_case()
    joints, costs, steps = solver_for(model).solve(pixels, starts)
    np.testing.assert_allclose(joints, np.repeat(truth[:, None], 3, axis=1), atol=1e-6)
    assert costs.max() < 1e-6
    assert steps.max() < 20


def test_joints_from_noisy_pixels_are_the_least_squares():
    from scipy.optimize import least_squares

    model, truth, pixels, starts = solver_case()
    pixels = pixels + np.random.default_rng(1).normal(0, 0.5, pixels.shape)
    joints, costs, _ = solver_for(model).solve(pixels, starts, tolerance=1e-12)
    for image in range(len(truth)):
        seen = np.isfinite(pixels[image])
        expected = least_squares(
            lambda q, seen=seen, image=image: (chain_pixels(model, q) - pixels[image])[seen], starts[image, 0]
        )
        np.testing.assert_allclose(joints[image, 0], expected.x, atol=1e-5)
        assert costs[image, 0] == pytest.approx(2 * expected.cost, rel=1e-6)


def test_a_mistaken_feature_hardly_pulls_robust_joints():
    model, truth, pixels, starts = solver_case()
    pixels[:, 0, 1] += 30.0
    plain, _, _ = solver_for(model).solve(pixels, starts)
    robust, _, _ = solver_for(model).solve(pixels, starts, robust_scale=1.0)
    off = [np.abs(found[:, 0] - truth).max() for found in (plain, robust)]
    assert off[1] < 0.05 * off[0]


def test_a_free_body_is_three_joints_that_slide_and_three_that_turn():
    from scipy.optimize import least_squares

    model, rng = random_model(1), np.random.default_rng(3)
    bases = Rotation.from_rotvec(rng.normal(0, 0.3, (4, 3))).as_matrix()
    shifts = rng.normal(0, 0.05, (4, 3))
    solver = JointSolver(4, 1, np.full(len(LINKS), 6), 6, CAMERAS, sliding=np.arange(6) < 3)
    known = {k: model[k] for k in ("features", "camera_rotation", "camera_translation", "intrinsics")}
    solver.set_model(axes=np.tile(np.eye(3), (2, 1)), points=np.zeros((6, 3)), **known)
    solver.set_model(base_rotation=bases[:, None], base_translation=shifts[:, None])

    still = model | {"links": np.zeros(len(LINKS), int)}

    def pixels_at(image, q):
        pose = np.eye(4)
        pose[:3, :3] = bases[image] @ Rotation.from_euler("XYZ", q[3:]).as_matrix()
        pose[:3, 3] = shifts[image] + bases[image] @ q[:3]
        return chain_pixels(still, np.zeros(JOINTS), pose)

    truth = rng.normal(0, 0.1, (4, 6))
    pixels = np.array([pixels_at(k, q) for k, q in enumerate(truth)]) + rng.normal(0, 0.5, (4, CAMERAS, len(LINKS), 2))
    found, costs, _ = solver.solve(pixels, np.zeros((4, 1, 6)), tolerance=1e-12)
    for image in range(4):
        expected = least_squares(lambda q, image=image: (pixels_at(image, q) - pixels[image]).ravel(), truth[image])
        np.testing.assert_allclose(found[image, 0], expected.x, atol=1e-5)
        assert costs[image, 0] == pytest.approx(2 * expected.cost, rel=1e-6)


@pytest.mark.gpu
def test_the_same_on_a_gpu():
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    for local in ("none", "joints", "pose"):
        on_cpu, on_gpu = loaded(local)[0], loaded(local, "cuda:0")[0]
        for projection in (on_cpu, on_gpu):
            projection.evaluate()
        np.testing.assert_allclose(on_gpu.residuals, on_cpu.residuals, atol=1e-9)
        np.testing.assert_allclose(on_gpu.jacobian, on_cpu.jacobian, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(on_gpu.local_jacobian, on_cpu.local_jacobian, rtol=1e-9, atol=1e-7)
    model, _, pixels, starts = solver_case()
    found = [solver_for(model, device).solve(pixels, starts)[0] for device in ("cpu", "cuda:0")]
    np.testing.assert_allclose(found[1], found[0], atol=1e-7)
