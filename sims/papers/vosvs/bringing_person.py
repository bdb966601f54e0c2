"""A person who brings a thing, puts it down before the robot, and steps back: VOS-VS Fig. 20, to show where it is."""

from collections.abc import Iterator

import numpy as np

from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.mobile_manipulator.person import HIP, Person
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.walking_person import WalkingPerson

REACH = 0.52  # m, how far before the hips things are put down
CARRY = (0.34, -0.16, 1.02)  # the hand while walking: to the front, to the left, over the floor [m]
_STOOP = (0.42, 1.1)  # hips over the floor [m], lean [rad]
_SECONDS = 1.4  # to stoop, and to rise
_BEFORE = 0.05  # m, from the hand to the middle of what it holds
_CLEAR = 0.004  # m over the floor at which it is let go
_BACK = 1.3  # m, stepped back in the end


class BringingPerson:
    """Brings an object from where the person stands; call it before every frame.

    Args:
        world: with the person in it.
        person: who; the hand is empty.
        name: of the object, which appears in the hand.
        start: where the person begins (x, y) [m].
        goal: where to put the object (x, y) [m].
        toward: (x, y) that the person then faces [m]: the robot's place.

    Attributes:
        name: of the object.
        walker: the walk.
        done: whether the object is there and the person has stepped back.
    """

    def __init__(
        self,
        world: MobileWorld,
        person: Person,
        name: str,
        start: tuple[float, float],
        goal: np.ndarray,
        toward: tuple[float, float],
    ):
        self.name = name
        self._person, self._toward = person, np.array(toward, dtype=float)
        goal = np.asarray(goal, dtype=float)
        away = (goal - self._toward) / np.linalg.norm(goal - self._toward)
        self._spot, self._exit = goal + REACH * away, goal + (REACH + _BACK) * away
        way = self._spot - np.array(start)
        self.walker = WalkingPerson(person, start, float(np.arctan2(way[1], way[0])))
        self.walker.hand = np.array(CARRY)
        self.walker.show()
        self._half = world.objects[name].height / 2
        self._put_in_hand(world, name)
        self._steps: Iterator[None] = self._script()
        self.done = False

    def __call__(self) -> None:
        """Act for a frame."""
        if not self.done:
            self.done = next(self._steps, True) is True

    def _put_in_hand(self, world: MobileWorld, name: str) -> None:
        heading = self.walker.heading
        x, y, z = CARRY[0] + _BEFORE, CARRY[1], CARRY[2] - self._half
        ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        world.place(
            name, [*(self.walker.place + x * ahead + y * left), z], heading + np.pi / 2, settle_frames=0
        )  # its broad side ahead
        self._person.hold(name)

    def _script(self) -> Iterator[None]:
        walker = self.walker
        yield from self._walk(self._spot)
        while not walker.face(self._toward):
            walker.show()
            yield
        low = np.array([REACH - _BEFORE, 0.0, self._half + _CLEAR])
        yield from self._change(np.array([*_STOOP, *low]))
        self._person.let_go()
        yield from self._pause(10)
        # The hand goes back before it goes up.
        yield from self._change(np.array([*_STOOP, REACH - 0.2, -0.05, self._half + 0.06]), 0.4)
        yield from self._change(np.array([HIP, 0.0, *CARRY]))
        walker.hand = None
        yield from self._walk(self._exit)

    def _walk(self, goal: np.ndarray) -> Iterator[None]:
        self.walker.goal = goal
        while not self.walker.there:
            self.walker()
            yield
        yield from self._pause(10)

    def _pause(self, frames: int) -> Iterator[None]:
        for _ in range(frames):
            self.walker()
            yield

    def _change(self, goal: np.ndarray, seconds: float = _SECONDS) -> Iterator[None]:
        """Bring hips, lean and hand to (5,) values, smoothly."""
        walker = self.walker
        assert walker.hand is not None
        begin = np.array([walker.hips, walker.lean, *walker.hand])
        frames = max(1, round(seconds / FRAME_SECONDS))
        for frame in range(1, frames + 1):
            share = 0.5 - 0.5 * np.cos(np.pi * frame / frames)
            now = begin + share * (goal - begin)
            walker.hips, walker.lean, walker.hand = float(now[0]), float(now[1]), now[2:]
            walker.show()
            yield
