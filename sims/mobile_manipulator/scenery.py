"""Rooms other than that of the trials: other floors, walls, supports and lights, drawn from a seed.

What a segmenter learned in such rooms it has never seen before the backgrounds that it is asked about.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.materials import MATERIALS
from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint, add_material, painted_texture

PATTERNS = ("mottled", "tiles", "stripes", "wood", "plaster", "carton")
PRINTED = ("wood", "plaster", "carton")  # drawn by the engine, whose colors are mixed with the surface's
APART = 0.2  # of color, at least, between a surface of another room and every one of the trials' room, RGB in 0 to 1
HEIGHTS_APART = 0.03  # m, likewise of supports
TESTED_HEIGHTS = (0.0, 0.125, 0.25)  # m, of the trials' supports
_TEXELS = 128
_WALLS = (  # middle and half lengths [m]
    ((3.2, 0.0, 1.2), (0.05, 5.0, 1.2)),
    ((0.0, 4.2, 1.2), (5.0, 0.05, 1.2)),
    ((0.0, -4.2, 1.2), (5.0, 0.05, 1.2)),
)


@dataclass(frozen=True)
class Surface:
    """How something in a room looks: RGB in 0 to 1, a pattern of :data:`PATTERNS`, and the seed that draws it."""

    color: tuple[float, float, float]
    pattern: str
    seed: int


@dataclass(frozen=True)
class Support:
    """A box that objects stand on: its middle, half its lengths and its height [m]."""

    middle: tuple[float, float]
    half: tuple[float, float]
    height: float
    surface: Surface


@dataclass(frozen=True)
class Lamp:
    """A directional light: where it shines to, its brightness, and its color's deviation from white."""

    direction: tuple[float, float, float]
    diffuse: tuple[float, float, float]


@dataclass(frozen=True)
class Scenery:
    """A room.

    Attributes:
        floor, wall: how they look.
        supports: two boxes, in place of the green and the blue bin of the trials.
        lamps: in place of the trials' lamp and window.
        ambient: light from everywhere.
    """

    floor: Surface
    wall: Surface
    supports: tuple[Support, Support]
    lamps: tuple[Lamp, Lamp]
    ambient: float

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Where objects are put: on the floor beside the supports, and on the middle of each (x, y, z) [m]."""
        return (1.0, -0.55, 0.0), *((*one.middle, one.height) for one in self.supports)


def draw_scenery(seed: int, number: int) -> Scenery:
    """The room of that number: surfaces, heights and lights away from those of the trials' room.

    Args:
        seed: of everything in it.
        number: rooms of one seed differ by it.
    """
    rng = np.random.default_rng([seed, 45, number])
    supports = []
    for y in (0.0, 0.55):
        half = float(rng.uniform(0.15, 0.19)), float(rng.uniform(0.19, 0.25))
        supports.append(Support((1.0, y), half, _draw_height(rng), _draw_surface(rng)))
    lamps = _draw_lamp(rng, rng.uniform(0.3, 0.6)), _draw_lamp(rng, rng.uniform(0.05, 0.3))
    floor, wall = _draw_surface(rng), _draw_surface(rng)
    return Scenery(floor, wall, (supports[0], supports[1]), lamps, float(rng.uniform(0.22, 0.42)))


def trial_colors() -> np.ndarray:
    """Colors (3, 3) of the floor and the two bins of the trials' room, before their mottling."""
    text = resources.files("dense_vs.sims").joinpath("models", "mobile_manipulator.xml").read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text)
    return np.array([spec.geom(name).rgba[:3] for name in ("floor", "green_bin", "blue_bin")])


class OtherRoom:
    """Makes a room of a scenery out of that of the trials; to be given to a :class:`MobileWorld` as an addition.

    Args:
        scenery: the room's floor, supports in place of the bins, lights, and walls, which the trials' room has not.
    """

    def __init__(self, scenery: Scenery):
        self.scenery = scenery

    def __call__(self, spec: mujoco.MjSpec, _seed: int, _objects: Sequence[HouseholdObject]) -> None:
        """Change a model, in place.

        Raises:
            DenseVSError: a pattern that does not exist.
        """
        scenery = self.scenery
        _paint(spec, spec.geom("floor"), scenery.floor, repeat=1.2)
        for name, support in zip(("green_bin", "blue_bin"), scenery.supports, strict=True):
            geom = spec.geom(name)
            geom.size = [*support.half, support.height / 2]
            geom.pos = [*support.middle, support.height / 2]
            _paint(spec, geom, support.surface)
        for number, (place, size) in enumerate(_WALLS):
            wall = spec.worldbody.add_geom(
                name=f"wall_{number}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=place, size=size, contype=1, conaffinity=0
            )
            _paint(spec, wall, scenery.wall, repeat=0.8)
        for light, lamp in zip(spec.lights, scenery.lamps, strict=True):
            light.dir, light.diffuse = list(lamp.direction), list(lamp.diffuse)
        spec.visual.headlight.ambient = [scenery.ambient] * 3


def _draw_lamp(rng: np.random.Generator, brightness: float) -> Lamp:
    x, y = rng.uniform(-0.7, 0.7, 2)
    red, green, blue = brightness * rng.uniform(0.85, 1.1, 3)
    return Lamp((float(x), float(y), -0.8), (float(red), float(green), float(blue)))


def _draw_height(rng: np.random.Generator) -> float:
    while True:
        height = float(rng.uniform(0.05, 0.32))
        if np.abs(height - np.array(TESTED_HEIGHTS)).min() > HEIGHTS_APART:
            return height


def _draw_surface(rng: np.random.Generator) -> Surface:
    known = trial_colors()
    while True:
        color = rng.uniform(0.1, 0.9, 3)
        color = 0.5 * color + 0.5 * color.mean()  # rooms are duller than toys
        if np.linalg.norm(color - known, axis=1).min() > APART:
            break
    pattern = str(rng.choice(PATTERNS))
    return Surface((float(color[0]), float(color[1]), float(color[2])), pattern, int(rng.integers(1 << 30)))


def _paint(spec: mujoco.MjSpec, geom: mujoco.MjsGeom, surface: Surface, repeat: float = 0.0) -> None:
    name = f"other_{geom.name}"
    add_material(spec, name, surface_texture(surface), Paint(surface.color, specular=0.1), repeat)
    geom.material = name
    geom.rgba = [0.5, 0.5, 0.5, 1.0]


def surface_texture(surface: Surface) -> np.ndarray:
    """Texture (H, W, 3) uint8 of a surface.

    Raises:
        DenseVSError: a pattern that does not exist.
    """
    rng, color = np.random.default_rng(surface.seed), np.array(surface.color)
    if surface.pattern == "mottled":
        return painted_texture(rng, Paint(surface.color, tuple(np.clip(0.8 * color, 0, 1)), 0.35), _TEXELS)
    if surface.pattern in PRINTED:
        drawn = MATERIALS[surface.pattern](rng).astype(float)
        return np.rint(np.clip(drawn - drawn.mean(axis=(0, 1)) + 255 * color, 0, 255)).astype(np.uint8)
    if surface.pattern not in PATTERNS:
        raise DenseVSError(f"pattern is {surface.pattern!r}; expected one of {', '.join(PATTERNS)}")
    image = painted_texture(rng, Paint(surface.color), _TEXELS)
    period = int(rng.integers(20, 50))
    lines = np.arange(_TEXELS) % period < (2 if surface.pattern == "tiles" else period // 3)
    image[lines] = np.rint(0.75 * image[lines]).astype(np.uint8)
    if surface.pattern == "tiles":
        image[:, lines] = np.rint(0.75 * image[:, lines]).astype(np.uint8)
    return image
