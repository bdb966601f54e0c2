"""LeRobot v3.0 datasets out: a parquet file and a video an episode, and the metadata that names them.

LeRobot knows no time stamps but multiples of 1 / fps, so each image is stored with the joints at its own stamp,
interpolated between the readings around it.
"""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, output_folder
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.joint_readings import JointReadings
from dense_vs.recording.lerobot_folder import PATHS, STATE
from dense_vs.recording.video_writer import FASTEST, MOST_QUALITY, VideoWriter
from dense_vs.recording.writer_checks import check_open, recorded_names, recorded_text
from dense_vs.robot.camera_image import check_rgb

CHUNK = 1000  # files in a folder


class LeRobotWriter:
    """A :class:`~dense_vs.recording.RecordingWriter` of one camera.

    Args:
        folder: of the dataset, made here.
        joint_names: N names.
        fps: images a second, a whole number [Hz].
        quality: of :class:`VideoWriter`.
        camera: its name; the feature is ``observation.images.CAMERA``.
        task: what the robot does, in words.
        robot: its kind.

    Raises:
        DenseVSError: pyarrow is not installed, a frame rate that LeRobot does not take, or names or words that cannot
            be stored.
    """

    def __init__(
        self,
        folder: Path,
        joint_names: tuple[str, ...],
        *,
        fps: float = 30.0,
        quality: int = 12,
        camera: str = "camera",
        task: str = "move",
        robot: str = "unknown",
    ):
        try:
            importlib.import_module("pyarrow")
        except ImportError as error:
            raise DenseVSError(
                "writing LeRobot datasets needs pyarrow, which is not installed; pip install 'dense-vs[recordings]'"
            ) from error
        fps = check_number("fps", fps, above=0, most=FASTEST)
        check_whole("quality", quality, least=0, most=MOST_QUALITY)
        if round(fps) < 1 or abs(fps - round(fps)) > 0.01 * fps:
            raise DenseVSError(f"fps is {fps!r}; a LeRobot dataset expects a whole number of at least 1")
        self._folder, self._names, self._fps = folder, recorded_names(joint_names), round(fps)
        for name, text in (("camera", camera), ("task", task), ("robot", robot)):
            recorded_text(name, text)
        self._quality, self._task, self._robot = quality, task, robot
        self._camera = f"observation.images.{camera}"
        self._size: tuple[int, int] | None = None
        self._rows: list[dict[str, Any]] = []
        self._all_joints: list[np.ndarray] = []
        self._frames = 0
        self._closed = False
        self._begin()

    def add_image(self, image: np.ndarray, time: float) -> None:
        """Add an image; odd sides are cut by a pixel."""
        check_open(self._closed, self._folder)
        image = check_rgb(image, "frame", least=2)
        time = check_number("image time stamp", time)
        if self._video is None:
            video = self._path(PATHS["v3"][1])
            output_folder(video.parent)
            self._video = VideoWriter(video, self._fps, quality=self._quality)
        self._video.write(image)
        self._size = image.shape[0] - image.shape[0] % 2, image.shape[1] - image.shape[1] % 2
        self._stamps.append(time)

    def add_joints(self, positions: np.ndarray, time: float) -> None:
        """Add a reading; one that is not newer than the last is the same reading again."""
        check_open(self._closed, self._folder)
        self._joints.add(positions, time)

    def end_episode(self) -> None:
        """Complete an episode; what comes next is another one.

        Raises:
            DenseVSError: no image, or fewer than two joint readings.
        """
        import pyarrow as pa

        if self._video is None or len(self._joints) < 2:
            raise DenseVSError(
                f"episode has {len(self._stamps)} images and {len(self._joints)} joint readings; expected at least 1 "
                "and 2"
            )
        self._video.__exit__(None)
        log = JointLog(self._names, np.array(self._joints.times), np.array(self._joints.positions))
        joints = log.at(np.clip(self._stamps, log.times[0], log.times[-1])).astype(np.float32)
        count, episode = len(joints), len(self._rows)
        index = np.arange(count)
        columns = {
            STATE: pa.FixedSizeListArray.from_arrays(pa.array(joints.ravel()), joints.shape[1]),
            # The state that follows is what a position-controlled robot was told.
            "action": pa.FixedSizeListArray.from_arrays(
                pa.array(joints[np.minimum(index + 1, count - 1)].ravel()), joints.shape[1]
            ),
            "timestamp": pa.array((index / self._fps).astype(np.float32)),
            "frame_index": pa.array(index),
            "episode_index": pa.array(np.full(count, episode)),
            "index": pa.array(index + self._frames),
            "task_index": pa.array(np.zeros(count, dtype=np.int64)),
        }
        data = self._path(PATHS["v3"][0])
        output_folder(data.parent)
        _write_parquet(data, pa.table(columns))
        self._rows.append(self._row(episode, count))
        self._frames += count
        self._all_joints.append(joints)
        self._begin()
        self._write_meta()

    def close(self) -> None:
        """Complete the last episode and the metadata."""
        if self._closed:
            return
        try:
            if self._stamps or not self._rows:
                self.end_episode()
        finally:
            self.abort()  # an episode that could not be completed

    def abort(self) -> None:
        """Leave out the episode that is not complete."""
        self._closed = True
        if self._video is not None:
            self._video.__exit__(KeyboardInterrupt)
        self._begin()

    def _begin(self) -> None:
        self._video: VideoWriter | None = None
        self._stamps: list[float] = []
        self._joints = JointReadings(self._names)

    def _path(self, template: str) -> Path:
        chunk, file = divmod(len(self._rows), CHUNK)
        return self._folder / template.format(chunk_index=chunk, file_index=file, video_key=self._camera)

    def _row(self, episode: int, count: int) -> dict[str, Any]:
        chunk, file = divmod(episode, CHUNK)
        video = f"videos/{self._camera}"
        return {
            "episode_index": episode,
            "tasks": [self._task],
            "length": count,
            "data/chunk_index": chunk,
            "data/file_index": file,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + count,
            f"{video}/chunk_index": chunk,
            f"{video}/file_index": file,
            f"{video}/from_timestamp": 0.0,
            f"{video}/to_timestamp": count / self._fps,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }

    def _write_meta(self) -> None:
        import pyarrow as pa

        assert self._size is not None  # an episode has images
        vector = {"dtype": "float32", "shape": [len(self._names)], "names": list(self._names)}
        numbers = {name: {"dtype": "int64", "shape": [1], "names": None} for name in _INDICES}
        video = {
            "video.height": self._size[0],
            "video.width": self._size[1],
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": self._fps,
            "video.channels": 3,
            "has_audio": False,
        }
        image = {"dtype": "video", "shape": [*self._size, 3], "names": ["height", "width", "channels"], "info": video}
        info = {
            "codebase_version": "v3.0",
            "robot_type": self._robot,
            "total_episodes": len(self._rows),
            "total_frames": self._frames,
            "total_tasks": 1,
            "chunks_size": CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 500,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._rows)}"},
            "data_path": PATHS["v3"][0],
            "video_path": PATHS["v3"][1],
            "features": {
                STATE: vector,
                "action": vector,
                self._camera: image,
                "timestamp": {"dtype": "float32", "shape": [1], "names": None},
                **numbers,
            },
        }
        meta = output_folder(self._folder / "meta")
        output_folder(meta / "episodes" / "chunk-000")
        _write_parquet(meta / "episodes" / "chunk-000" / "file-000.parquet", pa.Table.from_pylist(self._rows))
        tasks = pa.table({"task_index": pa.array([0]), "task": pa.array([self._task])})
        _write_parquet(meta / "tasks.parquet", tasks.replace_schema_metadata({"pandas": json.dumps(_TASK_INDEX)}))
        joints = np.concatenate(self._all_joints)
        statistics = {
            "min": joints.min(axis=0),
            "max": joints.max(axis=0),
            "mean": joints.mean(axis=0),
            "std": joints.std(axis=0),
        }
        plain = {name: [float(x) for x in values] for name, values in statistics.items()} | {"count": [len(joints)]}
        _write_json(meta / "stats.json", {STATE: plain, "action": plain})
        _write_json(meta / "info.json", info)  # last: a folder without it is no dataset


_INDICES = ("frame_index", "episode_index", "index", "task_index")
# Tells pandas that the task's words are the rows' names, as lerobot expects.
_TASK_INDEX = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}
        for name, kind, stored in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
    "pandas_version": "2.0.0",
}


def _write_parquet(path: Path, table: Any) -> None:
    import pyarrow.parquet as pq

    with atomic_write(path) as stream:
        pq.write_table(table, stream)


def _write_json(path: Path, content: Any) -> None:
    with atomic_write(path, "w") as stream:
        json.dump(content, stream, indent=4)
