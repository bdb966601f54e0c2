"""A hierarchy of regions over superpixels: neighbours that look alike merge first, so that objects appear as nodes.

Ward's criterion on the superpixels' features with their adjacency as constraint (scikit-learn). Every node of the tree
is a candidate region: n superpixels give 2 n - 1. What adds up over superpixels (areas, moments, histograms) is known
for all nodes from one cumulative sum, as the superpixels under a node are neighbours in depth-first order.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dense_vs.errors import DenseVSError
from dense_vs.segmentation.few_shot.superpixels import Superpixels


@dataclass(frozen=True)
class RegionTree:
    """A tree of N = 2 n - 1 nodes; the first n are the superpixels, a parent comes after its children."""

    parent: np.ndarray  # (N,) the last is its own
    height: np.ndarray  # (N,) Ward's distance at which the node was made, 0 for superpixels
    order: np.ndarray  # (n,) superpixels in depth-first order
    start: np.ndarray  # (N,) where a node's superpixels begin in it
    size: np.ndarray  # (N,) number of superpixels of a node
    join: np.ndarray  # (p,) lowest node that holds both superpixels of a pair

    def node_sums(self, leaf_sums: np.ndarray) -> np.ndarray:
        """Sums (N, c) over nodes from sums (n, c) over superpixels."""
        total = np.zeros((len(leaf_sums) + 1, leaf_sums.shape[1]))
        np.cumsum(leaf_sums[self.order], axis=0, out=total[1:])
        return total[self.start + self.size] - total[self.start]

    def boundary_sums(self, pixels: Superpixels, of_first: np.ndarray, of_second: np.ndarray) -> np.ndarray:
        """Sums (N, c) along the outer boundary of every node, the image's border not counted.

        Args:
            pixels: the superpixels.
            of_first, of_second: what a pair's border counts for its first and its second superpixel, (p, c).
        """
        columns = of_first.shape[1]
        around, inner = np.zeros((pixels.count, columns)), np.zeros((len(self.parent), columns))
        for c in range(columns):
            around[:, c] = np.bincount(pixels.first, of_first[:, c], pixels.count)
            around[:, c] += np.bincount(pixels.second, of_second[:, c], pixels.count)
            inner[:, c] = np.bincount(self.join, of_first[:, c] + of_second[:, c], len(self.parent))
        return self.node_sums(around) - self._over_subtrees(inner)

    def mask(self, pixels: Superpixels, node: int) -> np.ndarray:
        """The node's pixels, bool (h, w)."""
        chosen = np.zeros(pixels.count, dtype=bool)
        chosen[self.order[self.start[node] : self.start[node] + self.size[node]]] = True
        return chosen[pixels.labels]

    def _over_subtrees(self, values: np.ndarray) -> np.ndarray:
        """Sums (N, c) of a value at every inner node over the node and all below it.

        The inner nodes under a node are the joints between its superpixels in depth-first order: each stands
        between the last superpixel of its first child and the first of its second.
        """
        n = len(self.order)
        between = np.zeros((n + 1, values.shape[1]))
        # The second child is the one whose range begins later than its parent's.
        second = np.flatnonzero(self.start > self.start[self.parent])
        between[self.start[second] + 1] = values[self.parent[second]]
        total = np.cumsum(between, axis=0)
        return total[self.start + self.size] - total[self.start + 1]


def region_tree(pixels: Superpixels, features: np.ndarray) -> RegionTree:
    """Merge superpixels by their features (n, c).

    Raises:
        DenseVSError: scikit-learn is not installed.
    """
    try:
        from sklearn.cluster import ward_tree
    except ImportError as error:
        raise DenseVSError(
            "the few-shot segmenter needs scikit-learn, which is not installed; pip install 'dense-vs[vos]'"
        ) from error
    n = pixels.count
    pairs = sparse.coo_matrix((np.ones(len(pixels.first)), (pixels.first, pixels.second)), shape=(n, n))
    merged: Any = ward_tree(features, connectivity=(pairs + pairs.T).tocsr(), return_distance=True)
    children, distances = np.asarray(merged[0]), np.asarray(merged[4])
    nodes = n + len(children)
    parent, size, start = np.full(nodes, nodes - 1), np.ones(nodes, np.int64), np.zeros(nodes, np.int64)
    for k, (one, other) in enumerate(children.tolist()):
        parent[one] = parent[other] = n + k
        size[n + k] = size[one] + size[other]
    for k in range(len(children) - 1, -1, -1):
        one, other = children[k]
        start[one] = start[n + k]
        start[other] = start[n + k] + size[one]
    order = np.argsort(start[:n], kind="stable")
    height = np.concatenate([np.zeros(n), distances])
    return RegionTree(parent, height, order, start, size, _joins(parent, pixels.first, pixels.second))


def _joins(parent: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Lowest common ancestors: as parents come later, the earlier node of a pair climbs until both are one."""
    one, other = first.copy(), second.copy()
    while (apart := one != other).any():
        climbs = apart & (one < other)
        one[climbs] = parent[one[climbs]]
        climbs = apart & ~climbs
        other[climbs] = parent[other[climbs]]
    return one
