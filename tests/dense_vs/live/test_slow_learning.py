"""A camera of a few images a second: learning goes on until there are enough to fit a body to, and not for ever."""

import numpy as np
import pytest
from sliding_scene import SlidingRobot, wait_for

from dense_vs.live import learning
from dense_vs.live.learning import LEAST_SECONDS, MOST_FOR_BODY, MOST_SECONDS, Learning
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource
from dense_vs.pipeline.explained_motion import ExplainedMotion
from dense_vs.point_servo.learned_body import LEAST_IMAGES


@pytest.fixture
def learn(tmp_path):
    """Let a session learn with so many images a second; it, and the images that came whenever it was looked at."""
    sessions = []

    def run(fps):
        robot = SlidingRobot(pace=False, fps=fps)
        # A computer that is busy with something else for half a second is no stalled camera here.
        options = LiveOptions(labels=False, folder=tmp_path, stall_seconds=20.0)
        session = LiveSession(LiveSource(robot, robot, "board"), options)
        sessions.append(session)
        learned, told = [], []
        publish = session._publish

        def noted(frame, before):
            publish(frame, before)
            state = session.board.snapshot.state
            if state["mode"] == "learning":
                told.append(state["body_images"])
                learned.append(frame.time)

        session._publish = noted
        session.start()
        assert wait_for(lambda: session.mode is Mode.STILL, 60), session.board.lines()
        standing = session.number
        assert wait_for(lambda: session.number > standing + 2 * LEAST_IMAGES)  # images of a robot that does not move
        session.ask(lambda: session.begin_mode(Mode.LEARNING))
        assert wait_for(lambda: any("learned: " in line for line in lines(session)), 60), lines(session)
        return session, learned[-1] - learned[0], told

    yield run
    for session in sessions:
        session.end()


def lines(session):
    return [line["text"] for line in session.board.lines()]


def test_it_goes_on_until_the_body_has_its_images(learn):
    session, seconds, told = learn(6.0)
    assert seconds > LEAST_IMAGES / 6.0 - 1.5  # an image or more came before, and the verdict is due every 6 frames
    assert seconds < MOST_FOR_BODY / 2
    assert told[-1]["need"] == LEAST_IMAGES
    counts = [images["have"] for images in told]
    assert counts == sorted(counts)
    assert counts[0] < 6
    assert session.body.process.images >= LEAST_IMAGES
    assert wait_for(lambda: any("learning the body" in line for line in lines(session)))
    assert not any("images came" in line for line in lines(session))


def test_it_ends_where_too_few_come_and_says_so(learn, monkeypatch):
    monkeypatch.setattr(learning, "MOST_FOR_BODY", 45.0)  # the fewest images that are of one clock have it after 57 s
    session, seconds, told = learn(0.7)
    assert 45 - 6 < seconds < 45 + 12  # images are 1.4 s apart, and looked at by sixes
    assert told[-1]["have"] < LEAST_IMAGES
    assert wait_for(lambda: any("the body was not found" in line for line in lines(session)), 60)
    said = next(line for line in lines(session) if "the body was not found" in line)
    came = int(said.split(": ")[1].split()[0])
    assert told[-1]["have"] <= came <= told[-1]["have"] + 1  # the last image ends the learning
    assert f"{came} images came, it takes {LEAST_IMAGES}" in said


def test_a_verdict_waits_for_the_images_that_are_missing():
    explained = ExplainedMotion(1)
    explained.explained = lambda begin, end: 0.95
    learning, sure, unsure = Learning(explained, 10.0), np.array([1.0]), np.array([0.1])
    for seconds in (LEAST_SECONDS + 1, MOST_SECONDS + 1):
        assert learning.verdict(10.0 + seconds, sure, images_missing=1) is None
        good, text = learning.verdict(10.0 + seconds, sure, images_missing=0)
        assert good
        assert "95 %" in text
    good, _ = learning.verdict(10.0 + MOST_FOR_BODY, sure, images_missing=1)
    assert good  # J is learned, though the body is not
    good, text = Learning(explained, 10.0).verdict(10.0 + MOST_SECONDS, unsure, images_missing=1)
    assert not good  # where J is not learned, no image is waited for
    assert "joint 1" in text
