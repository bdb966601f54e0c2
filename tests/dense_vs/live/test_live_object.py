"""An object with a box around it: it is found where it is, brought to the middle, and let go when commands stop."""

import numpy as np
import pytest
from sliding_scene import DISC, HEIGHT, WIDTH, SlidingRobot, wait_for

pytest.importorskip("sklearn", reason="the vos extra is not installed")

from dense_vs.errors import DenseVSError
from dense_vs.live.actions import Actions
from dense_vs.live.live_object import checked_box, mask_of_box
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource

MIDDLE = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])


@pytest.fixture(scope="module")
def robot():
    return SlidingRobot()


@pytest.fixture(scope="module")
def session(robot):
    session = LiveSession(LiveSource(robot, robot, "board"), LiveOptions(body=False, labels=False, stall_seconds=5.0))
    session.start()
    assert wait_for(lambda: session.mode is Mode.STILL, 60), session.board.lines()
    do(session, do="learn")
    assert wait_for(lambda: any("learned: J" in line["text"] for line in session.board.lines()), 60)
    yield session
    session.end()


def do(session, **message):
    Actions(session).carry_out(message)


def boxed(session, robot):
    """Draw a box around the disc and wait until it is learned."""
    x, y = robot.place(DISC[:2])
    radius, before = DISC[2] + 4, session.objects.known
    do(session, do="object", **{"from": [x - radius, y - radius], "to": [x + radius, y + radius]})
    assert wait_for(lambda: session.objects.known not in (None, before))
    assert wait_for(lambda: session.objects.known.state == "ready", 60), session.board.lines()


def test_it_is_found_and_centered(session, robot):
    boxed(session, robot)
    assert np.hypot(*(session.objects.known.centroid - robot.place(DISC[:2]))) < 2.0
    do(session, do="center")
    assert wait_for(lambda: any("object: converged" in line["text"] for line in session.board.lines()), 60), (
        session.board.lines()
    )
    assert wait_for(lambda: session.mode is Mode.STILL)
    assert np.abs(robot.place(DISC[:2]) - MIDDLE).max() < 6.0  # 5 px is the loop's own tolerance
    assert not session.gate.open


def test_a_point_follows_it_and_a_stop_ends_that(session, robot):
    boxed(session, robot)
    do(session, do="clear")
    place = robot.place(DISC[:2]) + np.array([-30, 10])
    do(session, do="point", at=place.tolist(), frame=1 << 40)
    assert wait_for(lambda: len(session.points) == 1)
    number = next(iter(session.points)).number
    do(session, do="chase", point=number)
    assert wait_for(lambda: session.mode is Mode.REACHING)
    point = next(iter(session.points))
    assert np.hypot(*(point.target - robot.place(DISC[:2]))) < 12.0
    session.stop("the test")
    assert wait_for(lambda: session.mode is Mode.STILL)


def test_a_stop_ends_the_centering(session, robot):
    boxed(session, robot)
    session.ask(lambda: setattr(robot, "q", robot.q + np.array([0.2, 0.1])))
    assert wait_for(lambda: np.hypot(*(session.objects.known.centroid - robot.place(DISC[:2]))) < 5.0)
    do(session, do="center")
    assert wait_for(lambda: session.mode is Mode.CENTERING)
    session.stop("the test")
    assert wait_for(lambda: session.objects.known.state == "ready", 40), session.objects.known.state
    assert wait_for(lambda: session.mode is Mode.STILL)  # just after
    do(session, do="drop_object")
    assert wait_for(lambda: session.objects.known is None)


def test_a_box_has_to_be_of_some_size():
    image = np.zeros((60, 80, 3), np.uint8)
    assert checked_box(image, (50, 40, 20, 10)) == (20, 10, 30, 30)
    for box in ((1, 1, 3, 30), (0, 0, 79, 59)):
        with pytest.raises(DenseVSError, match="box is"):
            checked_box(image, box)
    with pytest.raises(DenseVSError, match="gray"):
        checked_box(image[..., 0], (20, 10, 50, 40))


def test_a_box_becomes_the_mask_of_what_is_in_it(robot):
    image, _ = SlidingRobot(pace=False).read()
    radius = DISC[2]
    mask = mask_of_box(image, (DISC[0] - radius - 4, DISC[1] - radius - 4, 2 * radius + 8, 2 * radius + 8))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    true = np.hypot(x - DISC[0], y - DISC[1]) <= radius
    assert (mask & true).sum() / (mask | true).sum() > 0.8
