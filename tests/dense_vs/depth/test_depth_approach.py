"""The approach stops where it should, and knows the depth of a disc whose depth is known."""

import numpy as np
import pytest
from flat_room import Disc, FlatRoom

from dense_vs.depth.approach import ApproachEnd, DepthApproach
from dense_vs.errors import DenseVSError


def approach(room, **options):
    return DepthApproach(room, room, room, joint="lift", **options).run()


@pytest.mark.parametrize("method", ["vos-de", "robust"])
@pytest.mark.parametrize("height", [0.0, 0.2])
def test_depth_of_a_disc(method, height):
    room = FlatRoom(Disc(np.array([0.01, 0.0]), radius=0.04, height=height))
    result = approach(room, method=method)
    assert result.end is ApproachEnd.NEAR
    assert result.z_object == pytest.approx(height, abs=0.006)
    assert result.distance == pytest.approx(0.2, rel=0.1)
    assert room.q[2] - height > 0.17
    assert result.whole.all()


def test_object_that_leaves_the_image():
    room = FlatRoom(Disc(np.zeros(2), radius=0.16))
    result = approach(room)
    assert result.end is ApproachEnd.BORDER
    assert result.camera_z[result.nearest] > room.q[2]
    assert result.z_object == pytest.approx(0.0, abs=0.02)


def test_joint_limit():
    room = FlatRoom(Disc(np.zeros(2)), limits=[(-1, 1), (-1, 1), (0.5, 1), (-1, 1)])
    result = approach(room)
    assert result.end is ApproachEnd.LIMIT
    assert room.q[2] >= 0.5
    # 0.3 m of way at 0.5 m distance: a third of a pixel of the disc's edge is 4 cm.
    assert result.z_object == pytest.approx(0.0, abs=0.06)
    assert abs(result.z_object) < 3 * result.distance_std


def test_camera_that_does_not_move():
    room = FlatRoom(Disc(np.zeros(2)), limits=[(-1, 1), (-1, 1), (0.8, 1), (-1, 1)])
    result = approach(room)
    assert result.end is ApproachEnd.LIMIT
    assert result.z_object is None
    assert result.distance is None
    assert result.why


def test_object_never_seen():
    result = approach(FlatRoom(None))
    assert result.end is ApproachEnd.LOST
    assert result.z_object is None
    assert len(result.areas) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"near": 0.0}, "near is 0.0; expected a finite number above 0"),
        ({"steps": (0.1, 0.01)}, "largest of steps is 0.01; expected a finite number of at least 0.1"),
        ({"steps": (0.01, np.inf)}, "largest of steps is inf"),
        ({"views": 1}, "views is 1; expected a whole number of at least 2"),
        ({"method": "guess"}, "method is 'guess'; expected one of vos-de, robust, learned"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        DepthApproach(FlatRoom(None), FlatRoom(None), FlatRoom(None), joint="lift", **options)


def test_unknown_joint():
    with pytest.raises(DenseVSError, match="expected one of forward"):
        DepthApproach(FlatRoom(None), FlatRoom(None), FlatRoom(None), joint="arm")


def test_gripper_that_hides_a_part():
    room = FlatRoom(Disc(np.zeros(2), radius=0.05))
    fingers = np.zeros((240, 320), bool)
    fingers[:, 230:] = True  # the disc grows behind it from a distance of 0.16 m
    seen = room.segment
    room.segment = lambda image: seen(image) & ~fingers
    result = approach(room, near=0.1, hidden=fingers)
    assert result.end is ApproachEnd.BORDER
    assert result.z_object == pytest.approx(0.0, abs=0.005)
    assert result.distance > 0.15


def test_masks_of_parts_at_first_do_not_end_it():
    room = FlatRoom(Disc(np.zeros(2), radius=0.05))
    rng = np.random.default_rng(0)
    seen = room.segment

    def part(image):
        mask = seen(image)
        if room.q[2] > 0.5:
            mask[:, : 160 + int(rng.integers(-8, 8))] = False
        return mask

    room.segment = part
    result = approach(room)
    assert result.end is ApproachEnd.NEAR
    assert room.q[2] < 0.3
    assert result.z_object == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("steps", [(0.01, np.inf), (0.01, np.nan), (0.0, 0.05), (0.05, 0.01), (0.01,), 0.05, None])
def test_steps_that_would_send_the_camera_anywhere(steps):
    room = FlatRoom(Disc(np.zeros(2)))
    with pytest.raises(DenseVSError, match="steps"):
        approach(room, steps=steps)
    assert not room.commands


def test_no_step_is_longer_than_asked_for_and_none_on_an_old_image():
    room = FlatRoom(Disc(np.zeros(2)))
    approach(room, steps=(0.01, 0.03))
    assert np.abs(room.commands).max() <= 0.03
    room = FlatRoom(Disc(np.zeros(2)))
    image, read = room.read(), room.read
    room.read = lambda: image if len(room.commands) > 2 else read()
    with pytest.raises(DenseVSError, match=r"the approach stopped: the image is that of the view before, from "):
        approach(room)
    assert len(np.flatnonzero(np.any(room.commands, axis=1))) <= 4


@pytest.mark.parametrize(
    ("image_late", "reading_late", "why"),
    [(10.0, 0.0, "the image is 10.000 s old"), (0.0, 10.0, "the joint reading is 10.000 s old")],
)
def test_a_last_view_that_is_old_gives_no_depth(image_late, reading_late, why):
    """No command follows the last of the allowed views, so the gate does not see its stamps."""
    room = FlatRoom(Disc(np.zeros(2)))
    read, joints = room.read, room.joints
    seen = []

    def late_image():
        image, time = read()
        seen.append(time)
        return image, time - image_late * (len(seen) == 6)

    def late_reading():
        positions, time = joints()
        return positions, time - reading_late * (len(seen) == 6)

    room.read, room.joints = late_image, late_reading
    with pytest.raises(DenseVSError, match=f"the approach stopped: {why}"):
        approach(room, views=6)
    assert len(seen) == 6


@pytest.mark.parametrize("joints", [0.0, 10.0])
def test_old_stamps_move_nothing(joints):
    room = FlatRoom(Disc(np.zeros(2)))
    read, reading = room.read, room.joints
    room.read = lambda: (read()[0], room.time - (10.0 - joints))
    room.joints = lambda: (reading()[0], room.time - joints)
    with pytest.raises(DenseVSError, match=r"the approach stopped: the .* is 10.000 s old"):
        approach(room)
    assert not np.any(room.commands)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"steps": (0.01, 3e38)},
            "the largest of steps is 3e.38; expected a finite number of at least 0.01 and at most 1",
        ),
        ({"steps": (0.01, 1.1)}, "the largest of steps is 1.1"),
        ({"hidden": "x"}, "hidden has shape"),
        ({"hidden": np.ones((2, 2))}, "hidden has shape"),
        ({"on_view": 3}, "on_view is 3; expected a function"),
        ({"method": np.ones(2)}, "method is .*; expected one of"),
        ({"method": ["robust"]}, "method is .*; expected one of"),
    ],
)
def test_arguments_are_checked_at_construction(options, said):
    room = FlatRoom(None)
    with pytest.raises(DenseVSError, match=said):
        DepthApproach(room, room, room, joint="lift", **options)
