"""Lenses against OpenCV's, and what a world with one says of its images."""

import cv2
import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.lens import Lens
from dense_vs.sims.engine.realism import Realism
from dense_vs.sims.engine.swaying_camera import SwayingCamera

INTRINSICS = np.array([[250.0, 0.0, 158.0], [0.0, 260.0, 122.0], [0.0, 0.0, 1.0]])
SIZE = (240, 320)
LENSES = [(0.0, 0.0), (-0.2, 0.05), (0.15, -0.01)]


@pytest.mark.parametrize("distortion", LENSES)
def test_pixels_are_opencvs_and_back(distortion):
    lens = Lens(INTRINSICS, SIZE, distortion)
    pixels = np.random.default_rng(0).uniform((-0.5, -0.5), (319.5, 239.5), (200, 2))
    n = lens.directions(pixels)
    np.testing.assert_allclose(lens.pixels(n), pixels, atol=1e-7)
    points = np.concatenate([n, np.ones((200, 1))], axis=1)
    shown, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), INTRINSICS, np.array([*distortion, 0.0, 0.0]))
    np.testing.assert_allclose(shown[:, 0], pixels, atol=1e-7)


def test_rays_of_squares_average_to_the_pixels_middle():
    lens = Lens(INTRINSICS, SIZE)
    fine = lens.grid(3).reshape(240, 3, 320, 3, 2)
    np.testing.assert_allclose(fine.mean(axis=(1, 3)), lens.grid(), atol=1e-12)
    rays = lens.rays()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(rays[:, :2] / -rays[:, 2:] * [1, -1], lens.grid().reshape(-1, 2))


def test_a_lens_that_folds_the_image_is_refused():
    with pytest.raises(DenseVSError, match=r"distortion is \(-0.9, 0.0\)"):
        Lens(INTRINSICS, SIZE, (-0.9, 0.0))


def test_far_to_the_side_nothing_is_shown():
    lens = Lens(INTRINSICS, SIZE, (-0.2, 0.05))
    assert np.isnan(lens.pixels(np.array([30.0, 0.0]))).all()


def make(frames, **realism):
    world = SimWorld("planar", seed=3, device="cpu", height=60, width=80, realism=Realism(**realism))
    for k in range(frames):
        world.step([0.03, -0.02, 0.04 - 0.01 * k])
    return world


WITH = {"distortion": (-0.3, 0.1), "sway": 0.01}


def test_depth_and_ids_are_those_of_the_swayed_and_distorted_rays():
    world = make(4, **WITH)
    model, frame, pose = world.scene.model, world.frame(), world.T_world_camera
    state = mujoco.MjData(model)
    state.qpos[:], state.mocap_pos[:] = (
        world.physics.host_state(0).qpos,
        world.physics.host_state(0).mocap_pos,
    )
    mujoco.mj_forward(model, state)
    groups, geom = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8), np.array([-1], dtype=np.int32)
    distortion = np.array([*WITH["distortion"], 0.0, 0.0])
    compared = 0
    for y in range(1, 59, 3):
        for x in range(1, 79, 3):
            if np.any(frame.ids[y - 1 : y + 2, x - 1 : x + 2] != frame.ids[y, x]):
                continue
            criteria = (cv2.TERM_CRITERIA_COUNT, 300, 0.0)
            n = cv2.undistortPoints(
                np.array([[[x, y]]], dtype=float), world.intrinsics, distortion, criteria=criteria
            ).ravel()
            ray = pose[:3, :3] @ [*n, 1.0]
            depth = mujoco.mj_ray(model, state, pose[:3, 3], ray, groups, True, -1, geom)
            assert geom[0] == frame.ids[y, x]
            assert depth == pytest.approx(frame.depth[y, x], abs=1e-4)
            compared += 1
    assert compared > 200


def test_what_a_pixel_shows_is_seen_there_and_flow_says_where_it_was():
    now, before = make(4, **WITH), make(3, **WITH)
    flow, mask = now.true_flow(), now.robot_mask()
    still = np.argwhere(~mask)[::97]
    for y, x in [*np.argwhere(mask)[::23], *still]:
        point = now.track_point((x, y))
        np.testing.assert_allclose(now.project(point), (x, y), atol=1e-6)
        np.testing.assert_allclose(np.array([x, y]) - flow[y, x], before.project(point), atol=2e-4)
    assert np.abs(flow[~mask]).max() > 0.01  # the camera sways


def test_jacobian_is_the_slope_of_the_distorted_image():
    world = make(4, **WITH)
    jacobian, mask = world.true_jacobian(), world.robot_mask()
    q, step = world.physics.host_state(0).qpos.copy(), 1e-5
    columns = world.scene.model.jnt_qposadr[world.scene.joint_ids]
    pixels = np.argwhere(mask)[::41]
    points = [world.track_point((x, y)) for y, x in pixels]
    state = world.physics.host_state(0)
    for n, column in enumerate(columns):
        seen = []
        for sign in (-1, 1):
            state.qpos[:] = q
            state.qpos[column] += sign * step
            mujoco.mj_kinematics(world.scene.model, state)
            seen.append([world.project(point) for point in points])
        slope = np.diff(seen, axis=0)[0] / (2 * step)
        found = jacobian[pixels[:, 0], pixels[:, 1], :, n]
        np.testing.assert_allclose(found, slope, atol=2e-4 * np.abs(jacobian).max())


def test_sway_is_as_large_as_asked():
    sway = SwayingCamera(0.01, [np.random.default_rng(k) for k in range(2)], 0, "cpu")
    times = np.arange(0, 300, 0.1)
    turns = np.array([[sway.rotation(w, t)[[2, 0, 1], [1, 2, 0]] for t in times] for w in range(2)])
    np.testing.assert_allclose(turns.std(axis=1), 0.01, rtol=0.05)
    assert np.abs(turns[0] - turns[1]).max() > 0.01
