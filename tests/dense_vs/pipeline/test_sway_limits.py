"""Whose motion a camera's is, on either side of every limit, with flow of a known similarity."""

import numpy as np
import pytest

from dense_vs.pipeline import camera_sway
from dense_vs.pipeline.camera_sway import CameraSway

Y, X = np.mgrid[4:120:8, 4:160:8]
PLACES = np.stack([X, Y], axis=2).reshape(-1, 2).astype(float)
SPAN = np.array([0.1, 0.0])


def observed(sway, shift, body=0.0, agree=1.0, span=SPAN):
    """The camera shifts everything; the body's share of the places has a J; some places move otherwise."""
    rng = np.random.default_rng(0)
    count = len(PLACES)
    order = rng.permutation(count)
    jacobian = np.zeros((count, 2, 2))
    jacobian[order[: round(body * count)]] = 100.0
    flow = np.tile(np.array(shift, float), (count, 1))
    rest = order[round(body * count) :]
    other = rest[: round((1 - agree) * len(rest))]
    flow[other] += rng.uniform(6, 12, (len(other), 2)) * rng.choice([-1, 1], (len(other), 2))
    return sway.observe(PLACES, flow, jacobian, span)


def judged(body=0.0, agree=1.0):
    sway = CameraSway(120, 160, 2)
    rng = np.random.default_rng(1)
    for _ in range(camera_sway.JUDGED + 5):
        observed(sway, rng.uniform(-1.5, 1.5, 2), body, agree)
    return sway


def test_a_motion_that_joints_do_not_foretell_is_the_camera_s():
    sway = judged()
    assert sway.unknown == 0
    assert sway.foretold < camera_sway.FORETOLD
    motion = observed(sway, (2.0, -1.0))
    assert motion is not None
    np.testing.assert_allclose(motion.matrix, [[1, 0, 2], [0, 1, -1]], atol=1e-6)
    before = sway.taken
    assert observed(sway, (camera_sway.MOST_SWAY - 0.5, 0.0)) is not None
    assert observed(sway, (camera_sway.MOST_SWAY + 0.5, 0.0)) is None
    assert (sway.taken, sway.unknown) == (before + 1, 1)


@pytest.mark.parametrize("by", ["body", "others"])
def test_enough_of_the_background_has_to_agree(by):
    """Its share of the image times the share of it that agrees."""
    least = camera_sway.LEAST_BACKGROUND
    sway = CameraSway(120, 160, 2)
    for share, known in ((least + 0.08, True), (least - 0.08, False)):
        before = sway.unknown
        options = {"body": 1 - share} if by == "body" else {"body": 1 - (share + 0.1), "agree": share / (share + 0.1)}
        observed(sway, (2.0, 1.0), **options)
        assert (sway.unknown == before) == known


def test_a_motion_that_joints_foretell_is_left():
    sway = CameraSway(120, 160, 2)
    rng = np.random.default_rng(2)
    for _ in range(camera_sway.JUDGED + 20):
        span = rng.uniform(-0.05, 0.05, 2)
        assert observed(sway, span @ np.array([[30.0, 5.0], [-8.0, 20.0]]), span=span) is None
    assert sway.foretold > 0.9
    assert sway.taken == 0


def test_nothing_is_taken_before_it_is_known_whose_it_is():
    sway = CameraSway(120, 160, 2)
    assert np.isnan(sway.foretold)
    rng = np.random.default_rng(3)
    taken = [observed(sway, rng.uniform(-1.5, 1.5, 2)) is not None for _ in range(camera_sway.JUDGED + 3)]
    assert taken == [False] * (camera_sway.JUDGED - 1) + [True] * 4
