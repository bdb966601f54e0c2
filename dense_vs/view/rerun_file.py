"""An estimate from a recording as a file of the Rerun viewer (``rerun estimate.rrd``): images, labels, J and curves."""

import os
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.pipeline.recorded import RecordedEstimate
from dense_vs.view.panels import as_rgb, vectors_to_rgb

FLOW_SCALE = 4.0  # px a frame, of full brightness
JPEG_QUALITY = 90
APPLICATION = "dense-vs estimate"


def require_rerun() -> Any:
    """Rerun's module.

    Raises:
        DenseVSError: it is not installed.
    """
    try:
        return import_module("rerun")
    except ImportError as error:
        raise DenseVSError("an .rrd file needs Rerun, which is not installed; pip install 'dense-vs[rerun]'") from error


class RerunFile:
    """Writes an .rrd file frame by frame; use as a context manager.

    Entities: ``camera`` and in it ``own`` (labels, where the estimate has them); ``flow``; ``jacobian/JOINT`` [px a
    usual step of the joint], hue is the direction; ``joints/JOINT`` in the joint's own unit; ``explained_motion``. All
    on the timeline ``time`` [s] of the camera's clock. Images are JPEG. The file takes its name when it is complete; an
    error leaves none.

    Args:
        path: of the file.
        done: the estimate that the frames come from.

    Raises:
        DenseVSError: Rerun is not installed, or the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], done: RecordedEstimate):
        rerun = require_rerun()
        self.path = Path(path)
        check_writable(self.path)
        self._partial = self.path.with_name(f".{self.path.name}.partial")
        self._done, self._rerun = done, rerun
        names = done.episode.log.names
        self._columns = [rerun.new_entity_path(["jacobian", name]) for name in names]
        self._joints = [rerun.new_entity_path(["joints", name]) for name in names]
        self._stream: Any = rerun.RecordingStream(APPLICATION)
        self._stream.save(self._partial)

    def add(self, frame: ProcessedFrame, estimator: DenseJacobian) -> None:
        """Add a frame and the estimator after it."""
        rerun, stream, done = self._rerun, self._stream, self._done
        stream.set_time("time", duration=frame.time)
        self._log_image("camera", as_rgb(frame.image))
        for path, position in zip(self._joints, frame.positions, strict=True):
            stream.log(path, rerun.Scalars(position))
        if frame.flow is None:
            return
        self._log_image("flow", vectors_to_rgb(frame.flow, FLOW_SCALE))
        if done.labeled:
            stream.log("camera/own", rerun.SegmentationImage(done.labels().astype(np.uint8), opacity=0.4))
        usual = done.usual_step
        J = np.nan_to_num(estimator.to_numpy())
        for n, path in enumerate(self._columns):
            self._log_image(path, vectors_to_rgb(J[..., n] * usual[n], FLOW_SCALE))

    def close(self) -> None:
        """Add how much of the motion was explained, and finish the file.

        Raises:
            DenseVSError: the disk is full; no file is left.
        """
        for time, share in zip(*self._done.explained.over_time(), strict=True):
            self._stream.set_time("time", duration=time)
            self._stream.log("explained_motion", self._rerun.Scalars(share))
        try:
            end_stream(self._stream, self.path)
            os.replace(self._partial, self.path)
        except BaseException:
            self._partial.unlink(missing_ok=True)
            raise

    def __enter__(self) -> "RerunFile":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            with suppress(DenseVSError):  # what has gone wrong already is what is to be heard of
                end_stream(self._stream, self.path)
            self._partial.unlink(missing_ok=True)

    def _log_image(self, path: str, rgb: np.ndarray) -> None:
        self._stream.log(path, self._rerun.Image(rgb).compress(jpeg_quality=JPEG_QUALITY))


def end_stream(stream: Any, path: str | os.PathLike[str]) -> None:
    """Finish one of Rerun's streams, which is to become a file.

    Raises:
        DenseVSError: what was still to be written cannot be.
    """
    try:
        stream.flush()
    except Exception as error:  # whatever Rerun raises
        raise DenseVSError(f"cannot write {path}: {error}") from error
    finally:
        stream.disconnect()
