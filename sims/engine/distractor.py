"""Distractors that move on their own before the camera: a textured plate, a person who walks by, a chair that rolls by.

The path of each is a Lissajous figure, p(t) = c + a sin(2 pi f t + phi), drawn from the seed, other for every
world. ``behind`` keeps the plate between the arm and the wall, where the arm covers it now and then; ``front`` lets it
pass before the arm. The person and the chair pass ``behind`` the arm, where the arm covers them, ``next`` to it, on
the side where the arm does not come, or ``across``, covering parts of it: the person's own arm, or the feet of a chair
that is carried past.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dense_vs.kernels.simulation.lissajous import lissajous_positions

Range = tuple[float, float]
_NO_MOTION: Range = (0.0, 0.0)


@dataclass(frozen=True)
class DistractorKind:
    """A distractor, and for each axis the range that its path is drawn from.

    Attributes:
        body: mocap body of the robot's model.
        center, amplitude: [m].
        frequency: [1/s].
        without: geoms of the body that this kind does not have.
    """

    body: str
    center: tuple[Range, Range, Range]
    amplitude: tuple[Range, Range, Range]
    frequency: tuple[Range, Range, Range]
    without: tuple[str, ...] = ()


def _plate(y: float) -> DistractorKind:
    return DistractorKind(
        "distractor",
        center=((-0.05, 0.05), (y, y), (0.3, 0.4)),
        amplitude=((0.25, 0.4), _NO_MOTION, (0.08, 0.16)),
        frequency=((0.1, 0.2), _NO_MOTION, (0.12, 0.25)),
    )


def _walker(x: Range, y: Range, amplitude: Range, frequency: Range, without: tuple[str, ...]) -> DistractorKind:
    """Back and forth sideways at a walk, with the bobbing of steps."""
    return DistractorKind(
        "walker",
        center=(x, y, _NO_MOTION),
        amplitude=(amplitude, (0.02, 0.06), (0.01, 0.02)),
        frequency=(frequency, (0.1, 0.2), (1.6, 2.0)),
        without=without,
    )


def _chair(x: Range, y: Range, amplitude: Range, frequency: Range, height: float = 0.0) -> DistractorKind:
    """Back and forth on its casters, or carried at a height [m]."""
    return DistractorKind(
        "chair",
        center=(x, y, (height, height)),
        amplitude=(amplitude, (0.05, 0.1), _NO_MOTION),
        frequency=(frequency, (0.1, 0.2), _NO_MOTION),
    )


_REACH = ("walker-reach", "walker-hand")  # the arm that reaches over the robot's
DISTRACTORS = {
    "behind": _plate(0.36),
    "front": _plate(-0.33),
    "walker-behind": _walker((-0.4, -0.1), (1.0, 1.2), (0.4, 0.7), (0.1, 0.18), _REACH),
    "walker-next": _walker((0.1, 0.15), (1.0, 1.1), (0.15, 0.2), (0.15, 0.3), _REACH),
    "walker-across": _walker((-0.15, 0.05), (0.95, 1.0), (0.3, 0.5), (0.1, 0.18), ()),
    "chair-behind": _chair((-0.4, 0.0), (0.8, 1.0), (0.3, 0.5), (0.1, 0.2)),
    "chair-next": _chair((0.15, 0.2), (0.8, 0.9), (0.15, 0.2), (0.15, 0.3)),
    "chair-across": _chair((-0.3, -0.15), (0.4, 0.45), (0.4, 0.6), (0.1, 0.18), height=1.21),
}


@dataclass(frozen=True)
class DistractorPath:
    """Paths of a distractor, one a world; SI units."""

    center: np.ndarray  # (worlds, 3)
    amplitude: np.ndarray  # (worlds, 3)
    frequency: np.ndarray  # (worlds, 3), 1/s
    phase: np.ndarray  # (worlds, 3), rad

    @classmethod
    def draw(cls, rngs: list[np.random.Generator], kind: str) -> "DistractorPath":
        """One path from each generator."""
        ranges = DISTRACTORS[kind]
        rows = []
        for rng in rngs:
            center, amplitude, frequency = (
                [_drawn(rng, *axis) for axis in axes] for axes in (ranges.center, ranges.amplitude, ranges.frequency)
            )
            rows.append((center, amplitude, frequency, rng.uniform(0.0, 2.0 * np.pi, 3)))
        return cls(*(np.array(column, dtype=np.float32) for column in zip(*rows, strict=True)))


class Distractor:
    """Writes the body's position for the time of each world into a (worlds, nmocap) array of positions."""

    def __init__(self, path: DistractorPath, mocap: int, device: wp.Device):
        self._mocap = mocap
        with wp.ScopedDevice(device):
            self._center = wp.array(path.center, dtype=wp.vec3)
            self._amplitude = wp.array(path.amplitude, dtype=wp.vec3)
            self._frequency = wp.array(path.frequency, dtype=wp.vec3)
            self._phase = wp.array(path.phase, dtype=wp.vec3)

    def place(self, time: wp.array, position: wp.array) -> None:
        """Position [m] at the worlds' times [s], shapes (worlds,) and (worlds, nmocap)."""
        lissajous_positions(self._center, self._amplitude, self._frequency, self._phase, time, self._mocap, position)


def _drawn(rng: np.random.Generator, low: float, high: float) -> float:
    # A value that is fixed takes no draw.
    return low if low == high else rng.uniform(low, high)
