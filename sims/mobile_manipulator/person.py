"""A person of capsules in the mobile manipulator's room: walks, stoops, carries a thing in the right hand.

A puppet: every part stands where the pose puts it, nothing pushes it. Legs and arms are chains of two links whose feet
and hands are told; knees and elbows follow. Lengths are those of an adult of 1.73 m.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint, add_material, painted_texture
from dense_vs.sims.mobile_manipulator.world import MobileWorld

HIP, TORSO = 0.92, 0.5  # m over the floor, standing; from the hips to the shoulders
THIGH, SHIN, ANKLE = 0.43, 0.43, 0.07
UPPER_ARM, FOREARM = 0.29, 0.27
HIPS, SHOULDERS = 0.1, 0.19  # m to either side
SIDES = {"left": 1.0, "right": -1.0}
GRIP = "person_grip"  # an upright frame in the right hand
CLOTHES = {
    "shirt": Paint((0.72, 0.09, 0.16), (0.95, 0.78, 0.2), 0.3, 0.05),
    "trousers": Paint((0.13, 0.16, 0.3), (0.1, 0.12, 0.22), 0.3, 0.03),
    "skin": Paint((0.8, 0.58, 0.46), (0.76, 0.52, 0.4), 0.2, 0.1),
    "hair": Paint((0.2, 0.13, 0.08), (0.13, 0.08, 0.05), 0.4, 0.2),
    "shoes": Paint((0.1, 0.1, 0.11), (0.25, 0.25, 0.26), 0.1, 0.3),
}
# Capsules (or spheres, where both ends are one) of each part, in its frame: z points along a limb, x to the front.
_PARTS: dict[str, list[tuple[str, tuple[float, ...], tuple[float, ...], float]]] = {
    "pelvis": [("trousers", (0, -0.07, 0.0), (0, 0.07, 0.0), 0.125)],
    "torso": [
        ("shirt", (0, -0.05, 0.08), (0, -0.08, 0.4), 0.115),
        ("shirt", (0, 0.05, 0.08), (0, 0.08, 0.4), 0.115),
        ("shirt", (0, -0.15, 0.47), (0, 0.15, 0.47), 0.07),
        ("skin", (0, 0, 0.5), (0, 0, 0.6), 0.055),
    ],
    "head": [
        ("skin", (0.015, 0, 0.16), (0.015, 0, 0.21), 0.09),
        ("hair", (-0.012, 0, 0.19), (-0.012, 0, 0.225), 0.095),
    ],
    "thigh": [("trousers", (0, 0, 0), (0, 0, THIGH), 0.08)],
    "shin": [
        ("trousers", (0, 0, 0), (0, 0, SHIN), 0.058),
        ("shoes", (-0.02, 0, SHIN + 0.03), (0.14, 0, SHIN + 0.04), 0.04),
    ],
    "upper_arm": [("shirt", (0, 0, 0), (0, 0, UPPER_ARM), 0.055)],
    "forearm": [("skin", (0, 0, 0), (0, 0, FOREARM - 0.05), 0.038), ("skin", (0, 0, FOREARM), (0, 0, FOREARM), 0.05)],
}  # fmt: skip
_SINGLE = ("pelvis", "torso", "head")


@dataclass(frozen=True)
class PersonPose:
    """How a person stands.

    Attributes:
        place: (x, y) of the hips on the floor [m].
        heading: to the front, about the vertical [rad].
        phase: of the walk [rad]; a full turn is two steps.
        stride: how far a foot is before or behind the hips at most [m]; 0 stands.
        hips: of the hips over the floor [m]; less than :data:`HIP` bends the knees.
        lean: of the torso to the front [rad].
        right_hand: where it is (3,) [m], as far as the arm reaches; None swings with the walk.
    """

    place: tuple[float, float]
    heading: float = 0.0
    phase: float = 0.0
    stride: float = 0.0
    hips: float = HIP
    lean: float = 0.0
    right_hand: tuple[float, float, float] | None = None


def add_person(spec: mujoco.MjSpec, seed: int, objects: Sequence[HouseholdObject]) -> None:
    """Put a person into a model; the right hand can hold any of the objects without links."""
    for number, (name, paint) in enumerate(CLOTHES.items()):
        add_material(spec, f"person_{name}", painted_texture(np.random.default_rng([seed, 25, number]), paint), paint)
    for part in _part_names():
        body = spec.worldbody.add_body(name=f"person_{part}", mocap=True, pos=[0.0, 0.0, -3.0])
        for cloth, start, end, radius in _PARTS[part.removeprefix("left_").removeprefix("right_")]:
            _add_capsule(body, f"person_{cloth}", np.array(start), np.array(end), radius)
    spec.worldbody.add_body(name=GRIP, mocap=True, pos=[0.0, 0.0, -3.0])
    for thing in objects:
        if not thing.links:
            spec.add_equality(
                name=f"{GRIP}_{thing.body}",
                type=mujoco.mjtEq.mjEQ_WELD,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1=GRIP,
                name2=thing.body,
                active=False,
                solref=[0.02, 1.0],
            )


class Person:
    """The person in a world that was made with :func:`add_person`; out of sight until posed.

    Attributes:
        pose: the last one; None before the first.
        held: name of the object in the right hand.
    """

    def __init__(self, world: MobileWorld):
        self._world = world
        self.pose: PersonPose | None = None
        self.held: str | None = None

    def show(self, pose: PersonPose) -> None:
        """Stand as a pose says from now on."""
        self.pose = pose
        for part, (start, axes) in person_frames(pose).items():
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, axes.ravel())
            self._world.put_body(GRIP if part == "grip" else f"person_{part}", start, quaternion)

    def hold(self, name: str) -> None:
        """Keep an object in the right hand as it now stands to it.

        Raises:
            DenseVSError: something is held already.
        """
        if self.held is not None:
            raise DenseVSError(f"the hand holds {self.held!r}; expected an empty one for {name!r}")
        model, state = self._world.model, self._world.state
        grip, body = (model.body(one) for one in (GRIP, self._world.objects[name].body))
        mocap = int(model.body_mocapid[grip.id])
        # The grip is upright or turned about the vertical; the engine has its pose of the last frame.
        back, offset, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(back, state.mocap_quat[mocap])
        column = model.jnt_qposadr[body.jntadr[0]]
        mujoco.mju_rotVecQuat(offset, state.qpos[column : column + 3] - state.mocap_pos[mocap], back)
        mujoco.mju_mulQuat(turn, back, state.qpos[column + 3 : column + 7])
        equality = model.equality(f"{GRIP}_{self._world.objects[name].body}").id
        model.eq_data[equality, :11] = [0, 0, 0, *offset, *turn, 1.0]
        state.eq_active[equality] = True
        self.held = name

    def let_go(self) -> None:
        """Hold nothing any more."""
        if self.held is not None:
            equality = self._world.model.equality(f"{GRIP}_{self._world.objects[self.held].body}").id
            self._world.state.eq_active[equality] = False
        self.held = None

    def geoms(self, cloth: str = "shirt") -> np.ndarray:
        """Ids of the geoms that an article of :data:`CLOTHES` covers."""
        if cloth not in CLOTHES:
            raise DenseVSError(f"clothing {cloth!r} is unknown; expected one of {', '.join(map(repr, CLOTHES))}")
        return np.flatnonzero(self._world.model.geom_matid == self._world.model.material(f"person_{cloth}").id)


def person_frames(pose: PersonPose) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Origin (3,) [m] and axes (3, 3), in columns, of every part and of the ``grip`` in the right hand."""
    front = np.array([np.cos(pose.heading), np.sin(pose.heading), 0.0])
    left, up = np.array([-front[1], front[0], 0.0]), np.array([0.0, 0.0, 1.0])
    upright = np.stack([front, left, up], axis=1)
    hips = np.array([*pose.place, pose.hips])
    spine = np.cos(pose.lean) * up + np.sin(pose.lean) * front
    chest = np.stack([np.cross(left, spine), left, spine], axis=1)
    neck = hips + TORSO * spine
    frames = {"pelvis": (hips, upright), "torso": (hips, chest), "head": (neck, _half_way(upright, chest))}
    for side, sign in SIDES.items():
        swing = pose.phase + (0.0 if sign > 0 else np.pi)
        hip = hips + sign * HIPS * left
        lifted = 0.3 * pose.stride * max(0.0, np.cos(swing))
        foot = hip + pose.stride * np.sin(swing) * front
        foot[2] = ANKLE + lifted
        _limb(frames, side, ("thigh", "shin"), (hip, foot), (THIGH, SHIN), front, front)
        shoulder = hips + (TORSO - 0.03) * spine + sign * SHOULDERS * left
        hand = shoulder - 0.5 * up + (0.12 - 0.5 * pose.stride * np.sin(swing)) * front + 0.04 * sign * left
        if side == "right" and pose.right_hand is not None:
            hand = np.array(pose.right_hand, dtype=float)
        end = _limb(frames, side, ("upper_arm", "forearm"), (shoulder, hand), (UPPER_ARM, FOREARM), -front - up, front)
        if side == "right":
            frames["grip"] = (end, upright)
    return frames


def _limb(frames, side, names, ends, lengths, bend, front) -> np.ndarray:
    """Put a limb of two links between two points; where it ends, which is short of the second if that is too far."""
    start, end = ends
    way = end - start
    distance = float(np.clip(np.linalg.norm(way), 0.05, 0.999 * sum(lengths)))
    along = way / max(float(np.linalg.norm(way)), 1e-9)
    end = start + distance * along
    aside = bend - (bend @ along) * along
    aside /= max(float(np.linalg.norm(aside)), 1e-9)
    first, second = lengths
    near = (distance**2 + first**2 - second**2) / (2 * distance)  # law of cosines
    middle = start + near * along + np.sqrt(max(first**2 - near**2, 0.0)) * aside
    frames[f"{side}_{names[0]}"] = (start, _axes_along(middle - start, front))
    frames[f"{side}_{names[1]}"] = (middle, _axes_along(end - middle, front))
    return end


def _axes_along(direction: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Axes (3, 3) with z along a direction and x to the front as far as that allows."""
    z = direction / np.linalg.norm(direction)
    x = front - (front @ z) * z
    if np.linalg.norm(x) < 1e-3:  # along the front: x then points up
        x = np.array([0.0, 0.0, 1.0]) - z[2] * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _half_way(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Axes between two that share their y axis."""
    z = one[:, 2] + other[:, 2]
    z /= np.linalg.norm(z)
    return np.stack([np.cross(one[:, 1], z), one[:, 1], z], axis=1)


def _part_names() -> list[str]:
    return [*_SINGLE, *[f"{side}_{part}" for part in _PARTS if part not in _SINGLE for side in SIDES]]


def _add_capsule(body, material: str, start: np.ndarray, end: np.ndarray, radius: float) -> None:
    way = end - start
    length = float(np.linalg.norm(way))
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    if length:
        mujoco.mju_quatZ2Vec(turn, way / length)
    kinds = mujoco.mjtGeom
    body.add_geom(
        type=kinds.mjGEOM_CAPSULE if length else kinds.mjGEOM_SPHERE,
        size=[radius, length / 2 if length else 0.0, 0.0],
        pos=list((start + end) / 2),
        quat=list(turn),
        contype=0,
        conaffinity=0,
        material=material,
        rgba=[0.5, 0.5, 0.5, 1.0],
    )
