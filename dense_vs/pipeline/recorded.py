"""The estimator on a recorded episode: repeated images joined, gaps left out, decoding beside the filter."""

from collections.abc import Callable, Iterator
from typing import Any, Unpack

import numpy as np

from dense_vs.body.self_body import SelfBody
from dense_vs.checks import check_flag, check_number
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.excitation import Excitation, excitation
from dense_vs.jacobian.options import (
    MAX_JOINTS_DEFAULT_ORDER_2,
    STANDARD_SPREAD,
    STANDARD_STEP,
    EstimatorOptions,
    recorded_options,
)
from dense_vs.pipeline.body_prior import BodyPrior
from dense_vs.pipeline.camera_sway import CameraSway
from dense_vs.pipeline.explained_motion import ExplainedMotion
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame, scaled_size
from dense_vs.recording import ClockOffset, Episode, Recording
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.recording.prefetch import prefetch
from dense_vs.recording.survey import joint_motions

# Found on three reaches of a humanoid (``profiling/real_robot.py``): 0.03 to 0.07 s do alike.
JOINT_SMOOTHING = 0.065  # s
LABELED_WIDTH = 320  # px, about, of the images that labels are found in
STILL_NOISES = 5.0  # standard deviations of its readings that a joint at rest stays within from image to image


class RecordedEstimate:
    """Iterates over an episode: every image that brings new motion, and the estimator after it.

    Args:
        episode: images and joints on one clock.
        scale: factor on the image size.
        method: of :class:`FlowEstimator`. ``"dis-medium"`` unless given: on a real robot's compressed and blurred
            images a J learned from it explains more of the motion than one from ``"dis"``, whichever of the two
            measures it. On simulated, richly textured arms ``"dis"`` is nearer to the true J.
        smoothing: standard deviation of the Gaussian that smooths the joints over time where repeated images show that
            the stamps are the recorder's [s], see :meth:`JointLog.smoothed`; 0 takes them as logged. Elsewhere they
            are taken as logged.
        device, threads, estimator_options: of :class:`DenseJacobian`, whose help has their units and defaults; those of
            :func:`recorded_options` and ``joint_scale`` where they are not given. Joints that hardly move are left out;
            the others' units do not matter. ``on_bad_flow`` is ``"skip"`` unless given.
        start: an estimator to go on with, made here unless given.
        prior: what a body model knows of J from the first image on.
        label: whether to label the robot's own pixels, see :meth:`labels`.
        before_update: called with each frame's time, flow and joint step while ``estimator`` is still that of the frame
            before; a judge of its prediction beside ``explained``.
        sway: whether the camera may sway, see :class:`FramePipeline`. J is then nearer to what the joints do; it
            foretells less of the image's whole motion, the sway's part of it being gone.

    Attributes:
        estimator: the estimator.
        explained: how much of the motion it explains so far.
        labeled: whether there are labels.
        excitation: how well the log shows each joint.
        last_frame: the last one, None before the first.

    Raises:
        DenseVSError: bad options, or a start that does not fit.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        scale: float = 1.0,
        method: str = "dis-medium",
        smoothing: float = JOINT_SMOOTHING,
        device: str = "auto",
        threads: int | None = None,
        start: DenseJacobian | None = None,
        prior: BodyPrior | None = None,
        label: bool = False,
        before_update: Callable[[float, np.ndarray, np.ndarray], None] | None = None,
        sway: bool = False,
        **estimator_options: Unpack[EstimatorOptions],
    ):
        check_number("scale", scale, above=0, most=1)
        images = episode.images()
        episode.check_overlap(images)
        height, width = scaled_size((images.height, images.width), scale)
        self.frame_count, self.fps = images.frame_count, images.fps
        joints = len(episode.log.names)
        self._smoothing = check_number("smoothing", smoothing, least=0)
        self.excitation = recorded_excitation(episode, self.fps)
        if start is None:
            options = _recorded_defaults(joints, self.excitation, estimator_options)
            start = DenseJacobian(height=height, width=width, joints=joints, device=device, threads=threads, **options)
        has = start.options
        if (has.height, has.width, has.joints, has.worlds) != (height, width, joints, 1):
            raise DenseVSError(
                f"start is of {has.width} x {has.height} px and {has.joints} joints; expected {width} x {height} px "
                f"and {joints} joints as the recording has"
            )
        self.episode, self.estimator = episode, start
        self.explained = ExplainedMotion(joints)
        self._distinct = DistinctImages((), self.fps)
        self.last_frame: ProcessedFrame | None = None
        self._squared_steps, self._steps = np.zeros(joints), 0
        self._before_update = before_update
        body = None
        self.labeled = check_flag("label", label)
        if self.labeled:
            # By how far joints go, which repeated images do not change.
            body = SelfBody(joint_scale=_scale_by_spread(self.excitation), device=device, threads=threads)
        self._pipeline = FramePipeline(
            start,
            FlowEstimator(method, height, width),
            scale=scale,
            body=body,
            baseline=0.0,
            still=self._still_steps(),
            before_update=self._judge,
            prior=prior,
            sway=sway,
            body_step=max(1, round(width / LABELED_WIDTH)),
        )

    def align(self, offset: float | ClockOffset) -> None:
        """Move the joint log onto the camera's clock, before the first frame; see :meth:`Episode.shifted`."""
        self.episode = self.episode.shifted(offset)

    def begin_with(self, prior: BodyPrior) -> None:
        """Take another prior than the one given, before the first frame, as of a body once the clocks are one."""
        self._pipeline.prior = prior

    def labels(self) -> np.ndarray:
        """Whether each pixel of the last frame is the robot's own body, bool ``(H, W)``.

        Raises:
            DenseVSError: made without ``label``.
        """
        return self._pipeline.labels()

    @property
    def camera_sway(self) -> CameraSway | None:
        """What is known of the camera's own motion; None without ``sway``."""
        return self._pipeline.camera_sway

    @property
    def images(self) -> int:
        """Images within the joint log so far."""
        return self._distinct.images

    @property
    def repeated(self) -> int:
        """Images among them that repeat the one before; their joint steps go with the next image."""
        return self._distinct.repeated

    @property
    def gaps(self) -> int:
        """Places at which images are missing, over which nothing is learned."""
        return len(self._distinct.gaps)

    @property
    def usual_step(self) -> np.ndarray:
        """Root mean square joint step between images ``(N,)``, in the joints' own units."""
        return np.sqrt(self._squared_steps / max(self._steps, 1))

    def __iter__(self) -> Iterator[tuple[ProcessedFrame, DenseJacobian]]:
        """Frames and the estimator.

        Raises:
            DenseVSError: fewer than two images within the log, or a damaged file, at that point.
        """
        stamped = ((frame.image, frame.time) for frame in self.episode)
        self._distinct = DistinctImages(stamped, self.fps)
        log = self.episode.log
        smooth = log.smoothed(self._smoothing)
        for found in prefetch(self._distinct):
            if found.after_gap:
                self._pipeline.restart()
            joints = (smooth if found.evened else log).at(np.clip([found.time], log.times[0], log.times[-1]))[0]
            self.last_frame = self._pipeline.process(found.image, found.time, joints)
            yield self.last_frame, self.estimator

    def _still_steps(self) -> np.ndarray:
        """Joint steps ``(N,)`` that noise alone makes; joints that are left out may do what they like."""
        noise = np.array([joint.noise for joint in joint_motions(self.episode.log)])
        return np.where(self.excitation.learned, STILL_NOISES * noise, np.finfo(np.float64).max)

    def _judge(self, time: float, flow: Any, dq: Any) -> None:
        if self._before_update is not None:
            self._before_update(time, flow, dq)
        self.explained.observe(time, flow, self.estimator.to_numpy(), dq)
        self._squared_steps += np.square(dq)
        self._steps += 1


def estimate_recording(
    recording: Episode | Recording,
    *,
    scale: float = 1.0,
    method: str = "dis-medium",
    smoothing: float = JOINT_SMOOTHING,
    device: str = "auto",
    threads: int | None = None,
    start: DenseJacobian | None = None,
    prior: BodyPrior | None = None,
    label: bool = False,
    before_update: Callable[[float, np.ndarray, np.ndarray], None] | None = None,
    sway: bool = False,
    **estimator_options: Unpack[EstimatorOptions],
) -> RecordedEstimate:
    """The estimator on an episode, or on the chosen one of a recording; arguments as of :class:`RecordedEstimate`.

    Raises:
        DenseVSError: bad options, or a start that does not fit.
    """
    return RecordedEstimate(
        recording.episode() if isinstance(recording, Recording) else recording,
        scale=scale,
        method=method,
        smoothing=smoothing,
        device=device,
        threads=threads,
        start=start,
        prior=prior,
        label=label,
        before_update=before_update,
        sway=sway,
        **estimator_options,
    )


def recorded_excitation(episode: Episode, fps: float) -> Excitation:
    """How well an episode's log shows each joint, at the rate of its images."""
    log = episode.log
    count = max(3, int((log.times[-1] - log.times[0]) * fps) + 1)
    return excitation(log.at(np.linspace(log.times[0], log.times[-1], count)), log.names)


def _scale_by_spread(seen: Excitation) -> np.ndarray:
    """Typical steps ``(N,)`` at the pace of the standard babbling, of joints that go as far as these; 0 if left out."""
    return np.where(seen.learned, STANDARD_STEP / STANDARD_SPREAD * seen.spread, 0.0)


def _recorded_defaults(joints: int, seen: Excitation, given: EstimatorOptions) -> EstimatorOptions:
    """Options of the estimator for a recording: those given, else what real recordings need."""
    options: EstimatorOptions = {"on_bad_flow": "skip", **given}
    if options.get("covariance", "shared") == "shared":
        options = {**recorded_options(joints), **options}
        if "joint_scale" not in options:
            typical = seen.scale
            if joints <= MAX_JOINTS_DEFAULT_ORDER_2:
                # The Hessian's prior says how much J changes over a posture's range, however fast that is gone through:
                # from a slow log's own steps it would be many times too wide.
                typical = _scale_by_spread(seen)
            options["joint_scale"] = tuple(typical)
    return options
