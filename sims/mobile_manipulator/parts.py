"""Building blocks of household objects: a part is a geom with a paint; a shape is a list of them.

Lengths are meters; z is up from the surface that the object rests on. Hollow things are rings of boxes, as a mesh
collides as its convex hull.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

BOX = mujoco.mjtGeom.mjGEOM_BOX
CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER
CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE
SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE


@dataclass(frozen=True)
class Part:
    """One geom of an object.

    Attributes:
        kind: MuJoCo geom type.
        size: as MuJoCo's ``size``, half lengths and radii.
        position: of its center in the object's frame.
        zaxis: direction of the geom's own z axis.
        paint: name of the object's paint that covers it.
        twist: turn about the geom's own z axis [rad].
    """

    kind: mujoco.mjtGeom
    size: tuple[float, ...]
    position: tuple[float, float, float]
    zaxis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    paint: str = "body"
    twist: float = 0.0

    def quaternion(self) -> np.ndarray:
        """Orientation (4,) of the geom in the object's frame."""
        turn, spin, both = np.zeros(4), np.zeros(4), np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, np.array(self.zaxis, dtype=float))
        mujoco.mju_axisAngle2Quat(spin, np.array([0.0, 0.0, 1.0]), self.twist)
        mujoco.mju_mulQuat(both, turn, spin)
        return both


def box(length: float, width: float, height: float, *, at=(0.0, 0.0, 0.0), paint: str = "body", twist: float = 0.0):
    """A box by its full lengths, standing with its bottom center at a place."""
    x, y, z = at
    return Part(BOX, (length / 2, width / 2, height / 2), (x, y, z + height / 2), paint=paint, twist=twist)


def cylinder(diameter: float, height: float, *, at=(0.0, 0.0, 0.0), paint: str = "body"):
    """An upright cylinder, standing with its bottom center at a place."""
    x, y, z = at
    return Part(CYLINDER, (diameter / 2, height / 2), (x, y, z + height / 2), paint=paint)


def rod(start, end, diameter: float, *, paint: str = "body", rounded: bool = True):
    """A capsule (its ends beyond start and end), or a cylinder, between two points."""
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    length = float(np.linalg.norm(end - start))
    middle = (start + end) / 2
    axis = (end - start) / length
    kind = CAPSULE if rounded else CYLINDER
    return Part(kind, (diameter / 2, length / 2), tuple(middle), zaxis=tuple(axis), paint=paint)


def ball(diameter: float, *, at=(0.0, 0.0, 0.0), paint: str = "body"):
    """A sphere that touches the ground at a place."""
    x, y, z = at
    return Part(SPHERE, (diameter / 2,), (x, y, z + diameter / 2), paint=paint)


def ring(outer: float, inner: float, height: float, *, at=(0.0, 0.0, 0.0), sides: int = 16, paint: str = "body"):
    """A vertical tube of boxes, by its outer and inner diameter."""
    wall = (outer - inner) / 2
    radius = (outer + inner) / 4
    chord = outer * np.tan(np.pi / sides)
    parts = []
    for angle in 2 * np.pi * np.arange(sides) / sides:
        place = (at[0] + radius * np.cos(angle), at[1] + radius * np.sin(angle), at[2])
        part = box(wall, chord, height, at=place, paint=paint)
        parts.append(replace(part, twist=float(angle)))
    return parts


def dish_rim(sides: int = 24) -> list[Part]:
    """The flared rim of a plate of 258 mm: flat bars that rise outward to 24 mm."""
    slope = np.arctan2(0.018, 0.049)
    parts = []
    for angle in 2 * np.pi * np.arange(sides) / sides:
        place = (0.104 * np.cos(angle), 0.104 * np.sin(angle), 0.01)
        part = box(0.053, 2 * 0.13 * np.tan(np.pi / sides), 0.005, at=place)
        normal = (-np.sin(slope) * np.cos(angle), -np.sin(slope) * np.sin(angle), np.cos(slope))
        parts.append(replace(part, zaxis=normal, twist=_twist_towards(normal, angle)))
    return parts


def _twist_towards(normal: tuple[float, float, float], angle: float) -> float:
    """Turn about the normal that makes the part's x axis point radially."""
    quaternion, matrix = np.zeros(4), np.zeros(9)
    mujoco.mju_quatZ2Vec(quaternion, np.array(normal))
    mujoco.mju_quat2Mat(matrix, quaternion)
    axes = matrix.reshape(3, 3)
    radial = np.array([np.cos(angle), np.sin(angle), 0.0])
    return float(np.arctan2(radial @ axes[:, 1], radial @ axes[:, 0]))
