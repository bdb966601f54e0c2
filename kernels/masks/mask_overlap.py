"""Intersection and union of masks with many candidate masks at once, for the Jaccard index of VOS-VS (22).

Masks are packed to a bit a pixel first, so that one operation compares 64 pixels.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch, row_bands
from dense_vs.kernels.masks.mask_words import WordMasks, packed_byte, set_bytes

wp.set_module_options({"enable_backward": False})

BITS = 64  # pixels of a packed word


@dataclass(frozen=True)
class Overlap:
    """Pixel counts.

    Attributes:
        intersection: ``(worlds, candidates)`` int64 [px].
        union: ``(worlds, candidates)`` int64 [px].
    """

    intersection: np.ndarray
    union: np.ndarray

    @property
    def jaccard(self) -> np.ndarray:
        """Intersection over union, float64 ``(worlds, candidates)``; 0 where both masks are empty."""
        return np.divide(self.intersection, self.union, out=np.zeros(self.union.shape), where=self.union > 0)


class OverlapReducer:
    """Compares the mask of every world with the same candidates, without allocating on the device.

    Args:
        worlds, height, width: of the masks.
        candidates: how many.
        device: Warp device.
        threads: CPU threads.
    """

    def __init__(self, worlds: int, height: int, width: int, candidates: int, device: Any = "cpu", threads: int = 1):
        device = wp.get_device(device)
        self._masks = _BitMasks(worlds, height, width, device, threads)
        self._candidates = _BitMasks(candidates, height, width, device, threads)
        bands = row_bands(threads, height, device)
        self._counts = wp.zeros((bands, worlds, candidates, 3), dtype=wp.int32, device=device)
        self._launch = PixelLaunch(
            count_overlap,
            (worlds * candidates, height, 1),
            [bands, self._masks.bits, self._candidates.bits, self._counts],
            device,
            threads,
        )

    def set_candidates(self, candidates: Any) -> None:
        """Take candidate masks ``(candidates, H, W)``, uint8 or bool; they stay until the next call.

        Raises:
            ValueError: another shape or dtype.
        """
        self._candidates.take(candidates)

    def __call__(self, masks: Any) -> Overlap:
        """Compare masks ``(worlds, H, W)``, uint8 or bool, with the candidates.

        Raises:
            ValueError: another shape or dtype.
        """
        self._masks.take(masks)
        self._counts.zero_()
        self._launch()
        counts = self._counts.numpy().astype(np.int64).sum(axis=0)
        both = counts[..., 2]
        return Overlap(both, counts[..., 0] + counts[..., 1] - both)


class _BitMasks:
    """Masks of a bit a pixel, uint64 ``(n, H, ceil(W / 64))``."""

    def __init__(self, count: int, height: int, width: int, device: wp.Device, threads: int):
        self._staged = WordMasks(count, height, width, device)
        row = -(-width // BITS)
        self.bits = wp.zeros((count, height, row), dtype=wp.uint64, device=device)
        self._pack = PixelLaunch(pack_bits, (count, height, row), [self._staged.words, self.bits], device, threads)

    def take(self, masks: Any) -> None:
        self._staged.stage(masks)
        self._pack()


@wp.kernel
def pack_bits(
    row_begin: int,
    column_step: int,
    # In:
    words_in: wp.array3d(dtype=wp.uint64),
    # Out:
    bits_out: wp.array3d(dtype=wp.uint64),
):
    """Eight words of eight bytes into one of 64 bits, in an order that is the same for all masks."""
    world, row, column = wp.tid()
    y = row_begin + row
    last = words_in.shape[2]
    for k in range(column, bits_out.shape[2], column_step):
        packed = wp.uint64(0)
        for word in range(8):
            if k * 8 + word < last:
                packed = (packed << wp.uint64(8)) | packed_byte(set_bytes(words_in[world, y, k * 8 + word]))
        bits_out[world, y, k] = packed


@wp.func
def count_bits(word: wp.uint64) -> int:
    """How many bits of the word are set."""
    pairs = word - ((word >> wp.uint64(1)) & wp.uint64(0x5555555555555555))
    fours = (pairs & wp.uint64(0x3333333333333333)) + ((pairs >> wp.uint64(2)) & wp.uint64(0x3333333333333333))
    bytes = (fours + (fours >> wp.uint64(4))) & wp.uint64(0x0F0F0F0F0F0F0F0F)
    return int((bytes * wp.uint64(0x0101010101010101)) >> wp.uint64(56))


@wp.kernel
def count_overlap(
    row_begin: int,
    column_step: int,
    bands: int,
    # In:
    masks_in: wp.array3d(dtype=wp.uint64),
    candidates_in: wp.array3d(dtype=wp.uint64),
    # Out:
    counts_out: wp.array4d(dtype=int),  # (bands, worlds, candidates, 3): of mask, candidate, both
):
    """Count the pixels of a row, a thread a row on any device: it is only a few packed words."""
    pair, row, _ = wp.tid()
    y = row_begin + row
    candidates = candidates_in.shape[0]
    world = pair / candidates
    candidate = pair - world * candidates
    of_mask = int(0)
    of_candidate = int(0)
    of_both = int(0)
    for k in range(masks_in.shape[2]):
        mask = masks_in[world, y, k]
        other = candidates_in[candidate, y, k]
        of_mask += count_bits(mask)
        of_candidate += count_bits(other)
        of_both += count_bits(mask & other)
    # PixelLaunch began this band at row height * band // bands.
    height = masks_in.shape[1]
    band = (row_begin * bands + height - 1) / height
    wp.atomic_add(counts_out, band, world, candidate, 0, of_mask)
    wp.atomic_add(counts_out, band, world, candidate, 1, of_candidate)
    wp.atomic_add(counts_out, band, world, candidate, 2, of_both)
