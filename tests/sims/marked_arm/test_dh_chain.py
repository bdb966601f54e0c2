from importlib import resources

import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.dh_chain import ARMS, UR5, find_arm


@pytest.mark.parametrize("name", list(ARMS))
def test_chain_and_mjcf_model_are_the_same_arm(name):
    chain = ARMS[name]
    file = resources.files("dense_vs.sims").joinpath("models", f"{name}.xml")
    model = mujoco.MjModel.from_xml_string(file.read_text())
    data = mujoco.MjData(model)
    for joints in np.random.default_rng(0).uniform(-3, 3, (5, chain.joints)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        pose = chain.flange_pose(joints)
        np.testing.assert_allclose(data.site("flange").xpos, pose[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.site("flange").xmat.reshape(3, 3), pose[:3, :3], atol=1e-9)


@pytest.mark.parametrize("name", list(ARMS))
def test_jacobian_is_the_derivative_of_the_pose(name):
    chain = ARMS[name]
    joints = chain.home + np.random.default_rng(1).normal(0, 0.3, chain.joints)
    pose, step = chain.flange_pose(joints), 1e-6
    for i, column in enumerate(chain.flange_jacobian(joints).T):
        ahead, behind = (chain.flange_pose(joints + sign * step * np.eye(chain.joints)[i]) for sign in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(column[:3], slope[:3, 3], atol=1e-8)
        spin = slope[:3, :3] @ pose[:3, :3].T
        np.testing.assert_allclose(column[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_the_tool_points_down_at_home():
    for chain in ARMS.values():
        np.testing.assert_allclose(chain.flange_pose(chain.home)[:3, 2], [0, 0, -1], atol=2e-3)


def test_wrong_names_and_counts_are_answered():
    with pytest.raises(DenseVSError, match="'ur5', 'baxter'"):
        find_arm("ur10")
    with pytest.raises(DenseVSError, match=r"\(5,\); expected \(..., 6\)"):
        UR5.flange_pose(np.zeros(5))
