"""A body remembered from some of the humanoid's episodes, as ``dense-vs body --kind posture --scale 0.5`` learns it."""

from collections.abc import Iterable

import numpy as np
from g1_episodes import ARM, DATA

from dense_vs.body_model import Keyframes, MemoryFit, PostureMemory
from dense_vs.cli.body_recordings import SeenBody
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.recording import ClockOffset, open_recording


class Remembered:
    """Flow of every episode, measured once; memories of any choice of them.

    Args:
        clocks: offset of each episode, by its number.
    """

    def __init__(self, clocks: dict[int, ClockOffset]):
        recording = open_recording(DATA, joint_names=ARM)
        self._seen: dict[int, SeenBody] = {}
        self._flows: dict[int, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
        for number, clock in clocks.items():
            seen = self._seen[number] = SeenBody(recording.joint_names)
            seen.add(recording.episode(number).shifted(clock), 0.5)
            flow = FlowEstimator("dis-medium", *seen.images[0].shape)
            self._flows[number] = [
                (flow(seen.images[k - 1], seen.images[k]).astype(np.float16), seen.joints[k], step)
                for k, step in seen.steps(0, len(seen.images))
            ]
            self._size = seen.images[0].shape
            seen.images.clear()

    def of(self, numbers: Iterable[int]) -> PostureMemory:
        """The memory of these episodes."""
        chosen = list(numbers)
        flows = [one for number in chosen for one in self._flows[number]]
        learned = np.any([self._seen[number].learned for number in chosen], axis=0)
        positions, steps = (np.array([one[k] for one in flows]) for k in (1, 2))
        fit = MemoryFit(self._size, Keyframes.choose(positions, steps, learned))
        for flow, q, dq in flows:
            fit.add(flow, q, dq)
        return fit.solved()
