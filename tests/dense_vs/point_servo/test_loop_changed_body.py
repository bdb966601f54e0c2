"""A loop begins with a body of another day: it says that the body is not as it was, finds out why, and goes on."""

import numpy as np
import pytest
from textured_arm import SIZE, TexturedArm

from dense_vs import ServoLoop
from dense_vs.body_model import ChangeKind
from dense_vs.health.faults import FaultKind

NONE, OFFSET = np.zeros(3), np.array([0.0, 0.15, 0.0])
TURN, SHIFT = np.array([0.03, -0.02, 0.05]), np.array([0.01, 0.0, -0.02])


class ArmOfAnotherDay:
    """Camera and robot, whose elbow reads more than it did, or whose camera was moved."""

    joint_names = ("base", "elbow", "wrist")
    joint_limits = np.tile([-0.5, 0.6], (3, 1))

    def __init__(self, offset=NONE, moved=(NONE, NONE)):
        self.arm, self.offset, self.moved = TexturedArm(), offset, moved
        self.q, self.time = np.zeros(3), 0.0

    def read(self):
        gray = self.arm.image(self.q, *self.moved, samples=1)
        return np.repeat(gray[..., None], 3, axis=2), self.time

    def joints(self):
        return self.q + self.offset, self.time

    def command(self, delta):
        self.q = self.q + delta
        self.time += 1 / 30


@pytest.mark.parametrize(
    ("robot", "kind"),
    [
        (ArmOfAnotherDay(), None),
        (ArmOfAnotherDay(OFFSET), ChangeKind.JOINT),
        (ArmOfAnotherDay(moved=(TURN, SHIFT)), ChangeKind.CAMERA),
    ],
)
def test_a_saved_body_is_brought_up_to_the_day(robot, kind):
    model = robot.arm.model()
    said = []
    loop = ServoLoop(
        robot, robot, device="cpu", seed=1, body_model=model, joint_delay=0.0,
        on_frame=lambda loop: said.append([str(fault) for fault in loop.faults if fault.kind is FaultKind.BODY]),
    )  # fmt: skip
    assert (loop.frame.gray.shape, loop.body_model) == (SIZE, model)
    loop.babble(4.0)
    change = loop.learned_body.change
    if kind is None:
        assert change is None
        assert loop.body_model is model
        assert not any(said)
        return
    assert change.kind is kind
    assert any(
        "body changed: the body is not as it was learned: it looks like its model by 0." in one[0]
        for one in said
        if one
    )
    np.testing.assert_allclose(change.offsets, robot.offset, atol=0.01)
    assert loop.body_model is not model
    points, links = model.surface.points[::60], model.surface.links[::60]
    seen = robot.arm.pixels(points, links, robot.q, *robot.moved)
    off = np.linalg.norm(loop.body_model.points(robot.q + robot.offset).pixels[::60] - seen, axis=1)
    before = np.linalg.norm(model.points(robot.q + robot.offset).pixels[::60] - seen, axis=1)
    assert np.quantile(off, 0.9) < 0.5
    assert np.quantile(before, 0.9) > 3.0
    said.clear()
    loop.babble(2.5)
    assert not any(said)
    assert loop.learned_body.change is change  # nothing more is asked
