"""The estimator on a whole recording."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.excitation import Excitation, excitation
from dense_vs.jacobian.options import MAX_JOINTS_DEFAULT_ORDER_2, STANDARD_STEP, recorded_options
from dense_vs.pipeline.frame_pipeline import Frame, FramePipeline, scaled_size
from dense_vs.recording.video_recording import Recording


def estimate_recording(
    recording: Recording,
    *,
    scale: float = 1.0,
    method: str = "dis",
    device: str = "auto",
    threads: int | None = None,
    **options: Any,
) -> Iterator[tuple[Frame, DenseJacobian]]:
    """Run the estimator over a recording; yields every frame within the log and the estimator after it.

    Args:
        recording: images, times and joints.
        scale: factor on the image size.
        method: of :class:`FlowEstimator`.
        device, threads, options: of :class:`DenseJacobian`; those of :func:`recorded_options` and ``joint_scale``
            where they are not given. Joints that hardly move are left out; the others' units do not matter from 7
            joints on, and are rad (m) below unless ``joint_scale`` says otherwise.

    Raises:
        DenseVSError: bad options, at the call; fewer than two frames within the log, at the end.
    """
    if not 0 < scale <= 1:
        raise DenseVSError(f"scale is {scale}; expected a number above 0 and at most 1")
    height, width = scaled_size((recording.video.height, recording.video.width), scale)
    options.setdefault("on_bad_flow", "skip")
    joints = len(recording.log.names)
    if options.get("covariance", "shared") == "shared":
        options = recorded_options(joints) | options
        if "joint_scale" not in options:
            typical = recorded_excitation(recording).scale
            if joints <= MAX_JOINTS_DEFAULT_ORDER_2:
                # The Hessian's prior holds in rad: from a slow log's own steps it would be many times too wide.
                typical = np.where(typical > 0, STANDARD_STEP, 0.0)
            options["joint_scale"] = typical
    estimator = DenseJacobian(height=height, width=width, joints=joints, device=device, threads=threads, **options)
    pipeline = FramePipeline(estimator, FlowEstimator(method, height, width), scale=scale)
    return ((pipeline.process(*frame), estimator) for frame in recording)


def recorded_excitation(recording: Recording) -> Excitation:
    """How well a recording's log shows each joint, at the rate of its images."""
    log = recording.log
    count = max(3, int((log.times[-1] - log.times[0]) * recording.video.fps) + 1)
    return excitation(log.at(np.linspace(log.times[0], log.times[-1], count)), log.names)
