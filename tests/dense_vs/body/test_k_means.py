"""Clusters of Jacobians that are few enough to sort by hand."""

import numpy as np
import pytest
import warp as wp

from dense_vs.body.k_means import KMeans


@pytest.fixture
def sort():
    """Clusters of pixels in a row, each a Jacobian (x, 0) of one joint, from centers (x, 0) or seeded ones."""

    def run(values, start=None, members=None, clusters=3, **options):
        k_means = KMeans((1, 1, len(values)), 1, clusters, wp.get_device("cpu"), 1, **options)
        jacobian = np.zeros((1, 1, len(values), 2, 1), np.float32)
        jacobian[0, 0, :, 0, 0] = values
        k_means.jacobian.assign(jacobian)
        if members is not None:
            k_means.members.assign(np.array(members, np.int8).reshape(1, 1, -1))
        given = None
        if start is not None:
            given = np.zeros((len(start), 2, 1), np.float32)
            given[:, 0, 0] = start
        (found,) = k_means([np.random.default_rng(0)], None if given is None else [given])
        assert not found.centers[:, 1].any()
        return sorted(zip(found.centers[:, 0, 0].tolist(), found.sizes.tolist(), strict=True)), found.steps

    return run


def test_a_pixel_alone_is_a_cluster_and_a_center_alone_is_none(sort):
    clusters, steps = sort([0.0, 2.0, 40.0], start=[1.0, 30.0])
    assert clusters == [(1.0, 2), (40.0, 1)]
    assert steps == 2  # the second finds nothing to change
    assert sort([5.0, 5.0, 5.0], start=[5.0, 900.0])[0] == [(5.0, 3)]


def test_an_empty_center_takes_the_farthest_pixel(sort):
    assert sort([0.0, 1.0, 2.0, 10.0], start=[1.0, 900.0])[0] == [(1.0, 3), (10.0, 1)]


def test_pixels_that_do_not_count_are_in_no_cluster(sort):
    assert sort([0.0, 2.0, 40.0, np.nan], start=[1.0, 30.0], members=[1, 0, 1, 1])[0] == [(0.0, 1), (40.0, 1)]
    assert sort([0.0, 2.0], members=[0, 0])[0] == []
    assert sort([np.nan, np.inf])[0] == []


def test_seeds_are_pixels_that_differ(sort):
    assert sort([0.0, 40.0, 0.0, 90.0])[0] == [(0.0, 2), (40.0, 1), (90.0, 1)]
    assert sort([7.0, 7.0])[0] == [(7.0, 2)]
    assert sort([0.0, 0.25, 0.0, 0.5])[0] == [(0.0, 2), (0.25, 1), (0.5, 1)]  # however little
    assert sort([3.0])[0] == [(3.0, 1)]


def test_steps_end_where_told_or_where_centers_rest(sort):
    far = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert sort(far, start=[0.0, 0.75], max_steps=1)[1] == 1
    assert sort(far, start=[0.0, 0.75])[1] > 2
    assert sort(far, start=[0.0, 0.75], tolerance=9.0)[1] == 1


@pytest.mark.parametrize("seed", range(6))
def test_seeds_are_drawn_by_their_squared_distance_from_those_before(seed):
    """By the cumulated shares of the rows, then of the pixels in a row, of two numbers a seed."""
    rng = np.random.default_rng(100 + seed)
    vectors = rng.normal(0.0, 30.0, (4, 5, 2, 3)).astype(np.float32)
    vectors[1, 2, 0, 1] = np.nan
    members = np.ones((4, 5), np.int8)
    members[2, :3] = 0
    k_means = KMeans((1, 4, 5), 3, 4, wp.get_device("cpu"), 1)
    k_means.jacobian.assign(vectors[None])
    k_means.members.assign(members[None])
    counted = (members > 0) & np.isfinite(vectors).all(axis=(2, 3))
    drawn, expected = np.random.default_rng(seed), []
    for _ in range(4):
        spread = counted.astype(float)
        if expected:
            apart = np.nan_to_num(vectors).astype(float)[:, :, None] - np.array(expected, float)
            spread *= np.sum(apart**2, axis=(3, 4)).min(axis=2)
        shares = spread.sum(axis=1).cumsum() / spread.sum()
        row = int(np.sum(shares <= drawn.random()))
        column = int(np.sum(spread[row].cumsum() / spread[row].sum() <= drawn.random()))
        expected.append(vectors[row, column])
    np.testing.assert_array_equal(k_means._seeded(0, np.random.default_rng(seed)), expected)
