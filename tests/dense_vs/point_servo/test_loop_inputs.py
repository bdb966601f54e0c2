"""What is no step, scale, time, bound, model or method is refused by a loop, and the robot stays where it is."""

from typing import Any

import numpy as np
import pytest
from planar_robot import PlanarRobot, PlaneCamera

from dense_vs import DenseVSError, ServoLoop


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


def test_a_body_model_is_one(made):
    loop = made[1]
    for wrong in (None, "x", True, object()):
        with pytest.raises(DenseVSError, match=r"body model is .*; expected a BodyModel"):
            loop.use_body(wrong)
    assert loop.body_model is None


def test_no_body_is_learned_where_none_is_wanted(scene):
    _, loop = make(scene, body_model=np.False_)
    assert not loop.wants_body
    loop.forget()
    assert not loop.wants_body
    assert make(scene, body_model=np.True_)[1].wants_body


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
