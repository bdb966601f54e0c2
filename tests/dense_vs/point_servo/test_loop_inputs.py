"""What is no step, scale, time, bound, model or method is refused by a loop, and the robot stays where it is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from planar_robot import PlanarRobot, PlaneCamera

from dense_vs import Babbling, DenseVSError, ServoLoop, VisualServo
from dense_vs.robot.stamped import read_image, read_joints


def make(scene, **options):
    robot = PlanarRobot(0.5)
    return robot, ServoLoop(
        PlaneCamera(robot, scene), robot, **{"device": "cpu", "seed": 2, "body_model": False} | options
    )


@pytest.fixture(scope="module")
def made(scene):
    return make(scene)


@pytest.mark.parametrize(
    "wrong",
    [0.02, 0, np.ones(2), np.ones((1, 4)), "x", "1234", None, [[1.0], [1.0, 2.0]], [1j] * 4, ["1"] * 4, [True] * 4,
     [np.nan, 0, 0, 0], [0, 0, 0, np.inf], np.array([object()] * 4), np.zeros(4, "datetime64[D]")],
)  # fmt: skip
def test_what_is_no_step_of_every_joint_commands_nothing(made, wrong):
    robot, loop = made
    commands, frame = len(robot.sent), loop.frame
    with pytest.raises(DenseVSError, match=r"(?s)delta .*; expected finite numbers of shape \(4,\)"):
        loop.step(wrong)
    assert len(robot.sent) == commands
    assert loop.frame is frame


@pytest.mark.parametrize("step", [np.full(4, 0.01), [0.01, 0, 0, 0], np.zeros(4, int), np.full(4, 0.01, np.float32)])
def test_steps_are_numbers_of_every_joint(scene, step):
    robot, loop = make(scene)
    loop.step(step)
    np.testing.assert_allclose(robot.sent, [step], atol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        *[({"scale": scale}, "scale is .*above 0 and at most 1") for scale in ("x", np.nan, 0, 2.0, None, 1j, 10**400)],
        *[
            ({name: bound}, f"{name} .*expected a finite number above 0, or one for each joint")
            for name in ("max_step", "max_speed")
            for bound in ("1", "x", b"1", True, 1j, 10**400, np.datetime64("2020-01-01"), 0, [0.1, 0.1])
        ],
        *[({"body_model": model}, "body model is .*expected a BodyModel, True or False") for model in (None, "x", 1)],
        *[
            ({name: wrong}, f"{name} is .*; expected a.? {kind}")
            for name, kind in (
                ("estimator", "DenseJacobian"),
                ("servo", "VisualServo"),
                ("flow", "FlowEstimator"),
                ("babbling", "Babbling"),
                ("body", "SelfBody"),
                ("on_frame", "function, or None"),
            )
            for wrong in ("x", 3, object(), np.zeros(2))
        ],
        ({"servo": VisualServo(3)}, "servo has 3 joints; expected 4"),
        ({"babbling": Babbling(5)}, "babbling has 5 joints; expected 4"),
    ],
)
def test_a_loop_is_made_of_what_fits(scene, options, words):
    with pytest.raises(DenseVSError, match=words):
        make(scene, **options)


def test_a_camera_gives_images(scene):
    robot = PlanarRobot(0.5)
    camera = PlaneCamera(robot, scene)
    for wrong in ([1.0], "x", None, [[1], [1, 2]]):
        camera.read = lambda wrong=wrong: (wrong, 0.0)
        with pytest.raises(DenseVSError, match=r"the camera's image .*expected"):
            ServoLoop(camera, robot, device="cpu")


NO_PAIR = (None, 3, "ab", b"ab", [], (1,), (1, 2.0, 3), {"a": 1, "b": 2}, np.zeros(2))
NO_STAMP = ("x", None, 1j, True, [0.0], np.zeros(1), np.datetime64("2020-01-01"), 10**400, object())


@pytest.mark.parametrize("given", [*NO_PAIR, *(("it", stamp) for stamp in NO_STAMP)])
@pytest.mark.parametrize("what", ["image", "joints"])
def test_a_camera_and_a_robot_give_a_value_and_its_time(scene, what, given):
    robot, loop = make(scene)
    frame = loop.frame
    if what == "image":
        loop.camera.read, words = lambda: given, r"camera.read\(\) .*expected .* \[s\]"
    else:
        robot.joints, words = lambda: given, r"robot.joints\(\) .*expected .* \[s\]"
    for call in (lambda: loop.step(np.zeros(4)), loop.resume, lambda: ServoLoop(loop.camera, robot, device="cpu")):
        with pytest.raises(DenseVSError, match=words):
            call()
    assert loop.frame is frame


def test_a_time_is_any_number():
    for stamp in (3, 3.0, np.float32(3), np.int64(3), np.array(3.0), wp.array([3.0], device="cpu").numpy()[0]):
        image, time = read_image(SimpleNamespace(read=lambda stamp=stamp: ("image", stamp)))
        assert (image, time, type(time)) == ("image", 3.0, float)
        assert read_joints(SimpleNamespace(joints=lambda stamp=stamp: ["q", stamp])) == ("q", 3.0)
    unknown = SimpleNamespace(read=lambda: ("image", np.nan))
    assert np.isnan(read_image(unknown)[1])  # a number, of which others say what is wrong with it


def test_a_body_model_is_one(made):
    loop = made[1]
    for wrong in (None, "x", True, object()):
        with pytest.raises(DenseVSError, match=r"body model is .*; expected a BodyModel"):
            loop.use_body(wrong)
    assert loop.body_model is None


def test_no_body_is_learned_where_none_is_wanted(scene):
    _, loop = make(scene, body_model=np.False_)
    assert not loop.learned_body.wanted
    loop.forget()
    assert not loop.learned_body.wanted
    assert make(scene, body_model=np.True_)[1].learned_body.wanted


def test_a_point_that_cannot_be_followed_so_leaves_the_one_before(made):
    loop = made[1]
    loop.define_point([60.0, 50.0])
    before = loop.memory, loop.tracker
    methods: list[Any] = [np.array(["link", "aligned"]), "x", None, 3, ["link"]]
    for method in methods:
        with pytest.raises(DenseVSError, match=r"method is .*; expected one of link, aligned, fixed_point, paper"):
            loop.define_point([50.0, 40.0], method=method)
    for name in ("window", "min_correlation", "max_jump", "lost_after"):
        for value in (-1, "x", {"a": 1}, np.array([b"1"])):
            with pytest.raises(DenseVSError, match=f"{name} is"):
                loop.define_point([50.0, 40.0], **{name: value})
    assert (loop.memory, loop.tracker) == before


@pytest.mark.parametrize("swings", [0.01, 0.06])
def test_a_command_may_be_as_large_as_babbling_and_servo_together_need(scene, swings):
    """The larger of babbling's largest step and the servo's with four standard deviations of dither."""
    babbling = Babbling(4, amplitude=swings, seed=0)
    servo = VisualServo(4, max_step=0.02, dither=0.001)
    _, loop = make(scene, babbling=babbling, servo=servo)
    assert (babbling.largest_step > 0.024) == (swings == 0.06)
    np.testing.assert_allclose(loop.gate.max_step, max(babbling.largest_step, 0.024))
    _, told = make(scene, babbling=babbling, servo=servo, max_step=0.005)
    np.testing.assert_allclose(told.gate.max_step, 0.005)


def test_a_loop_that_learns_the_body_babbles_wider_at_times(scene):
    assert make(scene, body_model=True)[1].babbling.options.wide_amplitude == 0.35
    assert make(scene, body_model=False)[1].babbling.options.wide_amplitude is None
    _, slow = make(scene, body_model=True, command_period=0.1)
    assert (slow.babbling.options.wide_amplitude, slow.babbling.options.frame_time) == (0.35, 0.1)
    given = Babbling(4)
    assert make(scene, body_model=True, babbling=given)[1].babbling is given
