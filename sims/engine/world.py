"""The simulated world: a robot before a camera, whose images come with exact flow, Jacobian and mask.

image = SimWorld("arm", seed=3).frame().rgb
"""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import number_array
from dense_vs.checks import check_flag, check_options, check_whole
from dense_vs.device import resolve_device, resolve_threads, room_for
from dense_vs.errors import DenseVSError
from dense_vs.sims.engine import surface_points
from dense_vs.sims.engine.compliance import Compliance, resolve_compliance
from dense_vs.sims.engine.distractor import Distractor, DistractorPath
from dense_vs.sims.engine.exposure import make_renderer
from dense_vs.sims.engine.frames import DeviceFrame, Frame
from dense_vs.sims.engine.joint_readings import JointReadings
from dense_vs.sims.engine.lens import Lens
from dense_vs.sims.engine.physics import Physics, WarpPhysics, history_times, make_physics
from dense_vs.sims.engine.pose_memory import PoseMemory
from dense_vs.sims.engine.randomization import DomainRandomization, WorldModels, world_rng
from dense_vs.sims.engine.realism import Realism, resolve_realism
from dense_vs.sims.engine.renderer import camera_intrinsics
from dense_vs.sims.engine.scene import FRAME_SECONDS, Scene, load_scene
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.sims.engine.swaying_camera import SwayingCamera
from dense_vs.sims.engine.truth import GroundTruth
from dense_vs.sims.engine.viewpoint import Viewpoint

MAX_WORLDS, MAX_SIDE, MAX_SAMPLES = 65536, 16384, 16
BYTES_PER_PIXEL = 24  # about: color, packed and not, depth, and ids with and without their types
BYTES_PER_SAMPLE = 30  # about: packed color, and the direction and origin of its ray
BYTES_OF_PHYSICS = 50_000  # of a world, about


class SimWorld:
    """B simulated worlds of one robot with N chosen joints, seen by one camera each, 30 frames a second.

    Arrays come without the leading B for a single world. "rad" stands for m too where a joint is a slide.

    Args:
        robot: ``"arm"`` (4 joints in 3D), ``"painted"`` (the same joints in plain painted links, in a room with
            shadows), ``"planar"`` (3 joints, a plane that faces the camera),
            ``"upper-body"`` (two arms of 7 joints before the robot's own eyes), ``"upper-body-rake"`` and
            ``"upper-body-vacuum"`` (holding a tool, which counts as part of the robot), ``"panda"`` and others once
            ``dense-vs arms`` has built their scenes, or the path of an MJCF file with a camera and position actuators.
        joints: names of the joints that are commanded and that Jacobians have columns for, in this order;
            all joints that a position actuator drives when None. Others keep their position.
        camera: name of the camera; the first one when None.
        worlds: B. They share textures; postures and distractor paths differ.
        device: Warp device, see :func:`dense_vs.device.resolve_device`.
        height, width: of the image [px].
        seed: textures, initial posture and distractor path of our robots. An MJCF file is taken as it is, at its
            first keyframe if it has one.
        threads: CPU threads, see :func:`dense_vs.device.resolve_threads`.
        randomization: how else the worlds differ; they don't unless given.
        physics_on_device: step one world on a CPU with MuJoCo-Warp too, in place of MuJoCo's C engine.
        distractor: ``"none"``, ``"behind"`` (a moving plate between arm and wall) or ``"front"`` (before
            the arm, covering parts of it); ``"walker-behind"``, ``"walker-next"``, ``"walker-across"`` and the same
            with ``chair`` for the upper body, see :mod:`.distractor`; our robots only.
        samples: rays for a pixel's color along either side of it, see :mod:`.renderer`; unless given 2 where the model
            has meshes or is painted, whose detail aliases with one, else 1.
        realism: True or ``"realistic"``, another preset, or a :class:`.realism.Realism`: what sets images and joint
            readings of real cameras and robots apart, and what the truth is then, see :mod:`.realism`.
        compliance: True, or a :class:`.compliance.Compliance`, for joints that are soft, late and read with noise, as a
            tendon-driven robot's; our robots only. The truth stays exact.
        geom_groups: of an MJCF file's geoms, those drawn; 0, 1 and 2 unless given.
        first_world: number of the first of these worlds where they are some of many: the same as there.

    Attributes:
        samples, viewpoint: rays along a side of a pixel; the camera's pose and lens in float64.

    Raises:
        DenseVSError: any argument that cannot be used; the message lists the valid ones.
    """

    def __init__(
        self,
        robot: str | os.PathLike[str],
        *,
        joints: Sequence[str] | None = None,
        camera: str | None = None,
        worlds: int = 1,
        device: Any = "auto",
        height: int = 240,
        width: int = 320,
        seed: int = 0,
        threads: int | None = None,
        distractor: str = "none",
        compliance: bool | Compliance = False,
        randomization: DomainRandomization | None = None,
        physics_on_device: bool = False,
        samples: int | None = None,
        realism: bool | str | Realism = False,
        geom_groups: Sequence[int] | None = None,
        first_world: int = 0,
    ):
        worlds = check_whole("worlds", worlds, least=1, most=MAX_WORLDS)
        self.first_world = check_whole("first_world", first_world, least=0)
        self._numbers = range(self.first_world, self.first_world + worlds)
        self._realism = resolve_realism(realism)
        self._samples = None if samples is None else check_whole("samples", samples, least=1, most=MAX_SAMPLES)
        sides = {"least": 8, "most": MAX_SIDE}
        self._shape = (worlds, check_whole("height", height, **sides), check_whole("width", width, **sides))
        self._device = resolve_device(device)
        self._threads = resolve_threads(threads)
        self._randomization = check_options("randomization", randomization, DomainRandomization)
        self._physics_on_device = check_flag("physics_on_device", physics_on_device)
        self._choice = {"robot": robot, "joints": joints, "camera": camera, "distractor": distractor}
        self._compliance = self._choice["compliance"] = resolve_compliance(compliance)
        self._choice["geom_groups"] = geom_groups
        self._choice["texture_sets"] = self._randomization.texture_sets
        self._load(check_whole("seed", seed, least=0))

    def reset(self, seed: int | None = None) -> None:
        """Back to time 0: the same beginning again, or the one of another seed."""
        if seed is not None and check_whole("seed", seed, least=0) != self._seed:
            self._load(int(seed))
        else:
            self._begin()

    def step(self, delta: Any = None) -> None:
        """One camera frame (1/30 s) of physics.

        Args:
            delta: change of the joint position targets [rad], (N,) for all worlds or (B, N); None holds.
                Targets stay within ``joint_limits``.

        Raises:
            DenseVSError: wrong shape or non-finite values; nothing has moved.
        """
        step = self._joint_step(delta)
        self._poses.remember()
        self._readings.remember(self._physics.joint_history)
        self._physics.advance(step)
        self._frame += 1
        self._settle()

    def step_on_device(self, restarting: wp.array, unsound: wp.array) -> None:
        """One camera frame of physics by the steps that ``physics.joint_step`` (B, N) holds, with MuJoCo-Warp.

        Nothing is decided or counted on the host, so it can be captured in a graph; :meth:`count_frame` counts.

        Args:
            restarting: (B,) int; where it is not 0 the world is put back to its beginning instead. Set to 1 where
                the world's state has ceased to be finite.
            unsound: (B,) int, counted up there.
        """
        physics = self._physics
        assert isinstance(physics, WarpPhysics)
        self._poses.remember()
        physics.advance_on_device()
        physics.find_unsound(restarting, unsound)
        physics.restart_on_device(restarting)
        self._settle()

    def count_frame(self, frames: int = 1) -> None:
        """Note that a captured :meth:`step_on_device` has run that many times more."""
        self._frame += frames
        self._rendered = False

    def frame(self) -> Frame:
        """The present image, rendered when first asked for."""
        seen = self.frame_device()
        rgb = seen.rgb.numpy().copy()
        rgb = rgb if self._realism is None else self._realism.compressed(rgb)
        depth, ids = (array.numpy().copy() for array in (seen.depth, seen.ids))
        return Frame(self._out(rgb), self._out(depth), self._out(ids), self.time)

    def frame_device(self) -> DeviceFrame:
        """The present image in device arrays, which the next frame overwrites; without realism's compression."""
        if not self._rendered:
            self._renderer.render()
            self._rendered = True
        return DeviceFrame(self._renderer.rgb, self._renderer.depth, self._renderer.ids, self.time)

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (N,) of the chosen joints [rad], as they are read, and their time [s]."""
        return self._out(self._readings.of(self._physics.joint_positions()[:, None])[:, -1]), self.time

    def joint_history(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (S,) and positions (S, N) after each physics step of the last frame; S = 1 before the first."""
        history = self._physics.joint_history()
        return history_times(self._frame, history.shape[1]), self._out(self._readings.of(history))

    def true_jacobian(self, depth: bool = False) -> np.ndarray:
        """Image Jacobian (H, W, 2, N) of the surface point at every pixel [px/rad]; (H, W, 3, N) with depth [m/rad].

        Passive joints that constraints tie to the chosen ones follow them, see :mod:`.closed_chain`; all
        others keep their angle.
        """
        jacobian = self.true_jacobian_device(depth).numpy()
        return self._out(jacobian.reshape(*self._shape, 3 if depth else 2, -1).copy())

    def true_jacobian_device(self, depth: bool = False) -> wp.array:
        """The same on the device: (B, H, W, 2 N) float32, the row of x before that of y; 3 N with that of depth."""
        self.frame_device()
        chain = self._scene.chain
        if len(chain.passive):
            couplings = []
            for world in range(self._shape[0]):
                qpos = self._physics.host_state(world).qpos
                couplings.append(chain.coupling(self._physics.models.host(world), qpos))
            self._truth.coupling.assign(np.array(couplings, dtype=np.float32))
        truth = self._truth.spatial_jacobian if depth else self._truth.jacobian
        truth.compute()
        return truth.rows

    def true_flow(self) -> np.ndarray:
        """Flow (H, W, 2) [px] between the last two frames, stored at the pixels of the present one.

        ``x - u(x)`` is where the point seen at x was in the previous image; it may have been covered there.
        Zero before the first step.
        """
        return self._out(self.true_flow_device().numpy().copy())

    def true_flow_device(self) -> wp.array:
        """The same on the device: (B, H, W) of vec2."""
        self.frame_device()
        self._truth.compute_flow()
        return self._truth.flow

    def robot_mask(self) -> np.ndarray:
        """(H, W) bool: pixels of bodies that the chosen joints move, or passive ones that follow them: tools too."""
        return self._out(self.robot_mask_device().numpy().astype(bool))

    def robot_mask_device(self) -> wp.array:
        """The same on the device: (B, H, W) uint8."""
        self.frame_device()
        self._truth.compute_mask()
        return self._truth.mask

    def track_point(self, pixel: Any) -> SurfacePoint:
        """The surface point that a pixel shows now, to ask :meth:`project` and :meth:`visible` for later.

        Args:
            pixel: (x, y) for all worlds or (B, 2); need not be whole numbers.

        Raises:
            DenseVSError: outside the image, or no surface there.
        """
        return self.viewpoint.track(self._per_world(pixel, 2, "pixel"), self._shape[1:])

    def project(self, point: str | SurfacePoint) -> np.ndarray:
        """Pixel (2,) of a surface point or of the site (or body, or geom) of that name; nan behind the camera."""
        return self._out(np.stack([self.viewpoint.located(point, world)[0] for world in range(self._shape[0])]))

    def visible(self, point: SurfacePoint) -> bool | np.ndarray:
        """Whether the surface point is inside the image and nothing covers it; (B,) for several worlds."""
        worlds = self._shape[0]
        surface_points.check_point(point, worlds, self._scene.model.ngeom)
        seen = [self.viewpoint.sees(point, world, self._shape[1:]) for world in range(worlds)]
        return seen[0] if worlds == 1 else np.array(seen)

    @property
    def time(self) -> float:
        """Time of the present frame [s], a whole number of frames."""
        return self._frame * FRAME_SECONDS

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the N chosen joints."""
        return self._scene.joint_names

    @property
    def joint_limits(self) -> np.ndarray:
        """(N, 2) lowest and highest target [rad]; infinite where the model sets none."""
        return self._scene.joint_limits.copy()

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each of the N joints: ``"rad"`` of a hinge, ``"m"`` of a slide."""
        return self._scene.joint_units

    @property
    def intrinsics(self) -> np.ndarray:
        """(3, 3) camera matrix [px], pixel centers at integer coordinates; the lens comes before it."""
        return self.viewpoint.lens.intrinsics.copy()

    @property
    def realism(self) -> Realism | None:
        """What sets images and readings apart from exact ones."""
        return self._realism

    @property
    def T_world_camera(self) -> np.ndarray:
        """(4, 4) camera to world; camera axes x right, y down, z forward."""
        worlds = range(self._shape[0])
        return self._out(np.stack([self.viewpoint.pose(self._physics.host_state(world), world) for world in worlds]))

    @property
    def shape(self) -> tuple[int, int, int]:
        """(worlds, height, width)."""
        return self._shape

    @property
    def device(self) -> wp.Device:
        """Where images and truth are computed."""
        return self._device

    @property
    def threads(self) -> int:
        """CPU threads."""
        return self._threads

    @property
    def scene(self) -> Scene:
        """The compiled model and the ids of camera, joints and actuators."""
        return self._scene

    @property
    def physics(self) -> Physics:
        """The engine, its MuJoCo-Warp model and data."""
        return self._physics

    def _load(self, seed: int) -> None:
        worlds, height, width = self._shape
        scene = load_scene(**self._choice, seed=seed)
        rngs = [world_rng(seed, number, 2) for number in self._numbers]
        models = WorldModels(scene.model, scene.camera, rngs, self._randomization)
        self.samples = samples = self._samples or scene.samples
        realism = self._realism or Realism()
        lens = Lens(camera_intrinsics(scene.model, scene.camera, height, width), (height, width), realism.distortion)
        if realism.shadows:
            scene.model.light_castshadow[:] = True
        pixel_bytes = BYTES_PER_PIXEL + BYTES_PER_SAMPLE * samples**2 * (samples > 1 or realism.changes_exposure)
        with room_for("a simulation", worlds, pixel_bytes * height * width + BYTES_OF_PHYSICS, self._device):
            physics = make_physics(scene, worlds, self._device, models, self._physics_on_device)
            self._poses = PoseMemory(physics.data)
            seeds = np.array([world_rng(seed, number, 4).integers(2**31) for number in self._numbers])
            renderer = make_renderer(
                (scene.model, physics.model, physics.data, scene.camera, self._shape, self._device, self._threads),
                samples,
                lens,
                realism,
                self._poses,
                seeds,
                realism.shadows or scene.shadows,
            )
        rngs = [world_rng(seed, number, 5) for number in self._numbers]
        self._sway = SwayingCamera(realism.sway, rngs, scene.camera, self._device) if realism.sway else None
        self.viewpoint = Viewpoint(physics, lens, self._sway)
        self._truth = GroundTruth(scene, physics.data, self._poses, renderer, lens, self._device, self._threads)
        self._scene, self._physics, self._renderer, self._seed = scene, physics, renderer, seed
        self._readings = JointReadings(
            self._compliance, self._realism, lambda world: world_rng(seed, self._numbers[world], 3, self._frame)
        )
        self._distractor: Distractor | None = None
        if scene.distractor >= 0:
            rngs = [world_rng(seed, number, 1) for number in self._numbers]
            path = DistractorPath.draw(rngs, self._choice["distractor"])
            self._distractor = Distractor(path, scene.distractor, self._device)
        self._begin()

    def _begin(self) -> None:
        scene = self._scene
        qpos = np.repeat(scene.home_qpos[None], self._shape[0], axis=0)
        columns = scene.model.jnt_qposadr[scene.joint_ids]
        for world, row in enumerate(qpos):
            offset = world_rng(self._seed, self._numbers[world], 0).uniform(-1.0, 1.0, len(columns))
            row[columns] += scene.posture_range * offset
            row[:] = scene.chain.closed(self._physics.models.host(world), row)[0]
        self._physics.reset(qpos)
        self._readings.begin()
        self._frame = 0
        self._settle()
        self._poses.remember()

    def _settle(self) -> None:
        """Put the distractor where the time says, and mark the image as old."""
        data = self._physics.data
        if self._distractor is not None:
            self._distractor.place(data.time, data.mocap_pos)
        self._physics.update_poses()
        if self._sway is not None:
            self._sway.turn(data.time, data.cam_xmat)
        self._rendered = False

    def _joint_step(self, delta: Any) -> np.ndarray:
        if delta is None:
            return np.zeros((self._shape[0], len(self._scene.joint_ids)))
        return self._per_world(delta, len(self._scene.joint_ids), "delta")

    def _per_world(self, value: Any, columns: int, name: str) -> np.ndarray:
        """(B, columns) float64 from one row for all worlds or one for each."""
        worlds = self._shape[0]
        array = number_array(value, name)
        if array.shape not in ((columns,), (worlds, columns)):
            expected = f"({columns},)" if worlds == 1 else f"({columns},) or ({worlds}, {columns})"
            raise DenseVSError(f"{name} has shape {array.shape}; expected {expected}")
        return np.broadcast_to(array, (worlds, columns))

    def _out(self, array: np.ndarray) -> np.ndarray:
        return array[0] if self._shape[0] == 1 else array
