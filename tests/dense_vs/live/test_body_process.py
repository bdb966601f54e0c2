"""The body's process on a textured plate that a joint turns: it follows, answers, forgets, and its end is noticed."""

import os
import signal
import threading
from itertools import count

import numpy as np
import pytest
from planar_scene import TURN, PlanarScene
from sliding_scene import wait_for

from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.surface import Surface
from dense_vs.live.body_process import MOST_WAITING, BodyProcess, BodyState
from dense_vs.live.body_worker import BodyWorker, shown_frame
from dense_vs.robot.joint_group import JointGroup

SCENE = PlanarScene()
SIZE = SCENE.height, SCENE.width
START = np.array([84.0, 40.0])
GROUP = JointGroup(("turn",), np.arange(1), np.array([[-1.0, 1.0]]), ("rad",), 1)


def posture(angle):
    return np.array([0.0, 0.0, angle / TURN, 0.0])


def seen(angle, measured=True):
    return shown_frame(SCENE.image(posture(angle)), np.array([angle]), measured)


def place(angle):
    return SCENE.to_image(START, posture(angle))


def model():
    """The plate, which fills the image, at Z = 1."""
    focal = 100.0
    pixels = SCENE.pixels.reshape(-1, 2)
    points = np.column_stack([(pixels - SCENE.center) / focal, np.ones(len(pixels))])
    chain = Chain(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.array([-1]))
    surface = Surface(points, np.zeros(len(points), int), np.ones(len(points)), np.full(len(points), 90, np.uint8))
    center = float(SCENE.center[0]), float(SCENE.center[1])
    return BodyModel(ModelContent(chain, focal, center, SIZE, surface, np.ones(1, bool), np.array([[-0.3, 0.3]]), 0.1))


def jacobian():
    """J of the plate at the posture 0: perpendicular to the arm from the center."""
    arm = SCENE.pixels - SCENE.center
    return np.stack([-arm[..., 1], arm[..., 0]], axis=-1)[..., None].astype(np.float32)


@pytest.fixture
def process():
    found = []
    one = BodyProcess(SIZE, GROUP, lambda *told: found.append(told))
    one.found = found
    yield one
    one.end()
    assert not one.alive
    assert not any(thread.name.startswith("body ") for thread in threading.enumerate())


def begin(process):
    """Let it know the plate and follow the point; the number of the next frame."""
    process.use(model())
    for number, angle in enumerate(np.linspace(-0.2, 0.0, 12)):
        process.frame(number, seen(angle))
        assert wait_for(lambda: not process._waiting)
    process.follow(1, START, 11, seen(0.0), jacobian())
    return 12


def answer(process, number):
    """The answer about a frame."""
    found = {}
    assert wait_for(lambda: found.update(process.answers()) or number in found, 60)
    return found[number]


def test_it_follows_a_point_by_a_model_that_is_known(process):
    number = begin(process)
    assert process.knows
    first = answer(process, 11)[1]
    np.testing.assert_allclose(first.place, START, atol=0.1)
    for angle in np.linspace(0.0, 0.25, 9)[1:]:
        process.frame(number, seen(angle, measured=False))
        one = answer(process, number)[1]
        assert np.linalg.norm(one.place - place(angle)) < 1.0
        assert not one.lost
        number += 1
    process.drop(1)
    process.frame(number, seen(0.2))
    assert wait_for(lambda: not process._waiting)
    assert process.answers() == []


def test_too_few_images_are_no_body(process):
    process.frame(0, seen(0.0))
    process.learn(np.zeros(1), False)
    assert process.state is BodyState.LEARNING
    assert wait_for(lambda: process.found == [(None, "")], 60)
    assert process.state is BodyState.NOT_FOUND
    assert process.alive
    assert not process.sought_in_vain  # nobody knows what enough of them would have shown


def test_a_body_that_enough_images_do_not_show_was_sought_in_vain_until_one_is_known(process):
    for known in (lambda: process.use(model()), process.forget):
        process.state = BodyState.LEARNING
        process._take_model(False, "", "", True)
        assert process.sought_in_vain
        known()
        assert not process.sought_in_vain
    process._take_model(False, "", "", True)  # of a fit that was forgotten meanwhile
    assert not process.sought_in_vain


@pytest.mark.parametrize("in_vain", [False, True])
def test_the_answer_says_whether_a_body_was_sought_in_vain(in_vain, monkeypatch):
    said = []
    worker = BodyWorker(SIZE, GROUP, said.append)
    worker._body.sought_in_vain = in_vain
    monkeypatch.setattr(worker._body, "learn", lambda positions, agrees: False)
    worker.learn(np.zeros(1), "body.npz", False)
    assert said == [("learned", False, "body.npz", "", in_vain)]


def test_a_fit_that_is_forgotten_meanwhile_is_not_used(process):
    process.learn(np.zeros(1), False)
    process.forget()
    begin(process)  # it answers, so the fit is over
    answer(process, 11)
    assert process.found == []


def test_images_of_a_robot_that_stands_still_do_not_count(process):
    for angle, images in ((0.0, 1), (0.0, 1), (0.001, 1), (0.0021, 2), (0.0, 3)):
        process.frame(0, seen(angle))
        assert process.images == images
    process.forget_images()
    process.frame(0, seen(0.0))
    assert process.images == 1


def test_a_process_that_hangs_takes_no_more_than_some_frames(process):
    begin(process)
    answer(process, 11)
    os.kill(process._process.pid, signal.SIGSTOP)
    try:
        frames, numbers = [seen(angle) for angle in (0.1, 0.2)], count(12)

        def another() -> int:
            number = next(numbers)
            process.frame(number, frames[number % 2])
            return len(process._waiting)

        # Some are on their way, sent by a thread that may come late; then no more can be sent.
        assert wait_for(lambda: another() == MOST_WAITING)
        assert max(another() for _ in range(4 * MOST_WAITING)) <= MOST_WAITING + 1
        process.follow(2, START, 0, frames[0], jacobian())  # waits for its turn, as nothing is lost but frames
        assert process._waiting[-1][0] == "follow"
    finally:
        os.kill(process._process.pid, signal.SIGCONT)


def test_a_killed_process_is_noticed(process):
    begin(process)
    answer(process, 11)
    process.state = BodyState.LEARNING
    os.kill(process._process.pid, signal.SIGKILL)
    assert wait_for(lambda: not process.alive)
    assert wait_for(lambda: process.found == [(None, "")])
    assert not process.knows
    process.frame(99, seen(0.0))  # says nothing, waits for nobody


def test_a_point_that_is_on_no_link_is_told_of(monkeypatch):
    said = []
    worker = BodyWorker(SIZE, GROUP, said.append)
    monkeypatch.setattr(worker._body, "tracker", lambda *_, **__: None)
    worker.follow(3, START, 11, seen(0.0).gray, np.zeros(1), jacobian())
    assert said == [("seen", 11, {3: None})]
    worker.frame(12, seen(0.1).gray, np.array([0.1]), True, True)
    assert len(said) == 1


def test_points_are_sought_in_the_newest_of_frames_that_wait():
    said = []
    worker = BodyWorker(SIZE, GROUP, said.append)
    for number, angle in enumerate(np.linspace(-0.2, 0.0, 12)):
        frame = seen(angle)
        worker.frame(number, frame.gray, frame.positions, True, True)
    assert said == []
    worker._body.use(model(), None)
    worker.follow(1, START, 11, seen(0.0).gray, np.zeros(1), jacobian())
    for number, newest in ((12, False), (13, True)):
        frame = seen(0.1)
        worker.frame(number, frame.gray, frame.positions, True, newest)
    assert [(name, number) for name, number, _ in said] == [("seen", 11), ("seen", 13)]
    assert np.linalg.norm(said[-1][2][1].place - place(0.1)) < 1.0
