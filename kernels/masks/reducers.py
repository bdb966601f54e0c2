"""One pass over masks or labelled images: what VOS-VS computes from a segmentation, (3)-(5), and more.

Of every region: area s_A (3), centroid s_x, s_y (4), (5), box, second moments, and which sides of the image it
touches. A mask's pixels are summed eight at once; a row of labels is walked in runs of equal ones, whose sums are
known in closed form. The sums of a band of rows are added up apart, and then those of the bands. All sums are of whole
numbers: the same for any number of threads, and exact.
"""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.masks.mask_words import (
    WEIGHTS_ONE,
    WEIGHTS_X,
    WEIGHTS_XX,
    WORD,
    WordMasks,
    set_bytes,
    stage,
    weighted_bytes,
)

wp.set_module_options({"enable_backward": False})

SUMS = 6  # n, x, y, x^2, y^2, xy
REACH = 4  # width - least x, greatest x + 1, height - least y, greatest y + 1: all of them greatest values from 0
LEFT, RIGHT, TOP, BOTTOM = 1, 2, 4, 8  # bits of RegionSums.border
GPU_RUN = 64  # pixels of a row that a GPU thread walks

RowSums = wp.types.vector(3, wp.int64)  # of 1, x, x^2


@dataclass(frozen=True)
class RegionSums:
    """What one pass over a mask found; the leading axes of all arrays are (worlds,) or (worlds, labels).

    Attributes:
        sums: ``(..., 6)`` int64, over the region's pixels: 1, x, y, x^2, y^2, x y.
        box: ``(..., 4)`` int64 x, y, width, height [px]; zeros for an empty region.
        border: int64, which sides of the image the region touches, as the sum of 1 left, 2 right, 4 top, 8 bottom.
    """

    sums: np.ndarray
    box: np.ndarray
    border: np.ndarray

    @property
    def area(self) -> np.ndarray:
        """s_A (3), int64 [px]."""
        return self.sums[..., 0]

    @property
    def centroid(self) -> np.ndarray:
        """``(..., 2)`` float64 s_x, s_y (4), (5) [px]; NaN for an empty region."""
        with np.errstate(invalid="ignore"):
            return self.sums[..., 1:3] / self.sums[..., :1]

    @property
    def moments(self) -> np.ndarray:
        """``(..., 3)`` float64 central second moments xx, yy, xy over the area [px^2]; NaN for an empty region."""
        n, x, y, xx, yy, xy = (self.sums[..., k].astype(object) for k in range(SUMS))
        # n sum(x^2) - sum(x)^2 exceeds 64 bits and its terms nearly cancel: Python's whole numbers are exact.
        central = np.stack([n * xx - x * x, n * yy - y * y, n * xy - x * y], axis=-1).astype(np.float64)
        squared = self.sums[..., :1].astype(np.float64) ** 2
        with np.errstate(invalid="ignore"):
            return central / squared


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
        self._partial = _Partial(worlds, 1, (height, width), device, threads)
        self._launch = _row_launch(
            _kernels("mask").walk, (worlds, height, row), GPU_RUN // WORD, self._masks.words, self._partial, width
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
        found = self._partial.result()
        return RegionSums(found.sums[:, 0], found.box[:, 0], found.border[:, 0])


class LabelReducer:
    """Reduces labelled images, as ``cv2.connectedComponents`` makes them, for every label at once.

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
        view = wp.array(ptr=self._image.ptr, dtype=wp.uint64, shape=(worlds, height, pairs), device=device)
        view._source = self._image  # the view does not own the memory
        self._partial = _Partial(worlds, labels, (height, width), device, threads)
        self._launch = _row_launch(
            _kernels("label").walk, (worlds, height, pairs), GPU_RUN // 2, view, self._partial, width
        )

    def __call__(self, labelled: Any) -> RegionSums:
        """Reduce ``(worlds, H, W)`` int32, NumPy or Warp.

        Returns:
            With leading axes (worlds, L); row 0 is the background.

        Raises:
            ValueError: another shape or dtype.
        """
        if tuple(labelled.shape) != self._shape or labelled.dtype not in (np.int32, wp.int32):
            raise ValueError(
                f"labels have shape {labelled.shape} and dtype {labelled.dtype}; expected int32 {self._shape}"
            )
        stage(self._image[:, :, : self._shape[2]], labelled)
        self._partial.clear()
        self._launch()
        return self._partial.result()


class _Partial:
    """Sums by band of rows, and of all bands."""

    def __init__(self, worlds: int, labels: int, size: tuple[int, int], device: wp.Device, threads: int):
        self.size, self.threads, self.device = size, threads, device
        self.bands = min(threads, size[0]) if device.is_cpu else 1
        self.sums = wp.zeros((self.bands, worlds, labels, SUMS), dtype=wp.int64, device=device)
        self.reach = wp.zeros((self.bands, worlds, labels, REACH), dtype=wp.int32, device=device)

    def clear(self) -> None:
        self.sums.zero_()
        self.reach.zero_()

    def result(self) -> RegionSums:
        height, width = self.size
        sums = self.sums.numpy().sum(axis=0)
        reach = self.reach.numpy().max(axis=0).astype(np.int64)
        left, right, top, bottom = width - reach[..., 0], reach[..., 1], height - reach[..., 2], reach[..., 3]
        full = sums[..., 0] > 0
        box = np.where(full[..., None], np.stack([left, top, right - left, bottom - top], axis=-1), 0)
        sides = LEFT * (left == 0) + RIGHT * (right == width) + TOP * (top == 0) + BOTTOM * (bottom == height)
        return RegionSums(sums, box, np.where(full, sides, 0))


def _row_launch(kernel: Any, shape: tuple[int, int, int], run: int, image: Any, partial: _Partial, width: int) -> Any:
    """The kernel on row bands of a CPU, or on a GPU with a thread for every ``run`` elements of a row."""
    worlds, height, row = shape
    on_cpu = partial.device.is_cpu
    columns = 1 if on_cpu else -(-row // run)
    arguments = [row if on_cpu else run, partial.bands, width, image, partial.sums, partial.reach]
    return PixelLaunch(kernel, (worlds, height, columns), arguments, partial.device, partial.threads)


@cache
def _kernels(source: str) -> SimpleNamespace:
    """The row walk over ``"mask"`` words or ``"label"`` pixels."""

    @wp.func
    def sums_below(end: int) -> RowSums:
        """Sums of 1, x and x^2 over the pixels 0 .. end - 1: those of a run are a difference of two such."""
        m = wp.int64(end)
        one = wp.int64(1)
        pairs = m * (m - one)
        return RowSums(m, pairs / wp.int64(2), pairs * (m + m - one) / wp.int64(6))

    @wp.func
    def add_row(
        total: RowSums,
        first: int,
        end: int,
        y: int,
        band: int,
        world: int,
        label: int,
        height: int,
        width: int,
        sums: wp.array4d(dtype=wp.int64),
        reach: wp.array4d(dtype=int),
    ):
        """Add what one thread found of a region in one row, from its first to its last pixel."""
        row = wp.int64(y)
        wp.atomic_add(sums, band, world, label, 0, total[0])
        wp.atomic_add(sums, band, world, label, 1, total[1])
        wp.atomic_add(sums, band, world, label, 2, row * total[0])
        wp.atomic_add(sums, band, world, label, 3, total[2])
        wp.atomic_add(sums, band, world, label, 4, row * row * total[0])
        wp.atomic_add(sums, band, world, label, 5, row * total[1])
        wp.atomic_max(reach, band, world, label, 0, width - first)
        wp.atomic_max(reach, band, world, label, 1, end)
        wp.atomic_max(reach, band, world, label, 2, height - y)
        wp.atomic_max(reach, band, world, label, 3, y + 1)

    @wp.func
    def band_of(row_begin: int, bands: int, height: int) -> int:
        """The band that PixelLaunch began at this row: the least b with height * b // bands at or behind it."""
        return (row_begin * bands + height - 1) / height

    module = f"{__name__}_{source}"

    if source == "mask":

        @wp.kernel(module=module, enable_backward=False)
        def walk(
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
                    n = wp.int64(weighted_bytes(marked, wp.static(WEIGHTS_ONE)))
                    left = wp.int64(k * 8)
                    inner = wp.int64(weighted_bytes(marked, wp.static(WEIGHTS_X)))
                    count += n
                    of_x += left * n + inner
                    of_xx += left * (left * n + inner + inner)
                    of_xx += wp.int64(weighted_bytes(marked, wp.static(WEIGHTS_XX)))
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

    else:

        @wp.kernel(module=module, enable_backward=False)
        def walk(
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

    return SimpleNamespace(walk=walk)
