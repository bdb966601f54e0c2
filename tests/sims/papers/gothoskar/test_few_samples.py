"""Ten samples of wide motion: first poses that must be found for the fit to find anything."""

import pytest

from dense_vs.generative import GenerativeModel
from dense_vs.sims.papers.gothoskar.protocol import Trial, held_out_error


@pytest.mark.parametrize(("arm", "seed"), [("ur5", 17), ("ur5", 3), ("baxter", 2)])
def test_ten_wide_samples(arm, seed):
    trial = Trial(arm, seed, 2, "uniform")
    model = GenerativeModel.fit(trial.evidence(50).observations[:10], seed=seed)
    assert model.report.rms_px < 0.6  # the pixels' noise is 0.5
    assert held_out_error(model, trial.evidence(50, 1).observations) < 3.0
