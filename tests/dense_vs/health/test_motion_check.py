"""Motion that the joints do not explain is told from motion that they do."""

import numpy as np
import pytest

from dense_vs.health import FaultKind
from dense_vs.health.motion_check import BABBLING_SHARE, GIVEN_UP, KNOWN, LEFT_OUT_SHARE, UNKNOWN, MotionCheck

K, N, FRAME = 150, 4, 1 / 30


def path(seed=0, count=200):
    rng = np.random.default_rng(seed)
    noise = np.zeros(N)
    steps = []
    for _ in range(count):
        noise = 0.85 * noise + rng.normal(0, 0.006, N)
        steps.append(noise)
    return np.cumsum(steps, axis=0)


def case(seed=0, error=0.1):
    """Positions, true J of a robot that half of the image shows, and J as it was learned."""
    rng = np.random.default_rng([seed, 1])
    true = rng.normal(0, 60, (K, 2, N))
    true[K // 2 :] = 0.0
    return path(seed), true, true * (1 + error * rng.normal(size=true.shape)), rng


def flow_of(true, step, rng):
    return true @ step + rng.normal(0, 0.15, (K, 2))


def usual(check, q, true, learned, rng, frames):
    for k in frames:
        assert check.judge(flow_of(true, q[k + 1] - q[k], rng), learned, q[k + 1] - q[k]) is None


@pytest.mark.parametrize("error", [0.0, 0.1, 0.2])
def test_usual_motion_is_no_fault(error):
    q, true, learned, rng = case(error=error)
    check = MotionCheck()
    usual(check, q, true, learned, rng, range(190))
    assert check.usual < 0.15


@pytest.mark.parametrize("wrong", ["frozen", "noise", "other step"])
def test_motion_of_nothing_is_a_fault_at_once_until_it_lasts(wrong):
    q, true, learned, rng = case()
    check = MotionCheck()
    usual(check, q, true, learned, rng, range(100))
    faults = []
    for k in range(100, 190):
        step = q[k + 1] - q[k]
        flow = {"frozen": np.zeros((K, 2)), "noise": rng.normal(0, 3, (K, 2)), "other step": true @ -step}[wrong]
        faults.append(check.judge(flow, learned, step))
    assert faults[0] is not None
    assert faults[0].kind is FaultKind.MISFIT
    assert sum(fault is not None for fault in faults) < GIVEN_UP + 1  # then it is the robot that has changed


def test_nothing_is_judged_where_j_is_known_badly():
    q, true, _, rng = case()
    strange = rng.normal(0, 60, true.shape)
    check = MotionCheck()
    usual(check, q, true, strange, rng, range(KNOWN * 3))
    assert check.share > 0.3


@pytest.mark.parametrize(("variance", "named", "held"), [(0.0, True, True), (1.0, False, False)])
def test_motion_where_j_may_be_unknown_by_its_covariance_is_no_fault(variance, named, held):
    q, true, learned, rng = case()
    check = MotionCheck()
    check.least_share = BABBLING_SHARE
    usual(check, q, true, learned, rng, range(100))
    before = check.usual
    step = q[101] - q[100]
    fault = check.judge(flow_of(true * 2.2, step, rng), learned, step, 0.0, 0.0, variance)
    assert LEFT_OUT_SHARE > check.share > max(BABBLING_SHARE, 4 * before)
    assert (fault is not None) == named
    assert check.usual == before  # what is not known yet is not usual
    check.forget_doubt()
    strange = check.judge(rng.normal(0, 3, (K, 2)), learned, step, 0.0, 0.0, variance)
    assert check.share > LEFT_OUT_SHARE
    assert (strange is not None and strange.holds) == held


@pytest.mark.parametrize(("times", "named"), [(0.98, True), (1.02, False)])
def test_how_much_may_be_unknown(times, named):
    """All places alike: a flow of 6 px where 2 px were foretold leaves 16 of 40 px^2 unexplained, 0.4."""
    check = MotionCheck()
    J, flow = np.zeros((20, 2, 1)), np.zeros((20, 2))
    J[:, 0, 0] = 100.0
    flow[:, 0] = 2.0
    for _ in range(KNOWN + 1):
        assert check.judge(flow, J, np.array([0.02])) is None
    variance = times * 0.4 * 40 / (2 * UNKNOWN)
    fault = check.judge(3 * flow, J, np.array([0.02]), 0.0, 0.0, variance)
    assert check.share == pytest.approx(0.4)
    check.least_share = 0.1
    check.forget_doubt()
    fault = check.judge(3 * flow, J, np.array([0.02]), 0.0, 0.0, variance)
    assert (fault is not None) == named


@pytest.mark.parametrize(
    ("places", "moving", "told"), [(100, 20, False), (100, 19, True), (40, 12, False), (40, 11, True)]
)
def test_places_that_stand_still_decide_only_where_hardly_any_moves(places, moving, told):
    """J stays behind on what the robot has left; but a robot that does not move at all leaves nothing."""
    J, span = np.zeros((places, 2, 1)), np.array([0.1])
    J[:, 0] = 60.0
    for still in (0.0, 0.99):  # px: as good as still
        check, flow = MotionCheck(), 6.0 * np.eye(2)[:1].repeat(places, axis=0)
        for _ in range(KNOWN):
            assert check.judge(flow, J, span) is None
        flow[moving:, 0] = still
        assert (check.judge(flow, J, span) is not None) == told
