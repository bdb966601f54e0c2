"""Compiles the robot, the scenery and the household objects into one model."""

from collections.abc import Callable, Sequence
from importlib import resources

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.clutter_objects import clutter_objects
from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.objects import CHAIN_DIAMETER, CHAIN_LENGTH, household_objects
from dense_vs.sims.mobile_manipulator.paint import Paint, add_material, painted_texture
from dense_vs.sims.mobile_manipulator.parts import Part

JOINTS = (  # the order of VOS-VS (1)
    "head_tilt",
    "head_pan",
    "arm_lift",
    "arm_flex",
    "arm_roll",
    "wrist_flex",
    "wrist_roll",
    "base_forward",
    "base_lateral",
    "base_roll",
)
PULLER = "puller"
Addition = Callable[[mujoco.MjSpec, int, Sequence[HouseholdObject]], None]  # puts more into a room, from its seed
_CONTACT = {"friction": [0.8, 0.01, 0.0005], "condim": 4, "solref": [0.008, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2]}
_SCENERY = {"floor": (0.09, 3.0), "blue_bin": (0.03, 0.0), "green_bin": (0.03, 0.0)}  # mottling, repetitions a meter


def compile_model(
    names: Sequence[str] | None, seed: int, additions: Sequence[Addition] = ()
) -> tuple[mujoco.MjModel, dict[str, HouseholdObject]]:
    """The model with the named objects (all 24 when None) and what else is added, textures drawn from the seed.

    Raises:
        DenseVSError: a name that is not an object's; the message lists them.
    """
    trials = household_objects()
    known = {**trials, **clutter_objects()}
    chosen = list(trials) if names is None else list(names)
    for name in chosen:
        if name not in known:
            raise DenseVSError(f"object {name!r} is unknown; expected some of {', '.join(map(repr, known))}")
    text = resources.files("dense_vs.sims").joinpath("models", "mobile_manipulator.xml").read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(text)
    _paint_scenery(spec, np.random.default_rng([seed, 20]))
    order = list(known)
    for name in chosen:
        # Each object its own stream, so that a scene of fewer objects shows the same ones.
        _add_object(spec, known[name], np.random.default_rng([seed, 21, order.index(name)]))
    for add in additions:
        add(spec, seed, [known[name] for name in chosen])
    return spec.compile(), {name: known[name] for name in chosen}


def _paint_scenery(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    for geom in spec.geoms:
        if geom.name not in _SCENERY:
            continue
        _, repeat = _SCENERY[geom.name]
        color = np.array(geom.rgba[:3]) * rng.uniform(0.9, 1.1)
        paint = Paint(tuple(np.clip(color, 0, 1)), tuple(np.clip(0.85 * color, 0, 1)), 0.35, 0.15)
        add_material(spec, geom.name, painted_texture(rng, paint, 256 if geom.name == "floor" else 96), paint, repeat)
        geom.material = geom.name
        geom.rgba = [0.5, 0.5, 0.5, 1.0]


def _add_object(spec: mujoco.MjSpec, thing: HouseholdObject, rng: np.random.Generator) -> None:
    for name, paint in thing.paints.items():
        add_material(spec, f"{thing.body}_{name}", painted_texture(rng, paint), paint)
    body = spec.worldbody.add_body(name=thing.body)
    body.add_freejoint(name=thing.body)
    if thing.links:
        _add_chain(body, thing)
        _add_puller(spec, thing)
        return
    volume = sum(_volume(part) for part in thing.parts)
    for part in thing.parts:
        _add_geom(body, thing, part, thing.mass * _volume(part) / volume)


def _add_geom(body, thing: HouseholdObject, part: Part, mass: float) -> None:
    geom = body.add_geom(
        type=part.kind,
        size=[*part.size, *[0.0] * (3 - len(part.size))],
        pos=list(part.position),
        quat=part.quaternion(),
        mass=mass,
        contype=2,
        conaffinity=3,
        material=f"{thing.body}_{part.paint}",
        rgba=[0.5, 0.5, 0.5, 1.0],
        **_CONTACT,
    )
    if thing.rolls:
        geom.condim = 6
        geom.friction = [0.8, 0.01, 0.002]


def _add_chain(body, thing: HouseholdObject) -> None:
    """Links on ball joints; the first carries the object's free joint. Straight along x until it is laid out."""
    pitch = CHAIN_LENGTH / thing.links
    body.add_site(name=f"{thing.body}_end", pos=[-pitch / 2, 0.0, CHAIN_DIAMETER / 2], group=3)
    half = pitch / 2 - 0.2 * CHAIN_DIAMETER
    for link in range(thing.links):
        if link:
            body = body.add_body(name=f"{thing.body}_{link}", pos=[pitch, 0.0, 0.0])
            body.add_joint(
                name=f"{thing.body}_{link}", type=mujoco.mjtJoint.mjJNT_BALL, pos=[-pitch / 2, 0, 0],
                damping=0.0004, armature=2e-6,
            )  # fmt: skip
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[CHAIN_DIAMETER / 2, half, 0],
            pos=[0, 0, CHAIN_DIAMETER / 2],
            quat=[0.70710678, 0, 0.70710678, 0],
            mass=thing.mass / thing.links,
            contype=2,
            conaffinity=3,
            material=f"{thing.body}_body",
            rgba=[0.5, 0.5, 0.5, 1.0],
            **_CONTACT,
        )


def _add_puller(spec: mujoco.MjSpec, thing: HouseholdObject) -> None:
    """An unseen hand that can take the chain's first link and drag it; holds nothing at first."""
    spec.worldbody.add_body(name=PULLER, mocap=True, pos=[0.0, 0.0, -1.0]).add_site(name=PULLER, group=3)
    spec.add_equality(
        name=PULLER,
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1=f"{thing.body}_end",
        name2=PULLER,
        active=False,
        solref=[0.02, 1.0],
    )


def _volume(part: Part) -> float:
    size = part.size
    kinds = mujoco.mjtGeom
    if part.kind == kinds.mjGEOM_BOX:
        return 8.0 * size[0] * size[1] * size[2]
    if part.kind == kinds.mjGEOM_SPHERE:
        return 4.19 * size[0] ** 3
    return 2.0 * np.pi * size[0] ** 2 * size[1]
