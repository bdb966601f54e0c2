"""Grasping a disc: held at once, deeper after a miss, bounded when it cannot be held or the gripper jams."""

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspOutcome, GripperModel
from dense_vs.grasp.loop import GraspLoop, HandGeometry

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
GRIP = 0.17
BEHIND = 0.03
INTRINSICS = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])


def room(**options):
    world = FlatRoom(Disc(np.array([0.02, 0.01]), radius=0.02, height=0.1), start=(0.0, 0.0, 0.31, 0.0), **options)
    world.grip, world.axis, world.slack = GRIP, np.array([-BEHIND, 0.0]), 0.01
    return world


def loop(world, bite=0.0):
    pose = np.array([[0, -1, 0, -BEHIND], [1, 0, 0, 0], [0, 0, 1, GRIP], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    target = (CENTER[0] - FOCAL * BEHIND / GRIP, CENTER[1])
    hand = HandGeometry(GRIP, target, CENTER, INTRINSICS, model, bite=bite)
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


def test_attempts_after_misses_go_deeper_and_turn():
    world = room()
    world.slack = -1.0
    grasp = loop(world)
    lifts, wrists = [], []
    close = world.close

    def closing():
        lifts.append(world.q[2])
        wrists.append(world.q[3])
        return close()

    world.close = closing
    run = grasp.run(0.1)
    turns = [one.angle for one in run.attempts]
    assert turns[1] == turns[0]
    assert abs(turns[2] - turns[0]) >= np.deg2rad(175) / 4
    np.testing.assert_allclose(wrists[::2], turns, atol=1e-12)
    stops = lifts[::2]  # the gripper closes once at the object and once more, raised, to be asked how far
    np.testing.assert_allclose(np.diff(stops), [-0.008, -0.008], atol=1e-9)
    assert stops[0] == pytest.approx(0.1 + GRIP)
    assert world.q[3] == pytest.approx(0.0)  # the wrist is back


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
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.LOST]  # not found: nothing to attempt
    np.testing.assert_allclose(world.q, [0.0, 0.0, 0.31, 0.0], atol=1e-3)


@pytest.mark.parametrize("way", [(0.0, 0.17), (-0.2, 0.0), (0.19, -0.16)])
def test_object_that_is_pushed_out_of_view_is_found_again(way):
    world = room()
    close, pushed = world.close, []

    def closing():
        if not pushed:  # the fingers push it away once
            pushed.append(True)
            world.disc.place = world.disc.place + way
        return close()

    world.close = closing
    run = loop(world).run(0.1)
    outcomes = [one.check.outcome for one in run.attempts]
    assert outcomes == [GraspOutcome.MISSED, GraspOutcome.LOST, GraspOutcome.HELD]
    assert run.held
    np.testing.assert_allclose(world.q[:2] + world.axis, world.disc.place, atol=0.01)


def test_search_begins_where_the_object_was_last_seen():
    world = room()
    place, places, close = world.disc.place, [], world.close

    def closing():
        world.disc.place = np.array([5.0, 5.0])  # gone for good; from now on the hand looks for it
        world.before_look = lambda: places.append(world.q[:2].copy())
        return close()

    world.close = closing
    run = loop(world).run(0.1)
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.MISSED, GraspOutcome.LOST]
    np.testing.assert_allclose(world.q[:2] + world.axis, place, atol=0.01)  # above where it was, not where it began
    assert len(np.unique(np.round(places, 4), axis=0)) == 9


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
    with pytest.raises(DenseVSError, match="joint 'tower' is not in the robot"):
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
    with pytest.raises(DenseVSError, match=r"base is .*expected two joints out of forward, right, lift, wrist"):
        GraspLoop(
            world, world, world, world, loop(world).hand, lift="lift", wrist="wrist", base=("forward",), pinv=[[1, 1]]
        )
