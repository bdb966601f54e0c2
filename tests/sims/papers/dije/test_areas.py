"""Areas that a transported J covers and should not, and those it lost."""

import numpy as np

from dense_vs.sims.papers.dije.leak import areas_off


def test_areas_are_shares_of_the_arm():
    arm = np.zeros((10, 20), bool)
    arm[:, :10] = True
    carried = np.zeros_like(arm)
    carried[:, 4:15] = True
    assert areas_off(carried, arm) == (0.5, 0.4)
    assert areas_off(arm, arm) == (0.0, 0.0)
    assert areas_off(~arm, arm) == (1.0, 1.0)
    assert areas_off(np.zeros_like(arm), arm) == (0.0, 1.0)
