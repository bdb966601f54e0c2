"""Sums over rows of tables against NumPy's, bit by bit."""

import numpy as np
import pytest

from dense_vs.kernels.masks.row_sums import shared_histograms, sums_by_row


@pytest.mark.parametrize(("rows", "columns", "count"), [(0, 3, 4), (1, 1, 1), (200, 5, 7), (50, 3, 400)])
def test_rows_are_added_up_as_by_bincount(rows, columns, count):
    rng = np.random.default_rng(rows)
    index, values = rng.integers(0, count, rows), rng.standard_normal((rows, columns))
    expected = np.stack([np.bincount(index, values[:, c], count) for c in range(columns)], axis=1)
    np.testing.assert_array_equal(sums_by_row(index, values, count), expected)


@pytest.mark.parametrize("index", [[0, 1], [0, 1, 3], [-1, 1, 2]])
def test_indices_of_no_row(index):
    with pytest.raises(ValueError, match="expected one each, from 0 to 2"):
        sums_by_row(np.array(index), np.ones((3, 2)), 3)


@pytest.mark.parametrize("bins", [1, 7, 8, 9, 16, 18, 23, 128])
def test_shared_histograms_are_those_of_numpy(bins):
    rng = np.random.default_rng(bins)
    histograms, examples = rng.random((40, bins)), rng.random((6, bins))
    expected = np.minimum(histograms[:, None], examples).sum(axis=2)
    np.testing.assert_array_equal(shared_histograms(histograms, examples), expected)
    assert shared_histograms(histograms[:0], examples).shape == (0, 6)


def test_more_bins_than_numpy_adds_up_at_once():
    rng = np.random.default_rng(0)
    histograms, examples = rng.random((5, 300)), rng.random((2, 300))
    expected = np.minimum(histograms[:, None], examples).sum(axis=2)
    np.testing.assert_allclose(shared_histograms(histograms, examples), expected, rtol=1e-12)


def test_histograms_that_do_not_fit():
    with pytest.raises(ValueError, match="histograms of 3 and 4 bins"):
        shared_histograms(np.ones((2, 3)), np.ones((2, 4)))
