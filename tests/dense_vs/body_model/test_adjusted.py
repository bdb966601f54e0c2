"""Weights of an adjustment by hand: they fall beyond three times the usual error, which is the noise at least."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.body_model import adjustment


@pytest.mark.parametrize("size", [0.01, 0.5, 4.0])
def test_weights_fall_with_errors_beyond_what_is_usual(monkeypatch, size):
    errors = size * np.array([[0.6, 0.8], [1.0, 0.0], [0.0, -1.0], [6.0, 8.0], [1e9, 0.0]])
    asked = []
    problem = SimpleNamespace(noise=0.5, errors=lambda state: errors, weighted=lambda weights: weights)
    monkeypatch.setattr(adjustment, "solve", lambda *given: asked.append(given) or (given[1] + 1, 0.0))
    assert adjustment.adjusted(problem, 5, 2, 7) == 7
    usual = max(0.5, size / 1.1774)
    for k, (weights, state, iterations, _) in enumerate(asked):
        assert (state, iterations) == (5 + k, 7)
        expected = [1 / (1 + (e / (3 * usual)) ** 2) ** 2 for e in (size, size, size, 10 * size)]
        np.testing.assert_allclose(weights[:4], expected)
        assert 0 < weights[4] < 1e-9
    assert len(asked) == 2
