"""Builds the MJCF scene of a commercial arm from an unpacked package: ``scene.xml`` with its meshes beside it.

The arm keeps its meshes and materials. Its joints get position servos strong enough that it follows commands, gravity
is compensated and nothing touches, so that what is seen depends on the joints alone. It stands in a room before eight
cameras, A to H, with a site ``tip`` in the middle of its hand.
"""

import re
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

import mujoco

from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder
from dense_vs.sims.arms.cameras import add_cameras, surface_points
from dense_vs.sims.arms.catalog import ARMS, ROBOSUITE, CommercialArm
from dense_vs.sims.arms.packages import download_package
from dense_vs.sims.arms.room import add_room
from dense_vs.sims.engine.built_scenes import scenes_folder

SERVO_GAIN = 4000.0  # N m/rad
HOLDING_DAMPING = 1e4  # N m s/rad, of joints that nothing drives
_COLLISION_GROUP, _HIDDEN_GROUP = 0, 3  # robosuite draws group 1; the renderer draws groups 0 to 2
_TWICE = '<mesh name="robotiq_arg2f_base_link" file="meshes/robotiq_85_gripper/robotiq_arg2f_base_link_vis.stl" />'


def build_arm(name: str, folder: Path | None = None) -> Path:
    """Download what an arm needs, build its scene and leave nothing else behind; the path of ``scene.xml``.

    Args:
        name: of :data:`dense_vs.sims.arms.catalog.ARMS`.
        folder: where ``<name>/scene.xml`` goes; where ``--robot <name>`` looks for it unless given.

    Raises:
        DenseVSError: unknown name, no download, or a folder that cannot be written.
    """
    if name not in ARMS:
        raise DenseVSError(f"arm {name!r} is unknown; expected one of {', '.join(ARMS)}")
    arm = ARMS[name]
    out = output_folder((folder or scenes_folder()) / name)
    with tempfile.TemporaryDirectory() as temporary:
        package = Path(temporary)
        for requirement in sorted({arm.package, ROBOSUITE}):  # the room's textures are robosuite's
            download_package(requirement, package)
        return build_scene(arm, name, package, out)


def build_scene(arm: CommercialArm, name: str, package: Path, out: Path) -> Path:
    """Build an arm's scene from unpacked packages into the folder ``out``; the path of ``scene.xml``."""
    assets = output_folder(out / "assets")
    spec = _load(package / arm.file)
    _gather_assets(spec, package / arm.file, assets)
    _leave_out(spec, arm)
    if arm.gripper is not None:
        _mount_gripper(spec, arm, package, assets)
    spec.modelname = name
    _drive(spec, arm)
    add_room(spec, arm, package, assets)
    model = spec.compile()
    data = mujoco.MjData(model)
    for joint, angle in {**arm.home, **arm.held}.items():
        data.qpos[model.joint(joint).qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)
    first = int(model.joint(next(iter(arm.home))).bodyid[0])
    hand = model.body(arm.hand).id
    tip = surface_points(model, data, hand).mean(axis=0)
    local = data.xmat[hand].reshape(3, 3).T @ (tip - data.xpos[hand])
    spec.body(arm.hand).add_site(name="tip", pos=local, size=[0.005] * 3, group=4)
    add_cameras(spec, surface_points(model, data, first))
    spec.add_key(name="home", qpos=data.qpos.copy())
    spec.compile()
    scene = out / "scene.xml"
    scene.write_text(spec.to_xml().replace(str(assets), "assets"), encoding="utf-8")
    mujoco.MjModel.from_xml_path(str(scene))  # what was written is what was meant
    return scene


def _load(path: Path) -> mujoco.MjSpec:
    """A model file of a package, without what MuJoCo no longer accepts: a mesh named twice, a <default>'s group."""
    if not path.is_file():
        raise DenseVSError(f"the package holds no {path.name} at {path}; expected the pinned version")
    text = path.read_text(encoding="utf-8").replace(_TWICE, "")
    patched = path.with_name("patched_" + path.name)
    patched.write_text(re.sub(r'(<default class="[^"]*") group="\d"', r"\1", text), encoding="utf-8")
    return mujoco.MjSpec.from_file(str(patched))


def _gather_assets(spec: mujoco.MjSpec, source: Path, assets: Path) -> None:
    """Copy every mesh and picture of a specification into one folder and point the specification there."""
    for elements, folder in ((spec.meshes, spec.meshdir), (spec.textures, spec.texturedir)):
        for element in elements:
            if not element.file:
                continue
            places = [source.parent / (folder or "") / element.file, source.parent / element.file, Path(element.file)]
            found = next((place for place in places if place.is_file()), None)
            if found is None:
                raise DenseVSError(f"{source.name} names the file {element.file}, which the package does not hold")
            element.file = f"{found.parent.name}_{found.name}"
            shutil.copy(found, assets / element.file)
    spec.meshdir = spec.texturedir = str(assets)


def _leave_out(spec: mujoco.MjSpec, arm: CommercialArm) -> None:
    """Delete the package's own actuators, sensors and surroundings, and hide collision geoms."""
    _delete(spec, [*spec.actuators, *spec.sensors, *spec.equalities])
    _delete(spec, [e for e in (*spec.bodies, *spec.geoms, *spec.materials) if e.name in arm.without])
    if arm.without:  # it ships as a whole scene
        _delete(spec, spec.lights)
        _delete(spec, [t for t in spec.textures if t.file or t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX])
    else:
        _hide_collision(spec)


def _mount_gripper(spec: mujoco.MjSpec, arm: CommercialArm, package: Path, assets: Path) -> None:
    """Fix a gripper to the hand, its fingers as they are shipped."""
    assert arm.gripper is not None
    gripper = _load(package / arm.gripper)
    _gather_assets(gripper, package / arm.gripper, assets)
    _hide_collision(gripper)
    for parts in (gripper.actuators, gripper.sensors, gripper.tendons, gripper.equalities, gripper.joints):
        _delete(gripper, parts)
    gripper.option.gravity = spec.option.gravity  # it has the arm's; two would be a warning
    spec.attach(gripper, frame=spec.body(arm.hand).add_frame(), prefix="gripper_")


def _drive(spec: mujoco.MjSpec, arm: CommercialArm) -> None:
    """Position servos for the arm's joints; joints that stand still are damped, and those of no posture become rigid.

    A Fetch's torso, a screw, would otherwise slide by 12 mm as its arm moves: its file has no motor that holds it.
    """
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    _delete(spec, [joint for joint in spec.joints if joint.name not in {**arm.home, **arm.held}])
    for name in (*arm.home, *arm.held):
        joint = spec.joint(name)
        joint.frictionloss = 0
        joint.armature = max(float(joint.armature), 0.3)
        joint.damping = [1.0 if name in arm.home else HOLDING_DAMPING, 0, 0]
        joint.stiffness = [0.0, 0, 0]
    for name in arm.home:
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=SERVO_GAIN, dampratio=1.0)
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _hide_collision(spec: mujoco.MjSpec) -> None:
    for geom in spec.geoms:
        if geom.group == _COLLISION_GROUP:
            geom.group = _HIDDEN_GROUP


def _delete(spec: mujoco.MjSpec, elements: Iterable) -> None:
    for element in list(elements):
        spec.delete(element)
