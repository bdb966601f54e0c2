"""A small neural network that tells how likely a pixel belongs to the object: fitted by scikit-learn, run by NumPy.

One hidden layer, so that an image is two matrix products; the weights are plain arrays that a file can hold.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError


@dataclass(frozen=True)
class PixelClassifier:
    """F features, U hidden units."""

    mean: np.ndarray  # (F,) float32
    scale: np.ndarray  # (F,) float32
    hidden: np.ndarray  # (F, U) float32
    hidden_offset: np.ndarray  # (U,) float32
    output: np.ndarray  # (U,) float32
    output_offset: np.ndarray  # () float32

    @classmethod
    def fit(cls, features: np.ndarray, inside: np.ndarray, *, units: int = 48, seed: int = 0) -> "PixelClassifier":
        """Learn from (n, F) features and (n,) bool.

        Raises:
            DenseVSError: scikit-learn is not installed.
        """
        try:
            from sklearn.neural_network import MLPClassifier
        except ImportError as error:
            raise DenseVSError(
                "learning a segmenter needs scikit-learn, which is not installed; pip install 'dense-vs[vos]'"
            ) from error
        import warnings

        mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-3
        options: Any = {"alpha": 1e-2, "max_iter": 25, "batch_size": 256, "random_state": seed}
        network = MLPClassifier((units,), **options)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Stochastic Optimizer: Maximum iterations")
            network.fit((features - mean) / scale, inside)
        weights = (mean, scale, network.coefs_[0], network.intercepts_[0], network.coefs_[1][:, 0])
        return cls(*(np.asarray(w, dtype=np.float32) for w in (*weights, network.intercepts_[1][0])))

    def probability(self, features: np.ndarray) -> np.ndarray:
        """Probability (h, w) float32 of the object at every pixel of features (h, w, F)."""
        flat = features.reshape(-1, features.shape[-1])
        weights = self.hidden / self.scale[:, None]
        hidden = np.maximum(flat @ weights + (self.hidden_offset - self.mean @ weights), 0)
        logit = hidden @ self.output + self.output_offset
        return (1 / (1 + np.exp(-np.clip(logit, -30, 30)))).reshape(features.shape[:-1]).astype(np.float32)
