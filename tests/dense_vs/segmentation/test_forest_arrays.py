"""A forest whose arrays do not make trees is refused in words: a file may hold anything."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation.few_shot.decision_forest import DecisionForest


def forest(**changed):
    """A tree of one question with two leaves, and a leaf alone."""
    arrays = {
        "root": [0, 3], "feature": [1, -1, -1, -1], "threshold": [0.5, 0, 0, 0], "left": [1, -1, -1, -1],
        "right": [2, -1, -1, -1], "value": [0, 0.25, 0.75, 1.0],
    } | changed  # fmt: skip
    kinds = dict.fromkeys(("root", "feature", "left", "right"), np.int32)
    return DecisionForest(2, **{name: np.array(value, kinds.get(name, np.float32)) for name, value in arrays.items()})


def test_trees_that_fit_together_are_a_forest():
    assert len(forest().root) == 2


@pytest.mark.parametrize(
    "changed",
    [
        {"root": []},
        {"root": [0, 4]},
        {"root": [-1, 3]},
        {"left": [4, -1, -1, -1]},
        {"right": [0, -1, -1, -1]},
        {"left": [0, -1, -1, -1]},
        {"feature": [2, -1, -1, -1]},
        {"value": [0, 0.25, 0.75]},
    ],
)
def test_what_is_no_forest_is_refused(changed):
    with pytest.raises(DenseVSError, match=r"forest of . trees and .*; expected trees whose nodes fit together"):
        forest(**changed)
