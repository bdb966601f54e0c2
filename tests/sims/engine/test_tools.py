"""Tools in the hands of the upper body: loops that stay closed, and a Jacobian that knows it."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import fsolve

from dense_vs.sims import SimWorld

# Chosen joints, passive joints, sites that the loop keeps together, point that the experiments control.
TOOLS = {
    "rake": (
        ("left-shoulder-p", "left-elbow-p", "right-elbow-p"),
        ("right-wrist-p", "right-wrist-r", "rake-slide"),
        ("left-palm", "rake-grip"),
        "rake-tip",
    ),
    "vacuum": (
        ("left-shoulder-p", "left-elbow-p", "left-wrist-p"),
        ("vacuum-pitch", "vacuum-yaw", "vacuum-roll"),
        ("vacuum-end", "vacuum-neck"),
        "vacuum-head",
    ),
}


@pytest.fixture(scope="module", params=TOOLS)
def held(request):
    world = SimWorld(
        f"upper-body-{request.param}", joints=TOOLS[request.param][0], seed=3, device="cpu", height=60, width=80
    )
    for _ in range(5):
        world.step([0.02, -0.015, 0.01])
    for _ in range(10):
        world.step()
    return world, *TOOLS[request.param][1:]


def gap(model, state, sites):
    return state.site_xpos[model.site(sites[0]).id] - state.site_xpos[model.site(sites[1]).id]


def test_the_loop_stays_closed(held):
    world, passive, sites, _ = held
    model, state = world.scene.model, world.physics.host_state(0)
    assert {model.joint(int(j)).name for j in world.scene.chain.passive} == set(passive)
    assert np.abs(gap(model, state, sites)).max() < 1e-3
    world.reset()
    assert np.abs(gap(model, world.physics.host_state(0), sites)).max() < 1e-8


def test_jacobian_is_the_derivative_of_the_closed_loop(held):
    """Against finite differences; the loop is closed by a root finder that knows the two sites only."""
    world, passive, sites, point = held
    model = world.scene.model
    frame, jacobian = world.frame(), world.true_jacobian()
    places = [model.joint(name).qposadr[0] for name in passive]
    pose, K = world.T_world_camera, world.intrinsics

    def posture(joint, change):
        state = mujoco.MjData(model)
        state.qpos[:] = world.physics.host_state(0).qpos
        state.qpos[model.joint(joint).qposadr[0]] += change

        def opening(values):
            state.qpos[places] = values
            mujoco.mj_kinematics(model, state)
            return gap(model, state, sites)

        _, info, found, _ = fsolve(opening, state.qpos[places], xtol=1e-12, full_output=True)
        assert found == 1 or np.abs(info["fvec"]).max() < 1e-10
        opening(state.qpos[places])
        return state

    start = posture(world.joint_names[0], 0.0)
    pixels = np.argwhere(world.robot_mask())[::7, ::-1]
    tool = frame.ids[pixels[:, 1], pixels[:, 0]]
    tool = np.array([point.split("-")[0] in model.geom(g).name for g in tool])
    assert tool.sum() > 10
    surface = []
    for x, y in pixels:
        geom = frame.ids[y, x]
        seen = pose[:3, 3] + pose[:3, :3] @ (frame.depth[y, x] * np.linalg.solve(K, [x, y, 1.0]))
        surface.append((geom, start.geom_xmat[geom].reshape(3, 3).T @ (seen - start.geom_xpos[geom])))
    step = 1e-5
    for n, joint in enumerate(world.joint_names):
        images = []
        for change in (-step, step):
            state = posture(joint, change)
            seen = np.array([state.geom_xpos[g] + state.geom_xmat[g].reshape(3, 3) @ local for g, local in surface])
            rays = (seen - pose[:3, 3]) @ pose[:3, :3] @ K.T
            images.append(rays[:, :2] / rays[:, 2:])
        slope = (images[1] - images[0]) / (2 * step)
        assert np.abs(slope[tool]).max() > 1  # px/rad in a small image: every joint moves the tool
        np.testing.assert_allclose(
            jacobian[pixels[:, 1], pixels[:, 0], :, n], slope, atol=2e-3 * np.abs(jacobian).max()
        )


def test_physics_moves_the_image_as_the_jacobian_says(held):
    world, _, _, point = held
    world.reset()
    for _ in range(20):
        world.step()
    tool = world.track_point(world.project(point))
    start, before, slopes = world.joints()[0], world.project(tool), []
    for step in ([4e-3, 3e-3, 4e-3], [0.0] * 3):  # there, and come to rest
        for _ in range(10):
            world.step(step)
            x, y = np.rint(world.project(tool)).astype(int)
            slopes.append(world.true_jacobian()[y, x])
    moved = world.project(tool) - before
    assert np.linalg.norm(moved) > 1
    np.testing.assert_allclose(np.mean(slopes, axis=0) @ (world.joints()[0] - start), moved, atol=0.1)


def test_the_tool_counts_as_the_robot(held):
    world, _, _, point = held
    world.reset()
    x, y = np.rint(world.project(point)).astype(int)
    assert world.scene.model.geom(world.frame().ids[y, x]).name == point.replace("tip", "head")
    assert world.robot_mask()[y, x]
