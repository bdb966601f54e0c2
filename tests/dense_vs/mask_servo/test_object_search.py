"""A search is bounded, ends where the object is seen, and goes back where it is not."""

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
