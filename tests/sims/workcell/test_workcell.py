import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.renderer import camera_intrinsics
from dense_vs.sims.engine.surface_points import camera_pose
from dense_vs.sims.workcell.aruco_markers import find_corners
from dense_vs.sims.workcell.cell import HAND_MARKERS, PART_MARKERS, Workcell


def true_corners(cell, camera, marker, prefix):
    """Where a marker's corners are, from the simulator's poses."""
    model, data = cell.model, cell._data
    name = f"{prefix}/marker_{marker}"
    geom = model.geom(name).id
    x, z = model.geom(name).size[0] * 6 / 8, model.geom(name).size[2]  # 4 bits and a border, on a plate of 8 cells
    corners = np.array([[-x, x, z], [x, x, z], [x, -x, z], [-x, -x, z]])
    points = data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T
    intrinsics, pose = camera_intrinsics(model, camera, 480, 640), camera_pose(data, camera)
    seen = (points - pose[:3, 3]) @ pose[:3, :3] @ intrinsics.T
    return seen[:, :2] / seen[:, 2:]


def test_detected_corners_are_where_the_corners_are(cell):
    cell.reset()
    cell.command(np.array([0.1, -0.1, 0.05, 0.1, -0.1, 0.1]))
    seen = cell.see(HAND_MARKERS).reshape(2, -1, 4, 2)
    errors = [
        seen[camera, k] - true_corners(cell, camera, marker, "hand")
        for camera in range(2)
        for k, marker in enumerate(HAND_MARKERS)
        if np.isfinite(seen[camera, k]).all()
    ]
    assert len(errors) >= 3
    assert np.sqrt(np.mean(np.square(errors))) < 0.15
    assert np.abs(errors).max() < 0.8


def test_an_image_without_markers_has_none():
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
    assert np.isnan(find_corners(image, PART_MARKERS)).all()


def test_the_controller_is_inaccurate_and_the_encoders_do_not_see_the_springs(cell):
    cell.reset()
    start, step = cell.true_joints(), np.array([0.3, -0.2, 0.2, 0.3, -0.3, 0.3])
    cell.command(step)
    missed = cell.true_joints() - start - step
    assert 0.002 < np.abs(missed).max() < 0.15
    bent = np.abs(np.mean([cell.encoders() for _ in range(50)], axis=0) - cell.true_joints())
    assert 0.003 < bent.max() < 0.05


def test_a_grasped_part_is_held_by_friction_and_a_released_one_falls(cell):
    cell.reset()
    cell.teach_grasp(np.zeros(3), 0.0)
    cell.command(np.array([0.2, 0.0, 0.1, 0.0, 0.2, 0.0]))
    assert np.linalg.norm(cell.true_part_in_hand()) < 0.003
    cell.open_gripper()
    assert cell.true_part_position()[2] < 0.15


def test_a_peg_over_the_wall_does_not_enter_and_a_seated_one_is_in(cell):
    cell.reset()
    cell.teach_grasp(np.zeros(3), 0.0)
    cell.teach_seat(np.zeros(3))
    np.testing.assert_allclose(cell.true_insertion_depth(), 0.04, atol=1e-6)
    cell.teach_seat(np.array([0.02, 0.0, 0.0]))
    assert cell.true_insertion_depth() == 0.0
    cell.place_fixture_away()


def test_walls_of_the_hole_are_solid(cell):
    names = {cell.model.geom(i).name for i in range(cell.model.ngeom)}
    assert {"part/peg", "fixture/wall_front", "fixture/wall_left", "table"} <= names
    cell.reset()
    cell.place_fixture(np.array([0.5, 0.0]), 0.0)
    data = cell._data
    data.qpos[cell._part : cell._part + 7] = [0.51, 0.0, 0.05 + 0.116 + 0.003, 1, 0, 0, 0]  # 10 mm off the hole
    for _ in range(300):
        mujoco.mj_step(cell.model, data)
    assert cell.true_insertion_depth() < 0.01
    data.qpos[cell._part : cell._part + 7] = [0.5, 0.0, 0.05 + 0.116 + 0.003, 1, 0, 0, 0]
    data.qvel[:] = 0
    for _ in range(600):
        mujoco.mj_step(cell.model, data)
    assert cell.true_insertion_depth() > 0.035
    cell.place_fixture_away()


def test_bad_arguments_are_answered(cell):
    with pytest.raises(DenseVSError, match="6 finite numbers"):
        cell.command(np.zeros(5))
    with pytest.raises(DenseVSError, match="cameras is 0"):
        Workcell("ur5", peg=False, seed=0, cameras=0)
