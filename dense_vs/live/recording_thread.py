"""Writes a recording beside the loop: the loop hands over an image and goes on, a thread of its own compresses it."""

import shutil
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path
from queue import Full, Queue

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.writers import open_writer

MOST_WAITING = 90  # images that wait for the writer, about 3 s; a disk or a processor too slow ends the recording


class RecordingThread:
    """Writes images and joint readings to a folder, then packs it into a zip file beside it.

    Args:
        folder: new folder of the recording.
        form: of :func:`open_writer`.
        joint_names: N names.
        fps: of the camera [Hz].
        on_error: called with the text of an error, once.

    Attributes:
        archive: the zip file; there once :attr:`done` is set.
        done: set when nothing is written any more.

    Raises:
        DenseVSError: a folder that cannot be written to, another format, or a library that is not installed.
    """

    def __init__(
        self, folder: Path, form: str, joint_names: tuple[str, ...], fps: float, on_error: Callable[[str], None]
    ):
        self.folder, self.archive = folder, folder.with_suffix(".zip")
        self.done = threading.Event()
        self.failed = False
        try:
            self._writer = open_writer(form, folder, joint_names, fps=fps)
        except ImportError as error:
            raise DenseVSError(f"recording needs {error.name}; pip install 'dense-vs[recordings]'") from error
        self._on_error = on_error
        self._queue: Queue[tuple[np.ndarray, float, np.ndarray, float] | None] = Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write, name="live recording", daemon=True)
        self._thread.start()

    def add(self, image: np.ndarray, time: float, positions: np.ndarray, stamp: float) -> None:
        """Hand over an image and a joint reading; returns at once."""
        try:
            self._queue.put_nowait((image, time, np.array(positions, dtype=np.float64), stamp))
        except Full:
            self._fail("the recording ended: writing it is slower than the camera")

    def finish(self, timeout: float = 30.0) -> None:
        """Complete the files; waits for that up to ``timeout`` [s]."""
        self.close()
        self.done.wait(timeout)

    def close(self) -> None:
        """Complete the files once all that waits is written; returns soon, :attr:`done` says when."""
        try:
            self._queue.put(None, timeout=1.0)
        except Full:
            self._fail("the recording ended: writing it is slower than the camera")

    def _write(self) -> None:
        try:
            while (item := self._queue.get()) is not None and not self.failed:
                image, time, positions, stamp = item
                if np.isfinite(positions).all() and np.isfinite(stamp):  # what an encoder cannot tell is no reading
                    self._writer.add_joints(positions, stamp)
                rgb = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
                self._writer.add_image(rgb, time)
            if self.failed:
                self._writer.abort()
            else:
                self._writer.close()
                self._pack()
        except Exception as error:  # whatever a codec or a disk raises, the robot's loop goes on
            self._fail(f"the recording ended: {error}")
        finally:
            self.done.set()

    def _pack(self) -> None:
        with zipfile.ZipFile(self.archive, "w", zipfile.ZIP_STORED) as archive:
            for file in sorted(self.folder.rglob("*")):
                if file.is_file():
                    archive.write(file, file.relative_to(self.folder.parent))

    def _fail(self, text: str) -> None:
        if not self.failed:
            self.failed = True
            self._on_error(text)


def new_folder(parent: Path) -> Path:
    """A folder name in ``parent`` that is not taken: recording_001 and on."""
    number = 1
    while (folder := parent / f"recording_{number:03d}").exists() or folder.with_suffix(".zip").exists():
        number += 1
    return folder


def room_left(parent: Path) -> int:
    """Bytes that are free where recordings go."""
    return shutil.disk_usage(parent).free
