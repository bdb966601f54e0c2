"""VOS-VS (22) on drawn masks whose best angle is known, and the gripper's image against projected points."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GripperModel, WristVerdict, choose_wrist_angle, intersection_over_union

FOCAL, HEIGHT, WIDTH = 300.0, 160, 200
CENTER = np.array([WIDTH / 2, HEIGHT / 2])
INTRINSICS = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1.0]])
ANGLES = np.deg2rad(np.arange(-90, 90, 15.0))
DEPTH = 0.3


def gripper(opening=0.06):
    """A gripper under the camera whose hand x is image x and hand y is image y."""
    pose = np.eye(4)
    pose[2, 3] = DEPTH
    return GripperModel(opening=opening, width=0.02, thickness=0.012, length=0.001, T_camera_hand=pose)


def bar(angle, length=0.12, width=0.02):
    """A flat bar at the gripper's depth whose long side is turned from image x toward image y."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    across = np.array([x - CENTER[0], y - CENTER[1]]) * DEPTH / FOCAL
    along = across[0] * np.cos(angle) + across[1] * np.sin(angle)
    aside = -across[0] * np.sin(angle) + across[1] * np.cos(angle)
    return (np.abs(along) < length / 2) & (np.abs(aside) < width / 2)


def turned(one, other):
    """Angle [rad] between two directions of closing, which a half turn leaves as they are."""
    return abs((one - other + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("angle", np.deg2rad([-60.0, -30.0, 0.0, 30.0, 45.0, 75.0]))
def test_fingers_close_across_the_narrow_side(angle):
    """Turning the fingers the wrong way would close along the bar at all angles but 0 and 90 degrees."""
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    choice = choose_wrist_angle(bar(angle), fingers, ANGLES)
    assert turned(choice.angle, angle + np.pi / 2) < np.deg2rad(16)
    assert choice.verdict is WristVerdict.CLEAR
    assert choice.iou == choice.ious.min() == 0.0
    assert choice.ious.max() > 0.02
    assert choice.angle == ANGLES[choice.index]


def test_least_overlap_wins_where_every_angle_touches():
    mask = bar(0.0, 0.13, 0.062)  # wider than the gripper opens
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    choice = choose_wrist_angle(mask, fingers, ANGLES)
    assert choice.verdict is WristVerdict.TOUCHING
    common, union = (mask & fingers).sum(axis=(1, 2)), (mask | fingers).sum(axis=(1, 2))
    np.testing.assert_allclose(choice.ious, common / union)
    assert choice.iou <= choice.ious.min() + 1e-3
    assert choice.iou < 0.5 * choice.ious.max()
    assert turned(choice.angle, np.pi / 2) < np.deg2rad(1)


def test_smaller_turn_wins_among_equals():
    disc = np.hypot(*(np.mgrid[:HEIGHT, :WIDTH] - CENTER[::-1, None, None])) < 8
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    assert choose_wrist_angle(disc, fingers, ANGLES).angle == pytest.approx(0.0)


def test_second_rank_is_another_angle():
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    mask = bar(np.deg2rad(30.0))
    first, second = (choose_wrist_angle(mask, fingers, ANGLES, rank=rank) for rank in (0, 1))
    assert abs(second.angle - first.angle) >= np.ptp(ANGLES) / 4
    apart = np.abs(ANGLES - first.angle) >= np.ptp(ANGLES) / 4
    assert second.iou <= first.ious[apart].min() + 1e-3
    with pytest.raises(DenseVSError, match="rank is 2"):
        choose_wrist_angle(mask, fingers, ANGLES, rank=2)


def test_nothing_between_the_fingers():
    model = gripper()
    fingers, closing = (draw(ANGLES, INTRINSICS, (HEIGHT, WIDTH)) for draw in (model.finger_masks, model.closing_masks))
    aside = np.roll(bar(0.0, 0.02), 70, axis=0)
    assert choose_wrist_angle(aside, fingers, ANGLES, closing_masks=closing).verdict is WristVerdict.MISSING
    inside = choose_wrist_angle(bar(0.0, 0.02), fingers, ANGLES, closing_masks=closing)
    assert inside.verdict is WristVerdict.CLEAR
    assert inside.between == (bar(0.0, 0.02) & closing[inside.index]).sum() > 0


def test_empty_mask_turns_nothing():
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    choice = choose_wrist_angle(np.zeros((HEIGHT, WIDTH), bool), fingers, ANGLES)
    assert (choice.verdict, choice.angle, choice.index) == (WristVerdict.EMPTY, 0.0, -1)
    assert np.isnan(choice.iou)


def test_clearance_is_the_distance_to_the_nearer_finger():
    fingers = np.zeros((1, 40, 60), bool)
    fingers[0, 10:30, 5:8] = fingers[0, 10:30, 50:53] = True
    mask = np.zeros((40, 60), bool)
    mask[15:25, 20:40] = True
    assert choose_wrist_angle(mask, fingers, [0.0]).clearance == pytest.approx(11.0)  # from column 39 to column 50


@pytest.mark.parametrize("angle", np.deg2rad([0.0, 20.0, -50.0, 90.0]))
def test_fingers_stand_where_their_corners_project(angle):
    """The wrist turns from hand x toward hand y: the fingers' middles by hand, apart from the drawing code."""
    mask = gripper().finger_masks([angle], INTRINSICS, (HEIGHT, WIDTH))[0]
    for side in (-1, 1):
        reach = side * (0.06 / 2 + 0.012 / 2)
        place = reach * np.array([np.cos(angle), np.sin(angle)])
        x, y = np.rint(CENTER + FOCAL * place / (DEPTH - 0.0005)).astype(int)
        assert mask[y, x]
    assert not mask[round(CENTER[1]), round(CENTER[0])]


def test_jaccard_index():
    mask = np.zeros((10, 20), bool)
    mask[:, :10] = True
    candidates = np.stack([mask, ~mask, np.roll(mask, 5, axis=1), np.zeros_like(mask)])
    np.testing.assert_allclose(intersection_over_union(mask, candidates), [1, 0, 1 / 3, 0])
    with pytest.raises(DenseVSError, match="candidates have shape"):
        intersection_over_union(mask, candidates[:, :5])


def test_without_tolerance_the_clearest_angle_itself_is_taken():
    """The border of the tolerance is inside: with 0 the best is left."""
    fingers = gripper().finger_masks(ANGLES, INTRINSICS, (HEIGHT, WIDTH))
    free = choose_wrist_angle(bar(0.3), fingers, ANGLES, clearance_tolerance=0.0, iou_tolerance=0.0)
    assert free.verdict is WristVerdict.CLEAR
    assert free.clearance == max(
        choose_wrist_angle(bar(0.3), fingers[k : k + 1], ANGLES[k : k + 1]).clearance
        for k in range(len(ANGLES))
        if free.ious[k] == 0.0
    )


def test_fingers_reach_from_their_tips_back_to_the_camera():
    """What is nearer is seen farther from the middle: outside by the end at the palm, inside by the tip."""
    near = GripperModel(
        opening=0.04, width=0.02, thickness=0.01, length=0.1, T_camera_hand=gripper().T_camera_hand
    ).finger_masks([0.0], INTRINSICS, (HEIGHT, WIDTH))[0]
    columns = np.flatnonzero(near.any(axis=0)) - CENTER[0]
    assert columns.max() == pytest.approx(FOCAL * 0.03 / (DEPTH - 0.1), abs=1.0)
    assert columns[columns > 0].min() == pytest.approx(FOCAL * 0.02 / DEPTH, abs=1.0)
