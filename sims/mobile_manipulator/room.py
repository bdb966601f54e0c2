"""Walls around the mobile manipulator's room, and things along them in the colors of clothes and objects, as in a room
that people live in: what a segmenter has to tell a person from. Nothing of it is ever touched."""

from collections.abc import Sequence

import mujoco
import numpy as np

from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint, add_material, painted_texture

FAR = (5.0, 5.0, 7.0)  # m to the walls: ahead, to either side, behind
HEIGHT = 4.0
_PLASTER = Paint((0.78, 0.74, 0.66), (0.73, 0.69, 0.61), 0.4, 0.02)
_FURNITURE = {  # paint, size [m], and its middle on the floor; drawn along the walls
    "shelf": (Paint((0.5, 0.33, 0.18), (0.42, 0.26, 0.13), 0.4, 0.1), (0.35, 1.1, 1.8), (4.75, 1.6, 0.0)),
    "curtain": (Paint((0.7, 0.2, 0.22), (0.55, 0.14, 0.18), 0.4, 0.02), (0.1, 0.9, 2.2), (4.9, -0.9, 0.2)),
    "poster": (Paint((0.9, 0.8, 0.25), (0.75, 0.12, 0.14), 0.35, 0.1), (0.04, 0.7, 0.9), (4.96, 0.35, 1.1)),
    "cabinet": (Paint((0.16, 0.2, 0.36), (0.12, 0.16, 0.28), 0.3, 0.1), (1.2, 0.45, 1.2), (2.6, 4.7, 0.0)),
    "sofa": (Paint((0.66, 0.14, 0.12), (0.5, 0.1, 0.1), 0.3, 0.02), (1.7, 0.7, 0.75), (1.5, -4.4, 0.0)),
    "door": (Paint((0.82, 0.66, 0.42), (0.75, 0.58, 0.36), 0.3, 0.1), (0.9, 0.06, 2.0), (3.6, -4.95, 0.0)),
    "picture": (Paint((0.25, 0.5, 0.3), (0.85, 0.75, 0.3), 0.3, 0.1), (1.0, 0.04, 0.7), (0.9, 4.96, 1.2)),
}


def add_room(spec: mujoco.MjSpec, seed: int, objects: Sequence[HouseholdObject]) -> None:
    """Put walls and furniture into a model, textures drawn from the seed."""
    ahead, aside, behind = FAR
    middle = (ahead - behind) / 2
    walls = {
        "wall_ahead": ((0.1, 2 * aside, HEIGHT), (ahead + 0.05, 0.0, 0.0)),
        "wall_left": ((ahead + behind, 0.1, HEIGHT), (middle, aside + 0.05, 0.0)),
        "wall_right": ((ahead + behind, 0.1, HEIGHT), (middle, -aside - 0.05, 0.0)),
        "wall_behind": ((0.1, 2 * aside, HEIGHT), (-behind - 0.05, 0.0, 0.0)),
    }
    add_material(spec, "walls", painted_texture(np.random.default_rng([seed, 26]), _PLASTER, 256), _PLASTER, 0.5)
    for name, (size, place) in walls.items():
        _add_box(spec, name, "walls", size, place)
    for number, (name, (paint, size, place)) in enumerate(_FURNITURE.items()):
        add_material(spec, name, painted_texture(np.random.default_rng([seed, 27, number]), paint), paint, 1.5)
        _add_box(spec, name, name, size, place)


def _add_box(spec: mujoco.MjSpec, name: str, material: str, size, place) -> None:
    """A box by its full lengths, standing with its bottom center at a place."""
    length, width, height = size
    x, y, z = place
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[length / 2, width / 2, height / 2],
        pos=[x, y, z + height / 2],
        contype=0,
        conaffinity=0,
        material=material,
        rgba=[0.5, 0.5, 0.5, 1.0],
    )
