"""The room an arm stands in: plaster walls, a wooden floor, boxes with textures of the package, one light."""

import shutil
from pathlib import Path

import mujoco
import numpy as np

from dense_vs.sims.arms.catalog import ROBOSUITE_ASSETS, CommercialArm

_TEXTURES = {  # material: picture in the package, repetitions
    "room_wall": ("cream-plaster.png", 2),
    "room_floor": ("wood-tiles.png", 4),
    "room_box0": ("red-wood.png", 1),
    "room_box1": ("cereal.png", 1),
    "room_box2": ("steel-brushed.png", 1),
    "room_box3": ("blue-wood.png", 1),
}
BOXES = 10
WALL_DISTANCE = 2.3  # m


def add_room(spec: mujoco.MjSpec, arm: CommercialArm, package: Path, assets: Path) -> None:
    """Add the room to a specification, in place; its pictures are copied into ``assets``."""
    for name, (picture, repeat) in _TEXTURES.items():
        shutil.copy(package / ROBOSUITE_ASSETS / "textures" / picture, assets / picture)
        spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=picture)
        material = spec.add_material(name=name, texrepeat=[repeat, repeat], specular=0.1, shininess=0.2)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    floor = arm.floor
    _add_box(spec, arm, "room_floor", (0, 0, floor - 0.02), (2.5, 2.5, 0.02), "room_floor")
    for side in range(4):
        angle = side * np.pi / 2
        place = (WALL_DISTANCE * np.cos(angle), WALL_DISTANCE * np.sin(angle), floor + 1.5)
        _add_box(spec, arm, f"room_wall{side}", place, (0.02, WALL_DISTANCE, 1.5), "room_wall", angle)
    if floor < 0:
        half = -floor / 2 - 0.005
        _add_box(spec, arm, "room_pedestal", (0, 0, floor / 2 - 0.005), (0.16, 0.16, half), "room_box2")
    random = np.random.default_rng(3)
    for number in range(BOXES):
        angle = 2 * np.pi * number / BOXES + 0.2
        distance = random.uniform(1.75, 1.95)
        size = (*random.uniform(0.12, 0.28, 2), random.uniform(0.2, 0.55))
        place = (distance * np.cos(angle), distance * np.sin(angle), floor + size[2])
        _add_box(spec, arm, f"room_box{number}", place, size, f"room_box{number % 4}", random.uniform(0, np.pi))
    spec.worldbody.add_light(
        name="room_light",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[*arm.origin, 4],
        dir=[0.3, 0.4, -0.85],
        diffuse=[0.45] * 3,
        specular=[0.3] * 3,
        ambient=[0, 0, 0],
        castshadow=False,
    )
    headlight = spec.visual.headlight
    headlight.ambient[:], headlight.diffuse[:], headlight.specular[:] = 0.35, 0.25, 0.1


def _add_box(spec, arm: CommercialArm, name: str, place, half_size, material: str, turn: float = 0.0) -> None:
    """A box that nothing touches, turned about the vertical; ``place`` is relative to the arm's base."""
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[place[0] + arm.origin[0], place[1] + arm.origin[1], place[2]],
        size=list(half_size),
        quat=[np.cos(turn / 2), 0, 0, np.sin(turn / 2)],
        material=material,
        contype=0,
        conaffinity=0,
        group=0,
    )
