"""The whole servo loop of many simulated robots at once, on the device from the image to the joint command.

    world = SimWorld("arm", worlds=1024, seed=0, randomization=DomainRandomization(link_size=0.1, texture_sets=4))
    batch = BatchServo(world, targets=3)
    batch.run()
    print(batch.results().true_error_px)

A frame is physics, rendering, optical flow, the dense Jacobian's update, tracking, and the command of each world's own
phase: it babbles, then servos its point to one target after another, then rests. On a GPU a frame is one CUDA
graph and nothing is read back unless asked for. Every world finishes, loses its point or begins again on its own. A
lost point ends its world's run.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from dense_vs.device import room_for
from dense_vs.errors import DenseVSError
from dense_vs.flow.batch_flow import BYTES_PER_PIXEL, BatchFlow
from dense_vs.jacobian.error import JacobianError, jacobian_error
from dense_vs.jacobian.filter import JacobianFilter, filter_bytes
from dense_vs.jacobian.options import EstimatorOptions, JacobianOptions
from dense_vs.kernels.control.babbling import BabblingState, babbling_steps, restart_babbling, watch_flow
from dense_vs.kernels.control.servo_law import limits_array, servo_steps
from dense_vs.kernels.jacobian.surface_weights import surface_weight_kernels
from dense_vs.kernels.simulation.servo_episode import RESTING, EpisodeState, advance_episodes
from dense_vs.kernels.simulation.surface_projection import project_surface_points
from dense_vs.kernels.simulation.world_restart import joint_motion
from dense_vs.kernels.tracking.point_tracking import TrackedPoints, begin_tracks, carry_tracks, locate_tracks
from dense_vs.kernels.views import seen_as
from dense_vs.point_servo.law import ServoOptions
from dense_vs.point_servo.same_surface import SAME_SURFACE
from dense_vs.point_servo.tracker import FIXED_POINT_STEPS, TrackerOptions
from dense_vs.robot.babbling import BabblingOptions
from dense_vs.sims.batch.episode import ENDS, BatchResults, EpisodeOptions
from dense_vs.sims.engine.physics import WarpPhysics
from dense_vs.sims.engine.renderer import GrayRenderer
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.targets import reachable_targets
from dense_vs.sims.engine.world import SimWorld

WARM_UP_FRAMES = 2  # run launch by launch before a graph is captured: kernels compile and arrays are made
LONGEST_GUESS = 16.0  # px, of a flow that J dq may begin the search with; J is anything at first
CHECK_FRAMES = 30  # between looks at whether all worlds rest


class BatchServo:
    """B robots that learn their image Jacobians and reach image targets, each at its own pace.

    Args:
        world: B worlds at their beginning; with one world on a CPU made with ``physics_on_device=True``.
        point: site, body or geom of the model whose surface point is to be brought to the targets.
        targets: (B, K, 2) [px], or K for that many reachable places, drawn from the seed.
        seed: of babbling, dither and targets; every world has streams of its own.
        flow: method of :class:`BatchFlow`; each frame's search begins at J dq.
        estimator: options of :class:`dense_vs.DenseJacobian` that differ from the default; ``order`` is 1 unless
            given, as the state of order 2 takes 3.5 times the memory with four joints, and ``prediction`` ``"model"``.
        servo, babbling, tracker, episode: options of the parts.

    Attributes:
        frames: frames run so far.
        physics, filter, flow, tracks, episode, babbling: the parts, whose arrays are on the device.
        joint_positions: (B, N) float32 on the device [rad].
        servo_draws: (B,) random numbers that the servo law has drawn.
        restarting: (B,) not 0 where the world is put back to its beginning with the next frame.
        unsound: (B,) how often that was because its state was not finite.

    Raises:
        DenseVSError: parts or targets that do not fit; a GPU whose memory does not suffice.
    """

    def __init__(
        self,
        world: SimWorld,
        *,
        point: str = "tip",
        targets: Any = 1,
        seed: int = 0,
        flow: str = "farneback-guided-warp",
        estimator: EstimatorOptions | None = None,
        servo: ServoOptions | None = None,
        babbling: BabblingOptions | None = None,
        tracker: TrackerOptions | None = None,
        episode: EpisodeOptions | None = None,
    ):
        if not isinstance(world.physics, WarpPhysics):
            raise DenseVSError(
                "the world is stepped by MuJoCo's C engine; expected SimWorld(..., physics_on_device=True)"
            )
        if world.realism is not None:
            raise DenseVSError("the world has realism; expected one without, as a batch renders its own images")
        self.world, self.device = world, world.device
        self.frames = self._launched = 0
        self.physics = world.physics
        self._servo_options = servo or ServoOptions()
        self._babbling_options = babbling or BabblingOptions(frame_time=FRAME_SECONDS)
        self._tracker_options = tracker or TrackerOptions()
        self._episode_options = episode or EpisodeOptions()
        if (wide := self._babbling_options.wide_amplitude) is not None:
            raise DenseVSError(f"babbling has wide_amplitude {wide!r}; expected None, as a batch learns no bodies")
        worlds, height, width = world.shape
        joints = len(world.joint_names)
        # "nearest" samples the state twice where the model does not fit, and moving the state is what a GPU spends.
        chosen: EstimatorOptions = {"order": 1, "prediction": "model", "on_bad_flow": "skip", **(estimator or {})}
        options = JacobianOptions(height=height, width=width, joints=joints, worlds=worlds, **chosen)
        if options.covariance != "shared":
            raise DenseVSError(f"covariance is {options.covariance!r}; expected 'shared' in a batch")
        self.surface_point = world.track_point(world.project(point))
        places = self._targets(targets, seed)
        with room_for("a batch servo", worlds, _bytes_per_world(options), self.device):
            self._allocate(options, flow, places, seed)
        self._graphs: list[Any] = [None, None]

    def frame(self) -> None:
        """Physics, image, flow, update, tracking and command of one frame in every world."""
        now = self.filter.now
        if self.device.is_cuda and self._launched >= WARM_UP_FRAMES:
            if self._graphs[now] is None:
                with wp.ScopedCapture(self.device) as capture:
                    self._launch()
                self.filter.swap()  # capturing ran nothing
                self._graphs[now] = capture.graph
            wp.capture_launch(self._graphs[now])
            self.filter.swap()
        else:
            self._launch()
            self._launched += 1
        self.world.count_frame()
        self.frames += 1

    def run(self, frames: int | None = None) -> None:
        """Run that many frames, or until every world rests."""
        for count in range(self.longest_run if frames is None else frames):
            self.frame()
            if frames is None and count % CHECK_FRAMES == CHECK_FRAMES - 1 and self.resting.all():
                return

    def restart(self, where: Any) -> None:
        """Put worlds back to their beginning with the next frame, with all of their targets before them.

        Args:
            where: (B,) bool.

        Raises:
            DenseVSError: another shape or dtype.
        """
        chosen = np.asarray(where)
        shape = self.world.shape[:1]
        if chosen.shape != shape or chosen.dtype != bool:
            got = f"shape {chosen.shape} and dtype {chosen.dtype}"
            raise DenseVSError(f"where has {got}; expected bool of shape {shape}")
        fresh = EpisodeState.empty(self.episode.targets.numpy(), "cpu")
        for name in ("phase", "age", "settled", "target_index", "outcome", "frames", "error", "true_error"):
            array = getattr(self.episode, name)
            values = array.numpy()
            values[chosen] = getattr(fresh, name).numpy()[chosen]
            array.assign(values)
        self.restarting.assign(np.maximum(self.restarting.numpy(), chosen.astype(np.int32)))

    @property
    def longest_run(self) -> int:
        """Frames after which a run ends in any case: twice the longest course, for worlds that start again."""
        reaches = self.episode.outcome.shape[1] * (self._episode_options.max_frames + 1)
        return 2 * (self._babble_frames + reaches + 1)

    @property
    def resting(self) -> np.ndarray:
        """(B,) bool: worlds that have all of their targets behind them."""
        return self.episode.phase.numpy() == RESTING

    @property
    def jacobian(self) -> wp.array:
        """J at the present posture, (B, H, W) of 2 x N matrices [px/rad], on the device."""
        return self.filter.present()

    @property
    def gray(self) -> wp.array:
        """The latest images, (B, H, W) uint8, on the device."""
        return self.flow.gray

    @property
    def points(self) -> np.ndarray:
        """Tracked points (B, 2) [px]; meaningless in a world that still babbles."""
        return self.episode.point.numpy()[:, 0]

    @property
    def targets(self) -> np.ndarray:
        """All targets, (B, K, 2) [px]."""
        return self.episode.targets.numpy()

    def results(self) -> BatchResults:
        """The reaches so far."""
        episode = self.episode
        return BatchResults(
            outcome=np.array(ENDS, dtype=object)[episode.outcome.numpy()],
            frames=episode.frames.numpy(),
            error_px=episode.error.numpy(),
            true_error_px=episode.true_error.numpy(),
            restarts=self.unsound.numpy(),
        )

    def jacobian_errors(self) -> list[JacobianError]:
        """Error of J over the robot's pixels against the simulator's truth, a world each."""
        worlds, height, width = self.world.shape
        true = self.world.true_jacobian().reshape(worlds, height, width, 2, -1)
        mask = self.world.robot_mask().reshape(worlds, height, width)
        estimated = self.jacobian.numpy()
        return [jacobian_error(*images) for images in zip(estimated, true, mask, strict=True)]

    @property
    def _babble_frames(self) -> int:
        return max(1, round(self._episode_options.babble_seconds / FRAME_SECONDS))

    def _targets(self, targets: Any, seed: int) -> np.ndarray:
        worlds = self.world.shape[0]
        if isinstance(targets, (int, np.integer)) and not isinstance(targets, bool):
            if targets < 1:
                raise DenseVSError(f"targets is {targets}; expected at least 1")
            return reachable_targets(self.world, self.surface_point, int(targets), seed).reshape(worlds, -1, 2)
        places = np.asarray(targets, dtype=np.float64)
        if places.ndim != 3 or places.shape[0] != worlds or places.shape[2] != 2 or not np.isfinite(places).all():
            raise DenseVSError(f"targets have shape {places.shape}; expected finite ({worlds}, K, 2) or a whole number")
        return places

    def _allocate(self, options: JacobianOptions, flow: str, targets: np.ndarray, seed: int) -> None:
        world, device = self.world, self.device
        worlds, height, width = world.shape
        joints = options.joints
        threads = world.threads
        scene = world.scene
        # By each world's number, so that it is the same robot whoever has the worlds beside it.
        numbers = range(world.first_world, world.first_world + worlds)
        seeds = np.stack([np.random.default_rng([seed, 13, number]).integers(0, 2**31, 2) for number in numbers], 1)
        self.flow = BatchFlow(worlds, height, width, method=flow, device=device.alias, threads=threads)
        self.filter = JacobianFilter(options, device, threads, flow=self.flow.flow)
        self._renderer = GrayRenderer(
            self.flow.gray, scene.model, self.physics.model, self.physics.data, scene.camera, threads
        )
        window = self._tracker_options.window if self._tracker_options.method == "aligned" else None
        self.tracks = TrackedPoints.empty(worlds, 1, window, device)
        self.episode = EpisodeState.empty(targets, device)
        self.joint_positions = wp.zeros((worlds, joints), dtype=float, device=device)
        self.babbling = BabblingState.empty(seeds[0], joints, device)
        self._servo_seeds = wp.array(seeds[1], dtype=wp.uint32, device=device)
        self.servo_draws = wp.zeros(worlds, dtype=wp.uint32, device=device)
        self.restarting = wp.full(worlds, 1, dtype=int, device=device)
        self.unsound = wp.zeros(worlds, dtype=int, device=device)
        self._true_points = wp.zeros((worlds, 1), dtype=wp.vec2d, device=device)
        self._limits = limits_array(world.joint_limits, joints, device)
        self._columns = wp.array(scene.model.jnt_qposadr[scene.joint_ids], dtype=int, device=device)
        self._geoms = wp.array(self.surface_point.geoms, dtype=int, device=device)
        self._local = wp.array(self.surface_point.local, dtype=wp.vec3, device=device)
        kernels = self.filter.kernels
        self._weigh = surface_weight_kernels(joints, kernels.order, self.filter.layout).surface_weights
        self._weights = wp.full((worlds, height, width), 1.0, dtype=float, device=device)
        self._at_points = wp.zeros((worlds, 1), dtype=kernels.Jacobian, device=device)
        self._at_points_floats = seen_as(self._at_points, float, (worlds, 2, joints))

    @property
    def stages(self) -> dict[str, Callable[[], None]]:
        """The parts of a frame in order, by name; none reads from the device, each can be captured by itself."""
        return {
            "physics": self._move,
            "render": self._look,
            "flow": self._estimate_flow,
            "update": self._update_jacobian,
            "tracking": self._track,
            "command": self._command,
        }

    def _launch(self) -> None:
        with wp.ScopedDevice(self.device):
            for stage in self.stages.values():
                stage()

    def _move(self) -> None:
        self.world.step_on_device(self.restarting, self.unsound)

    def _look(self) -> None:
        self._renderer.render()
        data = self.physics.data
        fx, fy, cx, cy = (float(self.world.intrinsics[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        wp.launch(
            project_surface_points,
            dim=self.world.shape[0],
            inputs=[
                self._geoms,
                self._local,
                data.geom_xpos,
                data.geom_xmat,
                data.cam_xpos,
                data.cam_xmat,
                self.world.scene.camera,
                wp.vec4(fx, fy, cx, cy),
            ],
            outputs=[self._true_points],
        )

    def _estimate_flow(self) -> None:
        # J dq is where the search begins: what J knows, the flow need not find.
        joint_motion(self.physics.data.qpos, self._columns, self.restarting, self.joint_positions, self.filter.dq)
        self.filter.guess_flow(self.flow.guess, LONGEST_GUESS)
        wp.copy(self.flow.restarted, self.restarting)
        self.flow.update()

    def _update_jacobian(self) -> None:
        self.filter.forget(self.restarting)
        self.filter.advance_on_device()

    def _track(self) -> None:
        tracker, episode = self._tracker_options, self._episode_options
        carry_tracks(self.tracks, self.flow.flow, 1 if tracker.method == "paper" else 1 + FIXED_POINT_STEPS)
        locate_tracks(
            self.tracks,
            self.flow.gray,
            min_correlation=tracker.min_correlation,
            max_jump=tracker.max_jump,
            lost_after=int(np.ceil(tracker.lost_after)),
        )
        advance_episodes(
            self.episode,
            self.tracks.points,
            self.tracks.lost,
            self._true_points,
            self.restarting,
            babble_frames=self._babble_frames,
            tolerance=episode.tolerance,
            settle_frames=episode.settle_frames,
            max_frames=episode.max_frames,
        )
        # J at the points serves the definition of new ones and the servo law.
        now, kernels = self.filter.now, self.filter.kernels
        wp.launch(
            kernels.sample_points,
            dim=self._at_points.shape,
            inputs=[self.filter.state[now], self.filter.displacement[now], self.episode.point32],
            outputs=[self._at_points],
        )
        reach = tracker.window // 2 + 4  # the patch's samples take in a few pixels more
        side = 2 * reach + 1
        wp.launch(
            self._weigh,
            dim=(self.world.shape[0], side, side),
            inputs=[
                self.episode.defining,
                self.filter.state[now],
                self.filter.displacement[now],
                self.episode.point,
                self._at_points,
                reach,
                SAME_SURFACE,
            ],
            outputs=[self._weights],
        )
        begin_tracks(self.tracks, self.flow.gray, self._weights, self.episode.point, self.episode.defining)

    def _command(self) -> None:
        servo, babbling = self._servo_options, self._babbling_options
        steps = self.physics.joint_step
        steps.zero_()
        restart_babbling(self.babbling, self.restarting)
        watch_flow(self.babbling, self.flow.flow, max_flow=babbling.max_flow)
        babbling_steps(
            self.babbling,
            self.joint_positions,
            self._limits,
            self.episode.babbling,
            steps,
            amplitude=babbling.amplitude,
            time_constant=babbling.time_constant,
            frame_time=babbling.frame_time,
        )
        servo_steps(
            self._at_points_floats,
            self.episode.point_of_world,
            self.episode.target,
            self.joint_positions,
            self._limits,
            self.episode.reaching,
            self._servo_seeds,
            self.servo_draws,
            steps,
            gain=servo.gain,
            damping=servo.damping,
            max_step=servo.max_step,
            dither=servo.dither,
        )
        self.restarting.zero_()


def _bytes_per_world(options: JacobianOptions) -> int:
    """Memory of a world beside its simulation, about [bytes]: filter, flow, and 10 bytes a pixel of images."""
    return filter_bytes(options) + options.height * options.width * (BYTES_PER_PIXEL + 10)
