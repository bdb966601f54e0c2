"""Domain randomization: how the worlds of a batch differ beyond posture, seed and distractor.

Every world gets its own copy of those arrays of the model that differ: link sizes with all that follows from them
(joint places, masses, inertias), the choice of textures, lights, and the camera's pose. MuJoCo computes what depends
on what; MuJoCo-Warp takes the arrays with the worlds in front.
"""

import copy
from dataclasses import dataclass
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError

# Arrays of the model that may differ, by the name they have in both engines.
FIELDS = (
    "body_inertia",
    "body_invweight0",
    "body_ipos",
    "body_mass",
    "body_pos",
    "body_subtreemass",
    "cam_mat0",
    "cam_pos",
    "cam_pos0",
    "cam_poscom0",
    "cam_quat",
    "dof_invweight0",
    "geom_aabb",
    "geom_pos",
    "geom_rbound",
    "geom_size",
    "jnt_pos",
    "light_diffuse",
    "light_dir",
    "light_dir0",
    "light_pos0",
    "light_poscom0",
    "mat_texid",
    "site_pos",
)
_UNSCALABLE = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)


@dataclass(frozen=True, kw_only=True)
class DomainRandomization:
    """How far worlds differ; with the defaults they don't.

    Attributes:
        link_size: largest relative change of a link's size; length and thickness change together.
        texture_sets: sets of textures made from the seed; each geom of each world takes one of them.
        light: largest relative change of a light's brightness.
        light_angle: largest turn of a light's direction [rad].
        camera_position: largest shift of the camera along each axis [m].
        camera_angle: largest turn of the camera [rad].
    """

    link_size: float = 0.0
    texture_sets: int = 1
    light: float = 0.0
    light_angle: float = 0.0
    camera_position: float = 0.0
    camera_angle: float = 0.0

    def __post_init__(self):
        for name, most in (
            ("link_size", 0.5),
            ("light", 1.0),
            ("light_angle", np.pi),
            ("camera_position", None),
            ("camera_angle", np.pi),
        ):
            check_number(name, getattr(self, name), least=0, most=most)
        check_whole("texture_sets", self.texture_sets, least=1)


def world_rng(seed: int, world: int, purpose: int, *more: int) -> np.random.Generator:
    """Random numbers of the world of that number, the same whichever process makes it."""
    # Purposes apart, so that a distractor leaves the posture as it is; textures take [seed, 0].
    return np.random.default_rng([seed, 1 + purpose, world, *more])


class WorldModels:
    """The models of B worlds, as arrays for MuJoCo-Warp and one at a time for MuJoCo.

    Args:
        model: what they have in common; world w differs from it as drawn from ``rngs[w]``.
        camera: id of the camera that moves.
        rngs: a generator a world.
        options: how far they differ.

    Raises:
        DenseVSError: link sizes are to differ where a link is a mesh, which has no size.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: int, rngs: list[np.random.Generator], options: DomainRandomization
    ):
        self._template = model
        self._scratch = copy.copy(model)
        self._fields: dict[str, np.ndarray] = {}
        if options == DomainRandomization():
            return
        if options.link_size and np.isin(model.geom_type[model.geom_bodyid > 0], _UNSCALABLE).any():
            raise DenseVSError("link_size is above 0, but links of the model are meshes; expected 0 for such a model")
        data = mujoco.MjData(model)
        rows: dict[str, list[np.ndarray]] = {name: [] for name in FIELDS}
        for rng in rngs:
            for name in FIELDS:
                getattr(self._scratch, name)[...] = getattr(model, name)
            _scale_links(self._scratch, rng, options.link_size)
            _turn_lights(self._scratch, rng, options)
            _move_camera(self._scratch, camera, rng, options)
            _choose_textures(self._scratch, rng, options.texture_sets)
            mujoco.mj_setConst(self._scratch, data)
            for name, values in rows.items():
                values.append(getattr(self._scratch, name).copy())
        # Also where one world alone differs from the template: it has to be the same world as among many.
        self._fields = {
            name: np.stack(values) for name, values in rows.items() if np.not_equal(values, getattr(model, name)).any()
        }

    def host(self, world: int) -> mujoco.MjModel:
        """The model of a world; valid until the next call."""
        if not self._fields:
            return self._template
        for name, values in self._fields.items():
            getattr(self._scratch, name)[...] = values[world]
        return self._scratch

    def apply(self, model: mjw.Model) -> None:
        """Give the device's model the arrays that differ."""
        for name, values in self._fields.items():
            shared: Any = getattr(model, name)
            shape = (len(values), *shared.shape[1:])
            scalars = np.ascontiguousarray(values, dtype=wp.dtype_to_numpy(_scalar(shared.dtype)))
            setattr(model, name, wp.array(scalars.reshape(*shape, *_inner(shared.dtype)), dtype=shared.dtype))


def _scale_links(model: mujoco.MjModel, rng: np.random.Generator, most: float) -> None:
    # A draw whether or not it is used, so that one kind of change leaves the others as they are.
    scale = 1.0 + most * rng.uniform(-1.0, 1.0, model.nbody)
    fixed = np.array([model.body_weldid[body] == 0 or model.body_mocapid[body] >= 0 for body in range(model.nbody)])
    scale[fixed] = 1.0
    model.body_pos[:] *= scale[model.body_parentid, None]
    for positions, owner in (
        (model.geom_pos, model.geom_bodyid),
        (model.geom_size, model.geom_bodyid),
        (model.geom_aabb, model.geom_bodyid),
        (model.site_pos, model.site_bodyid),
        (model.jnt_pos, model.jnt_bodyid),
        (model.cam_pos, model.cam_bodyid),
    ):
        positions[:] *= scale[owner].reshape(-1, *[1] * (positions.ndim - 1))
    model.geom_rbound[:] *= scale[model.geom_bodyid]
    model.body_ipos[:] *= scale[:, None]
    model.body_mass[:] *= scale**3
    model.body_inertia[:] *= scale[:, None] ** 5


def _turn_lights(model: mujoco.MjModel, rng: np.random.Generator, options: DomainRandomization) -> None:
    for light in range(model.nlight):
        model.light_diffuse[light] *= 1.0 + options.light * rng.uniform(-1.0, 1.0)
        model.light_dir[light] = _turned(model.light_dir[light], rng, options.light_angle)


def _move_camera(model: mujoco.MjModel, camera: int, rng: np.random.Generator, options: DomainRandomization) -> None:
    model.cam_pos[camera] += options.camera_position * rng.uniform(-1.0, 1.0, 3)
    turn = np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, _direction(rng), options.camera_angle * rng.uniform(0.0, 1.0))
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, model.cam_quat[camera], turn)
    model.cam_quat[camera] = turned


def _choose_textures(model: mujoco.MjModel, rng: np.random.Generator, sets: int) -> None:
    role = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
    for material in range(model.nmat):
        choice = int(rng.integers(sets))
        texture = model.mat_texid[material, role]
        if choice and texture >= 0:
            name = f"{model.texture(texture).name}/{choice}"
            index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXTURE, name)
            if index >= 0:
                model.mat_texid[material, role] = index


def _direction(rng: np.random.Generator) -> np.ndarray:
    direction = rng.standard_normal(3)
    return direction / np.linalg.norm(direction)


def _turned(vector: np.ndarray, rng: np.random.Generator, most: float) -> np.ndarray:
    turn = np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, _direction(rng), most * rng.uniform(0.0, 1.0))
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, turn)
    return turned


def _scalar(dtype: Any) -> Any:
    return getattr(dtype, "_wp_scalar_type_", dtype)


def _inner(dtype: Any) -> tuple[int, ...]:
    return getattr(dtype, "_shape_", ())
