import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.classical_ibvs import ibvs_step, image_jacobian, interaction_matrix
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm
from dense_vs.sims.papers.gothoskar.servo_runs import Tasks, moves_needed, servo_ibvs

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
