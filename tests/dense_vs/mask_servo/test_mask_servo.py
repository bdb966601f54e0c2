"""Servoing on masks in a room whose answers are known: ends, limits, learning."""

from typing import Any

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom

from dense_vs import HadamardBroyden
from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.featurewise_broyden import FeaturewiseBroyden
from dense_vs.mask_servo.loop import MaskServo, ServoEnd

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
TRUE = np.diag([-0.8 / FOCAL, -0.8 / FOCAL])  # d(joint)/d(feature): forward motion moves the disc back
H = np.eye(2)


def servo(room: FlatRoom, pinv: Any = TRUE, **options: Any) -> MaskServo:
    options = {"joints": ("forward", "right"), "target": CENTER, "tolerance": 2.0, **options}
    return MaskServo(room, room, room, pinv=pinv, **options)


def test_centers_the_object():
    room = FlatRoom(Disc(np.array([0.2, -0.15])))
    run = servo(room, gain=0.7).run()
    assert run.end is ServoEnd.CONVERGED
    np.testing.assert_allclose(room.q[:2], room.disc.place, atol=2.5 * 0.8 / FOCAL)
    assert run.error_px <= 2.0
    assert np.all(np.array(room.commands)[:, 2:] == 0.0)


def test_a_step_is_no_longer_than_its_limit_unless_told_otherwise():
    far = np.array([0.4, -0.3])
    room = FlatRoom(Disc(far))
    servo(room, max_image_step=1e6).run(1)
    np.testing.assert_allclose(np.abs(room.commands[0][:2]).max(), 0.15)


@pytest.mark.parametrize("learner", [HadamardBroyden, FeaturewiseBroyden])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("place", [(0.12, -0.1), (-0.4, 0.25), (0.3, -0.3)])
def test_learns_from_any_sign(learner, signs, place):
    room = FlatRoom(Disc(np.array(place), radius=0.03))
    learning = learner(0.001 * np.diag(signs), H, 0.1)
    assert servo(room, learning, tolerance=3.0).run(120).end is ServoEnd.CONVERGED
    assert np.all(np.diag(learning.pinv) < 0.0)


def test_nothing_moves_while_the_object_is_not_seen():
    room = FlatRoom(None)
    run = servo(room, patience=3).run()
    assert run.end is ServoEnd.LOST
    assert len(run.looks) == 3
    assert room.commands == []
    assert np.isnan(run.error_px)


def test_lost_on_the_way():
    room = FlatRoom(Disc(np.array([0.2, 0.1])))

    def vanish():
        if len(room.commands) == 2:
            room.disc = None

    room.before_look = vanish
    assert servo(room, gain=0.3, patience=4).run().end is ServoEnd.LOST
    assert len(room.commands) == 2


def test_joint_limits_end_the_run():
    limits = [(-0.05, 0.05), (-1, 1), (0, 1), (-1, 1)]
    room = FlatRoom(Disc(np.array([0.2, 0.0])), limits=limits)
    assert servo(room).run(50).end is ServoEnd.AT_LIMIT
    assert abs(room.q[0]) <= 0.05 + 1e-9


@pytest.mark.parametrize("learner", [HadamardBroyden, FeaturewiseBroyden])
def test_wrong_signs_are_learned_at_the_border(learner):
    """The first steps push the object over the border before anything is learned; the robot itself finds its way."""
    room = FlatRoom(Disc(np.array([0.4, 0.0]), radius=0.12))
    wrong = servo(room, learner(0.001 * H, H, 0.1))
    assert wrong.run(80).end is ServoEnd.CONVERGED
    assert wrong.region is not None
    assert wrong.region.retreats > 0
    assert wrong.pinv[0, 0] < 0.0


def test_learning_ends_where_only_a_part_is_seen():
    room = FlatRoom(Disc(np.array([0.5, 0.0]), radius=0.12))
    run = servo(room, HadamardBroyden(0.001 * H, H, 0.1)).run(50)
    assert run.end is ServoEnd.LEAVING
    assert room.commands == []


def test_joint_that_does_not_follow_is_not_learned_from():
    room = FlatRoom(Disc(np.array([0.1, -0.1])))
    move = room.command
    room.command = lambda delta: move(np.where([True, False, True, True], delta, 0.0))
    learner = HadamardBroyden(0.001 * H, H, 0.1)
    assert servo(room, learner).run(50).end is ServoEnd.EXHAUSTED
    assert learner.pinv[1, 1] == 0.001


def test_masks_of_the_whole_image_do_not_move_the_robot():
    room = FlatRoom(Disc(np.zeros(2), radius=50.0))
    assert servo(room).run(10).end is ServoEnd.LOST
    assert room.commands == []


def test_object_nearer_than_when_j_was_learned():
    """J+ is 2.6 times too large: with its gain alone the object would swing from side to side and out of view."""
    room = FlatRoom(Disc(np.array([0.1, -0.08]), height=0.49))
    assert servo(room, gain=0.9).run(20).end is ServoEnd.CONVERGED


def test_unknown_joint():
    with pytest.raises(DenseVSError, match="joint 'elbow' is not in the robot; expected one of forward, right"):
        servo(FlatRoom(None), joints=("elbow",))


def test_featurewise_update_is_the_scalar_one():
    """With one joint and one feature (11) is j + alpha (dq/de - j)."""
    learner = FeaturewiseBroyden([[0.001, 0], [0, -0.002]], H, 0.1)
    learner.observe([0.0, 0.0], [50.0, 80.0])
    assert learner.observe([0.02, 0.03], [40.0, 95.0])
    expected = [0.001 + 0.1 * (0.02 / -10 - 0.001), -0.002 + 0.1 * (0.03 / 15 + 0.002)]
    np.testing.assert_allclose(np.diag(learner.pinv), expected, rtol=1e-12)
    assert not learner.observe([0.06, 0.03], [38.5, 95.0])  # a change within the noise
    np.testing.assert_allclose(np.diag(learner.pinv), expected, rtol=1e-12)


@pytest.mark.parametrize("coupling", [np.ones((2, 2)), np.zeros((2, 2)), np.ones(2)])
def test_featurewise_needs_a_feature_for_each_joint(coupling):
    with pytest.raises(DenseVSError, match="one 1 in each row"):
        FeaturewiseBroyden(0.001 * np.eye(2), coupling)


def test_a_step_of_less_than_a_pixel_may_be_asked_for():
    room = FlatRoom(Disc(np.array([0.2, -0.15])))
    servo(room, max_image_step=0.5)
    with pytest.raises(DenseVSError, match="max_image_step is 0"):
        servo(room, max_image_step=0.0)


@pytest.mark.parametrize("place", [(0.2, -0.15), (0.0, 0.0)])  # to be centered, and centered
@pytest.mark.parametrize(("image", "joints", "why"), [(10.0, 0.0, "the image"), (0.0, 10.0, "the joint reading")])
def test_old_stamps_stop_it_even_where_it_is_centered(place, image, joints, why):
    room = FlatRoom(Disc(np.array(place)))
    read, reading = room.read, room.joints
    room.read = lambda: (read()[0], room.time - image)
    room.joints = lambda: (reading()[0], room.time - joints)
    run = servo(room).run()
    assert run.end is ServoEnd.STOPPED
    assert run.stopped == f"{why} is 10.000 s old"
    assert not np.any(room.commands)


def test_joint_limits_on_old_images_are_no_end():
    room = FlatRoom(Disc(np.array([0.2, 0.0])), limits=[(-0.05, 0.05), (-1, 1), (0, 1), (-1, 1)])
    read = room.read
    run = servo(room).run(50)
    assert run.end is ServoEnd.AT_LIMIT
    looks = []

    def late():
        looks.append(read())
        return looks[-1][0], room.time - (np.nan if len(looks) == len(run.looks) else 0.0)

    room.q[:], room.read = (0.0, 0.0, 0.8, 0.0), late
    again = servo(room).run(50)
    assert (again.end, again.stopped) == (ServoEnd.STOPPED, "a time stamp is not finite")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pinv": 1j}, "pinv is 1j of dtype complex128; expected finite numbers of shape"),
        ({"pinv": np.eye(3)}, r"pinv has shape \(3, 3\); expected finite numbers of shape \(2, 2\)"),
        (
            {"pinv": HadamardBroyden(np.ones((3, 2)), np.ones((3, 2)))},
            r"learns J\+ of shape \(3, 2\); expected \(2, 2\)",
        ),
        ({"target": [1.0, 2.0, 3.0]}, "target has shape"),
        ({"target": "x"}, "target is 'x'"),
        ({"joints": 1.0}, "joints is 1.0"),
        ({"on_look": 3}, "on_look is 3; expected a function"),
    ],
)
def test_arguments_are_checked(options, said):
    with pytest.raises(DenseVSError, match=said):
        servo(FlatRoom(None), **options)


@pytest.mark.parametrize("looks", ["x", None, -1, 2.0, True])
def test_looks_are_a_whole_number(looks):
    room = FlatRoom(None)
    one = servo(room)
    one.servo.unseen = 2
    with pytest.raises(DenseVSError, match=r"max_looks is .*; expected a whole number of at least 0"):
        one.run(looks)
    assert one.servo.unseen == 2
    assert one.run(0).end is ServoEnd.EXHAUSTED
