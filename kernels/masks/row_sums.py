"""Sums over rows of tables, in C++: rows that belong together, and what two histograms share.

Sums are made in the order and with the partial sums that NumPy has for the same, bit by bit, without the tables of
intermediate results that NumPy writes for them.
"""

import numpy as np
import warp as wp

from dense_vs.kernels.launch import launch_pixels

wp.set_module_options({"enable_backward": False})

_ADD = """
#if !defined(__CUDA_ARCH__)
    const int columns = values.shape[1];
    for (int row = 0; row < values.shape[0]; ++row) {
        double *to = sums_out.data + (size_t)index.data[row] * columns;
        const double *from = values.data + (size_t)row * columns;
        for (int c = 0; c < columns; ++c) to[c] += from[c];
    }
#endif
"""
# NumPy adds up fewer than 8 numbers one after the other, and up to 128 as 8 partial sums, then what is left. Sums
# of more, which no vocabulary has, differ from its own by rounding.
_SHARE = """
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    const int words = histograms.shape[1];
    const double *own = histograms.data + (size_t)row * words;
    for (int k = 0; k < examples.shape[0]; ++k) {
        const double *other = examples.data + (size_t)k * words;
        const auto least = [&](int word) { return own[word] < other[word] ? own[word] : other[word]; };
        double sum = 0.0;
        int word = 0;
        if (words >= 8) {
            double part[8];
            for (; word < 8; ++word) part[word] = least(word);
            for (; word + 8 <= words; word += 8) for (int lane = 0; lane < 8; ++lane) part[lane] += least(word + lane);
            sum = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
        }
        for (; word < words; ++word) sum += least(word);
        shared_out.data[(size_t)row * examples.shape[0] + k] = sum;
    }
#endif
"""


@wp.func_native(_ADD)
def add_rows(index: wp.array(dtype=int), values: wp.array2d(dtype=wp.float64), sums_out: wp.array2d(dtype=wp.float64)):
    """Every row added to the sum that it belongs to."""
    ...


@wp.func_native(_SHARE)
def share_histograms(
    row: int,
    histograms: wp.array2d(dtype=wp.float64),
    examples: wp.array2d(dtype=wp.float64),
    shared_out: wp.array2d(dtype=wp.float64),
):
    """What a histogram shares with every example."""
    ...


@wp.kernel
def add_kernel(
    row_begin: int,
    column_step: int,
    # Data in:
    index: wp.array(dtype=int),
    values: wp.array2d(dtype=wp.float64),
    # Data out:
    sums_out: wp.array2d(dtype=wp.float64),
):
    """One thread for all rows."""
    add_rows(index, values, sums_out)


@wp.kernel
def share_kernel(
    row_begin: int,
    column_step: int,
    # Data in:
    histograms: wp.array2d(dtype=wp.float64),
    examples: wp.array2d(dtype=wp.float64),
    # Data out:
    shared_out: wp.array2d(dtype=wp.float64),
):
    """A histogram a thread."""
    _, row, _ = wp.tid()
    share_histograms(row_begin + row, histograms, examples, shared_out)


def sums_by_row(index: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, c) float64 of the rows of values (m, c) that have the same index (m,), as ``numpy.bincount``.

    Raises:
        ValueError: not an index for every row, or one that is not in 0 .. count - 1.
    """
    if len(index) != len(values) or (len(index) and not 0 <= index.min() <= index.max() < count):
        raise ValueError(f"{len(index)} indices of {len(values)} rows; expected one each, from 0 to {count - 1}")
    sums = np.zeros((count, values.shape[1]))
    if values.size:
        arrays = [_view(index, np.int32), _view(values, np.float64), _view(sums, np.float64)]
        launch_pixels(add_kernel, (1, 1, 1), arrays, "cpu")
    return sums


def shared_histograms(histograms: np.ndarray, examples: np.ndarray) -> np.ndarray:
    """Sums (n, m) of the lesser bins of histograms (n, K) and (m, K): Swain and Ballard's intersection (1991).

    Raises:
        ValueError: histograms of different numbers of bins.
    """
    if histograms.shape[1] != examples.shape[1]:
        raise ValueError(f"histograms of {histograms.shape[1]} and {examples.shape[1]} bins; expected as many")
    shared = np.empty((len(histograms), len(examples)))
    if shared.size:
        arrays = [_view(array, np.float64) for array in (histograms, examples, shared)]
        launch_pixels(share_kernel, (1, len(histograms), 1), arrays, "cpu")
    return shared


def _view(array: np.ndarray, kind: type) -> wp.array:
    dtype = wp.int32 if kind is np.int32 else wp.float64
    return wp.array(np.ascontiguousarray(array, dtype=kind), dtype=dtype, device="cpu", copy=False)
