"""Separable linear resampling of images, its weights in tables: blur, change of size and padding in one step.

Each output row (and column) is a weighted sum of a few neighbouring input rows. The tables come from the whole
matrix of weights, borders included, so that the kernels know neither borders nor scales.
"""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.image.pixel_runs import run_begin, run_module, run_type

wp.set_module_options({"enable_backward": False})


def linear_weights(source: int, target: int) -> np.ndarray:
    """Matrix (target, source) of linear interpolation between the centres of ``source`` pixels, ends repeated."""
    position = (np.arange(target) + 0.5) * (source / target) - 0.5
    position = np.clip(position, 0, source - 1)
    left = np.minimum(position.astype(int), max(source - 2, 0))
    fraction = position - left
    weights = np.zeros((target, source))
    rows = np.arange(target)
    weights[rows, left] = 1 - fraction
    weights[rows, np.minimum(left + 1, source - 1)] += fraction
    return weights


def blur_weights(size: int, kernel: np.ndarray) -> np.ndarray:
    """Matrix (size, size) of a symmetric filter; beyond an end the line is mirrored about its last pixel."""
    radius = len(kernel) // 2
    weights = np.zeros((size, size))
    rows = np.arange(size)
    period = max(2 * (size - 1), 1)
    for offset, weight in zip(range(-radius, radius + 1), kernel, strict=True):
        columns = np.abs((rows + offset) % period)
        np.add.at(weights, (rows, np.where(columns < size, columns, period - columns)), weight)
    return weights


def repeat_ends(weights: np.ndarray, margin: int) -> np.ndarray:
    """The matrix that also makes ``margin`` copies of the first and the last output on either side."""
    return np.pad(weights, ((margin, margin), (0, 0)), mode="edge")


@dataclass(frozen=True)
class BandTable:
    """A matrix of weights with few entries a row.

    Attributes:
        start: first input of each output, shape (outputs,).
        weights: of the inputs from there on, shape (taps, outputs).
        adjacent: 1 where the inputs of the run of outputs from there on begin side by side too.
    """

    start: wp.array
    weights: wp.array
    adjacent: wp.array

    @classmethod
    def of(cls, matrix: np.ndarray, lanes: int, device: Any) -> "BandTable":
        """The table of a matrix (outputs, inputs), for runs of ``lanes``."""
        inputs = matrix.shape[1]
        filled = matrix != 0
        first = filled.argmax(axis=1)
        last = inputs - 1 - filled[:, ::-1].argmax(axis=1)
        taps = int((last - first).max()) + 1
        start = np.minimum(first, inputs - taps)
        adjacent = np.lib.stride_tricks.sliding_window_view(np.diff(start) == 1, lanes - 1).all(axis=1)
        weights = np.take_along_axis(matrix, start[:, None] + np.arange(taps), axis=1).T
        return cls(
            start=wp.array(start.astype(np.int32), device=device),
            weights=wp.array(np.ascontiguousarray(weights, dtype=np.float32), device=device),
            adjacent=wp.array(adjacent.astype(np.int32), device=device),
        )

    def __len__(self) -> int:
        return len(self.start)


@cache
def resampling_kernels(lanes: int, dtype: Any = wp.float32) -> SimpleNamespace:
    """Kernels that resample the rows and the columns of images of ``dtype``, into float32."""
    Run = run_type(lanes)
    Source = run_type(lanes, dtype)

    kernel = wp.kernel(module=run_module(f"{__name__}_{dtype.__name__}_{lanes}"), enable_backward=False)

    @wp.func
    def as_float(pixels: Source) -> Run:
        converted = Run()
        for i in range(wp.static(lanes)):
            converted[i] = float(pixels[i])
        return converted

    @kernel
    def resample_rows(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        start_in: wp.array(dtype=int),
        weights_in: wp.array2d(dtype=float),
        image_in: wp.array3d(dtype=Source),
        # Out:
        image_out: wp.array3d(dtype=Run),
    ):
        """Every output row is a weighted sum of input rows."""
        world, row, column = wp.tid()
        y = row_begin + row
        start = start_in[y]
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            total = Run()
            for tap in range(weights_in.shape[0]):
                total += as_float(image_in[world, start + tap, x]) * weights_in[tap, y]
            image_out[world, y, x] = total

    @kernel
    def resample_columns(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        start_in: wp.array(dtype=int),
        adjacent_in: wp.array(dtype=int),
        weights_in: wp.array2d(dtype=Run),
        image_in: wp.array3d(dtype=float),
        image_runs_in: wp.array3d(dtype=Run),
        # Out:
        image_out: wp.array3d(dtype=Run),
    ):
        """Every output column is a weighted sum of input columns; a run at once where they lie side by side."""
        world, row, column = wp.tid()
        y = row_begin + row
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            total = Run()
            if adjacent_in[x] != 0:
                start = start_in[x]
                for tap in range(weights_in.shape[0]):
                    total += wp.cw_mul(weights_in[tap, x], image_runs_in[world, y, start + tap])
            else:
                for tap in range(weights_in.shape[0]):
                    value = Run()
                    for i in range(wp.static(lanes)):
                        value[i] = image_in[world, y, start_in[x + i] + tap]
                    total += wp.cw_mul(weights_in[tap, x], value)
            image_out[world, y, x] = total

    return SimpleNamespace(resample_rows=resample_rows, resample_columns=resample_columns)
