"""The estimator on a recorded episode: repeated images joined, gaps left out, decoding beside the filter."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.explained_motion import ExplainedMotion
from dense_vs.pipeline.frame_pipeline import Frame, FramePipeline, scaled_size
from dense_vs.recording import ClockOffset, Episode, Recording, RepetitionFilter
from dense_vs.recording import Frame as RecordedFrame
from dense_vs.recording.prefetch import prefetch
from dense_vs.recording.survey import is_gap


class RecordedEstimate:
    """Iterates over an episode: every image that brings new motion, and the estimator after it.

    Args:
        episode: images and joints on one clock.
        scale: factor on the image size.
        method: of :class:`FlowEstimator`.
        device, threads, options: of :class:`DenseJacobian`.
        start: an estimator to go on with, made here unless given.

    Attributes:
        estimator: the estimator.
        explained: how much of the motion it explains so far.
        images: images within the joint log so far.
        repeated: images among them that repeated the one before; their joint steps go with the next image.
        gaps: places at which images are missing, over which nothing is learned.
        last_frame: the last one, None before the first.

    Raises:
        DenseVSError: bad options, or a start that does not fit.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        scale: float = 1.0,
        method: str = "dis",
        device: str = "auto",
        threads: int | None = None,
        start: DenseJacobian | None = None,
        **options: Any,
    ):
        if not 0 < scale <= 1:
            raise DenseVSError(f"scale is {scale}; expected a number above 0 and at most 1")
        images = episode.images()
        episode.check_overlap(images)
        height, width = scaled_size((images.height, images.width), scale)
        self.frame_count, self.fps = images.frame_count, images.fps
        joints = len(episode.log.names)
        if start is None:
            options.setdefault("on_bad_flow", "skip")
            start = DenseJacobian(height=height, width=width, joints=joints, device=device, threads=threads, **options)
        has = start.options
        if (has.height, has.width, has.joints, has.worlds) != (height, width, joints, 1):
            raise DenseVSError(
                f"start is of {has.width} x {has.height} px and {has.joints} joints; expected {width} x {height} px "
                f"and {joints} joints as the recording has"
            )
        self.episode, self.estimator = episode, start
        self.explained = ExplainedMotion(joints)
        self._repetition = RepetitionFilter()
        self.images = self.gaps = 0
        self.last_frame: Frame | None = None
        self._squared_steps, self._steps = np.zeros(joints), 0
        self._pipeline = FramePipeline(
            start, FlowEstimator(method, height, width), scale=scale, before_update=self._judge
        )

    def align(self, offset: float | ClockOffset) -> None:
        """Move the joint log onto the camera's clock, before the first frame; see :meth:`Episode.shifted`."""
        self.episode = self.episode.shifted(offset)

    @property
    def repeated(self) -> int:
        """Images so far that repeated the one before."""
        return self._repetition.repeated

    @property
    def usual_step(self) -> np.ndarray:
        """Root mean square joint step between images ``(N,)``, in the joints' own units."""
        return np.sqrt(self._squared_steps / max(self._steps, 1))

    def __iter__(self) -> Iterator[tuple[Frame, DenseJacobian]]:
        """Frames and the estimator.

        Raises:
            DenseVSError: fewer than two images within the log, or a damaged file, at that point.
        """
        for recorded, gap in prefetch(self._distinct()):
            if gap:
                self._pipeline.restart()
            self.last_frame = self._pipeline.process(recorded.image, recorded.time, recorded.joints)
            yield self.last_frame, self.estimator

    def _distinct(self) -> Iterator[tuple[RecordedFrame, bool]]:
        """Images that are no repetition, and whether images are missing before them; runs on the reading thread."""
        last, gap = None, False
        for recorded in self.episode:
            self.images += 1
            if last is not None and is_gap(recorded.time - last, 1 / self.fps):
                self._repetition.restart()
                self.gaps += 1
                gap = True
            last = recorded.time
            if self._repetition.keep(cv2.cvtColor(recorded.image, cv2.COLOR_RGB2GRAY)):
                yield recorded, gap
                gap = False

    def _judge(self, time: float, flow: Any, dq: Any) -> None:
        self.explained.observe(time, flow, self.estimator.to_numpy(), dq)
        self._squared_steps += np.square(dq)
        self._steps += 1


def estimate_recording(recording: Episode | Recording, **options: Any) -> RecordedEstimate:
    """The estimator on an episode, or on the chosen one of a recording, see :class:`RecordedEstimate`."""
    return RecordedEstimate(recording.episode() if isinstance(recording, Recording) else recording, **options)
