"""Taichi's filter, an independent implementation, and ours, both against the equations in float64.

The comparisons in ``profiling/`` are fair only where both compute the same.
"""

from pathlib import Path

import numpy as np
import pytest
from reference_filters import ReferenceJacobian

from dense_vs import DenseJacobian

PROFILING = Path(__file__).resolve().parents[2] / "profiling"

# Of the largest |J| or variance: float32 state over a few frames.
TOLERANCE = 1e-4


# Taichi 1.7 asks Python for the locale in a way that 3.15 drops.
@pytest.mark.filterwarnings("ignore:'locale.getdefaultlocale' is deprecated:DeprecationWarning")
@pytest.mark.parametrize("joints", [1, 4, 7])
def test_warp_and_taichi_follow_the_equations(joints, monkeypatch):
    pytest.importorskip("taichi")
    monkeypatch.syspath_prepend(PROFILING)
    from filter_case import make_case
    from taichi_jacobian import TaichiFilter

    height, width = 37, 53
    case = make_case(height, width, joints)
    noises = case.noises
    ours = DenseJacobian(
        height=height,
        width=width,
        joints=joints,
        device="cpu",
        covariance="diagonal",
        prediction_iterations=1,
        initial_variance=noises.initial_variance,
        max_variance=noises.max_variance,
        process_noise=noises.process_noise,
        measurement_noise=noises.measurement_noise,
    )
    theirs = TaichiFilter(height, width, joints, noises)
    reference = ReferenceJacobian(ours.options)
    for flow, dq in zip(case.flow, case.dq, strict=True):
        ours.update(flow, dq)
        theirs.update(theirs.load(flow), dq)
        reference.update(flow, dq)
    for name in ("jacobian", "variance"):
        expected = getattr(reference, name)
        for filter_ in (ours, theirs):
            error = np.abs(getattr(filter_, name) - expected).max() / np.abs(expected).max()
            assert error < TOLERANCE, (name, type(filter_).__name__)
