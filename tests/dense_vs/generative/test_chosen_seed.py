"""Which seed's alignment is kept, by told numbers of samples and errors."""

import numpy as np
import pytest

from dense_vs.generative.reconstruction import sample_alignment
from dense_vs.generative.reconstruction.sample_alignment import align_samples

T, M = 40, 9
TURNS = np.tile(np.eye(3), (2, 1, 1))
SHIFTS = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.0]])
SHIFT = np.array([0.02, -0.01, 0.03])


@pytest.mark.parametrize(
    ("told", "best", "tried"),
    [
        ([(10, 0.3), (12, 0.9), (12, 0.2), (11, 0.15)], 3, 4),  # more samples, or nearly as many that fit better
        ([(30, 0.3), (33, 0.4), (27, 0.2), (30, 0.3)], 0, 4),  # a tenth more or less is as many
        ([(10, 0.3), (12, 0.4), (10, 0.2), (13, 0.5)], 1, 4),
        ([(40, 0.3), (38, 0.09), (40, 0.01)], 1, 2),  # sound, and nearly all samples
        ([(37, 0.05), (37, 0.06), (38, 0.11), (37, 0.2)], 0, 4),
        ([(38, 0.11), (38, 0.12), (40, 0.12), (38, 0.101)], 3, 4),
    ],
)
def test_more_samples_win_and_among_as_many_those_that_fit_best(monkeypatch, told, best, tried):
    """Errors are in structure's sizes, the median one; the hand stays where it is."""
    structure = np.random.default_rng(0).uniform(-0.3, 0.3, (M, 3))
    structure *= 0.3 / np.sqrt(structure.var(axis=0).sum())
    there = structure + SHIFTS[:, None]
    flat = np.tile(there[..., :2] / there[..., 2:], (T, 1, 1, 1))
    grown = []

    def grow(views, start, turns, places, posed):
        np.testing.assert_allclose(views.points[0], structure, atol=1e-12)
        count, error = told[len(grown)]
        posed[:] = np.arange(T) < count
        places[:] = SHIFT
        made = structure - SHIFT
        made[:, 0] += 0.3 * error
        made[:2, 1] += 0.05  # of two features it is larger
        grown.append(made)
        return made

    monkeypatch.setattr(sample_alignment, "grow", grow)
    _, places, found, posed = align_samples(flat, np.ones((T, 2, M), bool), np.ones(2, bool), TURNS, SHIFTS)
    assert len(grown) == tried
    assert found is grown[best]
    np.testing.assert_array_equal(places, np.tile(SHIFT, (T, 1)))
    assert np.count_nonzero(posed) == told[best][0]
