"""The MuJoCo model of a cell: an arm on springs with a gripper, a part with or without a peg, a fixture, cameras."""

from dataclasses import dataclass
from importlib import resources

import mujoco
import numpy as np

from dense_vs.sims.marked_arm.dh_chain import DHChain
from dense_vs.sims.workcell.aruco_markers import paint_markers

PEG = (0.012, 0.012, 0.02)  # half sizes [m] of block.xml's peg
HOLE = 0.025  # m, width of fixture.xml's hole
PART_TO_SEAT = 0.076  # m from the handle's middle to the fixture's upper edge when the peg is home

_TIMESTEP = 0.001
_WORKPLACE = np.array([0.5, 0.03, 0.21])  # m, before the arm
_WRIST_JOINTS = 3
_DAMPING_RATIO = 0.7


@dataclass(frozen=True)
class Inaccuracy:
    """How the arm's joint controller errs. Springs between motors and links, as in Baxter, whose stiffness this is.

    A command moves the motors by the commanded step times ``1 + N(0, proportional)`` plus ``N(0, independent)``, a draw
    a joint and a command. The links then hang on the springs, held by Coulomb friction; only part of their weight is
    compensated. Encoders sit at the motors and do not see the springs.
    """

    proportional: float = 0.1
    independent: float = 0.0  # rad
    encoder: float = 0.002  # rad, standard deviation of a reading
    stiffness: tuple[float, float] = (843.0, 250.0)  # N m/rad, of joints before and at the wrist
    friction: tuple[float, float] = (0.8, 0.25)  # N m
    uncompensated: float = 0.2  # share of the links' weight


def compile_cell(
    chain: DHChain, peg: bool, cameras: int, inaccuracy: Inaccuracy, rng: np.random.Generator
) -> mujoco.MjModel:
    """The cell's model: joints and actuators of the arm first, names of gripper, part and fixture prefixed.

    Args:
        chain: the arm.
        peg: whether the part has a peg and there is a fixture.
        cameras: how many; each is placed by hand before the arm, so nothing about it is exact.
        inaccuracy: of the arm.
        rng: draws the cameras' places.
    """
    spec = load_model(chain.name)
    spec.option.timestep = _TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.noslip_iterations = 10
    names = [joint.name for joint in spec.joints]
    stiffness = np.full(chain.joints, inaccuracy.stiffness[0])
    friction = np.full(chain.joints, inaccuracy.friction[0])
    stiffness[-_WRIST_JOINTS:], friction[-_WRIST_JOINTS:] = inaccuracy.stiffness[1], inaccuracy.friction[1]
    for body in spec.bodies:
        body.gravcomp = 1.0 - inaccuracy.uncompensated
    for name, spring in zip(names, stiffness, strict=True):
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=float(spring))
    spec.attach(load_model("gripper"), site=spec.site("flange"), prefix="hand/")
    frame = spec.worldbody.add_frame()
    part = load_model("block")
    if peg:
        spec.attach(load_model("fixture"), frame=frame, prefix="fixture/")
    else:
        part.delete(part.geom("peg"))
    spec.attach(part, frame=frame, prefix="part/")
    _add_surroundings(spec)
    for number, (place, axes) in enumerate(_camera_poses(cameras, rng)):
        spec.worldbody.add_camera(name=f"camera_{number}", pos=place, xyaxes=axes, fovy=36.0)
    paint_markers(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[: chain.joints] = chain.home
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    inertia = np.diag(mass)[: chain.joints]
    model.dof_damping[: chain.joints] = 2 * _DAMPING_RATIO * np.sqrt(stiffness * inertia)
    model.dof_frictionloss[: chain.joints] = friction
    return model


def load_model(name: str) -> mujoco.MjSpec:
    """One of ``sims/models``."""
    text = resources.files("dense_vs.sims").joinpath("models", f"{name}.xml").read_text(encoding="utf-8")
    return mujoco.MjSpec.from_string(text)


def _add_surroundings(spec: mujoco.MjSpec) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(
        name="table",
        type=box,
        size=[0.4, 0.6, 0.01],
        pos=[0.62, 0, -0.01],
        rgba=[0.5, 0.45, 0.4, 1],
        friction=[0.6, 0.01, 0.001],
    )
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=[-0.5, 0.1, -0.8], diffuse=[0.4] * 3, specular=[0] * 3
    )
    light = spec.visual.headlight
    light.ambient, light.diffuse, light.specular = [0.5] * 3, [0.35] * 3, [0.0] * 3


def _camera_poses(count: int, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places and axes of cameras before the arm, each set up by hand: nothing is exact."""
    poses = []
    azimuths = np.linspace(-0.78, 0.78, count) if count > 1 else np.array([0.3])
    for azimuth in azimuths + rng.uniform(-0.1, 0.1, count):
        elevation = rng.uniform(0.32, 0.46)
        ray = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        right = np.cross([0.0, 0.0, 1.0], ray)
        right /= np.linalg.norm(right)
        roll = rng.choice([-1, 1]) * rng.uniform(0.06, 0.15)
        right = np.cos(roll) * right + np.sin(roll) * np.cross(ray, right)
        place = _WORKPLACE + rng.uniform(1.1, 1.25) * ray
        poses.append((place, np.concatenate([right, np.cross(ray, right)])))
    return poses
