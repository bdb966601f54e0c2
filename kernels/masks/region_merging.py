"""Ward's hierarchy of neighboring regions, in C++: a tree for every set of features.

The two neighbors whose merging adds least to the sum of squared distances from the regions' means merge first (Ward
1963, with the adjacency as constraint); of equal ones those with the lower numbers. Every border between two regions
stands once in a heap and is moved in it when a merger changes what it costs; of two borders between the same regions
one is dropped. Distances, their order and ties are those of scikit-learn's ``ward_tree``.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dense_vs.kernels.launch import launch_pixels

wp.set_module_options({"enable_backward": False})


_MERGE = """
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    const int n = features.shape[1], columns = features.shape[2], pairs = first.shape[0], nodes = 2 * n - 1;
    int *parent = nodes_out.data + (size_t)tree * 3 * nodes, *start = parent + nodes, *size = start + nodes;
    int *order = order_out.data + (size_t)tree * n, *join = join_out.data + (size_t)tree * pairs;
    double *height = height_out.data + (size_t)tree * nodes;
    const double *given = features.data + (size_t)tree * n * columns;
    // What the tree is worked out in; see merging_memory.
    double *reals = reals_in_work.data + (size_t)tree * reals_in_work.shape[1];
    double *means = reals, *sums = means + (size_t)nodes * columns, *cost = sums + (size_t)nodes * columns;
    int *left = wholes_in_work.data + (size_t)tree * wholes_in_work.shape[1];
    const auto take = [&](int count) { left += count; return left - count; };
    int *children = take(2 * n);
    int *first_half = take(nodes);  // first of a node's halves of borders, -1 at the end
    int *met_by = take(nodes), *met = take(nodes);  // the merged node that has met this one, and by which border
    int *next_half = take(2 * pairs);
    int *ends = take(2 * pairs);  // nodes of a border, -1 where it is gone
    int *heap = take(pairs), *place = take(pairs);
    int *instead = take(pairs);  // border that stands for a dropped one, -1 where it stands itself

    // Ward's cost of the merger at a border: what it adds to the sum of squared distances from the means.
    const auto price = [&](int border) {
        const int one = ends[2 * border], other = ends[2 * border + 1];
        const double a = size[one], b = size[other];
        double squares = 0.0;
        for (int c = 0; c < columns; ++c) {
            const double off = means[(size_t)one * columns + c] - means[(size_t)other * columns + c];
            squares += off * off;
        }
        cost[border] = squares * ((a * b) / (a + b));
    };
    const auto before = [&](int one, int other) {
        if (cost[one] != cost[other]) return cost[one] < cost[other];
        const int *a = ends + 2 * one, *b = ends + 2 * other;
        const int later_a = a[0] > a[1] ? a[0] : a[1], later_b = b[0] > b[1] ? b[0] : b[1];
        if (later_a != later_b) return later_a < later_b;
        return a[0] + a[1] - later_a < b[0] + b[1] - later_b;
    };
    int count = 0;
    const auto rise = [&](int border, int at) {
        while (at > 0 && before(border, heap[(at - 1) / 2])) {
            heap[at] = heap[(at - 1) / 2];
            place[heap[at]] = at;
            at = (at - 1) / 2;
        }
        heap[at] = border;
        place[border] = at;
        return at;
    };
    const auto sink = [&](int border, int at) {
        for (int below = 2 * at + 1; below < count; below = 2 * at + 1) {
            if (below + 1 < count && before(heap[below + 1], heap[below])) ++below;
            if (!before(heap[below], border)) break;
            heap[at] = heap[below];
            place[heap[at]] = at;
            at = below;
        }
        heap[at] = border;
        place[border] = at;
    };
    const auto settle = [&](int border, int at) { sink(border, rise(border, at)); };
    const auto drop = [&](int border) {
        const int at = place[border], last = heap[--count];
        ends[2 * border] = ends[2 * border + 1] = -1;
        if (last != border) settle(last, at);
    };

    for (int k = 0; k < nodes; ++k) { parent[k] = nodes - 1; first_half[k] = -1; met_by[k] = -1; }
    for (int k = 0; k < n; ++k) {
        size[k] = 1;
        height[k] = 0.0;
        for (int c = 0; c < columns; ++c) means[k * columns + c] = sums[k * columns + c] = given[k * columns + c];
    }
    for (int e = 0; e < pairs; ++e) {
        const int both[2] = {first.data[e], second.data[e]};
        for (int side = 0; side < 2; ++side) {
            ends[2 * e + side] = both[side];
            next_half[2 * e + side] = first_half[both[side]];
            first_half[both[side]] = 2 * e + side;
        }
        instead[e] = -1;
        price(e);
        heap[e] = e;
        place[e] = e;
    }
    count = pairs;
    for (int at = pairs / 2 - 1; at >= 0; --at) sink(heap[at], at);

    int made = n;
    for (; made < nodes && count > 0; ++made) {
        const int border = heap[0];
        const int one = ends[2 * border] < ends[2 * border + 1] ? ends[2 * border] : ends[2 * border + 1];
        const int other = ends[2 * border] + ends[2 * border + 1] - one, of_merged[2] = {one, other};
        height[made] = sqrt(2.0 * cost[border]);
        join[border] = made;
        drop(border);
        parent[one] = parent[other] = made;
        children[2 * (made - n)] = one;
        children[2 * (made - n) + 1] = other;
        size[made] = size[one] + size[other];
        for (int c = 0; c < columns; ++c) {
            const size_t to = (size_t)made * columns + c;
            sums[to] = sums[(size_t)other * columns + c] + sums[(size_t)one * columns + c];
            means[to] = sums[to] / size[made];
        }
        for (int which = 0; which < 2; ++which) {
            for (int half = first_half[of_merged[which]], next; half >= 0; half = next) {
                next = next_half[half];
                const int e = half / 2, beyond = ends[half ^ 1];
                if (beyond < 0) continue;
                if (met_by[beyond] == made) {
                    instead[e] = met[beyond];
                    drop(e);
                    continue;
                }
                met_by[beyond] = made;
                met[beyond] = e;
                ends[half] = made;
                next_half[half] = first_half[made];
                first_half[made] = half;
                price(e);
                settle(e, place[e]);
            }
        }
    }
    for (int e = 0; e < pairs; ++e) {
        int standing = e;
        while (instead[standing] >= 0) standing = instead[standing];
        join[e] = join[standing];
    }
    made_out.data[tree] = made;
    if (made < nodes) return;
    start[nodes - 1] = 0;
    for (int k = nodes - 1; k >= n; --k) {
        const int one = children[2 * (k - n)], other = children[2 * (k - n) + 1];
        start[one] = start[k];
        start[other] = start[k] + size[one];
    }
    for (int k = 0; k < n; ++k) order[start[k]] = k;
#endif
"""


@wp.func_native(_MERGE)
def merge(
    tree: int,
    features: wp.array3d(dtype=wp.float64),
    first: wp.array(dtype=int),
    second: wp.array(dtype=int),
    reals_in_work: wp.array2d(dtype=wp.float64),
    wholes_in_work: wp.array2d(dtype=int),
    made_out: wp.array(dtype=int),
    nodes_out: wp.array3d(dtype=int),
    height_out: wp.array2d(dtype=wp.float64),
    order_out: wp.array2d(dtype=int),
    join_out: wp.array2d(dtype=int),
):
    """One tree."""
    ...


@wp.kernel
def merge_kernel(
    row_begin: int,
    column_step: int,
    # Data in:
    features: wp.array3d(dtype=wp.float64),
    first: wp.array(dtype=int),
    second: wp.array(dtype=int),
    reals_in_work: wp.array2d(dtype=wp.float64),
    wholes_in_work: wp.array2d(dtype=int),
    # Data out:
    made_out: wp.array(dtype=int),
    nodes_out: wp.array3d(dtype=int),
    height_out: wp.array2d(dtype=wp.float64),
    order_out: wp.array2d(dtype=int),
    join_out: wp.array2d(dtype=int),
):
    """A tree a thread."""
    _, row, _ = wp.tid()
    merge(
        row_begin + row, features, first, second, reals_in_work, wholes_in_work,
        made_out, nodes_out, height_out, order_out, join_out,
    )  # fmt: skip


@dataclass(frozen=True)
class MergedRegions:
    """T trees of N = 2 n - 1 nodes; the first n are the regions, and a parent comes after its children.

    Attributes:
        parent: (T, N) int32, the last its own.
        start: (T, N) int32, where a node's regions begin in the order.
        size: (T, N) int32, number of regions of a node.
        height: (T, N) float64, Ward's distance at which a node was made, 0 for the regions themselves.
        order: (T, n) int32, regions in depth-first order, the child with the lower number first.
        join: (T, p) int32, lowest node that holds both regions of a pair.
    """

    parent: np.ndarray
    start: np.ndarray
    size: np.ndarray
    height: np.ndarray
    order: np.ndarray
    join: np.ndarray


def merge_regions(first: np.ndarray, second: np.ndarray, features: np.ndarray, threads: int = 1) -> MergedRegions:
    """Merge n regions into one, once for every set of features.

    Args:
        first, second: (p,) the regions of each pair of neighbors, no pair twice.
        features: (T, n, c) finite, compared by their Euclidean distance.
        threads: trees made at once.

    Raises:
        ValueError: numbers that are not those of regions, or regions that no way through neighbors joins.
    """
    trees, n, columns = features.shape
    pairs, nodes = len(first), 2 * n - 1
    if len(second) != pairs or any(part.size and not 0 <= part.min() <= part.max() < n for part in (first, second)):
        raise ValueError(f"pairs are of other regions than the {n} that have features")
    made = np.zeros(trees, np.int32)
    numbers = np.empty((trees, 3, nodes), np.int32)
    height = np.empty((trees, nodes))
    order, join = np.empty((trees, n), np.int32), np.empty((trees, pairs), np.int32)
    work = np.empty((trees, 2 * nodes * columns + pairs)), np.empty((trees, 2 * n + 3 * nodes + 7 * pairs), np.int32)
    inputs = features.astype(np.float64), first.astype(np.int32), second.astype(np.int32)
    arguments = [_view(part) for part in (*inputs, *work, made, numbers, height, order, join)]
    launch_pixels(merge_kernel, (1, trees, 1), arguments, "cpu", threads)
    if (made < nodes).any():
        raise ValueError(f"{n} regions whose neighbors join them to {nodes + 1 - made.min()} parts; expected one")
    return MergedRegions(numbers[:, 0], numbers[:, 1], numbers[:, 2], height, order, join)


def _view(array: np.ndarray) -> wp.array:
    dtype = wp.int32 if array.dtype == np.int32 else wp.float64
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device="cpu", copy=False)
