"""A recording on the page: it was not told to move, its robot is as fast as it was, its images may come twice."""

import numpy as np
from sliding_scene import J, SlidingRobot, wait_for

from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource

FRAMES, STEP = 180, 1 / 15  # s
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
PLACE_STEP = 0.06  # rad of the board's slides, up to 4 px a new image
GEAR = 4.0  # rad of a joint by rad of its slide: farther than any command of a loop moves one


class Recorded(SlidingRobot):
    """Moves to and fro by itself, each image twice, then is over."""

    def __init__(self):
        super().__init__(pace=False)
        self.count = 0

    def read(self):
        if self.count == FRAMES:
            raise StopIteration("the recording is over")
        new = self.count // 2
        self.q, self.count = PLACE_STEP * np.array(CORNERS[new % 4]), self.count + 1
        image, self.time = super().read()[0], self.count * STEP
        return image, self.time

    def joints(self):
        positions, stamp = super().joints()
        return GEAR * positions, stamp

    def command(self, delta):
        assert not np.any(delta)


def test_no_watch_holds_what_was_recorded_and_j_is_learned():
    robot, frames = Recorded(), []
    source = LiveSource(robot, robot, "recording", commands=False)
    session = LiveSession(source, LiveOptions(labels=False))
    publish = session._publish

    def noted(frame, before):
        frames.append(frame)
        publish(frame, before)

    session._publish = noted
    session.start()
    try:
        assert wait_for(lambda: session.mode is Mode.ENDED, 60), session.board.lines()
        assert session.body_state.value == "unknown"  # a robot that follows no commands has none
        kinds = {fault.kind.value for frame in frames for fault in frame.faults}
        assert kinds <= {"frozen image"}, kinds
        assert session.board.snapshot.state["faults"] == []
        assert not any("stall" in line["text"] for line in session.board.lines())
        np.testing.assert_allclose(session.running_loop().estimator.at([80.0, 60.0])[0], J / GEAR, atol=3.0)
    finally:
        session.end()
