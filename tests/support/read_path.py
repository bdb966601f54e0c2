"""A robot whose joints go along a smooth random path, for tests of what is read of it and when."""

import numpy as np

PLACES, JOINTS, FRAME = 150, 4, 1 / 30
NAMES = tuple("abcd")


class Path:
    """A robot that goes along a smooth random path, read at the time that is set."""

    def __init__(self, seed, frames=200):
        rng = np.random.default_rng(seed)
        noise, steps = np.zeros(JOINTS), []
        for _ in range(frames):
            noise = 0.85 * noise + rng.normal(0, 0.006, JOINTS)
            steps.append(noise)
        self.path, self.time = np.cumsum(steps, axis=0), 0.0

    def at(self, time):
        return np.array([np.interp(time, np.arange(len(self.path)) * FRAME, joint) for joint in self.path.T])

    def joints(self):
        return self.at(self.time), self.time
