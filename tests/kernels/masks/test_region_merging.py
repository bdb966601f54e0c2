"""Ward's trees against scikit-learn's, bit by bit: the same mergers in the same order, at the same distances."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse

from dense_vs.kernels.masks.region_merging import merge_regions


def planar(rows, columns):
    """Pairs of neighbors of a grid of cells."""
    cell = np.arange(rows * columns).reshape(rows, columns)
    pairs = [(cell[:, :-1], cell[:, 1:]), (cell[:-1], cell[1:]), (cell[:-1, 1:], cell[1:, :-1])]
    return tuple(np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))


def random_graph(rng, regions, extra):
    """A tree that joins all, and some pairs more."""
    pairs = {(int(rng.integers(k)), k) for k in range(1, regions)}
    while len(pairs) < regions - 1 + extra:
        one, other = sorted(rng.choice(regions, 2, replace=False).tolist())
        pairs.add((one, other))
    return tuple(np.array(sorted(pairs)).T)


def reference(first, second, features):
    """Children (n - 1, 2) and distances of scikit-learn's tree."""
    from sklearn.cluster import ward_tree

    n = len(features)
    pairs = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(n, n))
    merged: Any = ward_tree(features, connectivity=(pairs + pairs.T).tocsr(), return_distance=True)
    return np.asarray(merged[0]), np.asarray(merged[4])


def assert_trees(first, second, features):
    merged = merge_regions(first, second, features)
    n = features.shape[1]
    for t, given in enumerate(features):
        children, distances = reference(first, second, given)
        under = [{k} for k in range(n)]
        parent = np.full(2 * n - 1, 2 * n - 2)
        for k, (one, other) in enumerate(children.tolist()):
            under.append(under[one] | under[other])
            parent[[one, other]] = n + k
        np.testing.assert_array_equal(merged.parent[t], parent)
        np.testing.assert_array_equal(merged.height[t], np.concatenate([np.zeros(n), distances]))
        for k, members in enumerate(under):
            begin = merged.start[t, k]
            assert set(merged.order[t, begin : begin + merged.size[t, k]].tolist()) == members
        for k, (one, other) in enumerate(children.tolist()):  # the lower number stands first
            assert merged.start[t, one] == merged.start[t, n + k]
            assert merged.start[t, other] == merged.start[t, one] + merged.size[t, one]
        for a, b, join in zip(first.tolist(), second.tolist(), merged.join[t].tolist(), strict=True):
            assert join == next(k for k, members in enumerate(under) if {a, b} <= members)


def test_trees_of_a_grid_are_those_of_scikit_learn():
    rng = np.random.default_rng(0)
    first, second = planar(12, 15)
    assert_trees(first, second, rng.standard_normal((3, 180, 4)))


@pytest.mark.parametrize("seed", range(4))
def test_trees_of_any_graph_are_those_of_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    first, second = random_graph(rng, 60, 20 * seed)
    assert_trees(first, second, rng.standard_normal((1, 60, 1 + seed)))


def test_equal_costs_merge_the_lower_numbers_first():
    rng = np.random.default_rng(1)
    first, second = planar(9, 9)
    assert_trees(first, second, np.stack([np.zeros((81, 2)), rng.integers(0, 2, (81, 2)), rng.integers(0, 4, (81, 2))]))


def test_who_stands_first_in_a_pair_is_the_same():
    rng = np.random.default_rng(2)
    first, second = planar(6, 7)
    features = rng.standard_normal((1, 42, 3))
    turned = rng.random(len(first)) < 0.5
    one, other = np.where(turned, second, first), np.where(turned, first, second)
    for name, array in vars(merge_regions(first, second, features)).items():
        np.testing.assert_array_equal(array, getattr(merge_regions(one, other, features), name), err_msg=name)


def test_threads_change_nothing():
    first, second = planar(10, 10)
    features = np.random.default_rng(3).standard_normal((2, 100, 4))
    for name, array in vars(merge_regions(first, second, features)).items():
        np.testing.assert_array_equal(array, getattr(merge_regions(first, second, features, 2), name), err_msg=name)


def test_one_region_is_its_own_tree():
    none = np.zeros(0, np.int64)
    merged = merge_regions(none, none, np.ones((1, 1, 2)))
    assert [array.tolist() for array in vars(merged).values()] == [[[0]], [[0]], [[1]], [[0.0]], [[0]], [[]]]


def test_two_regions_by_hand():
    merged = merge_regions(np.array([0]), np.array([1]), np.array([[[1.0], [4.0]]]))
    assert merged.height[0].tolist() == [0.0, 0.0, 3.0]  # the root of twice 9 * 1 * 1 / 2
    assert merged.join[0].tolist() == [2]


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (([0, 2], [1, 3]), "to 2 parts"),
        (([], []), "to 4 parts"),
        (([0], [4]), "other regions than the 4"),
        (([-1], [2]), "other regions than the 4"),
        (([0, 1], [2]), "other regions than the 4"),
    ],
)
def test_regions_that_are_not_neighbors(pairs, message):
    first, second = (np.array(part, np.int64) for part in pairs)
    with pytest.raises(ValueError, match=message):
        merge_regions(first, second, np.zeros((1, 4, 1)))
