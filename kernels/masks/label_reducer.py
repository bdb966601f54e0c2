"""One pass over labeled images: of every label area and centroid, VOS-VS (3), VOS-VS (4), VOS-VS (5), box, second
moments and border contact.

A row is walked in runs of equal labels, whose sums are known in closed form.
"""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.masks.mask_words import stage
from dense_vs.kernels.masks.region_sums import PartialSums, RegionSums, RowSums, add_row, band_of
from dense_vs.kernels.views import seen_as

wp.set_module_options({"enable_backward": False})

GPU_RUN = 64  # pixels of a row that a GPU thread walks


class LabelReducer:
    """Reduces labeled images, as ``cv2.connectedComponents`` makes them, for every label at once.

    Args:
        worlds, height, width: of the images.
        labels: number of labels L, the background 0 among them; pixels with another label are not counted.
        device: Warp device.
        threads: CPU threads.
    """

    def __init__(self, worlds: int, height: int, width: int, labels: int, device: Any = "cpu", threads: int = 1):
        device = wp.get_device(device)
        self.labels = labels
        self._shape = (worlds, height, width)
        pairs = -(-width // 2)
        # Rows are filled up by a label that no row of the result counts.
        self._image = wp.full((worlds, height, 2 * pairs), -1, dtype=wp.int32, device=device)
        view = seen_as(self._image, wp.uint64, (worlds, height, pairs))
        self._partial = PartialSums(worlds, labels, (height, width), device, threads)
        self._launch = self._partial.row_launch(reduce_label_rows, (worlds, height, pairs), GPU_RUN // 2, view)

    def __call__(self, labeled: Any) -> RegionSums:
        """Reduce ``(worlds, H, W)`` int32, NumPy or Warp.

        Returns:
            With leading axes (worlds, L); row 0 is the background.

        Raises:
            ValueError: another shape or dtype.
        """
        if tuple(labeled.shape) != self._shape or labeled.dtype not in (np.int32, wp.int32):
            raise ValueError(
                f"labels have shape {labeled.shape} and dtype {labeled.dtype}; expected int32 {self._shape}"
            )
        stage(self._image[:, :, : self._shape[2]], labeled)
        self._partial.clear()
        self._launch()
        return self._partial.result()


@wp.func
def sums_below(end: int) -> RowSums:
    """Sums of 1, x and x^2 over the pixels 0 .. end - 1: those of a run are a difference of two such."""
    m = wp.int64(end)
    one = wp.int64(1)
    pairs = m * (m - one)
    return RowSums(m, pairs / wp.int64(2), pairs * (m + m - one) / wp.int64(6))


@wp.kernel
def reduce_label_rows(
    row_begin: int,
    column_step: int,
    run: int,
    bands: int,
    width: int,
    # In:
    pairs_in: wp.array3d(dtype=wp.uint64),  # two labels each, the left one in the low half
    # Out:
    sums_out: wp.array4d(dtype=wp.int64),
    reach_out: wp.array4d(dtype=int),
):
    """Runs of equal labels; two pixels at once where both carry on the run."""
    world, row, column = wp.tid()
    y = row_begin + row
    height = pairs_in.shape[1]
    labels = sums_out.shape[2]
    band = band_of(row_begin, bands, height)
    first = column * run
    last = wp.min(first + run, pairs_in.shape[2])
    begin = first * 2
    label = int(-1)
    same = wp.uint64(0xFFFFFFFFFFFFFFFF)
    for k in range(first, last + 1):
        pair = wp.uint64(0xFFFFFFFFFFFFFFFF)  # ends the last run
        if k < last:
            pair = pairs_in[world, y, k]
        if pair != same:
            for half in range(2):
                present = int((pair >> wp.uint64(32 * half)) & wp.uint64(0xFFFFFFFF))
                x = k * 2 + half
                if present != label:
                    if label >= 0 and label < labels:
                        total = sums_below(x) - sums_below(begin)
                        add_row(total, begin, x, y, band, world, label, height, width, sums_out, reach_out)
                    begin = x
                    label = present
            half_word = wp.uint64(wp.uint32(label))
            same = half_word | (half_word << wp.uint64(32))
