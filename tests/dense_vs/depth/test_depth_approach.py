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


@pytest.mark.parametrize("options", [{"near": 0.0}, {"steps": (0.1, 0.01)}, {"views": 1}])
def test_bad_options(options):
    with pytest.raises(DenseVSError, match="expected above 0"):
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
