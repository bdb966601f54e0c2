"""A search is bounded, ends where the object is seen, and goes back where it is not."""

import datetime

import numpy as np
import pytest
from flat_room import Disc, FlatRoom

from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.object_search import search_object, search_offsets

JOINTS = ("forward", "right")


def test_seen_at_once():
    room = FlatRoom(Disc(np.array([0.1, 0.1])))
    result = search_object(room, room, room, joints=JOINTS)
    assert (result.found, result.looks) == (True, 1)
    assert room.commands == []


def test_found_beside_the_view():
    room = FlatRoom(Disc(np.array([0.0, 0.7])))
    result = search_object(room, room, room, joints=JOINTS, reach=(0.4, 0.4))
    assert result.found
    assert room.q[1] == pytest.approx(0.4)


@pytest.mark.parametrize(("rings", "looks"), [(0, 1), (1, 9), (2, 25)])
def test_never_farther_than_its_rings(rings, looks):
    room = FlatRoom(None, start=(0.3, -0.2, 0.8, 0.0))
    ways = []
    room.before_look = lambda: ways.append(np.abs(room.q[:2] - [0.3, -0.2]))
    result = search_object(room, room, room, joints=JOINTS, reach=(0.25, 0.3), rings=rings)
    assert (result.found, result.looks) == (False, looks)
    assert np.all(np.max(ways, axis=0) <= rings * np.array([0.25, 0.3]) + 1e-9)
    np.testing.assert_allclose(room.q[:2], [0.3, -0.2], atol=1e-3)


def test_small_steps_are_made_too():
    """Half a centimeter may bring an object into view; a millimeter is what a robot stands off by anyway."""
    for reach, farthest in ((0.005, 0.005), (0.0005, 0.0)):
        room = FlatRoom(None)
        places = [room.q[:2].copy()]
        room.before_look = lambda room=room, places=places: places.append(room.q[:2].copy())
        search_object(room, room, room, joints=JOINTS, reach=(reach, reach))
        np.testing.assert_allclose(np.abs(np.array(places) - places[0]).max(axis=0), farthest, atol=1e-9)


def test_joint_limits_are_kept():
    room = FlatRoom(None, limits=[(-0.1, 0.1), (-5, 5), (0, 1), (-1, 1)])
    places = []
    room.before_look = lambda: places.append(room.q[0])
    search_object(room, room, room, joints=JOINTS)
    assert np.abs(places).max() <= 0.1


@pytest.mark.parametrize("options", [{"reach": (0, 1)}, {"reach": (1, 1, 1)}, {"reach": (1, 1), "rings": -1}])
def test_bad_offsets(options):
    with pytest.raises(DenseVSError, match="expected"):
        search_offsets(**options)


def test_unknown_joints():
    with pytest.raises(DenseVSError, match="joint 'base' is not in the robot; expected one of forward"):
        search_object(FlatRoom(None), FlatRoom(None), FlatRoom(None), joints=("base", "right"))


def test_a_few_pixels_are_no_object():
    room = FlatRoom(Disc(np.array([0.1, 0.1])))
    seen = search_object(room, room, room, joints=JOINTS)
    area = seen.quality.area
    assert search_object(room, room, room, joints=JOINTS, min_area=area, rings=0).found
    assert not search_object(room, room, room, joints=JOINTS, min_area=area + 1, rings=0).found


@pytest.mark.parametrize("object_in_view", [True, False])
@pytest.mark.parametrize(("image", "joints", "why"), [(10.0, 0.0, "the image"), (0.0, 10.0, "the joint reading")])
@pytest.mark.parametrize("looks", [1, 4])
def test_old_stamps_end_it_where_it_is(object_in_view, image, joints, why, looks):
    room = FlatRoom(None)
    read, reading, made = room.read, room.joints, []

    def late():
        made.append(room.q.copy())
        if len(made) == looks and object_in_view:
            room.disc = Disc(room.q[:2].copy())
        return read()[0], room.time - image * (len(made) >= looks)

    room.read = late
    room.joints = lambda: (reading()[0], room.time - joints * (len(made) >= looks))
    result = search_object(room, room, room, joints=JOINTS)
    assert (result.found, result.looks, len(made)) == (False, looks, looks)
    assert result.stopped == f"{why} is 10.000 s old"
    np.testing.assert_array_equal(room.q, made[-1])


@pytest.mark.parametrize("looks", [2, 9])
def test_a_reading_that_ages_while_the_mask_is_made_moves_nothing(looks):
    room = FlatRoom(None)
    reading, segment, made = room.joints, room.segment, []

    def mask(image):
        made.append(room.q.copy())
        return segment(image)

    room.segment = mask
    room.joints = lambda: (reading()[0], room.time - 10.0 * (len(made) >= looks))
    result = search_object(room, room, room, joints=JOINTS)
    assert (result.found, result.looks) == (False, looks)
    assert result.stopped == "the joint reading is 10.000 s old"
    np.testing.assert_array_equal(room.q, made[-1])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"joints": None}, "joints is None; expected a sequence of names"),
        ({"joints": ("forward",)}, "expected two of forward, right, lift, wrist"),
        ({"min_area": datetime.datetime(2020, 1, 1)}, "min_area is .*expected a finite number of at least 0"),
        ({"min_area": -1}, "min_area is -1"),
        ({"reach": (0.25, 3e38)}, "expected a ring at most 100 m away"),
        ({"reach": (0.25, 2.0), "rings": 51}, "expected a ring at most 100 m away"),
    ],
)
def test_arguments_are_checked_before_anything_moves(options, said):
    room = FlatRoom(None)
    with pytest.raises(DenseVSError, match=said):
        search_object(room, room, room, **{"joints": JOINTS, **options})
    assert room.commands == []
