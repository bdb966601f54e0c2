"""A small vocabulary of colours: half of it the object's, half the background's, so that histograms tell them apart."""

from dataclasses import dataclass

import cv2
import numpy as np

_BITS = 5  # of each of R, G, B in the look-up table


@dataclass(frozen=True)
class ColourWords:
    """Which of K words a colour is, as a table over RGB in steps of 8."""

    count: int
    table: np.ndarray  # (32768,) uint8

    @classmethod
    def fit(cls, inside: np.ndarray, outside: np.ndarray, *, words: int, seed: int) -> "ColourWords":
        """Cluster the object's and the background's colours, RGB uint8 (n, 3) each, into half of the words each."""
        from sklearn.cluster import KMeans

        levels = (np.arange(1 << _BITS) * 8 + 4).astype(np.uint8)
        every = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
        centres = []
        for colours in (inside, outside):
            found = min(words // 2, len(np.unique(colours, axis=0)))
            kmeans = KMeans(found, random_state=seed).fit(_lab(colours))
            centres.append(kmeans.cluster_centers_)
        centre = np.concatenate(centres).astype(np.float32)
        distance = ((_lab(every)[:, None] - centre) ** 2).sum(axis=2)
        return cls(len(centre), distance.argmin(axis=1).astype(np.uint8))

    def of(self, rgb: np.ndarray) -> np.ndarray:
        """Words (h, w) uint8 of an RGB uint8 image."""
        levels = (rgb >> (8 - _BITS)).astype(np.int32)
        return self.table[(levels[..., 0] << (2 * _BITS)) + (levels[..., 1] << _BITS) + levels[..., 2]]


def _lab(colours: np.ndarray) -> np.ndarray:
    """RGB uint8 (n, 3) as float32 Lab (n, 3), weighted as in :mod:`dense_vs.segmentation.few_shot.pixel_channels`."""
    rgb = colours[None].astype(np.float32) / np.float32(255)
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab)[0] * np.array([0.01, 0.015, 0.015], np.float32)
