"""A memory of the humanoid is made of the episodes chosen and no other."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))


def test_a_memory_is_made_of_the_episodes_chosen_and_no_other(monkeypatch):
    import remembered

    class Seen:
        def __init__(self, names):
            self.images, self.joints = [], []

        def add(self, episode, scale):
            assert scale == 0.5
            number = episode
            self.images = [np.full((4, 6), number + k, np.uint8) for k in range(3)]
            self.joints = np.array([[number + 0.1 * k] for k in range(3)])
            self.learned = np.array([number == 5, number == 10])

        def steps(self, first, last):
            assert (first, last) == (0, 3)
            return [(1, np.array([0.1])), (2, np.array([0.2]))]

    class Fit:
        def __init__(self, size, keyframes):
            self.size, self.keyframes, self.seen = size, keyframes, []

        def add(self, flow, q, dq):
            self.seen.append((float(flow[0, 0]), q[0], dq[0]))

        def solved(self):
            return self

    episodes = SimpleNamespace(joint_names=["a"], episode=lambda number: SimpleNamespace(shifted=lambda _: number))
    monkeypatch.setattr(remembered, "open_recording", lambda data, joint_names: episodes)
    monkeypatch.setattr(remembered, "SeenBody", Seen)

    def flow(method, height, width):
        return lambda before, now: 10.0 * before + now

    monkeypatch.setattr(remembered, "FlowEstimator", flow)
    monkeypatch.setattr(remembered, "MemoryFit", Fit)
    monkeypatch.setattr(remembered.Keyframes, "choose", lambda *chosen: chosen)
    fit = remembered.Remembered({5: "clock", 10: "clock", 20: "clock"}).of([5, 10])
    assert fit.size == (4, 6)
    assert [one[0] for one in fit.seen] == [10 * 5 + 6, 10 * 6 + 7, 10 * 10 + 11, 10 * 11 + 12]
    np.testing.assert_allclose([one[1:] for one in fit.seen], [(5.1, 0.1), (5.2, 0.2), (10.1, 0.1), (10.2, 0.2)])
    positions, steps, learned = fit.keyframes
    np.testing.assert_allclose(positions[:, 0], [5.1, 5.2, 10.1, 10.2])
    np.testing.assert_allclose(steps[:, 0], [0.1, 0.2, 0.1, 0.2])
    assert learned.tolist() == [True, True]  # a joint that any of them has moved
