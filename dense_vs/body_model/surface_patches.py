"""Patches of a surface around points and their alignment in later images; for one world on a CPU."""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.tracking.patch_alignment import Patches, align_patches, define_patches
from dense_vs.kernels.views import seen_as


class SurfacePatches:
    """Patches of one size.

    Args:
        window: side of a patch [px], odd.
    """

    def __init__(self, window: int):
        self.window = window
        self._threads = resolve_threads()

    def taken(self, gray: np.ndarray, points: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """The patches ``(K, window^2, 2)`` float32 around ``points`` ``(K, 2)`` [px].

        They hold gray values less 128 and weights. ``weights`` ``(H, W)`` 0..1 says how much each pixel counts.
        """
        count = len(points)
        mask = np.ones(gray.shape, np.float32) if weights is None else np.ascontiguousarray(weights, np.float32)
        patches = Patches.empty(1, count, self.window, "cpu")
        everywhere = wp.full(1, 1, dtype=int, device="cpu")
        mask_array = wp.array(mask[None], dtype=wp.float32, device="cpu")
        define_patches(patches, _image(gray), mask_array, _places(points), everywhere)
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
        patches = Patches(self.window, wp.array(pixels[None], dtype=wp.vec2, device="cpu"))
        places = wp.zeros((1, count), dtype=wp.vec2d, device="cpu")
        maps = wp.zeros((1, count), dtype=wp.mat22, device="cpu")
        correlation = wp.zeros((1, count), dtype=wp.float32, device="cpu")
        start = wp.array(np.asarray(affine, np.float32)[None], dtype=wp.mat22, device="cpu")
        align_patches(patches, _image(gray), _places(guess), start, places, maps, correlation, self._threads)
        return places.numpy()[0].copy(), maps.numpy()[0].copy(), correlation.numpy()[0].copy()


def _image(gray: np.ndarray) -> Any:
    whole = np.ascontiguousarray(gray)
    return seen_as(wp.array(whole, dtype=wp.uint8, device="cpu", copy=False), wp.uint8, (1, *whole.shape))


def _places(points: np.ndarray) -> Any:
    return wp.array(np.asarray(points, np.float64)[None], dtype=wp.vec2d, device="cpu")
