"""Why a point does not get to its target."""

import numpy as np
import pytest

from dense_vs.live.reachability import PATIENCE, Reachability, reason

FREE = np.array([[-1.0, 1.0]] * 3)
GOOD = np.array([[100.0, 20.0, 0.0], [0.0, 80.0, 30.0]])


@pytest.mark.parametrize(
    ("J", "error", "positions", "word"),
    [
        (np.full((2, 3), 0.1), [30, 0], [0, 0, 0], "not learned"),
        (np.array([[100.0, 50, 20], [0.5, 0, 0]]), [0, 30], [0, 0, 0], "singular"),
        (np.array([[100.0, 0, 0], [0, 80, 30]]), [30, 0], [1, 0, 0], "joint limit: joint 1"),
        (GOOD, [30, 0], [0, 0, 0], "does not come nearer"),
    ],
)
def test_each_reason_is_found(J, error, positions, word):
    said = reason(J, np.array(error, float), np.array(positions, float), FREE, 15.0)
    assert word in said


def test_it_speaks_only_once_the_error_no_longer_falls():
    watch = Reachability()
    for k in range(3 * PATIENCE):
        watch.observe(GOOD, [100 * 0.98**k, 0], np.zeros(3), FREE, 15.0)
        assert not watch.why
    for _ in range(PATIENCE):
        watch.observe(GOOD, [20, 0], np.zeros(3), FREE, 15.0)
    assert watch.why
    watch.observe(GOOD, [0.5, 0], np.zeros(3), FREE, 15.0)
    assert not watch.why
