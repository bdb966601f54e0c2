"""A metal tray into which objects are poured in a heap, VOS-VS Fig. 19: physics decides where they lie.

The tray stands on a counter that leaves room for the robot's base below it, and for things put aside beside the tray.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint, add_material, painted_texture
from dense_vs.sims.mobile_manipulator.world import MobileWorld

TRAY = (1.0, 1.5)  # m, its middle, clear of the bins
TRAY_HALF = (0.22, 0.27)  # m
COUNTER = 0.3  # m, height of its top
FLOOR = COUNTER + 0.006  # m, height of the tray's floor
ASIDE = (0.0, 0.6)  # m, from the tray to free room on the counter
_COUNTER_TOP = ((0.27, 0.68, 0.01), (1.0, 1.82, COUNTER - 0.01))  # half lengths and middle [m]
_RIM, _WALL = 0.03, 0.004  # m, the rim's height and thickness
_METAL = Paint((0.56, 0.57, 0.6), (0.5, 0.51, 0.54), 0.3, 0.7, 0.6)
_WOOD = Paint((0.66, 0.5, 0.33), (0.58, 0.42, 0.26), 0.4, 0.2)
_SPREAD = 0.05  # m around the middle, from where things fall
_LAYER = 0.14  # m that each begins above the one before
_PATIENCE = 150  # frames until everything has to lie still
_STILL = 0.02  # m/s
_POURS = 40


def add_tray(spec: mujoco.MjSpec, seed: int, objects: Sequence[HouseholdObject]) -> None:
    """Put the counter and the tray into a model."""
    add_material(spec, "counter", painted_texture(np.random.default_rng([seed, 29]), _WOOD, 256), _WOOD, 1.0)
    add_material(spec, "tray", painted_texture(np.random.default_rng([seed, 28]), _METAL, 256), _METAL, 2.0)
    x, y = TRAY
    half_x, half_y = TRAY_HALF
    high, wall = _RIM / 2, _WALL / 2
    low, middle = (COUNTER + FLOOR) / 2, COUNTER + high
    _add_box(spec, "counter", "counter", *_COUNTER_TOP)
    for side in (-1, 1):  # legs, at the back
        leg = (_COUNTER_TOP[1][0] + 0.24, _COUNTER_TOP[1][1] + side * 0.64, COUNTER / 2 - 0.01)
        _add_box(spec, f"counter_leg_{side}", "counter", (0.025, 0.025, COUNTER / 2 - 0.01), leg)
    _add_box(spec, "tray", "tray", (half_x, half_y, (FLOOR - COUNTER) / 2), (x, y, low))
    for side, name in ((-1, "front"), (1, "back")):
        _add_box(spec, f"tray_{name}", "tray", (wall, half_y, high), (x + side * half_x, y, middle))
    for side, name in ((-1, "right"), (1, "left")):
        _add_box(spec, f"tray_{name}", "tray", (half_x, wall, high), (x, y + side * half_y, middle))


def _add_box(spec: mujoco.MjSpec, name: str, material: str, size, place) -> None:
    """A box by its half lengths and its middle."""
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=list(size),
        pos=list(place),
        contype=1,
        conaffinity=0,
        friction=[0.7, 0.005, 0.0002],
        material=material,
        rgba=[0.5, 0.5, 0.5, 1.0],
    )


def pour(world: MobileWorld, names: Sequence[str], rng: np.random.Generator) -> int:
    """Let objects fall into the tray from above, one over the other and turned at random; until all lie in it, still.

    Args:
        world: made with :func:`add_tray`.
        names: of the objects, without links; others stay where they are.
        rng: of the pour.

    Returns:
        How many pours it took: one that spills something over the rim is done anew.

    Raises:
        DenseVSError: no pour stayed in the tray.
    """
    for number in range(1, _POURS + 1):
        for layer, name in enumerate(rng.permutation(list(names))):
            turn = rng.standard_normal(4)
            place = np.append(np.array(TRAY) + rng.uniform(-_SPREAD, _SPREAD, 2), FLOOR + 0.12 + _LAYER * layer)
            _drop(world, str(name), place, turn / np.linalg.norm(turn))
        for _ in range(_PATIENCE // 10):
            world.wait(10)
            if max(_speed(world, name) for name in names) < _STILL:
                break
        if all(in_tray(world.object_center(name)) for name in names):
            return number
    raise DenseVSError(f"no pour of {', '.join(names)} stayed in the tray in {_POURS} tries; expected fewer objects")


def in_tray(center: np.ndarray) -> bool:
    """Whether an object's center of mass (3,) [m] is over the tray and near its floor."""
    x, y, z = center
    inside = abs(x - TRAY[0]) < TRAY_HALF[0] and abs(y - TRAY[1]) < TRAY_HALF[1]
    return bool(inside and FLOOR < z < FLOOR + 0.25)


def _drop(world: MobileWorld, name: str, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Put an object's frame at a position (3,) [m] and orientation (4,), at rest; it falls as time passes."""
    world.place(name, position, settle_frames=0)
    column = world.model.joint(world.objects[name].body).qposadr[0]
    world.state.qpos[column + 3 : column + 7] = quaternion


def _speed(world: MobileWorld, name: str) -> float:
    """Of an object's frame [m/s]."""
    dof = world.model.joint(world.objects[name].body).dofadr[0]
    return float(np.linalg.norm(world.state.qvel[dof : dof + 3]))
