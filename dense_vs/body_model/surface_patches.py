"""Patches of a surface around points and their alignment in later images; for one world on a CPU."""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.tracking.patch_alignment import PatchAlignment, Patches, define_patches


class SurfacePatches:
    """Patches of one size.

    Args:
        window: side of a patch [px], odd.
    """

    def __init__(self, window: int):
        self.window = window
        self._threads = resolve_threads()
        self._memory: _AlignmentMemory | None = None

    def taken(self, gray: np.ndarray, points: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """The patches ``(K, window^2, 2)`` float32 around ``points`` ``(K, 2)`` [px].

        They hold gray values less 128 and weights. ``weights`` ``(H, W)`` 0..1 says how much each pixel counts.
        """
        count = len(points)
        mask = np.ones(gray.shape, np.float32) if weights is None else np.asarray(weights, np.float32)
        patches = Patches.empty(1, count, self.window, "cpu")
        everywhere = wp.full(1, 1, dtype=int, device="cpu")
        places = _seen(np.asarray(points, np.float64)[None], wp.vec2d)
        define_patches(patches, _seen(gray[None], wp.uint8), _seen(mask[None], wp.float32), places, everywhere)
        return patches.pixels.numpy().reshape(count, self.window**2, 2).copy()

    def align(
        self, pixels: np.ndarray, gray: np.ndarray, guess: np.ndarray, affine: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where patches ``(K, window^2, 2)`` are seen: places ``(K, 2)`` [px], maps ``(K, 2, 2)``, correlations.

        Args:
            pixels: as :meth:`taken` gave them.
            gray: uint8 ``(H, W)``.
            guess: ``(K, 2)`` [px] and affine ``(K, 2, 2)``: what to begin with.
            affine: from a patch to the image.
        """
        count = len(guess)
        memory = self._memory
        if memory is None or memory.most < count or memory.size != gray.shape:
            most = count if memory is None else max(count, 2 * memory.most)
            self._memory = memory = _AlignmentMemory(self.window, most, gray.shape)
        memory.image[0], memory.pixels[0, :count] = gray, pixels
        memory.guess[0, :count], memory.start[0, :count] = guess, affine
        memory.alignment(count, self._threads)
        return memory.places[0, :count].copy(), memory.maps[0, :count].copy(), memory.correlation[0, :count].copy()


class _AlignmentMemory:
    """What up to ``most`` patches are aligned in: packing its arrays takes ten times as long as to align one patch."""

    def __init__(self, window: int, most: int, size: tuple[int, ...]):
        self.most, self.size = most, size
        self.image = np.zeros((1, *size), np.uint8)
        self.pixels = np.zeros((1, most, window**2, 2), np.float32)
        self.guess, self.places = np.zeros((2, 1, most, 2))
        self.start, self.maps = np.zeros((2, 1, most, 2, 2), np.float32)
        self.correlation = np.zeros((1, most), np.float32)
        self.alignment = PatchAlignment(
            Patches(window, _seen(self.pixels, wp.vec2)), _seen(self.image, wp.uint8), _seen(self.guess, wp.vec2d),
            _seen(self.start, wp.mat22), _seen(self.places, wp.vec2d), _seen(self.maps, wp.mat22),
            _seen(self.correlation, wp.float32),
        )  # fmt: skip


def _seen(values: np.ndarray, dtype: Any) -> Any:
    """The same memory as a Warp array."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu", copy=False)
