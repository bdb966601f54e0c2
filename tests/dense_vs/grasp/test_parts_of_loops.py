"""Cameras, segmenters and grippers of another kind are refused at the call; what they give, where it is given."""

from types import SimpleNamespace

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom

from dense_vs import DenseVSError, MaskServo
from dense_vs.depth import DepthApproach
from dense_vs.grasp import GraspLoop, GripperModel, HandGeometry
from dense_vs.mask_servo import search_object
from dense_vs.robot.gripper_reply import close_gripper, open_gripper

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
PINV = np.diag([-1e-3, -1e-3])
BASE = ("forward", "right")


def grasp(robot, camera, segmenter, gripper=None):
    pose = np.array([[0, -1, 0, -0.03], [1, 0, 0, 0], [0, 0, 1, 0.17], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    intrinsics = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
    hand = HandGeometry(0.17, CENTER, CENTER, intrinsics, model)
    gripper = robot if gripper is None else gripper
    return GraspLoop(camera, robot, segmenter, gripper, hand, lift="lift", wrist="wrist", base=BASE, pinv=PINV)


RUNS = {
    "servo": lambda robot, c, s: MaskServo(c, robot, s, joints=BASE, pinv=PINV, target=CENTER).run(3),
    "search": lambda robot, c, s: search_object(c, robot, s, joints=BASE),
    "approach": lambda robot, c, s: DepthApproach(c, robot, s, joint="lift", views=3).run(),
    "grasp": lambda robot, c, s: grasp(robot, c, s).run(0.1),
}


def room():
    return FlatRoom(Disc(np.array([0.02, 0.01]), radius=0.02, height=0.1), start=(0.0, 0.0, 0.31, 0.0))


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("wrong", [None, "x", 3, SimpleNamespace(read=1, segment=True)], ids=str)
def test_parts_of_another_kind(name, wrong):
    world, kind = room(), type(wrong).__name__
    world.read = world.joints = lambda: pytest.fail("used")
    with pytest.raises(DenseVSError, match=f"^camera is a {kind} without read; expected methods read$"):
        RUNS[name](world, wrong, world)
    with pytest.raises(DenseVSError, match=f"^segmenter is a {kind} without segment; expected methods segment$"):
        RUNS[name](world, world, wrong)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("given", [None, "x", 3, (1.0,), (np.zeros((HEIGHT, WIDTH, 3), np.uint8), "now")], ids=type)
def test_what_a_camera_gives_is_checked(name, given):
    world = room()
    with pytest.raises(DenseVSError, match=r"camera\.read\(\)"):
        RUNS[name](world, SimpleNamespace(read=lambda: given), world)
    assert world.commands == []


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("given", [None, "x", 3, np.zeros(5, bool), np.zeros((9, 9), bool), np.zeros((HEIGHT, WIDTH))],
                         ids=lambda given: str(np.shape(given)))  # fmt: skip
def test_what_a_segmenter_gives_is_checked(name, given):
    world = room()
    with pytest.raises(DenseVSError, match=r"the mask of a SimpleNamespace .*; expected"):
        RUNS[name](world, world, SimpleNamespace(segment=lambda _: given, reset=True))
    assert world.commands == []


@pytest.mark.parametrize("wrong", [None, "x", 3, SimpleNamespace(open=None, close=1)], ids=str)
def test_grippers_of_another_kind(wrong):
    with pytest.raises(DenseVSError, match=r"^gripper is a .* without open, close; expected methods open, close$"):
        grasp(room(), room(), room(), SimpleNamespace(open=1) if wrong is None else wrong)


@pytest.mark.parametrize(
    "state",
    [None, True, 0.1, {"opening": 0.1, "jammed": False}, SimpleNamespace(opening=0.1), SimpleNamespace(jammed=False),
     SimpleNamespace(opening="x", jammed=False), SimpleNamespace(opening=np.nan, jammed=False),
     SimpleNamespace(opening=0.1, jammed="no")],
    ids=str,
)  # fmt: skip
def test_what_a_gripper_reports_is_checked(state):
    good = SimpleNamespace(opening=0.1, jammed=False)
    gripper = SimpleNamespace(open=lambda: state, close=lambda: state)
    for command, source in ((open_gripper, "open"), (close_gripper, "close")):
        with pytest.raises(DenseVSError, match=rf"^gripper\.{source}\(\).*; expected"):
            command(gripper)
        assert command(SimpleNamespace(open=lambda: good, close=lambda: good)) is good
    world = room()
    with pytest.raises(DenseVSError, match=r"^gripper\.open\(\).*; expected"):
        grasp(world, world, world, gripper).run(0.1)
    with pytest.raises(DenseVSError, match=r"^gripper\.close\(\).*; expected"):
        grasp(world, world, world, SimpleNamespace(open=lambda: good, close=lambda: state)).run(0.1)


def test_a_finger_that_begins_behind_the_camera_is_not_drawn():
    """Its tip is 0.02 m before it, its end 0.01 m behind it."""
    pose = np.eye(4)
    pose[2, 3] = 0.02
    model = GripperModel(opening=0.1, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    intrinsics = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
    with pytest.raises(DenseVSError, match=r"a finger reaches to -0\.0100 m before the camera"):
        model.finger_masks([0.0], intrinsics, (HEIGHT, WIDTH))
