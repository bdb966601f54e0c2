"""The estimator on a whole recording."""

from collections.abc import Iterator
from typing import Any

from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
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
        device, threads, options: of :class:`DenseJacobian`.

    Raises:
        DenseVSError: bad options, at the call; fewer than two frames within the log, at the end.
    """
    if not 0 < scale <= 1:
        raise DenseVSError(f"scale is {scale}; expected a number above 0 and at most 1")
    height, width = scaled_size((recording.video.height, recording.video.width), scale)
    options.setdefault("on_bad_flow", "skip")
    estimator = DenseJacobian(
        height=height, width=width, joints=len(recording.log.names), device=device, threads=threads, **options
    )
    pipeline = FramePipeline(estimator, FlowEstimator(method, height, width), scale=scale)
    return ((pipeline.process(*frame), estimator) for frame in recording)
