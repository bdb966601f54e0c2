"""A hand that drags a chain's end about the floor on a winding way, with a jerk now and then, and stays in the room."""

import numpy as np

from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.mobile_manipulator.world import MobileWorld

JERK = 0.8  # m/s, for a twentieth of every 4 seconds
PERIOD = 120  # frames
ACCELERATION = 4.0  # m/s^2, the hand's; a chain pulled by steps of its speed flies apart
ROOM = 0.9  # m from where it began
HEIGHT = 0.012  # m over the floor


class DraggingHand:
    """Moves a chain's end; call it before every frame.

    Args:
        world: the chain's.
        name: of the chain.
        speed: [m/s] between jerks.
        rng: of the way.
    """

    def __init__(self, world: MobileWorld, name: str, speed: float, rng: np.random.Generator):
        self._world, self._name, self._speed, self._rng = world, name, speed, rng
        self._begin = world.frames
        self._middle = world.object_position(name)[:2].copy()
        self._heading = rng.uniform(-np.pi, np.pi)
        self._velocity = np.zeros(2)
        self._place = world.pull_chain(name, None)

    def __call__(self) -> None:
        """Move for a frame."""
        away = self._place[:2] - self._middle
        self._heading += 0.05 * self._rng.standard_normal()
        if np.hypot(*away) > ROOM and away @ [np.cos(self._heading), np.sin(self._heading)] > 0:
            self._heading = np.arctan2(-away[1], -away[0]) + self._rng.uniform(-0.8, 0.8)
        jerk = (self._world.frames - self._begin) % PERIOD < PERIOD // 20
        wanted = (JERK if jerk else self._speed) * np.array([np.cos(self._heading), np.sin(self._heading)])
        change = wanted - self._velocity
        most = ACCELERATION * FRAME_SECONDS
        self._velocity = self._velocity + change * min(1.0, most / max(float(np.hypot(*change)), 1e-9))
        self._place[:2] += FRAME_SECONDS * self._velocity
        self._place[2] = HEIGHT
        self._world.pull_chain(self._name, self._place)

    def let_go(self) -> None:
        """Hold nothing any more."""
        self._world.pull_chain(self._name, None)
