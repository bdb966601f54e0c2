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


def test_steps_end_where_told_or_where_centers_rest(sort):
    far = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert sort(far, start=[0.0, 0.75], max_steps=1)[1] == 1
    assert sort(far, start=[0.0, 0.75])[1] > 2
    assert sort(far, start=[0.0, 0.75], tolerance=9.0)[1] == 1
