"""A person who walks about before the robot: from place to place, by turns slow and brisk, with a stop now and then."""

from collections.abc import Callable

import numpy as np

from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.mobile_manipulator.person import HIP, Person, PersonPose

STEP = 0.62  # m, of one step
TURN = 2.0  # rad/s
ACCELERATION = 1.2  # m/s^2
NEAR = 0.08  # m from a place that counts as there


class WalkingPerson:
    """Walks toward a goal, if there is one; call it before every frame.

    Args:
        person: who.
        place: (x, y) where to begin [m].
        heading: [rad].

    Attributes:
        goal: (x, y) [m] to walk to; None stands.
        speed: [m/s] on the way.
        hand: where the right hand is (3,) relative to the hips' place, x to the front [m]; None lets it swing.
        hips, lean: see :class:`PersonPose`.
        traveled: the way so far [m].
    """

    def __init__(self, person: Person, place: tuple[float, float], heading: float):
        self.person = person
        self._place, self._heading = np.array(place, dtype=float), float(heading)
        self._phase = self._pace = 0.0
        self.goal: np.ndarray | None = None
        self.speed = 0.7
        self.hand: np.ndarray | None = None
        self.hips, self.lean = HIP, 0.0
        self.traveled = 0.0
        self.show()

    @property
    def place(self) -> np.ndarray:
        """(x, y) [m]."""
        return self._place.copy()

    @property
    def heading(self) -> float:
        """[rad]."""
        return self._heading

    @property
    def there(self) -> bool:
        """Whether there is no goal left to walk to."""
        return self.goal is None

    def __call__(self) -> None:
        """Move for a frame."""
        wanted = 0.0
        if self.goal is not None:
            way = np.asarray(self.goal, dtype=float) - self._place
            distance = float(np.hypot(*way))
            if distance < NEAR:
                self.goal = None
            else:
                self._turn_to(float(np.arctan2(way[1], way[0])))
                ahead = float(np.cos(np.arctan2(way[1], way[0]) - self._heading))
                # Slow enough to stop at the goal, and not before the turn is nearly done.
                wanted = min(self.speed, np.sqrt(2 * ACCELERATION * distance)) * max(0.0, ahead) ** 2
        most = ACCELERATION * FRAME_SECONDS
        self._pace += float(np.clip(wanted - self._pace, -2 * most, most))
        step = FRAME_SECONDS * self._pace
        self._place += step * np.array([np.cos(self._heading), np.sin(self._heading)])
        self._phase += np.pi * step / STEP
        self.traveled += step
        self.show()

    def face(self, place: np.ndarray) -> bool:
        """Turn toward a place for a frame; whether that is done."""
        way = np.asarray(place, dtype=float)[:2] - self._place
        return self._turn_to(float(np.arctan2(way[1], way[0])))

    def show(self) -> None:
        """Stand as it is now."""
        hand = None
        if self.hand is not None:
            cos, sin = np.cos(self._heading), np.sin(self._heading)
            x, y, z = self.hand
            hand = (self._place[0] + cos * x - sin * y, self._place[1] + sin * x + cos * y, z)
        stride = 0.5 * STEP * min(1.0, self._pace / 0.5)
        x, y = self._place
        self.person.show(PersonPose((x, y), self._heading, self._phase, stride, self.hips, self.lean, hand))

    def _turn_to(self, heading: float) -> bool:
        off = (heading - self._heading + np.pi) % (2 * np.pi) - np.pi
        self._heading += float(np.clip(off, -TURN * FRAME_SECONDS, TURN * FRAME_SECONDS))
        return abs(off) < TURN * FRAME_SECONDS


class Stroll:
    """Sends a walking person from place to place without end; call it before every frame.

    Args:
        walker: who.
        draw: the next place (x, y) [m].
        rng: of speeds and stops.
        speeds: least and highest [m/s].
    """

    def __init__(
        self,
        walker: WalkingPerson,
        draw: Callable[[np.random.Generator], np.ndarray],
        rng: np.random.Generator,
        speeds: tuple[float, float] = (0.4, 0.9),
    ):
        self.walker, self._draw, self._rng, self._speeds = walker, draw, rng, speeds
        self._pause = 0

    def __call__(self) -> None:
        """Move for a frame."""
        if self.walker.there and self._pause <= 0:
            self.walker.goal = self._draw(self._rng)
            self.walker.speed = self._rng.uniform(*self._speeds)
            self._pause = int(self._rng.integers(0, 30))
        elif self.walker.there:
            self._pause -= 1
        self.walker()
