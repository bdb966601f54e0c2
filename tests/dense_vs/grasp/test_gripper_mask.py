"""The gripper's image, pixel by pixel, beside the hulls of its corners, and the poses that it takes."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GripperModel

CAMERA = np.array([[150.0, 0, 50.0], [0, 160.0, 42.0], [0, 0, 1]])
SHAPE = (80, 100)


def pose(rotation, place):
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = rotation, place
    return whole


def gripper(T, opening=0.06, width=0.03, length=0.05):
    return GripperModel(opening=opening, width=width, thickness=0.02, length=length, T_camera_hand=T)


def depth_inside(corners, T, angle, shape):
    """How far every pixel is within the hull of a box's corners [px], below 0 outside."""
    turned = np.array(corners) @ Rotation.from_rotvec([0, 0, angle]).as_matrix().T
    seen = turned @ T[:3, :3].T + T[:3, 3]
    places = (seen @ CAMERA.T)[:, :2] / seen[:, 2:]
    y, x = np.mgrid[: shape[0], : shape[1]]
    sides = ConvexHull(places).equations
    return -(np.stack([x, y], axis=-1) @ sides[:, :2].T + sides[:, 2]).max(axis=2)


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.3])
@pytest.mark.parametrize(("closing", "shape"), [(False, SHAPE), (True, SHAPE), (False, (12, 100))])
@pytest.mark.parametrize("place", [(0.01, 0.02, 0.25), (0.04, -0.05, 0.25), (-0.06, -0.03, 0.15)])
def test_a_mask_is_of_the_pixels_within_the_hulls_of_the_corners(angle, closing, shape, place):
    T = pose(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), place)
    model = gripper(T)
    draw = model.closing_masks if closing else model.finger_masks
    spans = [(-0.03, 0.03)] if closing else [(-0.05, -0.03), (0.03, 0.05)]
    within = np.max(
        [depth_inside(list(itertools.product(span, (-0.015, 0.015), (-0.05, 0.0))), T, angle, shape) for span in spans],
        axis=0,
    )
    first, mask = draw([0.1, angle], CAMERA, shape)
    assert mask.dtype == bool
    assert mask[within > 0.5].all()
    assert not mask[within < -1.0].any()  # what a border touches is drawn
    np.testing.assert_array_equal(draw([0.1], CAMERA, shape)[0], first)


def test_what_is_nearer_than_five_millimeters_is_not_drawn():
    toward = np.diag([1.0, -1.0, -1.0])  # its tip is nearest
    assert gripper(pose(toward, [0, 0, 0.005])).finger_masks([0.0], CAMERA, SHAPE).shape == (1, *SHAPE)
    with pytest.raises(DenseVSError, match=r"a finger reaches to 0\.0050 m .* expected at least 0\.005 m"):
        gripper(pose(toward, [0, 0, np.nextafter(0.005, 0)])).finger_masks([0.0], CAMERA, SHAPE)


@pytest.mark.parametrize(
    ("rotation", "taken"),
    [
        (np.eye(3) * (1 - 4e-5), True),
        (np.eye(3) * (1 + 4e-5), True),
        (np.eye(3) * (1 + 2e-4), False),
        (np.eye(3) * (1 - 2e-4), False),
        (np.diag([1.0, 1.0, -1.0]), False),
        (np.diag([2.0, 1.0, 0.5]), False),
        (np.zeros((3, 3)), False),
    ],
)
def test_a_pose_has_a_rotation(rotation, taken):
    T = pose(rotation, [0, 0, 0.3])
    if taken:
        np.testing.assert_array_equal(gripper(T).T_camera_hand, T)
        return
    with pytest.raises(DenseVSError, match="expected a rotation matrix"):
        gripper(T)
