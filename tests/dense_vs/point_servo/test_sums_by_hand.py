"""Shares of motion over time and of known pixels, and what sets the pace, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.pipeline import ExplainedMotion
from dense_vs.pipeline.explained_motion import MotionSums, share_of_pixels_known
from dense_vs.point_servo import following


def spans(*ones):
    explained = ExplainedMotion(2)
    for time, energy, *parts in ones:
        explained._add(MotionSums(time, energy, np.array(parts, float)))
    return explained


def test_shares_lie_between_times():
    explained = spans((1.0, 10.0, 4.0, 2.0), (2.0, 0.0, 0.0, 0.0), (3.0, 30.0, 9.0, -3.0), (5.0, 10.0, 10.0, 0.0))
    assert explained.explained() == pytest.approx(22 / 50)
    np.testing.assert_allclose(explained.by_joint(), [23 / 50, -1 / 50])
    assert explained.explained(1.0, 3.0) == pytest.approx(6 / 30)  # after the first time, up to the second
    assert explained.explained(0.9, 2.9) == pytest.approx(0.6)
    assert np.isnan(explained.explained(1.0, 2.0))
    times, shares = explained.over_time()
    np.testing.assert_allclose(times, [1.0, 3.0, 5.0])
    np.testing.assert_allclose(shares, [0.6, 0.2, 1.0])
    assert explained.settled() == pytest.approx(16 / 40)  # after 1 + a quarter of 4 s
    first, second, third, fourth = explained.quarters()
    assert first == pytest.approx(0.6)
    assert (second, fourth) == pytest.approx((0.2, 1.0))
    assert np.isnan(third)
    nothing = ExplainedMotion(2)
    assert np.isnan([nothing.settled(), *nothing.quarters(), nothing.explained()]).all()
    assert nothing.over_time()[0].size == 0


def test_long_recordings_join_their_spans(monkeypatch):
    monkeypatch.setattr("dense_vs.pipeline.explained_motion.MOST_SPANS", 4)
    explained = spans(*((float(k), 1.0, k / 10, 0.0) for k in range(9)))
    assert len(explained.spans) < 4
    assert explained.explained() == pytest.approx(sum(range(9)) / 90)
    assert explained.over_time()[0][-1] == 8.0


def test_pixels_are_known_that_a_usual_step_moves_by_a_tenth():
    J = np.zeros((1, 5, 2, 2))
    J[0, 0, 0, 0] = 9.9  # 0.099 px by the first joint's step
    J[0, 1, 0, 0] = 10.1
    J[0, 2, :, 1] = [3.6, 4.8]  # 0.12 px by the second's
    J[0, 3] = [[9.0, 4.0], [0.0, 0.0]]  # together they would, each by itself not
    J[0, 4, 0, 0] = np.nan
    estimator = SimpleNamespace(to_numpy=lambda: J)
    assert share_of_pixels_known(estimator, np.array([0.01, 0.02])) == pytest.approx(0.4)


def pipeline(updates, found=None, flow=None):
    estimator = SimpleNamespace(updates=updates, predicted_flow=lambda dq: np.full((2, 50, 2), 7.0), jacobian="J")
    body = None if found is None else SimpleNamespace(recognition=lambda J: found)
    frame = SimpleNamespace(dq=np.zeros(2), flow=flow)
    return SimpleNamespace(estimator=estimator, body=body), frame


def test_babbling_is_paced_by_the_flow_and_by_j_once_it_is_learned():
    measured = np.full((2, 50, 2), 3.0)
    learned = following.LEARNED_UPDATES
    assert following.pacing_flow(*pipeline(learned, flow=measured)) is measured
    np.testing.assert_array_equal(following.pacing_flow(*pipeline(learned + 1, flow=measured)), 7.0)
    assert following.pacing_flow(*pipeline(learned)) is None
    one, frame = pipeline(learned + 1)
    frame.dq = None
    assert following.pacing_flow(one, frame) is None


@pytest.mark.parametrize(("own", "known"), [(0, False), (1, True), (2, True)])
def test_what_is_not_the_robot_does_not_set_the_pace_once_the_robot_is_known(own, known):
    """One of a hundred pixels is enough."""
    found = np.full((2, 50), -1)
    found.ravel()[:own] = 1
    found[1, 40:] = 0
    flow = following.pacing_flow(*pipeline(10**6, found=found))
    assert np.isnan(flow[1, 40:]).all() == known
    assert np.isfinite(flow[0]).all()
    assert np.isfinite(flow[1, :40]).all()


@pytest.mark.parametrize(
    ("correlation", "lost", "renew", "renewed", "why"),
    [(0.9, False, 0.93, True, ""), (0.93, False, 0.93, False, ""), (0.85, False, 0.93, True, ""),
     (0.84, False, 0.93, False, "its surroundings correlate by 0.84 with how they were"), (0.9, True, 0.93, False, ""),
     (0.9, False, None, False, "")],
)  # fmt: skip
@pytest.mark.parametrize("far", [False, True])
def test_a_point_is_taken_along_by_flow_or_by_j(monkeypatch, correlation, lost, renew, renewed, why, far):
    events = []
    tracker = SimpleNamespace(
        correlation=np.array([correlation]), lost=np.array([lost]), points=np.zeros((1, 2)),
        options=SimpleNamespace(min_correlation=0.85), update=lambda flow, gray: events.append(flow),
        redefine=lambda *_: events.append("renewed"),
    )  # fmt: skip
    monkeypatch.setattr(following, "same_surface", lambda *_: None)
    most = following.MOST_BRIDGED
    line = SimpleNamespace(
        estimator=SimpleNamespace(predicted_flow=lambda dq: ("by J", float(dq[0]))),
        motion=lambda dq: most + (0.1 if far else 0.0),
    )
    before, now = (
        SimpleNamespace(positions=np.array([0.1]), gray="g0"),
        SimpleNamespace(positions=np.array([0.3]), gray="g1"),
    )
    said = following.follow(tracker, line, lambda a, b, at: (a, b, at.tolist()), before, now, renew)
    assert events[0] == (("by J", pytest.approx(0.2)) if far else ("g0", "g1", [0.0, 0.0]))
    assert events[1:] == (["renewed"] if renewed else [])
    assert said == why
