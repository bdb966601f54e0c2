"""Observations at the border of what an arm and its images can be, and just beyond it."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations

T, C, M, N = 5, 2, 3, 4


def given(**changes):
    arrays = {"joints": np.zeros((T, N)), "pixels": np.full((T, C, M, 2), 5.0), "image_sizes": [(480, 640), (800, 600)]}
    return Observations(**{**arrays, **changes})


def lens(camera=1, **changes):
    """Guesses of both cameras' lenses, one of them with other numbers; its image is 800 px long."""
    rows = np.array([[600.0, 600, 320, 240, 0, 0], [700.0, 700, 300, 400, 0, 0]])
    for name, value in changes.items():
        rows[camera, ["fx", "fy", "cx", "cy", "k1", "k2"].index(name)] = value
    return rows


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"fx": 40.0}, None), ({"fx": 39.9}, "focal lengths"), ({"fy": 39.9}, "focal lengths"),
        ({"fx": 8e5}, None), ({"fx": 8.1e5}, "focal lengths"), ({"fy": 8.1e5}, "focal lengths"),
        ({"cx": 8e5}, None), ({"cx": -8e5}, None), ({"cx": 8.1e5}, "focal lengths"), ({"cy": -8.1e5}, "focal lengths"),
        ({"k1": 100.0}, None), ({"k2": -100.0}, None), ({"k1": -100.1}, "focal lengths"), ({"k2": 100.1}, "focal len"),
        ({"fx": 0.0}, "fx, fy > 0"), ({"fy": -1.0}, "fx, fy > 0"), ({"cx": np.nan}, r"intrinsics\[1, 2\] is nan"),
    ],
)  # fmt: skip
def test_lenses(changes, why):
    rows = lens(**changes)
    if why is None:
        np.testing.assert_array_equal(given(intrinsics=rows).intrinsics, rows)
        return
    with pytest.raises(DenseVSError, match=why):
        given(intrinsics=rows)


def test_lenses_without_distortion_have_none():
    np.testing.assert_array_equal(given(intrinsics=lens()[:, :4]).intrinsics, lens())
    for rows in (lens()[:, :5], lens()[:1], np.hstack([lens(), lens()])[:, :7]):
        with pytest.raises(DenseVSError, match="intrinsics"):
            given(intrinsics=rows)
    sure = given(intrinsics=lens(), intrinsics_sigma=(1e-9, 1e-9))
    np.testing.assert_array_equal(sure.intrinsics_sigma, [1e-9, 1e-9])
    for sigma in ((0.0, 1.0), (1.0, 0.0), (1.0,), (1.0, np.nan)):
        with pytest.raises(DenseVSError, match="intrinsics_sigma"):
            given(intrinsics=lens(), intrinsics_sigma=sigma)


@pytest.mark.parametrize(
    ("sizes", "good"),
    [
        ([(1, 131072), (131072, 1)], True), ([(480, 640), (0, 640)], False), ([(480, 640), (480, 131073)], False),
        ([(480, 640), (480.5, 640)], False), ([(480, 640)], False), ([(480, 640)] * 3, False), ([], False),
        (np.array([[480.0, 640.0], [800, 600]]), True), ([(480, 640, 3)] * 2, False),
    ],
)  # fmt: skip
def test_sizes_of_images(sizes, good):
    if good:
        found = given(image_sizes=sizes).image_sizes
        assert found == [tuple(int(side) for side in size) for size in sizes]
        assert all(type(side) is int for size in found for side in size)
        return
    with pytest.raises(DenseVSError, match="expected 2 pairs"):
        given(image_sizes=sizes)


@pytest.mark.parametrize("name", ["joints", "poses", "actions", "pixels"])
def test_numbers_beyond_a_million_are_mistakes(name):
    def of(value):
        arrays = {"joints": np.zeros((T, N)), "poses": np.tile(np.eye(4), (T, 1, 1)), "actions": np.zeros((T - 1, N)),
                  "pixels": np.full((T, C, M, 2), 5.0)}  # fmt: skip
        array = arrays[name]
        array[(1, 2, 3) if name == "poses" else (1, 1, 2, 0) if name == "pixels" else (1, 2)] = value
        return given(**{name: array})

    for value in (1e6, -1e6):
        assert np.abs(getattr(of(value), name)).max() == 1e6
    for value in (1.001e6, -1.001e6):
        with pytest.raises(DenseVSError, match=f"{name} hold 1.001e"):
            of(value)
    for value in (np.inf, -np.inf):
        with pytest.raises(DenseVSError, match=name):
            of(value)


def posed(turn=0.0, scale=1.0, last=(0.0, 0.0, 0.0, 1.0), mirror=1.0, count=T):
    one = np.eye(4)
    one[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    one[:3, :3] *= scale
    one[2] *= mirror
    one[3] = last
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[count - 2] = one
    return poses


@pytest.mark.parametrize(
    ("changes", "good"),
    [
        ({"turn": 1.0}, True), ({"scale": 1 + 4e-5}, True), ({"scale": 1 + 6e-5}, False), ({"scale": 1 - 6e-5}, False),
        ({"mirror": -1.0}, False), ({"last": (0, 0, 0, 1 + 9e-5)}, True), ({"last": (0, 0, 0, 1 - 1.1e-4)}, False),
        ({"last": (0, 1.1e-4, 0, 1)}, False), ({"last": (0, -1.1e-4, 0, 1)}, False),
    ],
)  # fmt: skip
def test_poses_are_rotations_and_shifts(changes, good):
    if good:
        given(poses=posed(**changes), actions=posed(**changes, count=T - 1))
        return
    with pytest.raises(DenseVSError, match=rf"poses\[{T - 2}\] is"):
        given(poses=posed(**changes))
    with pytest.raises(DenseVSError, match=rf"actions\[{T - 3}\] is"):
        given(actions=posed(**changes, count=T - 1))


def test_a_sequence_of_one_has_no_actions():
    one = Observations(pixels=np.full((1, 1, 1, 2), 5.0), image_sizes=[(48, 64)], actions=np.zeros((0, 4, 4)),
                       joints=np.zeros((1, 1)))  # fmt: skip
    assert len(one.actions) == 0
    assert one.joint_count == 1
    for wrong in ({"joints": np.zeros((1, 0))}, {"pixels": np.zeros((0, 1, 1, 2))}, {"pixels": np.zeros((1, 0, 1, 2))},
                  {"pixels": np.zeros((1, 1, 0, 2))}):  # fmt: skip
        with pytest.raises(DenseVSError, match="expected at least one"):
            Observations(**{"pixels": np.zeros((1, 1, 1, 2)), "image_sizes": [(48, 64)], **wrong})


@pytest.mark.parametrize(
    ("pixels", "good"),
    [((np.nan, np.nan), True), ((np.nan, 3.0), False), ((3.0, np.nan), False), ((np.inf, 3.0), False),
     ((np.nan, np.inf), False), ((-np.inf, -np.inf), False)],
)  # fmt: skip
def test_pixels_are_seen_whole_or_not(pixels, good):
    array = np.full((T, C, M, 2), 5.0)
    array[3, 1, 2] = pixels
    if good:
        seen = given(pixels=array).seen
        assert not seen[3, 1, 2]
        assert seen.sum() == T * C * M - 1
        return
    with pytest.raises(DenseVSError, match="infinities or half a coordinate"):
        given(pixels=array)


@pytest.mark.parametrize(
    ("links", "joints", "good"),
    [
        ([0, 4, 2], N, True),
        ([0, 5, 2], N, False), ([-1, 4, 2], N, False), ([0, 4], N, False), ([0, 0, 0], None, True),
        ([0, 1, 0], None, False), ([0.0, 1.0, 2.0], N, False),
    ],
)  # fmt: skip
def test_links_of_features(links, joints, good):
    changes = {"feature_link": links, "joints": None if joints is None else np.zeros((T, N))}
    if good:
        found = given(**changes)
        assert found.feature_link.tolist() == links
        assert found.feature_link.dtype == np.int64
        assert found.joint_count == joints
        return
    with pytest.raises(DenseVSError, match=f"feature_link is .* from 0 to {joints or 0}, the joints"):
        given(**changes)


def test_chosen_postures_keep_what_belongs_to_them():
    rng = np.random.default_rng(0)
    whole = given(
        joints=rng.normal(size=(T, N)), actions=rng.normal(size=(T - 1, N)), poses=posed(turn=0.5),
        pixels=rng.normal(size=(T, C, M, 2)), intrinsics=lens(), intrinsics_sigma=(0.1, 3.0), feature_link=[1, 2, 3],
    )  # fmt: skip
    for index, places, acted in (
        (slice(1, 4), [1, 2, 3], True), ([0, 2], [0, 2], False), ([3, 2], [3, 2], False), (2, [2], True),
        (np.arange(T) != 2, [0, 1, 3, 4], False), (slice(None), list(range(T)), True),
    ):  # fmt: skip
        some = whole[index]
        assert len(some) == len(places)
        for name in ("joints", "poses", "pixels"):
            np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[places])
        if acted:
            np.testing.assert_array_equal(some.actions, whole.actions[places[:-1]])
        else:
            assert some.actions is None
        assert some.image_sizes == whole.image_sizes
        for name in ("intrinsics", "intrinsics_sigma", "feature_link"):
            np.testing.assert_array_equal(getattr(some, name), getattr(whole, name))
    few = given(joints=None)[1:3]
    assert (few.joints, few.poses, few.actions, few.joint_count) == (None, None, None, None)
    with pytest.raises(DenseVSError, match="actions have shape"):
        given(actions=np.zeros((T, N)))
    with pytest.raises(DenseVSError, match="actions have shape"):
        given(actions=np.zeros((T - 1, N + 1)))
    with pytest.raises(DenseVSError, match="joints have shape"):
        given(joints=np.zeros((T + 1, N)))
