"""A forest of extremely randomized trees: grown by scikit-learn, kept as plain arrays, run by a kernel.

Plain arrays go into a file without pickle and need no scikit-learn to be read; packed into one, they answer for an
image in a few milliseconds, with the bits that a walk through the plain ones has.
"""

from dataclasses import dataclass, field

import numpy as np

from dense_vs.device import resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.files import stored_array
from dense_vs.kernels.masks.decision_forest import PackedForest, pack_forest, run_forest

NODE_ARRAYS = ("feature", "threshold", "left", "right", "value")


@dataclass(frozen=True)
class DecisionForest:
    """T trees with M nodes in all, for rows of ``features`` numbers."""

    features: int
    root: np.ndarray  # (T,) int32
    feature: np.ndarray  # (M,) int32, -1 at a leaf
    threshold: np.ndarray  # (M,) float32
    left: np.ndarray  # (M,) int32
    right: np.ndarray  # (M,) int32
    value: np.ndarray  # (M,) float32
    _packed: PackedForest = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        nodes, trees = len(self.feature), len(self.root)
        sizes = {name: len(getattr(self, name)) for name in NODE_ARRAYS}
        if set(sizes.values()) != {nodes}:
            raise DenseVSError(f"a forest of {trees} trees and {sizes} nodes; expected trees whose nodes fit together")
        inner = self.feature >= 0
        # Children after their node: no loop, and every way ends at a leaf.
        forward = all(np.all(side[inner] > np.flatnonzero(inner)) for side in (self.left, self.right))
        inside = all(np.all(side[inner] < nodes) for side in (self.left, self.right))
        rooted = trees > 0 and np.all((self.root >= 0) & (self.root < nodes))
        if not (forward and inside and rooted) or np.any(self.feature >= self.features):
            raise DenseVSError(f"a forest of {trees} trees and {sizes} nodes; expected trees whose nodes fit together")
        try:
            packed = pack_forest(self.root, {name: getattr(self, name) for name in NODE_ARRAYS})
        except ValueError as error:
            raise DenseVSError(str(error)) from error
        object.__setattr__(self, "_packed", packed)

    @classmethod
    def grow(
        cls,
        features: np.ndarray,
        target: np.ndarray,
        weight: np.ndarray | None = None,
        *,
        trees: int,
        min_leaf: int,
        share: float,
        seed: int,
    ) -> "DecisionForest":
        """Learn to tell a target (n,) from features (n, F) by mean squared error.

        Args:
            features: of the examples.
            target: of the examples; 0 and 1 make the answer a probability.
            weight: of the examples (n,).
            trees: how many.
            min_leaf: fewest examples in a leaf.
            share: of the features that a split looks at.
            seed: of the random splits.

        Raises:
            DenseVSError: scikit-learn is not installed.
        """
        try:
            from sklearn.ensemble import ExtraTreesRegressor
        except ImportError as error:
            raise DenseVSError(
                "learning a segmenter needs scikit-learn, which is not installed; pip install 'dense-vs[vos]'"
            ) from error
        forest = ExtraTreesRegressor(
            trees, min_samples_leaf=min_leaf, max_features=share, n_jobs=resolve_threads(), random_state=seed
        )
        forest.fit(features.astype(np.float32), target, sample_weight=weight)
        grown = [one.tree_ for one in forest.estimators_]
        roots = np.concatenate([[0], np.cumsum([tree.node_count for tree in grown])[:-1]])
        leaf = [tree.children_left < 0 for tree in grown]
        return cls(
            features.shape[1],
            roots.astype(np.int32),
            np.concatenate([np.where(b, -1, t.feature) for t, b in zip(grown, leaf, strict=True)]).astype(np.int32),
            np.concatenate([t.threshold for t in grown]).astype(np.float32),
            np.concatenate([t.children_left + r for t, r in zip(grown, roots, strict=True)]).astype(np.int32),
            np.concatenate([t.children_right + r for t, r in zip(grown, roots, strict=True)]).astype(np.int32),
            np.concatenate([t.value[:, 0, 0] for t in grown]).astype(np.float32),
        )

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """Mean answer of the trees (n,) float32 for features (n, F).

        Raises:
            DenseVSError: another number of features.
        """
        if features.ndim != 2 or features.shape[1] != self.features:
            raise DenseVSError(f"features have shape {features.shape}; expected (n, {self.features})")
        return run_forest(features.astype(np.float32, copy=False), self._packed, resolve_threads())

    def arrays(self, prefix: str) -> dict[str, np.ndarray]:
        """The arrays under names with a prefix, for a file."""
        stored = {name: getattr(self, name) for name in ("root", *NODE_ARRAYS)}
        return {f"{prefix}_{name}": array for name, array in stored.items()} | {
            f"{prefix}_features": np.array(self.features)
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray], prefix: str) -> "DecisionForest":
        """What :meth:`arrays` gave.

        Raises:
            KeyError: an array is missing.
            DenseVSError: they do not fit together.
        """
        stored = {}
        for name in ("root", *NODE_ARRAYS):
            real = name in ("threshold", "value")
            array = stored_array(arrays, f"{prefix}_{name}", (-1,), "f" if real else "i")
            stored[name] = array.astype(np.float32 if real else np.int32)
        return cls(int(stored_array(arrays, f"{prefix}_features", (), "iu")), **stored)
