"""The mobile manipulator in its room: physics by MuJoCo's C engine, both cameras rendered by MuJoCo-Warp.

Motions are commanded as in VOS-VS section 4.2: a change of joint positions, carried out until the robot rests. The
base's odometry drifts, images carry sensor noise. Ids of the renderer are for annotations, tests and scores only.
"""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from dense_vs.device import resolve_device, resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.physics import HostPhysics
from dense_vs.sims.engine.renderer import Renderer, camera_intrinsics
from dense_vs.sims.engine.scene import FRAME_SECONDS, resolve_scene
from dense_vs.sims.engine.surface_points import camera_pose
from dense_vs.sims.mobile_manipulator.model import JOINTS, PULLER, Addition, compile_model
from dense_vs.sims.mobile_manipulator.set_aside import ObjectsInPlay

HEIGHT, WIDTH = 480, 640
CAMERAS = ("head", "grasp")
FINGERS = ("left_finger", "right_finger")
OPENING = 0.135  # m, largest
BASE = slice(7, 10)
_CHAIN_SLOPE = 0.05  # rad, of a chain that is dropped; its loops are of some six links
_HEAPS = 100  # tries to lay a chain clear of everything
_OVERLAP = 0.001  # m, that a chain may begin inside what it falls on
_BACK_OFF = 0.015  # m or rad, of the base from what it touched
# Joint speeds [rad/s, m/s]; a motion takes as long as its slowest joint.
SPEEDS = np.array([1.0, 1.0, 0.25, 0.8, 1.2, 1.2, 1.5, 0.3, 0.3, 0.6])


class MobileWorld:
    """One mobile manipulator, its bins, and household objects.

    Args:
        objects: names of :func:`household_objects` or :func:`clutter_objects`; the 24 of the former when None. Objects
            begin in storage: out of sight and out of the physics.
        seed: of textures, sensor noise and odometry.
        device: Warp device of the renderer; the CPU here, whose physics is MuJoCo's own.
        threads: CPU threads of the renderer.
        shadows: whether the ceiling lamp casts shadows; half as long again to render.
        noise: standard deviation of the images' noise, of 255.
        slip: standard deviation of the base's odometry error, as a share of each motion.
        additions: put more into the room, as a person or a tray.

    Raises:
        DenseVSError: an unknown object, a device that is not the CPU. Whatever lets time pass raises it too where the
            simulation becomes unstable; the world is then as it was before that frame, never back at its beginning.
    """

    def __init__(
        self,
        objects: Sequence[str] | None = None,
        *,
        seed: int = 0,
        device: Any = "cpu",
        threads: int | None = None,
        shadows: bool = False,
        noise: float = 2.0,
        slip: float = 0.02,
        additions: Sequence[Addition] = (),
    ):
        self.device = resolve_device(device)
        if not self.device.is_cpu:
            raise DenseVSError(f"device is {device!r}; expected 'cpu': this world's physics is MuJoCo's C engine")
        model, self.objects = compile_model(objects, seed, additions)
        self.scene = resolve_scene(model, JOINTS, "grasp")
        self.physics = HostPhysics(self.scene, self.device)
        self._in_play = ObjectsInPlay(self.physics.host_model, [thing.body for thing in self.objects.values()])
        threads = resolve_threads(threads)
        self._renderers = {
            name: Renderer(
                model,
                self.physics.model,
                self.physics.data,
                model.camera(name).id,
                (1, HEIGHT, WIDTH),
                self.device,
                threads,
                shadows=shadows,
            )
            for name in CAMERAS
        }
        self._rendered: dict[str, bool] = {}
        self._rng = np.random.default_rng([seed, 30])
        self._noise, self._slip = noise, slip
        self._finger_actuators = [model.actuator(name).id for name in FINGERS]
        self._columns = model.jnt_qposadr[self.scene.joint_ids]
        self._base_geom = model.geom("base").id
        self._target = self.scene.home_qpos[self._columns].copy()  # where the joints are commanded to be
        self._odometry_error = np.zeros(3)
        self.frames = 0
        self.before_frame: Callable[[], None] | None = None  # moves what moves on its own
        self.physics.reset(self._stored()[None])
        self._settled()

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model."""
        return self.scene.model

    @property
    def state(self) -> mujoco.MjData:
        """The engine's state."""
        return self.physics.host_state(0)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The ten joints in the order of VOS-VS (1)."""
        return JOINTS

    @property
    def joint_limits(self) -> np.ndarray:
        """(10, 2) lowest and highest position [rad, m]."""
        return self.scene.joint_limits.copy()

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each of the ten joints: ``"rad"`` of a hinge, ``"m"`` of a slide."""
        return self.scene.joint_units

    @property
    def time(self) -> float:
        """[s]."""
        return self.frames * FRAME_SECONDS

    def joints(self) -> np.ndarray:
        """Joint positions (10,) as the encoders tell them: those of the base by odometry [rad, m]."""
        q = self.state.qpos[self._columns].copy()
        q[BASE] -= self._odometry_error
        return q

    def true_joints(self) -> np.ndarray:
        """Joint positions (10,), the base where it is."""
        return self.state.qpos[self._columns].copy()

    def set_posture(self, q: Any, *, forget_odometry: bool = True) -> None:
        """Put the robot at joint positions (10,) at rest, without motion; objects stay where they are."""
        qpos = self.state.qpos.copy()
        qpos[self._columns] = q
        for name in FINGERS:
            qpos[self.model.joint(name).qposadr[0]] = OPENING / 2
        if forget_odometry:
            self._odometry_error[:] = 0.0
        self.physics.reset(qpos[None])
        self._target = qpos[self._columns].copy()
        for actuator in self._finger_actuators:
            self.state.ctrl[actuator] = OPENING / 2
        self._settled()

    def move(self, delta: Any, *, settle_frames: int = 6) -> None:
        """Change the joint targets by delta (10,) [rad, m] along a ramp at the joints' speeds, then come to rest.

        The base stops where it touches something, as a robot with a bumper does, and stays there.
        """
        delta = np.asarray(delta, dtype=float)
        if delta.shape != (len(JOINTS),) or not np.isfinite(delta).all():
            raise DenseVSError(f"delta is {delta.tolist()}; expected {len(JOINTS)} finite numbers")
        delta = delta.copy()
        slip = self._slip * delta[BASE] * self._rng.standard_normal(3)
        delta[BASE] += slip
        self._odometry_error += slip
        frames = max(1, int(np.ceil(np.max(np.abs(delta) / SPEEDS) / FRAME_SECONDS)))
        for _ in range(frames):
            self._advance(delta / frames)
            if delta[BASE].any() and np.any(self.state.contact.geom == self._base_geom):
                way = delta[BASE] / max(float(np.abs(delta[BASE]).max()), 1e-9)
                delta[BASE] = 0.0
                back = np.zeros(len(JOINTS))
                back[BASE] = self.true_joints()[BASE] - self._target[BASE] - _BACK_OFF * way
                self._advance(back)
        self.wait(settle_frames)

    def wait(self, frames: int) -> None:
        """Let frames pass with all targets held."""
        for _ in range(frames):
            self._advance(np.zeros(len(JOINTS)))
        self._settled()

    def set_gripper(self, opening: float, frames: int = 20) -> float:
        """Move the gripper to an opening [m] along a ramp of two thirds of the frames, and hold; the opening then."""
        goal, ramp = float(np.clip(opening, 0.0, OPENING)) / 2, max(1, 2 * frames // 3)
        start = [float(self.state.ctrl[actuator]) for actuator in self._finger_actuators]
        for frame in range(1, ramp + 1):
            for actuator, begin in zip(self._finger_actuators, start, strict=True):
                self.state.ctrl[actuator] = begin + frame / ramp * (goal - begin)
            self.wait(1)
        self.wait(frames - ramp)
        return self.opening()

    def opening(self) -> float:
        """Distance between the fingertips [m], by the fingers' encoders."""
        return float(sum(self.state.qpos[self.model.joint(name).qposadr[0]] for name in FINGERS))

    def image(self, camera: str) -> np.ndarray:
        """RGB uint8 (480, 640, 3) of ``"head"`` or ``"grasp"``, with sensor noise."""
        rgb = self._render(camera).rgb.numpy()[0]
        noise = self._rng.standard_normal(rgb.shape, dtype=np.float32)
        return np.clip(np.rint(rgb + self._noise * noise), 0, 255).astype(np.uint8)

    def restart_noise(self, rng: np.random.Generator) -> None:
        """Draw the noise of images and odometry anew, from a stream that one number of ``rng`` decides."""
        self._rng = np.random.default_rng(rng.integers(1 << 62))

    def depth(self, camera: str) -> np.ndarray:
        """True depth (480, 640) [m] along the optical axis."""
        return self._render(camera).depth.numpy()[0].copy()

    def true_mask(self, camera: str, name: str) -> np.ndarray:
        """Pixels of an object, bool (480, 640): for annotations, tests and scores."""
        return self.pixels_of(camera, self.geoms(name))

    def pixels_of(self, camera: str, geoms: np.ndarray) -> np.ndarray:
        """Pixels of some geoms by their ids, bool (480, 640): for annotations, tests and scores."""
        return np.isin(self._render(camera).ids.numpy()[0], geoms)

    def geoms(self, name: str) -> np.ndarray:
        """Ids of an object's geoms."""
        model = self.model
        root = model.body(self.objects[name].body).id
        return np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)

    def intrinsics(self, camera: str) -> np.ndarray:
        """(3, 3) camera matrix [px]."""
        return camera_intrinsics(self.model, self.model.camera(camera).id, HEIGHT, WIDTH)

    def camera_pose(self, camera: str) -> np.ndarray:
        """T_world_camera (4, 4)."""
        return camera_pose(self.state, self.model.camera(camera).id)

    def place(self, name: str, position: Any, yaw: float = 0.0, *, settle_frames: int = 15) -> None:
        """Put an object on what is at a position (3,) [m], turned about the vertical [rad], and let it come to rest."""
        self._place(name, position, yaw)
        self.wait(settle_frames)

    def lay_chain(self, name: str, position: Any, rng: np.random.Generator, step: float = 1.0) -> None:
        """Drop a chain in a random heap around a position (3,): each link turned against the one before it.

        It falls from a slope that lifts every link over those that it crosses, and from nowhere inside anything else,
        as a higher support beside its own: what begins inside something bursts out, faster than the engine can follow.

        Raises:
            DenseVSError: no such heap found; nothing has moved.
        """
        before = self.state.qpos.copy(), self.state.qvel.copy(), self._in_play.known(self.objects[name].body)
        for _ in range(_HEAPS):
            self._draw_heap(name, position, rng, step)
            if self._deepest_overlap(name) < _OVERLAP:
                break
        else:
            self.state.qpos[:], self.state.qvel[:] = before[:2]
            self._in_play.set(self.objects[name].body, before[2])
            self._settled()
            raise DenseVSError(
                f"{name!r} cannot be laid at {np.asarray(position).tolist()}: each of {_HEAPS} heaps began inside "
                "something else; expected free space around"
            )
        self.wait(30)

    def _draw_heap(self, name: str, position: Any, rng: np.random.Generator, step: float) -> None:
        """Put a chain's links where it is to fall from."""
        self._place(name, position, rng.uniform(-np.pi, np.pi))
        body = self.objects[name].body
        column = self.model.joint(body).qposadr[0]
        sloped, slope = np.zeros(4), np.array([np.cos(_CHAIN_SLOPE / 2), 0.0, -np.sin(_CHAIN_SLOPE / 2), 0.0])
        mujoco.mju_mulQuat(sloped, self.state.qpos[column + 3 : column + 7], slope)
        self.state.qpos[column + 3 : column + 7] = sloped
        upright = np.array([np.sin(_CHAIN_SLOPE), 0.0, np.cos(_CHAIN_SLOPE)])  # the vertical in every link's frame
        turn = rng.choice([-1.0, 1.0])
        for link in range(1, self.objects[name].links):
            if rng.random() < 0.25:
                turn = -turn
            joint = self.model.joint(f"{body}_{link}").qposadr[0]
            angle = turn * rng.uniform(0.5, 1.1) * step
            self.state.qpos[joint : joint + 4] = [np.cos(angle / 2), *(np.sin(angle / 2) * upright)]

    def _deepest_overlap(self, name: str) -> float:
        """How deep an object is inside something, or its parts inside one another [m]; 0 for not at all."""
        mujoco.mj_fwdPosition(self.model, self.state)
        contact = self.state.contact
        touches = np.isin(contact.geom, self.geoms(name)).any(axis=1)
        return float(-contact.dist[touches].min(initial=0.0))

    def store(self, names: Sequence[str] | None = None) -> None:
        """Put objects away, out of sight and out of the physics: they float there and touch nothing."""
        for name in self.objects if names is None else names:
            self._place(name, self._storage(name), 0.0)
            self._in_play.set(self.objects[name].body, False)
            if self.objects[name].links:
                for link in range(1, self.objects[name].links):
                    joint = self.model.joint(f"{self.objects[name].body}_{link}").qposadr[0]
                    self.state.qpos[joint : joint + 4] = [1, 0, 0, 0]
        self._settled()

    def object_position(self, name: str) -> np.ndarray:
        """Position (3,) of an object's frame; a chain's, of the middle of its links."""
        thing = self.objects[name]
        bodies = [thing.body, *[f"{thing.body}_{link}" for link in range(1, thing.links)]]
        return np.mean([self.state.body(body).xpos for body in bodies], axis=0)

    def object_center(self, name: str) -> np.ndarray:
        """Center of mass (3,) of an object, all links of a chain."""
        return self.state.subtree_com[self.model.body(self.objects[name].body).id].copy()

    def pull_chain(self, name: str, place: Any | None) -> np.ndarray:
        """Hold the end of a chain at a place (3,) [m] from now on, or let it go; where the end is."""
        equality = self.model.equality(PULLER).id
        self.state.eq_active[equality] = place is not None
        if place is not None:
            self.put_body(PULLER, place)
        return self.state.site(f"{self.objects[name].body}_end").xpos.copy()

    def put_body(self, body: str, place: Any, quaternion: Any = (1.0, 0.0, 0.0, 0.0)) -> None:
        """Put a body that nothing but the caller moves, as a part of a person, at a place (3,) [m] and orientation."""
        mocap = int(self.model.body_mocapid[self.model.body(body).id])
        for positions, turns in (
            (self.state.mocap_pos, self.state.mocap_quat),
            (self.physics.data.mocap_pos.numpy()[0], self.physics.data.mocap_quat.numpy()[0]),  # kept over resets
        ):
            positions[mocap], turns[mocap] = place, quaternion

    def highest_point(self, name: str) -> float:
        """Height of the highest of an object's bodies [m]; of a chain, of its highest link."""
        return float(self._body_heights(name).max())

    def lowest_point(self, name: str) -> float:
        """Height of the lowest of an object's bodies [m]; of a chain, of its lowest link."""
        return float(self._body_heights(name).min())

    def _body_heights(self, name: str) -> np.ndarray:
        thing = self.objects[name]
        bodies = [thing.body, *[f"{thing.body}_{link}" for link in range(1, thing.links)]]
        return np.array([self.state.body(body).xpos[2] for body in bodies])

    def remember(self) -> Callable[[], None]:
        """A function that puts robot, objects in play and time back to what they are now."""
        put_physics_back, frames = self.physics.remember(), self.frames
        target, error = self._target.copy(), self._odometry_error.copy()

        def put_back() -> None:
            put_physics_back()
            self.frames, self._target[:], self._odometry_error[:] = frames, target, error
            self._settled()

        return put_back

    def _advance(self, step: np.ndarray) -> None:
        """A frame; an error where the simulation became unstable, the state then that before the frame."""
        if self.before_frame is not None:
            self.before_frame()
        self.physics.advance(step[None])
        self._target = np.clip(self._target + step, *self.scene.joint_limits.T)
        self.frames += 1

    def _place(self, name: str, position: Any, yaw: float) -> None:
        joint = self.model.joint(self.objects[name].body)
        column, dof = joint.qposadr[0], joint.dofadr[0]
        count = 6 + 3 * max(0, self.objects[name].links - 1)
        self.state.qpos[column : column + 3] = np.asarray(position, dtype=float) + np.array([0, 0, 0.001])
        self.state.qpos[column + 3 : column + 7] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        self.state.qvel[dof : dof + count] = 0.0
        self._in_play.set(self.objects[name].body, True)

    def _storage(self, name: str) -> np.ndarray:
        number = list(self.objects).index(name)
        away = 1.5 if self.objects[name].links else 0.0  # a straight chain is long
        return np.array([-6.0 + 0.45 * (number % 6), -2.0 + 0.7 * (number // 6) - 2 * away, 0.0])

    def _stored(self) -> np.ndarray:
        qpos = self.scene.home_qpos.copy()
        for name, thing in self.objects.items():
            column = self.model.joint(thing.body).qposadr[0]
            qpos[column : column + 7] = [*self._storage(name), 1, 0, 0, 0]
        return qpos

    def _settled(self) -> None:
        self.physics.update_poses()
        self._rendered.clear()

    def _render(self, camera: str) -> Renderer:
        renderer = self._renderers.get(camera)
        if renderer is None:
            raise DenseVSError(f"camera {camera!r} is unknown; expected one of {', '.join(map(repr, CAMERAS))}")
        if not self._rendered.get(camera, False):
            renderer.render()
            self._rendered[camera] = True
        return renderer
