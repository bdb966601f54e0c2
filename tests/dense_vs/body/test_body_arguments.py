"""Bad arguments of a body are refused whether or not it has its size already; the body stays as it was."""

import numpy as np
import pytest

from dense_vs import DenseVSError, SelfBody


@pytest.fixture(params=[False, True], ids=["new", "sized"])
def body(request):
    size = {"height": 24, "width": 32, "joints": 2} if request.param else {}
    return SelfBody(device="cpu", threads=1, synchronous=True, **size)


@pytest.mark.parametrize("wrong", [np.array([24, 24]), "24", None, 24.0, 1])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_sizes(body, wrong, place):
    size = [24, 32, 2]
    size[place] = wrong if not (place == 2 and np.isscalar(wrong) and wrong == 1) else 0
    with pytest.raises(DenseVSError, match="expected a whole number"):
        body.fix_size(*size)
    body.fix_size(24, 32, 2)


@pytest.mark.parametrize("timeout", ["x", -1, np.nan, np.inf, [1.0], 10**400])
def test_waiting(body, timeout):
    with pytest.raises(DenseVSError, match=r"timeout is .*; expected a finite number of at least 0"):
        body.wait(timeout)
    assert body.wait(0.1)


def test_ragged_images(body):
    with pytest.raises(DenseVSError, match="image is a list; expected uint8 of shape"):
        body.observe(np.ones((24, 32, 2), np.float32), np.full(2, 0.01), [[1], [1, 2]])
