"""Arguments of a grasp that are none are refused at the call, before anything moves."""

import datetime
from types import SimpleNamespace

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspLoop, GripperModel, HandGeometry
from dense_vs.grasp.loop import _StoppedError

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
INTRINSICS = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
POSE = np.array([[0, -1, 0, -0.03], [1, 0, 0, 0], [0, 0, 1, 0.17], [0, 0, 0, 1]], dtype=float)
MODEL = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=POSE)


def hand(**options):
    return HandGeometry(**{"z_gripper": 0.17, "target": CENTER, "center": CENTER, "intrinsics": INTRINSICS,
                           "model": MODEL, "bite": 0.0, **options})  # fmt: skip


def loop(world, **options):
    good = {"lift": "lift", "wrist": "wrist", "base": ("forward", "right"), "pinv": np.diag([-1e-3, -1e-3])}
    return GraspLoop(world, world, world, world, options.pop("hand", hand()), **{**good, **options})


def room():
    return FlatRoom(Disc(np.array([0.02, 0.01]), radius=0.02, height=0.1), start=(0.0, 0.0, 0.31, 0.0))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"bite": np.nan}, "bite is nan; expected a finite number above -1 and below 1"),
        ({"bite": [0.01]}, r"bite is \[0.01\]; expected a finite number"),
        ({"bite": 1}, "bite is 1"),
        ({"z_gripper": 0.0}, "z_gripper is 0.0; expected a finite number above 0 and at most 10"),
        ({"z_gripper": "0.17"}, "z_gripper is '0.17'"),
        ({"z_gripper": 11}, "z_gripper is 11"),
        ({"target": "ab"}, "target is 'ab' .*expected x and y of one image point"),
        ({"target": (1.0, np.inf)}, "target is"),
        ({"center": [1.0]}, "center has shape"),
        ({"intrinsics": np.eye(4)}, "intrinsics has shape"),
        ({"intrinsics": np.zeros((3, 3))}, "expected focal lengths above 0"),
        ({"model": []}, r"model is \[\]; expected a GripperModel"),
    ],
)
def test_a_hand_is_checked(options, said):
    with pytest.raises(DenseVSError, match=said):
        hand(**options)


def test_a_hand_takes_lists_and_whole_numbers():
    one = hand(target=[220, 240], center=np.array([320, 240]), intrinsics=INTRINSICS.tolist())
    assert (one.target, one.center) == ((220.0, 240.0), (320.0, 240.0))
    np.testing.assert_array_equal(one.intrinsics, INTRINSICS)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"others": 5}, "others are 5; expected a list of segmenters"),
        ({"others": ["a"]}, r"others are \['a'\]; expected a list of segmenters, each with segment"),
        ({"others": [SimpleNamespace(segment=1)]}, "others are"),
        ({"others": "ab"}, "others are 'ab'"),
        ({"base": 1.0}, "base is 1.0; expected a sequence of names"),
        ({"base": "forward"}, "base is 'forward'"),
        ({"base": ("forward", "right", "lift")}, "expected two joints out of forward, right, lift, wrist"),
        ({"aside": [0.05, 3e38]}, r"aside is \[0.05, 3e\+38\]; expected at most 10 m each way"),
        ({"aside": [0.05, -10.5]}, "expected at most 10 m each way"),
        ({"aside": 1j}, "aside is 1j"),
        ({"raise_by": 2**31}, "raise_by is 2147483648; expected a finite number above 0 and at most 10"),
        ({"max_step": 1e-9}, "max_step is 1e-09; expected a finite number of at least 0.001"),
        ({"max_step": "x"}, "max_step is 'x'"),
        ({"hand": None}, "hand is None; expected a HandGeometry"),
        ({"policy": 3}, "policy is 3; expected a RegraspPolicy"),
        ({"on_attempt": 3}, "on_attempt is 3; expected a function"),
        ({"pinv": 1j}, "pinv is 1j"),
    ],
)
def test_a_loop_is_checked(options, said):
    with pytest.raises(DenseVSError, match=said):
        loop(room(), **options)


@pytest.mark.parametrize(
    ("z_object", "said"),
    [
        ("x", "z_object is 'x'; expected a finite number"),
        (datetime.date(2020, 1, 1), "z_object is"),
        (np.nan, "z_object is nan"),
        (-3e38, r"z_object is -3e\+38 with the lift at 0.31 m; expected a depth below it, by at most 10 m"),
        (0.31, "expected a depth below it"),
        (-9.7, "expected a depth below it"),
    ],
)
def test_a_depth_is_checked_before_anything_moves(z_object, said):
    world = room()
    one = loop(world)
    world.open = world.close = world.read = lambda: pytest.fail("used")
    one.policy.attempts_made = 2
    with pytest.raises(DenseVSError, match=said):
        one.run(z_object)
    assert world.commands == []
    assert one.policy.attempts_made == 2


@pytest.mark.parametrize("max_step", [1e-3, np.pi])
def test_the_farthest_ways_end(max_step):
    world = room()
    one = loop(world, aside=[10.0, -10.0], raise_by=10, max_step=max_step)
    one._move(one._base, np.array([10.0, -10.0]))
    one._move(one._lift, 10.0)
    np.testing.assert_allclose(world.q, [10.0, -10.0, 10.31, 0.0], atol=1e-9)
    assert len(world.commands) <= 2 * (np.ceil(10.0 / max_step) + 1)


def test_a_way_that_rounding_never_ends_is_ended():
    """Steps far below what a large number resolves leave it as it is."""
    world = room()
    one = loop(world)
    world.q[2] = 1e17  # no limits: an encoder's nonsense
    with pytest.raises(_StoppedError, match="by the joint reading"):
        one._descend(0.1, 0.0)
    assert world.commands == []


@pytest.mark.parametrize("distance", ["x", 0, -0.3, np.nan, np.inf, None, [0.3], 1e-320])
def test_a_distance_at_which_the_target_is_no_pixel(distance):
    with pytest.raises(DenseVSError, match=r"^distance is .*; expected"):
        hand(target=(1.0, 2.0)).target_at(distance)


@pytest.mark.parametrize("mask", ["x", None, np.zeros(3, bool), np.ones((4, 5)), [[True], [True, False]]])
def test_what_the_hand_may_hold_is_a_mask(mask):
    assert hand().holds(np.ones((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(DenseVSError, match=r"^mask .*; expected bool of shape \(H, W\)"):
        hand().holds(mask)
