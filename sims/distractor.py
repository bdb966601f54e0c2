"""A textured plate that moves on its own: what is not the robot also moves.

Its path is a Lissajous figure in a plane that faces the camera, p(t) = c + a sin(2 pi f t + phi), drawn from
the seed, other for every world. ``behind`` keeps it between the arm and the wall, where the arm covers it now and then;
``front`` lets it pass before the arm.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dense_vs.kernels.lissajous import lissajous_positions

DISTRACTORS = ("none", "behind", "front")
DISTRACTOR_BODY = "distractor"
_PLANE = {"behind": 0.36, "front": -0.33}  # y of the path's plane [m]


@dataclass(frozen=True)
class DistractorPath:
    """Paths of a distractor, one a world; SI units."""

    centre: np.ndarray  # (worlds, 3)
    amplitude: np.ndarray  # (worlds, 3)
    frequency: np.ndarray  # (worlds, 3), 1/s
    phase: np.ndarray  # (worlds, 3), rad

    @classmethod
    def draw(cls, rngs: list[np.random.Generator], kind: str) -> "DistractorPath":
        """One path from each generator."""
        rows = []
        for rng in rngs:
            centre = (rng.uniform(-0.05, 0.05), _PLANE[kind], rng.uniform(0.3, 0.4))
            amplitude = (rng.uniform(0.25, 0.4), 0.0, rng.uniform(0.08, 0.16))
            frequency = (rng.uniform(0.1, 0.2), 0.0, rng.uniform(0.12, 0.25))
            rows.append((centre, amplitude, frequency, rng.uniform(0.0, 2.0 * np.pi, 3)))
        return cls(*(np.array(column, dtype=np.float32) for column in zip(*rows, strict=True)))


class Distractor:
    """Writes the plate's position for the time of each world into a (worlds, nmocap) array of positions."""

    def __init__(self, path: DistractorPath, mocap: int, device: wp.Device):
        self._mocap = mocap
        with wp.ScopedDevice(device):
            self._centre = wp.array(path.centre, dtype=wp.vec3)
            self._amplitude = wp.array(path.amplitude, dtype=wp.vec3)
            self._frequency = wp.array(path.frequency, dtype=wp.vec3)
            self._phase = wp.array(path.phase, dtype=wp.vec3)

    def place(self, time: wp.array, position: wp.array) -> None:
        """Position [m] at the worlds' times [s], shapes (worlds,) and (worlds, nmocap)."""
        lissajous_positions(self._centre, self._amplitude, self._frequency, self._phase, time, self._mocap, position)
