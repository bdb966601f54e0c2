"""A packed forest against plain walks down its trees in the same arithmetic: identical answers."""

import numpy as np
import pytest

from dense_vs.kernels.masks.decision_forest import BLOCK, pack_forest, run_forest

NAMES = ("feature", "threshold", "left", "right", "value")


def random_forest(rng, trees, features, depth):
    """Trees of uneven depth, their children in any order behind them."""
    nodes, root = [], []

    def grow(left_to_go):
        place = len(nodes)
        nodes.append(None)
        if left_to_go == 0 or rng.random() < 0.2:
            nodes[place] = (-1, 0.0, -1, -1, rng.standard_normal())
            return place
        sides = [grow(left_to_go - 1) for _ in range(2)]
        one, other = sides if rng.random() < 0.5 else sides[::-1]
        # Thresholds among few values, so that features equal them.
        nodes[place] = (int(rng.integers(features)), float(rng.integers(-2, 3)) / 2, one, other, np.nan)
        return place

    for _ in range(trees):
        root.append(grow(depth))
    columns = zip(*nodes, strict=True)
    kinds = (np.int32, np.float32, np.int32, np.int32, np.float32)
    arrays = {name: np.array(column, kind) for name, column, kind in zip(NAMES, columns, kinds, strict=True)}
    return np.array(root, np.int32), arrays


def walked(features, root, trees):
    answers = np.zeros(len(features), np.float32)
    for index, row in enumerate(features):
        total = np.float32(0)
        for first in root.tolist():
            node = first
            while trees["feature"][node] >= 0:
                side = "left" if row[trees["feature"][node]] <= trees["threshold"][node] else "right"
                node = trees[side][node]
            total += trees["value"][node]
        answers[index] = total / np.float32(len(root))
    return answers


@pytest.mark.parametrize("rows", [0, 1, 7, 8, 9, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_answers_are_those_of_plain_walks(rows):
    rng = np.random.default_rng(rows)
    root, trees = random_forest(rng, 7, 5, 6)
    features = (rng.integers(-4, 5, (rows, 5)) / 4).astype(np.float32)
    for threads in (1, 2):
        np.testing.assert_array_equal(
            run_forest(features, pack_forest(root, trees), threads), walked(features, root, trees)
        )


@pytest.mark.parametrize("features", [1, 2, 3, 255, 256, 257, 3000])
def test_any_number_of_features(features):
    rng = np.random.default_rng(features)
    root, trees = random_forest(rng, 5, features, 5)
    rows = rng.standard_normal((20, features)).astype(np.float32)
    np.testing.assert_array_equal(run_forest(rows, pack_forest(root, trees)), walked(rows, root, trees))


def test_what_is_no_number_goes_right_and_stays_in_a_leaf():
    root, trees = random_forest(np.random.default_rng(0), 6, 2, 4)
    rows = np.array([[np.nan, 0.0], [np.inf, -np.inf], [np.nan, np.nan]], np.float32)
    np.testing.assert_array_equal(run_forest(rows, pack_forest(root, trees)), walked(rows, root, trees))


def test_trees_that_are_single_leaves():
    trees = {"feature": [-1, -1], "threshold": [0, 0], "left": [-1, -1], "right": [-1, -1], "value": [0.25, 0.5]}
    kinds = (np.int32, np.float32, np.int32, np.int32, np.float32)
    arrays = {name: np.array(trees[name], kind) for name, kind in zip(NAMES, kinds, strict=True)}
    packed = pack_forest(np.array([1, 0, 1], np.int32), arrays)
    assert run_forest(np.zeros((2, 3), np.float32), packed).tolist() == [np.float32(1.25) / np.float32(3)] * 2


def test_more_nodes_than_there_is_room_for():
    few = {name: np.zeros(3, np.float32 if name in ("threshold", "value") else np.int32) for name in NAMES}
    few["feature"][:] = [(1 << 29) - 1, -1, -1]
    few["left"][0], few["right"][0] = 1, 2
    assert pack_forest(np.array([0], np.int32), few).bits == 29
    few["feature"][0] = 1 << 29
    with pytest.raises(ValueError, match="3 nodes; expected less than 2"):
        pack_forest(np.array([0], np.int32), few)
