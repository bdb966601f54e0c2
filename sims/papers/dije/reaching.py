"""The reaching experiment: babble, learn J, bring a point of the body to targets; DIJE section V-B, Figs. 6 and 7.

The loop sees images and joint readings only. The simulator's truth chooses targets that can be reached and
measures the result.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.jacobian.error import JacobianError, jacobian_error
from dense_vs.point_servo.loop import ServoLoop
from dense_vs.point_servo.reach import Reach
from dense_vs.point_servo.tracker import sample
from dense_vs.robot.protocols import Camera
from dense_vs.sims.engine.adapters import SimCamera, SimRobot
from dense_vs.sims.engine.faults import FaultInjector
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.sims.engine.targets import reachable_targets
from dense_vs.sims.engine.world import SimWorld

STILL = 1e-3  # rad, m, of a joint in a frame: less is noise of its reading
RESTED, MOST_RESTING = 3, 45  # frames that it stands still, and that it is waited for
BACK, MOST_BACK = 0.01, 300  # rad, m, from the posture that it began in, and frames that the way there may take


@dataclass(frozen=True)
class MeasuredReach:
    """A reach with what only the simulator knows.

    Attributes:
        reach: as the loop saw it.
        true_error_px: distance of the surface point that was chosen from the target.
        jacobian: error of the dense J at the end of the reach.
        true_error_m: its distance in space from a target with depth [m]; NaN for one without.
    """

    reach: Reach
    true_error_px: float
    jacobian: JacobianError
    true_error_m: float = float("nan")


@dataclass
class Trace:
    """Record of every frame, from the first babbling step on; NaN where there is no point or target yet.

    Attributes:
        times: [s]; points, true_points, targets: ``(2,)`` each [px]; estimated, true: J at the point ``(2, N)``.
    """

    times: list[float] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    true_points: list[np.ndarray] = field(default_factory=list)
    targets: list[np.ndarray] = field(default_factory=list)
    estimated: list[np.ndarray] = field(default_factory=list)
    true: list[np.ndarray] = field(default_factory=list)


class ReachingExperiment:
    """One robot, one point, several targets.

    Args:
        world: of one robot.
        camera: of the world; one of color images alone unless given.
        point: site, body or geom of the model, or image point ``(2,)`` [px], that the surface point to control is
            seen at when the babbling is over. Pixels are those of the loop, whose images may be scaled, here and below.
        seed: of babbling, dither and targets.
        babble_seconds: time spent learning J first [s].
        command_seconds: time that the robot carries a command out in, see :class:`SimRobot`.
        scale: factor on the camera's images, as of :class:`ServoLoop`; one over a whole number.
        on_frame: called with the experiment after every frame.
        injector: camera and robot of the world, one of which may be at fault; sound ones unless given.
        traced: keep :attr:`trace`, whose truth takes longer than the loop.
        loop: options of :class:`ServoLoop`.
    """

    def __init__(
        self,
        world: SimWorld,
        *,
        point: Any = "tip",
        seed: int = 0,
        babble_seconds: float = 10.0,
        command_seconds: float = 0.0,
        scale: float = 1.0,
        on_frame: Callable[["ReachingExperiment"], None] | None = None,
        injector: FaultInjector | None = None,
        traced: bool = True,
        camera: Camera | None = None,
        **loop: Any,
    ):
        self.world = world
        self.babble_seconds = babble_seconds
        self.trace = Trace()
        self.surface_point: SurfacePoint | None = None
        if not 0 < scale <= 1 or not np.isclose(1 / scale, round(1 / scale)):
            raise DenseVSError(f"scale is {scale!r}; expected one over a whole number of at least 1")
        self.scale = scale
        self._point = point
        self._seed = seed
        self._on_frame = on_frame
        self._traced = traced
        self._injector = injector
        camera = camera or (SimCamera(world) if injector is None else injector)
        robot = SimRobot(world, command_seconds=command_seconds) if injector is None else injector
        self.loop = ServoLoop(camera, robot, seed=seed, scale=scale, on_frame=self._after_frame, **loop)
        self._began = self.loop.frame.positions

    def learn(self) -> JacobianError:
        """Babble, and return the error of J then."""
        self.loop.babble(self.babble_seconds)
        return self.jacobian_error()

    def choose(self, point: Any = None, **tracker: Any) -> np.ndarray:
        """Define the point to control at its present place, as a click in the image would; that place [px].

        The robot comes to rest first, unless the point is given as it is seen now: an image that waits for its joint
        readings shows where a moving robot was before. Where a point of the model has left the image meanwhile, or
        something that moves in another way covers it, the robot goes back to the posture that it began in.

        Args:
            point: another one than the constructor's; what has been learned stays.
            tracker: options of :class:`dense_vs.PointTracker`.
        """
        if point is not None:
            self._point = point
        if point is None or isinstance(point, str):
            self._come_to_rest()
        if isinstance(self._point, str) and not self._is_seen(self._point):
            self._go_back()
        pixel = self.project(self._point) if isinstance(self._point, str) else np.asarray(self._point, float)
        self.surface_point = self.world.track_point((pixel + 0.5) / self.scale - 0.5)
        self.loop.define_point(pixel, **tracker)
        return pixel

    def targets(self, count: int, **options: Any) -> np.ndarray:
        """Targets ``(count, 2)`` that the chosen point can reach, ``(count, 3)`` with ``depth=True``; options of
        :func:`reachable_targets`.
        """
        assert self.surface_point is not None
        for distance in ("least_distance", "border"):
            options[distance] = options.get(distance, 20.0) / self.scale
        targets = reachable_targets(self.world, self.surface_point, count, self._seed, **options)
        return np.concatenate([self._scaled(targets[:, :2]), targets[:, 2:]], axis=1)

    def project(self, point: str | SurfacePoint) -> np.ndarray:
        """Where a point truly is in the loop's images, ``(2,)`` [px]; see :meth:`SimWorld.project`.

        A camera that was bumped sees it elsewhere than the world's.
        """
        return self._scaled(np.asarray(self.world.project(point)) + self._shift())

    def reach(self, target: Any, **options: Any) -> MeasuredReach:
        """Servo to a target and measure; options of :meth:`ServoLoop.reach`."""
        assert self.surface_point is not None
        reach = self.loop.reach(target, **options)
        true_point = self.project(self.surface_point)
        true_error = float(np.hypot(*(true_point - reach.target[:2])))
        in_space = float("nan")
        if len(reach.target) == 3:
            in_space = float(np.linalg.norm(self.in_camera(self.surface_point) - self.seen_at(reach.target)))
        return MeasuredReach(reach, true_error, self.jacobian_error(), in_space)

    def in_camera(self, point: str | SurfacePoint) -> np.ndarray:
        """Where a point truly is before the camera, ``(3,)`` [m]; axes x right, y down, z forward."""
        pose = self.world.T_world_camera
        return pose[:3, :3].T @ (self.world.viewpoint.located(point, 0)[1] - pose[:3, 3])

    def seen_at(self, target: Any) -> np.ndarray:
        """Point ``(3,)`` [m] before the camera that a target ``(3,)`` [px, px, m] of the loop's images stands for."""
        x, y, depth = target
        pixel = (np.array([x, y]) + 0.5) / self.scale - 0.5
        return float(depth) * np.append(self.world.viewpoint.lens.directions(pixel), 1.0)

    def jacobian_error(self) -> JacobianError:
        """Error of the estimate now."""
        estimated = self.loop.estimator.to_numpy()
        return jacobian_error(estimated, *self.truth())

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """True J ``(H, W, 2, N)`` [px/rad] and the robot's pixels ``(H, W)`` in the loop's images, now.

        A pixel of a scaled image takes the mean J of those it covers, and is the robot's where all of them are.
        """
        jacobian, mask = self.world.true_jacobian(), self.world.robot_mask()
        columns, rows = self._shift()
        if columns or rows:
            jacobian, mask = (np.roll(truth, (rows, columns), axis=(0, 1)) for truth in (jacobian, mask))
        side = round(1 / self.scale)
        if side == 1:
            return jacobian, mask
        height, width = (length // side for length in mask.shape)
        squares = (height, side, width, side)
        whole = slice(height * side), slice(width * side)
        mean = jacobian[whole].reshape(*squares, *jacobian.shape[2:]).mean(axis=(1, 3))
        return mean * np.float32(self.scale), mask[whole].reshape(squares).min(axis=(1, 3))

    def _shift(self) -> np.ndarray:
        """Whole pixels ``(2,)`` by which the camera shows things elsewhere than the world's does."""
        return np.zeros(2, int) if self._injector is None else self._injector.shift

    def _come_to_rest(self) -> None:
        """Command nothing until the joints stand still."""
        still = 0
        for _ in range(MOST_RESTING):
            frame = self.loop.step(np.zeros(len(self.loop.group.names)))
            moves = frame.dq is None or np.abs(frame.dq).max() > STILL
            still = 0 if moves else still + 1
            if still == RESTED:
                break

    def _is_seen(self, point: str) -> bool:
        """Whether a point of the model is inside the loop's image now, and nothing that moves otherwise covers it."""
        height, width = self.loop.frame.gray.shape
        place = self.project(point)
        inside = bool((place >= 0).all() and (place <= (width - 1, height - 1)).all())
        return inside and self.world.viewpoint.shows(point, 0, self.world.shape[1:])

    def _go_back(self) -> None:
        """Go to the posture that it began in."""
        loop = self.loop

        def toward() -> np.ndarray:
            options = loop.servo.options
            return loop.group.step_toward(self._began, loop.joints.newest, options.max_step, min(options.gain, 1.0))

        for _ in range(MOST_BACK):
            loop.step(loop.when_due(toward))
            if np.abs(self._began - loop.joints.newest).max() < BACK:
                break
        self._come_to_rest()

    def _after_frame(self, loop: ServoLoop) -> None:
        if self._traced:
            self._note(loop)
        if self._on_frame is not None:
            self._on_frame(self)

    def _note(self, loop: ServoLoop) -> None:
        unknown = np.full(2, np.nan)
        trace = self.trace
        trace.times.append(loop.frame.time)
        if self.surface_point is None or loop.tracker is None:
            trace.points.append(unknown)
            trace.true_points.append(unknown)
            at = np.asarray(self.project(self._point) if isinstance(self._point, str) else self._point)
        else:
            trace.points.append(loop.point.copy())
            trace.true_points.append(self.project(self.surface_point))
            at = trace.true_points[-1]
        trace.targets.append(unknown if loop.target is None else loop.target[:2].copy())
        true = self.truth()[0]
        trace.true.append(sample(true.reshape(*true.shape[:2], -1), at[None])[0].reshape(true.shape[2:]))
        trace.estimated.append(loop.estimator.at(at)[0])

    def _scaled(self, pixels: np.ndarray) -> np.ndarray:
        # Pixel centers are whole numbers in both images.
        return pixels if self.scale == 1 else (pixels + 0.5) * self.scale - 0.5
