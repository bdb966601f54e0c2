"""The mean answer of a forest of binary decision trees for many rows of features: a row a thread.

A tree goes left where a feature is at most the node's threshold, as scikit-learn's do; a node without a feature
(-1) is a leaf. All trees lie one after the other in the same arrays.
"""

from typing import Any

import warp as wp

from dense_vs.kernels.launch import launch_pixels

wp.set_module_options({"enable_backward": False})


@wp.kernel
def forest_kernel(
    row_begin: int,
    column_step: int,
    # Data in:
    features_in: wp.array2d(dtype=float),
    root_in: wp.array(dtype=int),
    feature_in: wp.array(dtype=int),
    threshold_in: wp.array(dtype=float),
    left_in: wp.array(dtype=int),
    right_in: wp.array(dtype=int),
    value_in: wp.array(dtype=float),
    # Data out:
    answer_out: wp.array(dtype=float),
):
    """Mean answer of all trees for a row of features."""
    _, row, _ = wp.tid()
    index = row_begin + row
    trees = root_in.shape[0]
    total = float(0.0)
    for tree in range(trees):
        node = root_in[tree]
        while feature_in[node] >= 0:
            if features_in[index, feature_in[node]] <= threshold_in[node]:
                node = left_in[node]
            else:
                node = right_in[node]
        total += value_in[node]
    answer_out[index] = total / float(trees)


def run_forest(features: wp.array, trees: dict[str, wp.array], answer: wp.array, threads: int = 1) -> None:
    """Mean answer (n,) of the trees for features (n, F), all float32 on one device.

    Args:
        features: (n, F).
        trees: ``root`` (T,) int32, first node of every tree; of all M nodes ``feature`` (M,) int32, -1 at a leaf,
            ``threshold`` (M,) float32, ``left`` and ``right`` (M,) int32, ``value`` (M,) float32.
        answer: (n,), written.
        threads: row bands launched at once on a CPU.
    """
    names = ("root", "feature", "threshold", "left", "right", "value")
    arguments: list[Any] = [features, *(trees[name] for name in names), answer]
    launch_pixels(forest_kernel, (1, features.shape[0], 1), arguments, features.device, threads)
