"""Grasping a disc: held at once, deeper after a miss, bounded when it cannot be held or the gripper jams."""

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspOutcome, GripperModel
from dense_vs.grasp.loop import GraspLoop, HandGeometry

CENTRE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
GRIP = 0.17
BEHIND = 0.03
INTRINSICS = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])


def room(**options):
    world = FlatRoom(Disc(np.array([0.02, 0.01]), radius=0.02, height=0.1), start=(0.0, 0.0, 0.31, 0.0), **options)
    world.grip, world.axis, world.slack = GRIP, np.array([-BEHIND, 0.0]), 0.01
    return world


def loop(world, bite=0.0):
    pose = np.array([[0, -1, 0, -BEHIND], [1, 0, 0, 0], [0, 0, 1, GRIP], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    target = (CENTRE[0] - FOCAL * BEHIND / GRIP, CENTRE[1])
    hand = HandGeometry(GRIP, target, CENTRE, INTRINSICS, model, bite=bite)
    pinv = np.diag([-0.2 / FOCAL, -0.2 / FOCAL])
    return GraspLoop(world, world, world, world, hand, lift="lift", wrist="wrist", base=("forward", "right"), pinv=pinv)


def test_holds_at_the_first_attempt():
    world = room()
    run = loop(world).run(0.1)
    assert run.held
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.HELD]
    np.testing.assert_allclose(world.q[:2] + world.axis, world.disc.place, atol=0.01)


def test_goes_deeper_after_a_miss():
    world = room()
    run = loop(world).run(0.105)  # the estimate is 5 mm above the object
    assert run.held
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.MISSED, GraspOutcome.HELD]


def test_gives_up_in_the_end():
    world = room()
    world.slack = -1.0  # nothing is ever caught
    run = loop(world).run(0.1)
    assert not run.held
    assert len(run.attempts) == 3
    assert world.q[2] == pytest.approx(0.31, abs=0.02)


def test_jam_is_reported_and_bounded():
    world = room()
    world.jams = True
    run = loop(world).run(0.1)
    assert not run.held
    assert {one.check.outcome for one in run.attempts} == {GraspOutcome.JAMMED}
    assert len(run.attempts) == 3


def test_object_that_is_gone():
    world = room()
    world.disc = Disc(np.array([5.0, 5.0]))
    run = loop(world).run(0.1)
    assert not run.held
    assert {one.check.outcome for one in run.attempts} == {GraspOutcome.LOST}


def test_way_down_ends_at_what_is_in_the_way():
    world = room(limits=[(-1, 1), (-1, 1), (0, 1), (-2, 2)])
    command = world.command

    def blocked(delta):
        command(delta)
        world.q[2] = max(world.q[2], 0.265)  # the lift stays behind its command here

    world.command = blocked
    run = loop(world, bite=0.02).run(0.1)
    assert run.attempts[0].contact
    assert run.held


def test_unknown_joint():
    world = room()
    with pytest.raises(DenseVSError, match="'tower' is unknown"):
        GraspLoop(
            world,
            world,
            world,
            world,
            loop(world).hand,
            lift="tower",
            wrist="wrist",
            base=("forward", "right"),
            pinv=[],
        )
