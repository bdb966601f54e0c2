from importlib import resources

import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.dh_chain import ARMS, BAXTER, UR5, DHChain, find_arm


@pytest.mark.parametrize("name", list(ARMS))
def test_chain_and_mjcf_model_are_the_same_arm(name):
    chain = ARMS[name]
    file = resources.files("dense_vs.sims").joinpath("models", f"{name}.xml")
    model = mujoco.MjModel.from_xml_string(file.read_text())
    data = mujoco.MjData(model)
    for joints in np.random.default_rng(0).uniform(-3, 3, (5, chain.joint_count)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        pose = chain.flange_pose(joints)
        np.testing.assert_allclose(data.site("flange").xpos, pose[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.site("flange").xmat.reshape(3, 3), pose[:3, :3], atol=1e-9)


@pytest.mark.parametrize("name", list(ARMS))
def test_jacobian_is_the_derivative_of_the_pose(name):
    chain = ARMS[name]
    joints = chain.home + np.random.default_rng(1).normal(0, 0.3, chain.joint_count)
    pose, step = chain.flange_pose(joints), 1e-6
    for i, column in enumerate(chain.flange_jacobian(joints).T):
        ahead, behind = (chain.flange_pose(joints + sign * step * np.eye(chain.joint_count)[i]) for sign in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(column[:3], slope[:3, 3], atol=1e-8)
        spin = slope[:3, :3] @ pose[:3, :3].T
        np.testing.assert_allclose(column[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_the_tool_points_down_at_home():
    for chain in ARMS.values():
        np.testing.assert_allclose(chain.flange_pose(chain.home)[:3, 2], [0, 0, -1], atol=2e-3)


def test_wrong_names_and_counts_are_answered():
    with pytest.raises(DenseVSError, match="expected one of ur5, baxter"):
        find_arm("ur10")
    with pytest.raises(DenseVSError, match=r"\(5,\); expected \(..., 6\)"):
        UR5.flange_pose(np.zeros(5))


def test_ur5_at_home_is_where_its_links_lead():
    """Its two long links and d5 lie in a plane that the first joint turns; d4 stands off it, d6 points down."""
    along = -0.425 * np.cos(1.554) - 0.39225 * np.cos(0.133) - 0.09465 * np.sin(1.57)
    height = 0.089159 + 0.425 * np.sin(1.554) - 0.39225 * np.sin(0.133) - 0.09465 * np.cos(1.57) - 0.0823 * np.sin(1.57)
    c, s = np.cos(3.022), np.sin(3.022)
    pose = UR5.flange_pose(UR5.home)
    np.testing.assert_allclose(pose[:3, 3], [along * c + 0.10915 * s, along * s - 0.10915 * c, height], atol=2e-4)
    # The last joint turns the hand back by as much as the first has turned it.
    np.testing.assert_allclose(pose[:3, :3], np.diag([-1.0, 1.0, -1.0]), atol=2e-3)


def test_baxter_at_home_is_where_its_links_lead():
    """Upper arm up, forearm ahead, hand down, all in the plane that the first joint turns by 0.1 rad."""
    up, ahead, down = 1.595, 1.595 - 1.64, 1.595 - 1.64 - 1.526  # elevations; offsets are a right angle below
    links = ((0.36435, up), (0.069, up - np.pi / 2), (0.37429, ahead), (0.010, ahead - np.pi / 2), (0.229525, down))
    along = 0.069 + sum(length * np.cos(elevation) for length, elevation in links)
    height = 0.27035 + sum(length * np.sin(elevation) for length, elevation in links)
    pose = BAXTER.flange_pose(BAXTER.home)
    np.testing.assert_allclose(pose[:3, 3], [along * np.cos(0.1), along * np.sin(0.1), height], atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3], np.diag([-1.0, 1.0, -1.0]), atol=2e-3)


def test_a_joint_turns_and_moves_along_z_then_along_x():
    right = np.array([np.pi / 2])
    arm = DHChain("one", omega=right / 3, d=np.array([0.5]), a=np.array([0.2]), alpha=right, home=np.zeros(1))
    expected = [[0, 0, 1, 0], [1, 0, 0, 0.2], [0, 1, 0, 0.5], [0, 0, 0, 1]]  # after 30 and 60 degrees
    np.testing.assert_allclose(arm.flange_pose(2 * right / 3), expected, atol=1e-12)
    np.testing.assert_allclose(arm.flange_jacobian(2 * right / 3)[:, 0], [-0.2, 0, 0, 0, 0, 1], atol=1e-12)
