"""Sets of feature numbers, beside NumPy's."""

import numpy as np
import pytest

from dense_vs.point_servo.feature_numbers import are_among


@pytest.mark.parametrize("seed", range(4))
def test_which_numbers_are_among_others(seed):
    rng = np.random.default_rng(seed)
    numbers, others = rng.integers(0, 40, 25), rng.integers(0, 40, 10)
    np.testing.assert_array_equal(are_among(numbers, others, 40), np.isin(numbers, others))
    nothing = np.zeros(0, int)
    assert not are_among(numbers, nothing, 40).any()
    assert are_among(nothing, others, 40).shape == (0,)
