import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.classical_ibvs import (
    INTERACTIONS,
    Gain,
    ibvs_problem,
    ibvs_step,
    ibvs_steps,
    image_jacobian,
    interaction_matrix,
)
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm
from dense_vs.sims.papers.gothoskar.servo_runs import Tasks, moves_needed, servo_ibvs, servo_steps

INTRINSICS = np.array([620.0, 613.0, 318.0, 242.0])


@pytest.mark.parametrize("name", ["ur5", "baxter"])
def test_image_jacobian_is_the_derivative_of_the_pixels(name):
    arm = make_observed_arm(name, seed=1)
    joints = arm.chain.home + np.random.default_rng(0).normal(0, 0.2, arm.chain.joint_count)
    jacobian, step = image_jacobian(arm, joints), 1e-6
    for i, direction in enumerate(np.eye(arm.chain.joint_count)):
        ends = [arm.projections(arm.chain.flange_pose(joints + sign * step * direction)[None])[0] for sign in (1, -1)]
        np.testing.assert_allclose(jacobian[..., i], (ends[0] - ends[1]) / (2 * step), atol=1e-5)


def test_interaction_matrix_is_machinevision_toolboxs():
    toolbox = pytest.importorskip("machinevisiontoolbox")
    rng = np.random.default_rng(0)
    pixels, depths = rng.uniform([0, 0], [640, 480], (6, 2)), rng.uniform(0.5, 2, 6)
    camera = toolbox.CentralCamera(f=INTRINSICS[:2] * 1e-6, rho=1e-6, pp=INTRINSICS[2:], imagesize=(640, 480))
    np.testing.assert_allclose(interaction_matrix(pixels, depths, INTRINSICS), camera.visjac_p(pixels.T, depths))


def test_interaction_matrix_moves_points_as_a_moving_camera_sees_them():
    rng = np.random.default_rng(1)
    points = rng.uniform([-0.3, -0.3, 0.8], [0.3, 0.3, 1.5], (5, 3))

    def project(p):
        return p[:, :2] / p[:, 2:] * INTRINSICS[:2] + INTRINSICS[2:]

    twist = rng.normal(size=6)
    velocity = -twist[:3] - np.cross(twist[3:], points)
    expected = (project(points + 1e-7 * velocity) - project(points - 1e-7 * velocity)) / 2e-7
    matrix = interaction_matrix(project(points), points[:, 2], INTRINSICS)
    np.testing.assert_allclose((matrix @ twist).reshape(-1, 2), expected, rtol=1e-5, atol=1e-4)


def test_it_converges_at_a_moderate_gain():
    arm = make_observed_arm("ur5", seed=1)
    rng = np.random.default_rng(2)
    start = arm.chain.home + rng.normal(0, 0.1, (5, 6))
    target = arm.pixels(arm.chain.home + rng.normal(0, 0.1, (5, 6)))
    exact = NoisyController(0.0, "independent", rng)
    errors = servo_ibvs(arm, Tasks(start, target, target), 15, 0.5, rng, exact, lambda joints: joints)
    assert np.all(errors[:, 0] > 5)
    assert np.all(errors[:, -1] < 1)
    assert np.all(moves_needed(errors) > 2)


def test_nothing_in_common_is_refused():
    arm = make_observed_arm("ur5", seed=1)
    hidden = np.full((2, 12, 2), np.nan)
    with pytest.raises(DenseVSError, match="no feature is seen both"):
        ibvs_step(arm, arm.chain.home, hidden, hidden, 0.5)


def _problem(name, hands=6, seed=4):
    arm, rng = make_observed_arm(name, seed=2), np.random.default_rng(seed)
    joints, goal = arm.chain.home + rng.normal(0, 0.15, (2, hands, arm.chain.joint_count))
    pixels, target = arm.pixels(joints), arm.pixels(goal)
    pixels[0, 0, :5] = np.nan
    target[1, 1] = np.nan
    pixels[2] = np.nan
    return arm, joints, goal, pixels, target, ibvs_problem(arm, joints + 0.02, joints, pixels, goal, target)


def _reference_step(arm, believed, joints, pixels, goal, target, interaction):
    """vpServo's law for one hand before cameras, feature by feature as its manual writes it; no gain."""
    flange = arm.chain.flange_pose(believed)
    turned = np.kron(np.eye(2), flange[:3, :3].T) @ arm.chain.flange_jacobian(believed)  # eJe
    rows, error = [], []
    for camera, seen, wanted in zip(arm.cameras, pixels, target, strict=True):
        T = camera.T_camera_world @ flange  # cMe
        x, y, z = T[:3, 3]
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        V = np.block([[T[:3, :3], skew @ T[:3, :3]], [np.zeros((3, 3)), T[:3, :3]]])
        depths = []
        for q in (joints, goal):
            pose = camera.T_camera_world @ arm.chain.flange_pose(q)
            depths.append([(pose @ np.append(feature, 1.0))[2] for feature in arm.features])
        for k in range(len(arm.features)):
            if np.isnan(seen[k, 0]) or np.isnan(wanted[k, 0]):
                continue
            points = [(p[k] - camera.intrinsics[2:]) / camera.intrinsics[:2] for p in (seen, wanted)]
            matrices = [
                np.array([[-1 / Z, 0, u / Z, u * v, -1 - u * u, v], [0, -1 / Z, v / Z, 1 + v * v, -u * v, -u]])
                for (u, v), Z in zip(points, (depths[0][k], depths[1][k]), strict=True)
            ]
            L = {"current": matrices[0], "desired": matrices[1], "mean": sum(matrices) / 2}[interaction]
            rows.append(L @ V @ turned)
            error.append(points[0] - points[1])
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(error), rcond=1e-6)[0]


@pytest.mark.parametrize("interaction", INTERACTIONS)
@pytest.mark.parametrize("name", ["ur5", "baxter"])
def test_steps_are_those_of_the_law_written_out(name, interaction):
    arm, joints, goal, pixels, target, problem = _problem(name)
    steps = ibvs_steps(problem, Gain(0.3, 0.3), interaction)
    assert not steps[2].any()  # nothing seen
    for hand in (0, 1, 3, 4, 5):
        whole = _reference_step(
            arm, joints[hand] + 0.02, joints[hand], pixels[hand], goal[hand], target[hand], interaction
        )
        np.testing.assert_allclose(steps[hand], 0.3 * whole, rtol=1e-8, atol=1e-10)
        adaptive = ibvs_steps(problem, Gain(0.9, 0.2, 1.5), interaction)[hand]
        by = 0.7 * np.exp(-np.abs(whole).max() * 1.5 / 0.7) + 0.2
        np.testing.assert_allclose(adaptive, by * whole, rtol=1e-8, atol=1e-10)


def test_a_gain_goes_from_far_to_near_by_its_slope():
    gain = Gain(1.0, 0.2, 4.0)
    assert gain.of(np.zeros(2)).tolist() == [1.0, 1.0]
    assert gain.of(np.array(50.0)) == pytest.approx(0.2)
    assert (gain.of(np.array(1e-6)) - 1.0) / 1e-6 == pytest.approx(-4.0, rel=1e-4)
    assert gain.of(np.array([0.1]))[0] == pytest.approx(0.8 * np.exp(-0.5) + 0.2)
    assert Gain(0.5, 0.5, 9.0).of(np.array([0.0, 3.0])).tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ((0.0, 0.0), "at_zero is 0"),
        ((0.5, 0.0), "at_infinity is 0"),
        ((0.5, 0.6), "at_infinity is 0.6; expected at most at_zero, 0.5"),
        ((0.5, 0.2, -1.0), "slope is -1"),
        ((np.inf, 0.2), "at_zero is inf"),
    ],
)
def test_gains_that_make_no_sense_are_refused(numbers, message):
    with pytest.raises(DenseVSError, match=message):
        Gain(*numbers)


def test_an_unknown_interaction_matrix_is_refused():
    with pytest.raises(DenseVSError, match="expected one of current, desired, mean"):
        ibvs_steps(_problem("ur5")[-1], Gain(0.5, 0.5), "median")


def test_a_law_of_steps_converges_from_what_is_seen():
    arm, rng = make_observed_arm("ur5", seed=1), np.random.default_rng(2)
    start, goal = arm.chain.home + rng.normal(0, 0.1, (2, 5, 6))
    target = arm.pixels(goal)
    exact = NoisyController(0.0, "independent", rng)
    tasks = Tasks(start, target, target, goal)
    errors = servo_steps(arm, tasks, 12, lambda given: ibvs_steps(given, Gain(0.6, 0.6)), rng, exact, lambda q: q)
    assert errors.shape == (5, 13)
    assert np.all(errors[:, 0] > 5)
    assert np.all(errors[:, -1] < 1)
    assert np.all(moves_needed(errors) > 2)
    np.testing.assert_array_equal(tasks.start, start)
    away = servo_steps(arm, tasks, 2, lambda given: -ibvs_steps(given, Gain(0.2, 0.2)), rng, exact, lambda q: q)
    assert np.all(away[:, -1] > away[:, 0])


def test_a_law_of_steps_moves_the_arm_as_its_controller_does():
    arm, rng = make_observed_arm("ur5", seed=1), np.random.default_rng(3)
    start, goal = arm.chain.home + rng.normal(0, 0.1, (2, 2, 6))
    target = arm.pixels(goal)

    class Half:
        def joint_step(self, step):
            return step / 2

    def whole_way(given):
        return np.where([[True], [False]], goal - start, 0.0)

    errors = servo_steps(arm, Tasks(start, target, target, goal), 2, whole_way, rng, Half(), lambda q: q)
    np.testing.assert_allclose(errors[0, 2], 0.0, atol=1e-6)
    middle = arm.projections(arm.chain.flange_pose((start + goal)[:1] / 2))
    assert errors[0, 1] == pytest.approx(np.nanmean(np.linalg.norm(middle - target[:1], axis=-1)))
    assert errors[1, 0] == errors[1, 1] == errors[1, 2] > 1


def test_a_law_of_steps_needs_the_targets_depths():
    arm, rng = make_observed_arm("ur5", seed=1), np.random.default_rng(2)
    tasks = Tasks(arm.chain.home[None], *[arm.pixels(arm.chain.home[None])] * 2)
    with pytest.raises(DenseVSError, match="tasks have no goal"):
        servo_steps(arm, tasks, 1, lambda given: None, rng, NoisyController(0.0, "independent", rng), lambda q: q)
