"""What the gripper truly touches, by the engine's contacts: for scores only."""

from collections.abc import Callable
from types import TracebackType

import numpy as np

from dense_vs.sims.mobile_manipulator.world import FINGERS, MobileWorld

ACROSS = 0.5  # cosine, at least, between a finger's motion and the normal of what it presses on sideways


def held_between(world: MobileWorld, name: str) -> bool:
    """Whether both fingers press on an object sideways, from opposite sides: what lies under them is not between."""
    model, state, mine = world.model, world.state, world.geoms(name)
    closing = state.body("hand").xmat.reshape(3, 3)[:, 1]
    pressed = []
    for finger, side in zip(FINGERS, (1.0, -1.0), strict=True):
        geoms = np.flatnonzero(model.geom_bodyid == model.body(finger).id)
        # Normals point from the first geom to the second.
        towards = [
            normal @ closing * (1.0 if first in geoms else -1.0)
            for (first, second), normal in zip(state.contact.geom, state.contact.frame[:, :3], strict=True)
            if (first in geoms and second in mine) or (second in geoms and first in mine)
        ]
        # The left finger stands at +y and closes toward -y.
        pressed.append(any(-side * one > ACROSS for one in towards))
    return all(pressed)


class TouchRecord:
    """Records, while it is open, whether the fingers touch the scenery, and the palm an object.

    Args:
        world: whose frames are watched; what moves on its own in it goes on.
        name: of the object.

    Attributes:
        support: whether a finger touched floor, bin or another part of the room.
        palm: whether the palm, which carries the camera, touched the object.
    """

    def __init__(self, world: MobileWorld, name: str):
        model = world.model
        self._world, self._mine = world, world.geoms(name)
        bodies = [model.body(finger).id for finger in FINGERS]
        self._fingers = np.flatnonzero(np.isin(model.geom_bodyid, bodies))
        self._scenery = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
        self._palm = np.array([model.geom("palm").id])
        self.support = self.palm = False
        self._before: Callable[[], None] | None = None

    def __enter__(self) -> "TouchRecord":
        self._before = self._world.before_frame
        self._world.before_frame = self._look
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._world.before_frame = self._before

    def _look(self) -> None:
        if self._before is not None:
            self._before()
        pairs = self._world.state.contact.geom
        self.support |= _meet(pairs, self._fingers, self._scenery)
        self.palm |= _meet(pairs, self._palm, self._mine)


def _meet(pairs: np.ndarray, ones: np.ndarray, others: np.ndarray) -> bool:
    """Whether any of some pairs (k, 2) of geoms is of one of each group."""
    first, second = np.isin(pairs, ones), np.isin(pairs, others)
    return bool(np.any((first[:, 0] & second[:, 1]) | (first[:, 1] & second[:, 0])))
