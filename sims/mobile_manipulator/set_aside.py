"""Objects that are put aside float where they are and touch nothing, so that they cost the engine no contacts."""

from collections.abc import Sequence

import mujoco
import numpy as np


class ObjectsInPlay:
    """Which free bodies of a model take part in the physics; none of them at first.

    Args:
        model: that the engine steps; gravity compensation and collision masks of the bodies' geoms are set in it.
        bodies: names of the objects' root bodies.
    """

    def __init__(self, model: mujoco.MjModel, bodies: Sequence[str]):
        self._model = model
        self._members = {name: np.flatnonzero(model.body_rootid == model.body(name).id) for name in bodies}
        self._geoms = {
            name: np.flatnonzero(np.isin(model.geom_bodyid, members)) for name, members in self._members.items()
        }
        self._masks = model.geom_contype.copy(), model.geom_conaffinity.copy()
        self._in_play = dict.fromkeys(bodies, True)
        for body in bodies:
            self.set(body, False)

    def known(self, body: str) -> bool:
        """Whether an object takes part."""
        return self._in_play[body]

    def set(self, body: str, taking_part: bool) -> None:
        """Let an object take part, or set it aside where it is."""
        model, geoms, (contype, conaffinity) = self._model, self._geoms[body], self._masks
        model.body_gravcomp[self._members[body]] = 0.0 if taking_part else 1.0
        model.geom_contype[geoms] = contype[geoms] if taking_part else 0
        model.geom_conaffinity[geoms] = conaffinity[geoms] if taking_part else 0
        self._in_play[body] = taking_part
