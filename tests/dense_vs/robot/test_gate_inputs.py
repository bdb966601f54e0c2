"""What is no step, no bound and no stamp is refused by the last gate, and nothing is sent."""

from typing import Any

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.robot import CommandGate, JointGroup, WrappedRobot
from dense_vs.robot.camera_image import check_gray, check_rgb

NO_NUMBERS: list[Any] = ["1", "x", b"1", True, 1j, 10**400, np.datetime64("2020-01-01"), np.timedelta64(3, "s"), {1}]


class Robot:
    joint_names, joint_limits = ("a", "b"), np.array([[-1.0, 1.0]] * 2)

    def __init__(self):
        self.sent = []

    def joints(self):
        return np.zeros(2), 0.0

    def command(self, delta):
        self.sent.append(np.array(delta))


def gate_of(robot, max_step: Any = 0.1):
    return CommandGate(robot, JointGroup.of_robot(robot), max_step=max_step)


@pytest.mark.parametrize(
    "bound", [*NO_NUMBERS, None, [0.1], [0.1, -0.1], [[0.1], [0.1, 0.2]], ["1", "2"], [True, True]]
)
def test_a_bound_is_a_number_or_one_for_each_joint(bound):
    with pytest.raises(DenseVSError, match=r"max_step .*expected a finite number above 0, or one for each joint"):
        gate_of(Robot(), bound)


@pytest.mark.parametrize("bound", [1, 0.5, np.float32(0.5), [1, 2], (0.5, 2.0), np.array([1, 2])])
def test_bounds_that_are_numbers_are_taken(bound):
    np.testing.assert_array_equal(gate_of(Robot(), bound).max_step, np.broadcast_to(bound, (2,)))


@pytest.mark.parametrize("wrong", [[1, [2]], "x", 0.02, np.ones(3), [np.nan, 0.0], [1j, 0j], None, ["1", "2"]])
@pytest.mark.parametrize("of", ["delta", "positions"])
def test_what_is_no_step_is_not_sent(wrong, of):
    robot = Robot()
    gate = gate_of(robot)
    gate.stopped = "as before"
    with pytest.raises(DenseVSError, match=r"expected finite floating-point numbers of shape \(2,\)"):
        gate.send(**{"delta": np.zeros(2), "positions": np.zeros(2)} | {of: wrong}, image_time=1.0)
    assert robot.sent == []
    assert gate.stopped == "as before"
    assert gate.send(np.full(2, 0.05), np.zeros(2), image_time=1.0).all()  # nor was the image acted on


@pytest.mark.parametrize("name", ["image_time", "now", "reading_time"])
@pytest.mark.parametrize("wrong", [*NO_NUMBERS, [1.0]])
def test_what_is_no_stamp_sends_nothing(name, wrong):
    robot = Robot()
    gate = gate_of(robot)
    with pytest.raises(DenseVSError, match=rf"{name} .*expected numbers"):
        gate.send(np.full(2, 0.05), np.zeros(2), **{name: wrong})
    assert robot.sent == []


@pytest.mark.parametrize("stop", [None, 1, True, b"no", np.zeros(2), 10**5000], ids=type)
def test_what_is_no_reason_to_stop_sends_nothing(stop):
    robot = Robot()
    with pytest.raises(DenseVSError, match=r"^stop is .*; expected a reason"):
        gate_of(robot).send(np.full(2, 0.05), np.zeros(2), stop=stop)
    assert robot.sent == []


@pytest.mark.parametrize("stamp", [1, np.float32(1.0), np.int64(1), 2**62])
def test_stamps_are_whole_numbers_too(stamp):
    assert gate_of(Robot()).send(np.full(2, 0.05), np.zeros(2), image_time=stamp, now=stamp, reading_time=stamp).all()


def test_images_are_what_cameras_give():
    gray, rgb = np.zeros((4, 5), np.uint8), np.zeros((4, 5, 3), np.uint8)
    assert check_gray(gray) is gray
    assert check_rgb(rgb, least=4) is rgb
    masked = np.ma.masked_array(gray, mask=np.zeros(gray.shape, bool))
    assert type(check_gray(masked)) is np.ndarray
    no_gray: list[Any] = [rgb, gray.astype(float), gray[:0], [1.0], None, "x", gray.tolist()]
    for wrong in no_gray:
        with pytest.raises(DenseVSError, match=r"image .*; expected uint8 of shape \(H, W\)"):
            check_gray(wrong)
    no_rgb: list[Any] = [gray, rgb.astype(float), rgb[:0], rgb[..., :2], [1.0], None, "x"]
    for wrong in no_rgb:
        with pytest.raises(DenseVSError, match=r"image .*; expected uint8 of shape \(H, W, 3\)$"):
            check_rgb(wrong)
    with pytest.raises(DenseVSError, match="at least 5 x 5"):
        check_rgb(rgb, least=5)


@pytest.mark.parametrize("wrong", [[1.0], "x", 1j, [np.nan, 0.0], None, [[1.0], [1.0, 2.0]], b"1", ["1", "2"], 0.1])
def test_steps_of_a_group_are_checked(wrong):
    group, good = JointGroup.of_robot(Robot()), np.zeros(2)
    calls = {
        "delta": [group.spread, lambda one: group.clip_step(one, good)],
        "posture": [lambda one: group.step_toward(one, good, 0.1, 1.0)],
        "(posture|positions)": [lambda one: group.step_toward(good, one, 0.1, 1.0)],
        "step": [lambda one: gate_of(Robot()).bounded(one, good)],
        "positions": [lambda one: group.clip_step(good, one), lambda one: gate_of(Robot()).bounded(good, one)],
    }  # fmt: skip
    for name, ones in calls.items():
        for call in ones:
            with pytest.raises(DenseVSError, match=rf"^{name} .*; expected finite"):
                call(wrong)
    for longest in ("x", 0, np.nan, None, [0.1]):
        with pytest.raises(DenseVSError, match="longest is"):
            group.step_toward(good, good, longest, 1.0)
    for gain in ("x", 0, 1.1, np.nan, None, [0.1]):
        with pytest.raises(DenseVSError, match="gain is"):
            group.step_toward(good, good, 0.1, gain)


def test_a_gate_and_a_wrapper_take_a_robot():
    group: Any
    robot: Any
    for group in (None, "x", ("a", "b")):
        with pytest.raises(DenseVSError, match=r"^group is .*; expected a JointGroup"):
            CommandGate(Robot(), group, max_step=0.1)
    for robot in (None, "x", 3):
        with pytest.raises(DenseVSError, match=r"^robot is a .* without command; expected"):
            CommandGate(robot, JointGroup.of_robot(Robot()), max_step=0.1)
        with pytest.raises(DenseVSError, match=r"^robot is a .* without joints, command; expected"):
            WrappedRobot(robot)
