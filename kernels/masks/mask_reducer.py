"""One pass over masks, eight pixels at once: area and centroid, VOS-VS (3), VOS-VS (4), VOS-VS (5), box, second moments
and border contact.
"""

from typing import Any

import warp as wp

from dense_vs.kernels.masks.mask_words import (
    WEIGHTS_ONE,
    WEIGHTS_X,
    WEIGHTS_XX,
    WORD,
    WordMasks,
    set_bytes,
    weighted_bytes,
)
from dense_vs.kernels.masks.region_sums import PartialSums, RegionSums, RowSums, add_row, band_of

wp.set_module_options({"enable_backward": False})

GPU_RUN = 64  # pixels of a row that a GPU thread walks


class MaskReducer:
    """Reduces masks of one size, without allocating on the device.

    Args:
        worlds, height, width: of the masks.
        device: Warp device.
        threads: CPU threads.
    """

    def __init__(self, worlds: int, height: int, width: int, device: Any = "cpu", threads: int = 1):
        device = wp.get_device(device)
        self._masks = WordMasks(worlds, height, width, device)
        row = self._masks.words.shape[2]
        self._partial = PartialSums(worlds, 1, (height, width), device, threads)
        self._launch = self._partial.row_launch(
            reduce_mask_rows, (worlds, height, row), GPU_RUN // WORD, self._masks.words
        )

    def __call__(self, masks: Any) -> RegionSums:
        """Reduce ``(worlds, H, W)`` uint8 or bool, NumPy or Warp; any value but 0 belongs to the region.

        Returns:
            With leading axis (worlds,).

        Raises:
            ValueError: another shape or dtype.
        """
        self._masks.stage(masks)
        self._partial.clear()
        self._launch()
        return self._partial.result()[:, 0]


@wp.kernel
def reduce_mask_rows(
    row_begin: int,
    column_step: int,
    run: int,
    bands: int,
    width: int,
    # In:
    words_in: wp.array3d(dtype=wp.uint64),
    # Out:
    sums_out: wp.array4d(dtype=wp.int64),
    reach_out: wp.array4d(dtype=int),
):
    """Sums of eight pixels at once; most words of most masks are empty."""
    world, row, column = wp.tid()
    y = row_begin + row
    height = words_in.shape[1]
    count = wp.int64(0)
    of_x = wp.int64(0)
    of_xx = wp.int64(0)
    first = int(-1)
    end = int(0)
    begin = column * run
    for k in range(begin, wp.min(begin + run, words_in.shape[2])):
        word = words_in[world, y, k]
        if word != wp.uint64(0):
            marked = set_bytes(word)
            n = wp.int64(weighted_bytes(marked, WEIGHTS_ONE))
            left = wp.int64(k * 8)
            inner = wp.int64(weighted_bytes(marked, WEIGHTS_X))
            count += n
            of_x += left * n + inner
            of_xx += left * (left * n + inner + inner)
            of_xx += wp.int64(weighted_bytes(marked, WEIGHTS_XX))
            if first < 0:
                first = k
            end = k
    if first >= 0:
        head = set_bytes(words_in[world, y, first])
        tail = set_bytes(words_in[world, y, end])
        first *= 8
        while (head & wp.uint64(0x80)) == wp.uint64(0):
            head = head >> wp.uint64(8)
            first += 1
        end = end * 8 + 8
        while (tail >> wp.uint64(63)) == wp.uint64(0):
            tail = tail << wp.uint64(8)
            end -= 1
        total = RowSums(count, of_x, of_xx)
        band = band_of(row_begin, bands, height)
        add_row(total, first, end, y, band, world, 0, height, width, sums_out, reach_out)
