"""Exact Jacobian, flow, mask and depth against MuJoCo's C engine in float64 and against finite differences."""

import mujoco
import numpy as np
import pytest

from dense_vs.sims import SimWorld

# Depth comes from a float32 ray tracer: about 1e-5 of a meter, which moves a point along its ray only.
DEPTH_TOLERANCE = 1e-4  # m
FLOW_TOLERANCE = 1e-4  # px
JACOBIAN_TOLERANCE = 2e-4  # of the largest entry


def some_pixels(world, count=400):
    """Pixels (K, 2) with a surface, at least a third of them on what the joints move."""
    rng = np.random.default_rng(0)
    ids = world.frame().ids
    seen = np.argwhere(ids >= 0)[:, ::-1]
    robot = np.argwhere(world.robot_mask())[:, ::-1]
    return np.concatenate([rng.choice(seen, count), rng.choice(robot, count // 2)])


def camera(world, state):
    """Position and rotation (OpenCV axes) from MuJoCo's state."""
    index = world.scene.camera
    return state.cam_xpos[index], state.cam_xmat[index].reshape(3, 3) * [1, -1, -1]


def back_project(world, state, pixel, depth):
    origin, rotation = camera(world, state)
    return origin + rotation @ (depth * np.linalg.solve(world.intrinsics, [*pixel, 1.0]))


def project(world, state, point):
    origin, rotation = camera(world, state)
    p = world.intrinsics @ rotation.T @ (point - origin)
    return p[:2] / p[2]


def copied_state(world):
    """A state of our own with the world's positions."""
    model, source = world.scene.model, world.physics.host_state(0)
    state = mujoco.MjData(model)
    state.qpos[:], state.mocap_pos[:], state.mocap_quat[:] = source.qpos, source.mocap_pos, source.mocap_quat
    mujoco.mj_forward(model, state)
    return state


def surface_in_geom(world, state, frame, pixel):
    x, y = pixel
    geom = frame.ids[y, x]
    point = back_project(world, state, pixel, frame.depth[y, x])
    return geom, state.geom_xmat[geom].reshape(3, 3).T @ (point - state.geom_xpos[geom])


def placed(state, geom, local):
    return state.geom_xpos[geom] + state.geom_xmat[geom].reshape(3, 3) @ local


def test_jacobian_is_that_of_mj_jac(world):
    model, state, frame = world.scene.model, copied_state(world), world.frame()
    jacobian, spatial = world.true_jacobian(), world.true_jacobian(depth=True)
    assert jacobian.shape == (*frame.ids.shape, 2, len(world.joint_names))
    assert jacobian.dtype == np.float32
    np.testing.assert_array_equal(spatial[..., :2, :], jacobian)
    columns = model.jnt_dofadr[world.scene.joint_ids]
    _, rotation = camera(world, state)
    K = world.intrinsics
    of_point, of_camera = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for x, y in some_pixels(world):
        point = back_project(world, state, (x, y), frame.depth[y, x])
        mujoco.mj_jac(model, state, of_point, None, point, model.geom_bodyid[frame.ids[y, x]])
        mujoco.mj_jac(model, state, of_camera, None, point, model.cam_bodyid[world.scene.camera])
        velocity = rotation.T @ (of_point - of_camera)[:, columns]
        a, b = (x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1]
        interaction = np.diag([K[0, 0], K[1, 1]]) @ [[1, 0, -a], [0, 1, -b]] / frame.depth[y, x]
        np.testing.assert_allclose(
            jacobian[y, x], interaction @ velocity, atol=JACOBIAN_TOLERANCE * np.abs(jacobian).max()
        )
        np.testing.assert_allclose(spatial[y, x, 2], velocity[2], atol=DEPTH_TOLERANCE)  # m/rad


def test_jacobian_is_the_derivative_of_the_image(world):
    model, state, frame = world.scene.model, copied_state(world), world.frame()
    jacobian, step = world.true_jacobian(), 1e-5
    pixels = some_pixels(world, 100)
    surface = [surface_in_geom(world, state, frame, pixel) for pixel in pixels]
    for n, joint in enumerate(world.scene.joint_ids):
        images = []
        for sign in (-1.0, 1.0):
            shifted = copied_state(world)
            shifted.qpos[model.jnt_qposadr[joint]] += sign * step
            mujoco.mj_forward(model, shifted)
            images.append([project(world, shifted, placed(shifted, *s)) for s in surface])
        slope = np.diff(images, axis=0)[0] / (2 * step)
        tolerance = JACOBIAN_TOLERANCE * np.abs(jacobian).max()
        np.testing.assert_allclose(jacobian[pixels[:, 1], pixels[:, 0], :, n], slope, atol=tolerance)


@pytest.mark.parametrize("robot", ["arm", "planar", "eye_in_hand"])
def test_flow_is_the_displacement_of_surface_points(robot, eye_in_hand_file):
    if robot == "eye_in_hand":
        world = SimWorld(eye_in_hand_file, camera="hand", device="cpu", height=60, width=80)
    else:
        world = SimWorld(robot, seed=4, distractor="front", device="cpu", height=60, width=80)
    np.testing.assert_array_equal(world.true_flow(), 0.0)
    world.step(np.full(len(world.joint_names), 0.02))
    before = copied_state(world)
    world.step(np.full(len(world.joint_names), -0.03))
    after, frame, flow = copied_state(world), world.frame(), world.true_flow()
    assert flow.shape == (60, 80, 2)
    assert flow.dtype == np.float32
    assert np.abs(flow).max() > 0.5
    for x, y in some_pixels(world):
        old = project(world, before, placed(before, *surface_in_geom(world, after, frame, (x, y))))
        np.testing.assert_allclose(np.array([x, y]) - flow[y, x], old, atol=FLOW_TOLERANCE)


def test_what_does_not_move_has_no_flow(arm):
    frame, flow = arm.frame(), arm.true_flow()
    distractor = arm.scene.model.geom("distractor").id
    still = ~arm.robot_mask() & (frame.ids != distractor)
    np.testing.assert_array_equal(flow[still], 0.0)
    np.testing.assert_array_equal(arm.true_jacobian()[~arm.robot_mask()], 0.0)
    assert np.linalg.norm(flow[frame.ids == distractor], axis=-1).min() > 0.0


def test_small_motion_follows_the_jacobian():
    world = SimWorld("planar", device="cpu", height=60, width=80)
    for _ in range(30):
        world.step()
    start, _ = world.joints()
    world.step([1e-4, -1e-4, 2e-4])
    moved, _ = world.joints()
    predicted = world.true_jacobian() @ (moved - start)
    np.testing.assert_allclose(world.true_flow(), predicted, atol=1e-4)


def test_mask_is_the_bodies_that_the_chosen_joints_move(eye_in_hand_file):
    world = SimWorld(eye_in_hand_file, camera="fixed", joints=["finger"], device="cpu", height=60, width=80)
    finger = world.frame().ids == world.scene.model.geom("finger").id
    assert finger.sum() > 5
    np.testing.assert_array_equal(world.robot_mask(), finger)
    assert world.robot_mask().dtype == bool


def test_depth_and_ids_are_those_of_the_c_engines_rays(world):
    model, state, frame = world.scene.model, copied_state(world), world.frame()
    origin, rotation = camera(world, state)
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    geom, compared = np.array([-1], dtype=np.int32), 0
    height, width = frame.ids.shape
    for y in range(1, height - 1, 3):
        for x in range(1, width - 1, 3):
            around = frame.ids[y - 1 : y + 2, x - 1 : x + 2]
            if np.any(around != around[1, 1]):
                continue  # an outline: the nearest float may fall on either side
            ray = rotation @ np.linalg.solve(world.intrinsics, [x, y, 1.0])
            depth = mujoco.mj_ray(model, state, origin, ray, groups, True, -1, geom)
            assert geom[0] == frame.ids[y, x]
            if depth >= 0.0:
                assert depth == pytest.approx(frame.depth[y, x], abs=DEPTH_TOLERANCE)
                compared += 1
    assert compared > 200


def test_pixels_without_a_surface(tmp_path):
    path = tmp_path / "sky.xml"
    path.write_text(
        """<mujoco><worldbody><camera pos="0 0 2"/><body><joint name="j" axis="0 0 1"/>
        <geom size="0.3"/></body></worldbody><actuator><position joint="j"/></actuator></mujoco>"""
    )
    world = SimWorld(path, device="cpu", height=24, width=32)
    world.step([0.1])
    frame = world.frame()
    empty = frame.ids < 0
    assert empty.any()
    assert not empty.all()
    for image in (frame.depth, world.true_flow(), world.true_jacobian(), world.robot_mask()):
        assert np.all(image[empty] == 0)
    assert np.all(frame.depth[~empty] > 0)
