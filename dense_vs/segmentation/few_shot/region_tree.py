"""A hierarchy of regions over superpixels: neighbors that look alike merge first, so that objects appear as nodes.

Ward's criterion on the superpixels' features with their adjacency as constraint. Every node of the tree is a candidate
region: n superpixels give 2 n - 1. What adds up over superpixels (areas, moments, histograms) is known for all nodes
from one cumulative sum, as the superpixels under a node are neighbors in depth-first order.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.device import resolve_threads
from dense_vs.kernels.masks.region_merging import merge_regions
from dense_vs.kernels.masks.row_sums import sums_by_row
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

    def boundary_sums(self, around: np.ndarray, of_pair: np.ndarray) -> np.ndarray:
        """Sums (N, c) along the outer boundary of every node, the image's border not counted.

        Args:
            around: sums (N, c) over the nodes' superpixels, each with all of its own border.
            of_pair: (p, c) what a pair's border counts for its two superpixels together; it is inside a node that
                holds both.
        """
        return around - self._over_subtrees(sums_by_row(self.join, of_pair, len(self.parent)))

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


def region_trees(pixels: Superpixels, features: np.ndarray) -> list[RegionTree]:
    """Merge superpixels by their features, once for each of the sets (T, n, c)."""
    merged = merge_regions(pixels.first, pixels.second, features, resolve_threads())
    return [
        RegionTree(merged.parent[t], merged.height[t], merged.order[t], merged.start[t], merged.size[t], merged.join[t])
        for t in range(len(features))
    ]
