"""How much motion the joints leave unexplained: near 0 where they move the pixels, 1 where something else does."""

import numpy as np
import pytest

from dense_vs import DenseVSError, SelfBody

H, W = 24, 40


def test_own_motion_is_explained_and_a_strangers_is_not():
    """Left a surface that one joint moves, in the middle one that moves by itself, right one at rest."""
    body = SelfBody(synchronous=True, device="cpu", threads=1)
    with pytest.raises(DenseVSError, match="nothing has been observed"):
        body.unexplained()
    rng = np.random.default_rng(0)
    for _ in range(60):
        dq = rng.normal(0, 0.02, 1)
        flow = np.zeros((H, W, 2), np.float32)
        flow[:, :12, 0] = 100.0 * dq[0]
        flow[:, 14:26] = rng.normal(0, 2.0, 2)
        body.observe(flow, dq)
    share = body.unexplained()
    assert share.shape == (H, W)
    assert np.nanmedian(share[:, 2:10]) < 0.05
    assert np.nanmedian(share[:, 16:24]) > 0.8
    assert np.isnan(share[:, 30:]).all()
