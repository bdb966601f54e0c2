"""Features held to how they looked at first: taken from image to image alone, their places drift.

On a plain link most features lie along edges and shading, where every image adds some hundredths of a pixel, always to
the same side as the link turns: after a hundred images such features were 2 px off (median of a Panda's, by the truth),
and the chain that is adjusted to them with them. A feature's first look, turned as it was last seen, tells where it is.
"""

import numpy as np

from dense_vs.body_model.surface_patches import SurfacePatches

WINDOW = 15  # px, side of a look
SURE, REALIGNED = 0.9, 2.0  # correlation with the first look, and px, for a place to be corrected by that look
UNLIKE = 0.5  # correlation at which a feature is given up


class FeatureLooks:
    """First looks of features, by number."""

    def __init__(self):
        self._patches = SurfacePatches(WINDOW)
        self._pixels = np.zeros((0, WINDOW * WINDOW, 2), np.float32)
        self._maps = np.zeros((0, 2, 2))

    def take(self, numbers: np.ndarray, gray: np.ndarray, places: np.ndarray) -> None:
        """Take how features look now.

        Args:
            numbers: ``(K,)`` of the features; new ones follow on those that there are.
            gray: uint8 ``(H, W)``.
            places: ``(K, 2)`` [px].
        """
        if not len(numbers):
            return
        new = max(0, int(numbers.max()) + 1 - len(self._maps))
        self._pixels = np.concatenate([self._pixels, np.zeros((new, *self._pixels.shape[1:]), np.float32)])
        self._maps = np.concatenate([self._maps, np.zeros((new, 2, 2))])
        self._pixels[numbers] = self._patches.taken(gray, places)
        self.unturned(numbers)

    def unturned(self, numbers: np.ndarray) -> None:
        """Features are seen as they were seen first: the robot is back where it was then."""
        self._maps[numbers] = np.eye(2)

    def held(
        self, numbers: np.ndarray, gray: np.ndarray, places: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places of features by their looks.

        Args:
            numbers: ``(K,)`` of the features.
            gray: uint8 ``(H, W)``.
            places: ``(K, 2)`` where they are about [px].

        Returns:
            Places ``(K, 2)`` [px], corrected where the look says so for sure; bool ``(K,)``, where it does; bool
            ``(K,)``, whether what is seen there is like the feature at all.
        """
        if not len(numbers):
            return places.copy(), np.zeros(0, bool), np.zeros(0, bool)
        aligned, sure, correlation = self._aligned(numbers, gray, places, self._maps[numbers], REALIGNED)
        return np.where(sure[:, None], aligned, places), sure, correlation > UNLIKE

    def sought(
        self, numbers: np.ndarray, gray: np.ndarray, places: np.ndarray, maps: np.ndarray, most_off: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places of features that are not in sight, by looks turned by maps ``(K, 2, 2)``; bool ``(K,)``, where sure.

        Args:
            numbers, gray, places: as of :meth:`held`.
            maps: from px about a feature where its look was taken to px here.
            most_off: px that it may be from where it is expected.
        """
        if not len(numbers):
            return places.copy(), np.zeros(0, bool)
        return self._aligned(numbers, gray, places, maps, most_off)[:2]

    def _aligned(
        self, numbers: np.ndarray, gray: np.ndarray, places: np.ndarray, maps: np.ndarray, most_off: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places by the looks, where they are sure, and correlations; keeps how those that are sure are turned."""
        aligned, turned, correlation = self._patches.align(self._pixels[numbers], gray, places, maps)
        sure = (correlation > SURE) & (np.linalg.norm(aligned - places, axis=1) < most_off)
        self._maps[numbers[sure]] = turned[sure]
        return aligned, sure, correlation

    def renumber(self, renumbered: np.ndarray) -> None:
        """Take on new numbers ``(M,)``, in the same order, -1 for features that are forgotten."""
        self._pixels, self._maps = self._pixels[renumbered >= 0], self._maps[renumbered >= 0]
