"""Arrays of NumPy's subclasses: what a mask hides is no number, and the rest is taken as a plain array."""

import numpy as np
import pytest

from dense_vs.arrays import host_or_gpu, middle, number_array, plain_array, point_array, quantile, real_vector
from dense_vs.errors import DenseVSError

READERS = [
    lambda value: host_or_gpu(value, "it", "numbers"),
    lambda value: plain_array(value, "it", "numbers"),
    lambda value: number_array(value, "it", finite=False),
    lambda value: real_vector(value, "it", (2,)),
    lambda value: point_array(value, "it"),
]


@pytest.mark.parametrize("read", READERS)
def test_masked_values_are_no_numbers(read):
    for hidden in (np.nan, 0.5):  # under the mask
        with pytest.raises(DenseVSError, match=r"it has masked values; expected .*numbers|it .*masked"):
            read(np.ma.masked_array([0.1, hidden], mask=[False, True]))


@pytest.mark.parametrize("read", READERS)
def test_subclasses_are_read_as_plain_arrays(read):
    values = np.array([0.1, 0.2])

    class Other(np.ndarray):
        pass

    for one in (np.ma.masked_array(values, mask=[False, False]), np.ma.masked_array(values), values.view(Other)):
        found = read(one)
        assert type(found) is np.ndarray
        np.testing.assert_array_equal(found, values)


def test_bytes_are_no_numbers_and_a_view_may_be_too_large():
    with pytest.raises(DenseVSError, match=r"it is bytearray\(b'ab'\)"):
        number_array(bytearray(b"ab"), "it", (2,))
    endless = np.broadcast_to(np.float32(1), (10**7, 10**7))
    for read in (lambda: number_array(endless, "it"), lambda: point_array(endless, "it")):
        with pytest.raises(DenseVSError, match=r"it has shape \(10000000, 10000000\).*memory"):
            read()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("count", [1, 2, 3, 10, 31])
def test_quantiles_and_middles_are_numpy_s(share, count):
    values = np.random.default_rng(count).normal(size=(count, 4))
    assert quantile(values[:, 0], share) == pytest.approx(np.quantile(values[:, 0], share), rel=1e-12)
    for axis in (0, 1):
        np.testing.assert_allclose(middle(values, axis), np.median(values, axis=axis), rtol=1e-12)
    np.testing.assert_array_equal(values, np.random.default_rng(count).normal(size=(count, 4)))


@pytest.mark.parametrize("read", [real_vector, number_array])
def test_what_fits_at_once_is_copied_and_what_does_not_is_told(read):
    given = np.array([[1.0, 2.0], [3.0, 4.0]])
    got = read(given, "it", (2, -1))
    got[...] = 0
    assert given.all()
    for wrong in (given[0], given[:1], np.array([[1.0, np.nan], [3.0, 4.0]]), given.astype(complex)):
        with pytest.raises(DenseVSError, match="it "):
            read(wrong, "it", (2, -1))
    assert real_vector(given, "it", (2, 2), copy=False) is given
    assert np.isnan(number_array(np.array([np.nan]), "it", (1,), finite=False)).all()
