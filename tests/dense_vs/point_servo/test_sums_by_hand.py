"""What sets the pace of babbling, and how a point is taken along, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.point_servo import following


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
        options=SimpleNamespace(min_correlation=0.85, window=25), update=lambda flow, gray: events.append(flow),
        redefine=lambda points, gray, weights: events.append((gray, *weights)),
    )  # fmt: skip
    monkeypatch.setattr(following, "patch_weights", lambda pipeline, point, window: (pipeline, point.tolist(), window))
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
    assert events[1:] == ([("g1", line, [0.0, 0.0], 25)] if renewed else [])
    assert said == why
