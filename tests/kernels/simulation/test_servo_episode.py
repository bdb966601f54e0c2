"""Phases of a batch's worlds, frame by frame, against what each frame's point and target say."""

import numpy as np
import warp as wp

from dense_vs.kernels.simulation.servo_episode import (
    LOST,
    MISSED,
    PENDING,
    REACHED,
    REACHING,
    RESTING,
    EpisodeState,
    advance_episodes,
)

TARGETS = np.array([[[10.0, 10.0], [20.0, 10.0], [30.0, 10.0]]] * 3)
FAR = [0.0, 0.0]


def advance(state, tracked, lost=(0, 0, 0), true=None):
    points = np.array(tracked, dtype=np.float64)[:, None]
    truth = points if true is None else np.array(true, dtype=np.float64)[:, None]
    advance_episodes(
        state,
        wp.array(points, dtype=wp.vec2d, device="cpu"),
        wp.array(np.array(lost)[:, None], dtype=int, device="cpu"),
        wp.array(truth, dtype=wp.vec2d, device="cpu"),
        wp.zeros(3, dtype=int, device="cpu"),
        babble_frames=2,
        tolerance=1.0,
        settle_frames=2,
        max_frames=4,
    )


def test_a_lost_point_ends_its_worlds_run_and_no_other():
    state = EpisodeState.empty(TARGETS, "cpu")
    advance(state, [FAR] * 3)
    assert not state.defining.numpy().any()
    advance(state, [FAR] * 3, true=[[1.0, 2.0]] * 3)  # babbled enough: the point is defined
    np.testing.assert_array_equal(state.phase.numpy(), REACHING)
    np.testing.assert_array_equal(state.defining.numpy(), 1)
    np.testing.assert_array_equal(state.point.numpy()[:, 0], [[1.0, 2.0]] * 3)
    # World 0 is at its target, world 1 loses its point, world 2 gets nowhere.
    advance(state, [[10.0, 10.5], [5.0, 5.0], FAR], lost=[0, 1, 0], true=[[10.0, 10.5], [6.0, 6.0], FAR])
    np.testing.assert_array_equal(state.outcome.numpy(), [[PENDING] * 3, [LOST] * 3, [PENDING] * 3])
    np.testing.assert_array_equal(state.phase.numpy(), [REACHING, RESTING, REACHING])
    np.testing.assert_array_equal(state.defining.numpy(), 0)  # it is not given its point again
    np.testing.assert_array_equal(state.point.numpy()[1, 0], [5.0, 5.0])
    np.testing.assert_array_equal(state.frames.numpy()[1], [1, 0, 0])
    np.testing.assert_allclose(state.error.numpy()[1], [np.hypot(5, 5), np.nan, np.nan], rtol=1e-6)
    np.testing.assert_allclose(state.true_error.numpy()[1], [np.hypot(4, 4), np.nan, np.nan], rtol=1e-6)
    for _ in range(3):
        advance(state, [[10.0, 10.5], FAR, FAR], lost=[0, 0, 0])
    np.testing.assert_array_equal(state.outcome.numpy()[:, 0], [REACHED, LOST, MISSED])
    np.testing.assert_array_equal(state.outcome.numpy()[:, 1], [PENDING, LOST, PENDING])
    np.testing.assert_array_equal(state.phase.numpy(), [REACHING, RESTING, REACHING])
    np.testing.assert_array_equal(state.target.numpy()[[0, 2]], TARGETS[[0, 2], 1])
