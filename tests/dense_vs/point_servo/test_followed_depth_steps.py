"""The depth of a followed point, step by step: which pixels count, the plane through them, corrections, being lost."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.point_servo.followed_depth import FollowedDepth, _plane_at_center, _window

PLACE = np.array([10.0, 8.0])


def estimator(depth, row=(0.0, 0.0), with_depth=True):
    J = np.zeros((1, 3, 2))
    J[0, 2] = row
    return SimpleNamespace(
        depth=np.asarray(depth, np.float32), at=lambda place, depth: J, options=SimpleNamespace(depth=with_depth)
    )


def flat(depth=1.0, size=(20, 24)):
    return np.full(size, depth, np.float32)


def bare(depth=1.0, unseen=0):
    one = object.__new__(FollowedDepth)
    one.depth, one.unseen = depth, unseen
    return one


@pytest.mark.parametrize(
    ("place", "columns", "rows"),
    [((10.4, 7.6), (6, 14), (4, 12)), ((10.6, 7.4), (7, 15), (3, 11)), ((2.0, 1.0), (0, 6), (0, 5)),
     ((22.0, 18.0), (18, 23), (14, 19)), ((-4.0, 8.0), (0, 0), (4, 12)), ((27.0, 8.0), (23, 23), (4, 12))],
)  # fmt: skip
def test_pixels_around_a_place_are_those_within_four(place, columns, rows):
    offsets, depths = _window(flat(), np.array(place))
    x, y = (offsets + np.array(place)).T
    np.testing.assert_allclose([x.min(), x.max(), y.min(), y.max()], [*columns, *rows])
    assert len(depths) == (columns[1] - columns[0] + 1) * (rows[1] - rows[0] + 1)


@pytest.mark.parametrize("place", [(-5.0, 8.0), (29.0, 8.0), (8.0, -9.0), (8.0, 1e9), (-1e9, 5.0)])
def test_far_outside_there_are_none(place):
    assert len(_window(flat(), np.array(place))[1]) == 0


def test_pixels_without_depth_do_not_count():
    depth = flat()
    depth[8, 6:15] = [0.0, np.nan, np.inf, -1.0, 2.0, 0.0, 0.0, 0.0, 0.0]
    offsets, depths = _window(depth, PLACE)
    on_row = offsets[:, 1] == 0
    assert depths[on_row].tolist() == [2.0]
    assert offsets[on_row].tolist() == [[0.0, 0.0]]
    assert len(depths) == 81 - 8


def test_a_plane_is_read_at_the_place_itself():
    """Weighted by a bell of 2 px; a quarter of a square pixel holds the slope back where one line alone is known."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        offsets = rng.integers(-4, 5, (12, 2)).astype(float)
        depths = rng.uniform(0.9, 1.1, 12)
        weights = np.exp(-(offsets**2).sum(axis=1) / 8.0)
        weights /= weights.sum()
        middle, mean = weights @ offsets, weights @ depths
        matrix = sum(w * np.outer(o - middle, o - middle) for w, o in zip(weights, offsets, strict=True))
        right = sum(w * (o - middle) * (d - mean) for w, o, d in zip(weights, offsets, depths, strict=True))
        slope = np.linalg.solve(matrix + 0.25 * np.eye(2), right)
        assert _plane_at_center(offsets, depths) == pytest.approx(mean - slope @ middle)
    y, x = np.mgrid[-4:5, -4:5]
    around = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    assert _plane_at_center(around, 2.0 + around @ [0.1, -0.05]) == pytest.approx(2.0)
    line = around[around[:, 0] == 1]
    assert np.isfinite(_plane_at_center(line, np.full(9, 3.0)))


@pytest.mark.parametrize(("known", "enough"), [(5, False), (6, True)])
def test_six_pixels_are_enough_to_begin(known, enough):
    depth = np.zeros((20, 24), np.float32)
    depth[8, 6 : 6 + known] = 1.5
    assert (FollowedDepth.found(estimator(depth), PLACE) is not None) == enough
    if enough:
        begun = FollowedDepth(estimator(depth), PLACE)
        assert (begun.depth, begun.unseen, begun.lost) == (pytest.approx(1.5), 0, False)
    else:
        with pytest.raises(DenseVSError, match="known at 5 of the pixels"):
            FollowedDepth(estimator(depth), PLACE)
    assert FollowedDepth.found(estimator(flat(), with_depth=False), PLACE) is None


@pytest.mark.parametrize(("near", "depth"), [(3, 2.0), (4, 1.0), (6, 1.0)])
def test_it_begins_with_the_nearest_surface_that_is_no_speck(near, depth):
    """Beside an outline the window shows what lies behind, too: the fourth nearest pixel says which it is."""
    image = flat(2.0)
    image[8, 6 : 6 + near] = 1.0
    assert FollowedDepth(estimator(image), PLACE).depth == pytest.approx(depth)


@pytest.mark.parametrize(("there", "count", "after"), [
    (1.01, 81, 1.005), (0.99, 81, 0.995), (1.019, 81, 1.0095), (1.021, 81, 1.0), (0.979, 81, 1.0), (1.01, 6, 1.005),
    (1.01, 5, 1.0),
])  # fmt: skip
def test_pixels_of_the_same_surface_correct_half_of_the_difference(there, count, after):
    """Within two percent of the depth, and six of them at least; others are of another surface."""
    image = np.zeros((20, 24), np.float32)
    window = image[4:13, 6:15]
    cells = np.argsort(np.hypot(*(np.mgrid[-4:5, -4:5])).ravel(), kind="stable")[:count]
    window[np.unravel_index(cells, (9, 9))] = there
    one = bare()
    one._correct(estimator(image), PLACE)
    assert one.depth == pytest.approx(after, abs=2e-6)


def test_a_steep_surface_corrects_by_two_percent_at_most():
    """All of its pixels within 2 %, the plane through them goes on to 6 % at the place."""
    image = np.zeros((20, 24), np.float32)
    image[4:13, 13:15] = [1.015, 0.985]
    one = bare()
    offsets, depths = _window(image, PLACE)
    assert _plane_at_center(offsets, depths) > 1.02
    one._correct(estimator(image), PLACE)
    assert one.depth == pytest.approx(1.01)


def test_it_goes_along_by_what_j_says_of_the_joint_step():
    one = bare(2.0)
    found = one.update(estimator(flat(9.0), row=(0.5, -0.25)), PLACE, np.array([0.2, 0.4]), flat(9.0))
    assert found == one.depth == pytest.approx(2.0 + 0.1 - 0.1)
    one.update(estimator(flat(9.0), row=(0.5, 0.0)), PLACE, np.array([0.2, 0.0]), None)
    assert one.depth == pytest.approx(2.1)
    near = bare(2.0)
    near.update(estimator(flat(2.11), row=(0.5, 0.0)), PLACE, np.array([0.2, 0.0]), flat(2.11))
    assert near.depth == pytest.approx(2.105)  # first along, then half of what is left


@pytest.mark.parametrize(("count", "seen"), [(5, False), (6, True)])
def test_the_sensor_itself_has_to_show_it(count, seen):
    """The estimator bridges holes; of the present image six pixels at its depth are enough."""
    shown = np.zeros((20, 24), np.float32)
    shown[8, 6 : 6 + count] = 1.0
    one = bare(unseen=3)
    one.update(estimator(flat()), PLACE, np.zeros(2), shown)
    assert one.unseen == (0 if seen else 4)
    other = bare(unseen=3)
    other.update(estimator(flat()), PLACE, np.zeros(2), np.where(shown > 0, 1.03, 0.0).astype(np.float32))
    assert other.unseen == 4  # of another surface
    none = bare(unseen=3)
    none.update(estimator(flat()), PLACE, np.zeros(2), None)
    assert none.unseen == 4


@pytest.mark.parametrize(("unseen", "lost"), [(14, False), (15, True)])
def test_it_is_lost_after_fifteen_images(unseen, lost):
    assert bare(unseen=unseen).lost == lost
