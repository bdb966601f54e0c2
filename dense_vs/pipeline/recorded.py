"""The estimator on a whole recording."""

from collections.abc import Iterator
from typing import Unpack

from dense_vs.checks import check_number
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.options import EstimatorOptions
from dense_vs.pipeline.frame_pipeline import Frame, FramePipeline, scaled_size
from dense_vs.recording.video_recording import Recording


def estimate_recording(
    recording: Recording,
    *,
    scale: float = 1.0,
    method: str = "dis",
    device: str = "auto",
    threads: int | None = None,
    **estimator_options: Unpack[EstimatorOptions],
) -> Iterator[tuple[Frame, DenseJacobian]]:
    """Run the estimator over a recording; yields every frame within the log and the estimator after it.

    Args:
        recording: images, times and joints.
        scale: factor on the image size.
        method: of :class:`FlowEstimator`.
        device, threads, estimator_options: of :class:`DenseJacobian`, whose help has their units and defaults;
            ``on_bad_flow`` is ``"skip"`` unless given.

    Raises:
        DenseVSError: bad options, at the call; fewer than two frames within the log, at the end.
    """
    check_number("scale", scale, above=0, most=1)
    height, width = scaled_size((recording.video.height, recording.video.width), scale)
    options: EstimatorOptions = {"on_bad_flow": "skip", **estimator_options}
    estimator = DenseJacobian(
        height=height, width=width, joints=len(recording.log.names), device=device, threads=threads, **options
    )
    pipeline = FramePipeline(estimator, FlowEstimator(method, height, width), scale=scale)
    return ((pipeline.process(*frame), estimator) for frame in recording)
