"""The mean answer of a forest of binary decision trees for many rows of features, in C++: a block of rows a thread.

A tree goes left where a feature is at most the node's threshold, as scikit-learn's do. A node is eight bytes and its
children stand side by side, so that a tree stays in a core's cache, and several rows go down a tree together: while one
waits for its node the others' are on their way. Row by row through arrays of their own takes ten times as long.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dense_vs.kernels.launch import launch_pixels

wp.set_module_options({"enable_backward": False})

BLOCK = 64  # rows that go through all trees before the next ones do
_TOGETHER = 8  # rows that go down a tree at once

_ANSWER = f"""
#if !defined(__CUDA_ARCH__)
    constexpr int together = {_TOGETHER}, block = {BLOCK};
    struct Node {{ float threshold; int code; }};
    const Node *nodes = reinterpret_cast<const Node*>(nodes_in.data);
    const int rows = features.shape[0], columns = features.shape[1], trees = root.shape[0];
    const int begin = number * block, end = begin + block < rows ? begin + block : rows;
    const int mask = (1 << bits) - 1;
    float total[block] = {{}};
    for (int tree = 0; tree < trees; ++tree) {{
        for (int first = begin; first < end; first += together) {{
            int at[together];
            const float *row[together];
            for (int k = 0; k < together; ++k) {{
                at[k] = root.data[tree];
                row[k] = features.data + (size_t)(first + k < end ? first + k : end - 1) * columns;
            }}
            for (bool inside = true; inside;) {{
                inside = false;
                #pragma unroll
                for (int k = 0; k < together; ++k) {{
                    const Node node = nodes[at[k]];
                    const bool inner = node.code >= 0;
                    const int feature = inner ? node.code & mask : 0;
                    const int below = (node.code >> bits) + !(row[k][feature] <= node.threshold);
                    at[k] = inner ? below : at[k];
                    inside |= inner;
                }}
            }}
            for (int k = 0; k < together && first + k < end; ++k) total[first + k - begin] += nodes[at[k]].threshold;
        }}
    }}
    for (int row = begin; row < end; ++row) answer_out.data[row] = total[row - begin] / (float)trees;
#endif
"""


@wp.func_native(_ANSWER)
def answer_block(
    number: int,
    bits: int,
    features: wp.array2d(dtype=float),
    root: wp.array(dtype=int),
    nodes_in: wp.array2d(dtype=int),
    answer_out: wp.array(dtype=float),
):
    """Answers for the rows of a block."""
    ...


@wp.kernel
def forest_kernel(
    row_begin: int,
    column_step: int,
    # Data in:
    bits: int,
    features: wp.array2d(dtype=float),
    root: wp.array(dtype=int),
    nodes: wp.array2d(dtype=int),
    # Data out:
    answer_out: wp.array(dtype=float),
):
    """Mean answer of all trees for the rows of features."""
    _, row, _ = wp.tid()
    answer_block(row_begin + row, bits, features, root, nodes, answer_out)


@dataclass(frozen=True)
class PackedForest:
    """T trees with nodes of eight bytes.

    Attributes:
        root: (T,) int32, first node of every tree.
        nodes: (M, 2) int32. The bits of a float32, threshold or a leaf's value; the first child's number shifted by
            ``bits`` with the feature below it, the second child being the next node, or -1 at a leaf.
        bits: of a feature's number.
    """

    root: np.ndarray
    nodes: np.ndarray
    bits: int


def pack_forest(root: np.ndarray, trees: dict[str, np.ndarray]) -> PackedForest:
    """A forest in one array.

    Args:
        root: (T,) int32, first node of every tree.
        trees: of all M nodes ``feature`` (M,) int32, -1 at a leaf, ``threshold`` (M,) float32, ``left`` and ``right``
            (M,) int32, ``value`` (M,) float32.

    Raises:
        ValueError: more nodes and features than an integer of 32 bits has room for.
    """
    feature = trees["feature"]
    inner = feature >= 0
    bits = max(int(feature.max(initial=0)).bit_length(), 1)
    # Roots come first, then the two children of every inner node in turn.
    nodes = np.empty(len(root) + 2 * np.count_nonzero(inner), np.int64)
    if len(nodes) >= 1 << (31 - bits):
        raise ValueError(f"a forest of {len(nodes)} nodes; expected less than {1 << (31 - bits)}")
    nodes[: len(root)] = root
    nodes[len(root) :: 2], nodes[len(root) + 1 :: 2] = trees["left"][inner], trees["right"][inner]
    children = len(root) + 2 * (np.cumsum(inner) - 1)
    code = np.where(inner, (children << bits) + feature, -1)
    number = np.where(inner, trees["threshold"], trees["value"]).astype(np.float32).view(np.int32)
    packed = np.stack([number, code.astype(np.int32)], axis=1)[nodes]
    return PackedForest(np.arange(len(root), dtype=np.int32), np.ascontiguousarray(packed), bits)


def run_forest(features: np.ndarray, forest: PackedForest, threads: int = 1) -> np.ndarray:
    """Mean answer (n,) float32 of the trees for features (n, F) float32, on a CPU.

    Args:
        features: (n, F).
        forest: trees whose features are below F.
        threads: blocks of rows answered at once.
    """
    answer = np.empty(len(features), np.float32)
    if len(features):
        arrays = [_view(array) for array in (np.ascontiguousarray(features), forest.root, forest.nodes, answer)]
        launch_pixels(forest_kernel, (1, -(-len(features) // BLOCK), 1), [forest.bits, *arrays], "cpu", threads)
    return answer


def _view(array: np.ndarray) -> wp.array:
    return wp.array(array, dtype=wp.int32 if array.dtype == np.int32 else wp.float32, device="cpu", copy=False)
