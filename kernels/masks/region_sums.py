"""Sums over each region of a mask or labeled image, and the buffers that the kernels add them up in.

Of every region: area s_A, VOS-VS (3), centroid s_x, s_y, VOS-VS (4) and VOS-VS (5), box, second moments, and the
sides of the image that it touches. All sums are of whole numbers: the same for any number of threads, and exact. The
sums of each band of rows are added up apart, and then those of the bands.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.launch import PixelLaunch, row_bands

wp.set_module_options({"enable_backward": False})

SUMS = 6  # n, x, y, x^2, y^2, xy
REACH = 4  # width - least x, greatest x + 1, height - least y, greatest y + 1: all of them greatest values from 0
LEFT, RIGHT, TOP, BOTTOM = 1, 2, 4, 8  # bits of RegionSums.border

RowSums = wp.types.vector(3, wp.int64)  # of 1, x, x^2


@dataclass(frozen=True)
class RegionSums:
    """Sums over the regions; the leading axes of all arrays are (), (worlds,) or (worlds, labels).

    Attributes:
        sums: ``(..., 6)`` int64, over the region's pixels: 1, x, y, x^2, y^2, x y.
        box: ``(..., 4)`` int64 x, y, width, height [px]; zeros for an empty region.
        border: int64, which sides of the image the region touches, as the sum of 1 left, 2 right, 4 top, 8 bottom.
    """

    sums: np.ndarray
    box: np.ndarray
    border: np.ndarray

    def __getitem__(self, index: Any) -> "RegionSums":
        """The regions at an index of the leading axes."""
        return RegionSums(self.sums[index], self.box[index], self.border[index])

    @property
    def area(self) -> np.ndarray:
        """s_A, VOS-VS (3), int64 [px]."""
        return self.sums[..., 0]

    @property
    def centroid(self) -> np.ndarray:
        """``(..., 2)`` float64 s_x, s_y, VOS-VS (4) and VOS-VS (5) [px]; NaN for an empty region."""
        with np.errstate(invalid="ignore"):
            return self.sums[..., 1:3] / self.sums[..., :1]

    @property
    def moments(self) -> np.ndarray:
        """``(..., 3)`` float64 central second moments xx, yy, xy over the area [px^2]; NaN for an empty region."""
        n, x, y, xx, yy, xy = np.moveaxis(self.sums.astype(object), -1, 0)
        # n sum(x^2) - sum(x)^2 exceeds 64 bits and its terms nearly cancel: Python's whole numbers are exact.
        central = np.stack([n * xx - x * x, n * yy - y * y, n * xy - x * y], axis=-1).astype(np.float64)
        squared = self.sums[..., :1].astype(np.float64) ** 2
        with np.errstate(invalid="ignore"):
            return central / squared


class PartialSums:
    """Sums of each band of rows on a device, and of all bands."""

    def __init__(self, worlds: int, labels: int, size: tuple[int, int], device: wp.Device, threads: int):
        self.size, self.threads, self.device = size, threads, device
        self.bands = row_bands(threads, size[0], device)
        self.sums = wp.zeros((self.bands, worlds, labels, SUMS), dtype=wp.int64, device=device)
        self.reach = wp.zeros((self.bands, worlds, labels, REACH), dtype=wp.int32, device=device)

    def clear(self) -> None:
        """Begin with another image."""
        self.sums.zero_()
        self.reach.zero_()

    def row_launch(self, kernel: Any, shape: tuple[int, int, int], run: int, image: wp.array) -> PixelLaunch:
        """The kernel on row bands of a CPU, or on a GPU with a thread for every ``run`` elements of a row."""
        worlds, height, row = shape
        on_cpu = self.device.is_cpu
        columns = 1 if on_cpu else -(-row // run)
        arguments = [row if on_cpu else run, self.bands, self.size[1], image, self.sums, self.reach]
        return PixelLaunch(kernel, (worlds, height, columns), arguments, self.device, self.threads)

    def result(self) -> RegionSums:
        """Everything added up, with leading axes (worlds, labels)."""
        height, width = self.size
        sums = self.sums.numpy().sum(axis=0)
        reach = self.reach.numpy().max(axis=0).astype(np.int64)
        left, right, top, bottom = width - reach[..., 0], reach[..., 1], height - reach[..., 2], reach[..., 3]
        full = sums[..., 0] > 0
        box = np.where(full[..., None], np.stack([left, top, right - left, bottom - top], axis=-1), 0)
        sides = LEFT * (left == 0) + RIGHT * (right == width) + TOP * (top == 0) + BOTTOM * (bottom == height)
        return RegionSums(sums, box, np.where(full, sides, 0))


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
