"""LeRobot datasets v2.0, v2.1 and v3.0, read with pyarrow and PyAV, without the lerobot package.

``meta/info.json`` names the features and where their files are. In v2 each episode is a parquet file and a video a
camera; in v3 files hold many episodes, and ``meta/episodes/`` says which rows and which part of a video belong to one.
A partial download works for the episodes whose files are there.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from string import Formatter
from typing import Any

import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.files import MOST_JSON, file_path, input_file, parse_json, read_json
from dense_vs.recording.frame import ImageStream
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.parquet_columns import ParquetColumns
from dense_vs.recording.stored_image import read_image
from dense_vs.recording.video_reader import VideoReader

VERSIONS = ("v2.0", "v2.1", "v3.0")
PATHS = {  # where a version keeps its files, unless info.json says otherwise: data, video
    "v2": (
        "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    ),
    "v3": (
        "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    ),
}
STATE = "observation.state"
MAX_EPISODES = 1_000_000


class LeRobotFolder:
    """A :class:`~dense_vs.recording.RecordingFormat`.

    Joints are the feature ``observation.state``, or the only feature of numbers under ``observation.``.

    Args:
        path: of the dataset, with ``meta/info.json``.

    Raises:
        DenseVSError: another version, damaged metadata, no joints.
    """

    def __init__(self, path: Path):
        self.path = path
        info = _json(path / "meta" / "info.json")
        version = str(info.get("codebase_version", ""))
        if version not in VERSIONS:
            raise DenseVSError(f"{path} is a LeRobot folder of version {version!r}; expected {', '.join(VERSIONS)}")
        self.name = f"LeRobot {version}"
        self.version = version[:2]
        self._features: dict[str, Any] = info.get("features") or {}
        if not isinstance(self._features, dict) or not all(isinstance(f, dict) for f in self._features.values()):
            raise DenseVSError(f"{path}/meta/info.json is damaged: 'features' is no table of features")
        self.cameras = tuple(name for name in self._features if self._is_camera(name))
        self.state = self._state()
        self.joint_names = _joint_names(self._features[self.state], self.state)
        self._fps = _number(info.get("fps"), 30.0)
        self._chunk_size = int(_number(info.get("chunks_size"), 1000))
        templates = PATHS[self.version]
        self._data_path = str(info.get("data_path") or templates[0])
        self._video_path = str(info.get("video_path") or templates[1])
        self._rows = self._episode_rows(info)
        self.episodes = tuple(sorted(n for n in self._rows if self._present(n)))

    def log(self, episode: int) -> JointLog:
        """All joints of an episode.

        Raises:
            DenseVSError: a file that is missing, damaged or does not hold what info.json says.
        """
        file = self._data_file(episode)
        columns = ParquetColumns(file)
        wanted = ["timestamp", self.state]
        for name in wanted:
            if name not in columns.names:
                raise DenseVSError(f"{file} has no column {name!r}; it has {', '.join(columns.names)}")
        rows = columns.numbers([*wanted, *(["episode_index"] if "episode_index" in columns.names else [])])
        times, joints = rows["timestamp"].reshape(-1), rows[self.state]
        joints = joints.reshape(len(times), -1)
        if joints.shape[1] != len(self.joint_names):
            raise DenseVSError(
                f"{file} has {joints.shape[1]} numbers a row in {self.state!r}; expected {len(self.joint_names)}"
            )
        if "episode_index" in rows and self.version == "v3":
            mine = rows["episode_index"].reshape(-1) == episode
            times, joints = times[mine], joints[mine]
        try:
            return JointLog(self.joint_names, times, joints)
        except DenseVSError as error:
            raise DenseVSError(f"{file}: {error}") from error

    def images(self, episode: int, camera: str) -> ImageStream:
        """The images of an episode; its first is at the time of its first row."""
        if self._features[camera].get("dtype") == "image":
            return _ParquetImages(self._data_file(episode), camera, episode if self.version == "v3" else None)
        video = self._video_file(episode, camera)
        if self.version == "v2":
            return VideoReader(video)
        row = self._rows[episode]
        begin = _number(row.get(f"videos/{camera}/from_timestamp"), 0.0)
        end = _number(row.get(f"videos/{camera}/to_timestamp"), np.inf)
        return VideoReader(video, begin=begin, end=end)

    def _is_camera(self, name: str) -> bool:
        feature = self._features[name]
        about = feature.get("info") or feature.get("video_info") or {}
        depth = isinstance(about, dict) and bool(about.get("video.is_depth_map") or about.get("is_depth_map"))
        return feature.get("dtype") in ("video", "image") and not depth

    def _state(self) -> str:
        if STATE in self._features:
            return STATE
        numbers = [
            name
            for name, feature in self._features.items()
            if name.startswith("observation.") and str(feature.get("dtype")).startswith("float")
        ]
        if len(numbers) != 1:
            raise DenseVSError(
                f"{self.path} has no feature {STATE!r} for the joints; its features are {', '.join(self._features)}"
            )
        return numbers[0]

    def _episode_rows(self, info: dict[str, Any]) -> dict[int, dict[str, Any]]:
        """Metadata of each episode from meta/, by number."""
        if self.version == "v2":
            listed = _json_lines(self.path / "meta" / "episodes.jsonl")
            total = min(max(int(_number(info.get("total_episodes"), 0)), 0), MAX_EPISODES)
            numbers = [row.get("episode_index") for row in listed] or self._numbered(total)
            return {number: {} for number in numbers if isinstance(number, int) and 0 <= number < 10**9}
        rows: dict[int, dict[str, Any]] = {}
        for file in sorted((self.path / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
            columns = ParquetColumns(file)
            # Statistics of every feature, which would be most of the bytes, are left out.
            table = columns.rows([name for name in columns.names if not name.startswith("stats/")])
            for row in table:
                if isinstance(row.get("episode_index"), int):
                    rows[row["episode_index"]] = row
        return rows

    def _numbered(self, total: int) -> list[int]:
        """Numbers below ``total`` in the names of files: any number of episodes may be claimed."""
        names = (name for _, _, files in os.walk(self.path) for name in files)
        found = {int(digits) for name in names for digits in re.findall("[0-9]+", name)}
        return sorted(number for number in found if number < total)

    def _present(self, episode: int) -> bool:
        try:
            files = [self._data_file(episode)]
            files += [self._video_file(episode, c) for c in self.cameras if self._features[c].get("dtype") == "video"]
        except KeyError:
            return False
        return files[0].is_file() and (len(files) == 1 or any(file.is_file() for file in files[1:]))

    def _data_file(self, episode: int) -> Path:
        row = self._rows[episode]
        return self._file(self._data_path, episode, row.get("data/chunk_index"), row.get("data/file_index"))

    def _video_file(self, episode: int, camera: str) -> Path:
        row = self._rows[episode]
        chunk, file = row.get(f"videos/{camera}/chunk_index"), row.get(f"videos/{camera}/file_index")
        return self._file(self._video_path, episode, chunk, file, camera)

    def _file(self, template: str, episode: int, chunk: Any, file: Any, camera: str = "") -> Path:
        """A file named by a template of info.json, which may name nothing but numbers and the camera."""
        values = {
            "episode_index": episode,
            "episode_chunk": episode // max(self._chunk_size, 1),
            "chunk_index": chunk if isinstance(chunk, int) else 0,
            "file_index": file if isinstance(file, int) else 0,
            "video_key": camera,
        }
        try:
            fields = [(name, spec) for _, name, spec, _ in Formatter().parse(template) if name is not None]
        except ValueError as error:
            raise DenseVSError(f"{self.path}/meta/info.json has a bad file name {template!r}: {error}") from error
        if any(name not in values or not re.fullmatch(r"(0?\d)?d?", spec or "") for name, spec in fields):
            raise DenseVSError(
                f"{self.path}/meta/info.json has a bad file name {template!r}; expected fields {', '.join(values)}"
            )
        name = PurePosixPath(template.format(**values))
        if name.is_absolute() or ".." in name.parts:
            raise DenseVSError(f"{self.path}/meta/info.json names {name}; expected a file inside the folder")
        return file_path(self.path / name)  # refuses a name longer than a file's can be


class _ParquetImages:
    """Images that are stored in the rows of a parquet file, read a few rows at a time."""

    def __init__(self, file: Path, camera: str, episode: int | None):
        self._columns, self._camera, self._episode = ParquetColumns(file), camera, episode
        self._file = file
        self.fps, self.frame_count = 30.0, 0
        first = next(iter(self), None)
        if first is None:
            raise DenseVSError(f"{file} has no image in column {camera!r}")
        self.height, self.width = first[0].shape[:2]
        self.start = first[1]

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        names = [self._camera, "timestamp", *(["episode_index"] if self._episode is not None else [])]
        for row in self._columns.stream(names):
            if self._episode is not None and row["episode_index"] != self._episode:
                continue
            stored, time = row[self._camera], row["timestamp"]
            content = stored.get("bytes") if isinstance(stored, dict) else stored
            if not isinstance(content, bytes) or not isinstance(time, (int, float)):
                raise DenseVSError(f"{self._file} has no image bytes in column {self._camera!r}")
            yield read_image(content, f"image at {time:.3f} s of {self._file}"), float(time)


def _joint_names(feature: dict[str, Any], state: str) -> tuple[str, ...]:
    """Names of a feature's numbers, however they nest; numbered where there are none or not as many."""
    shape = feature.get("shape")
    if not isinstance(shape, (list, tuple)) or len(shape) != 1 or not isinstance(shape[0], int):
        raise DenseVSError(f"feature {state!r} has shape {shape}; expected one number, how many joints there are")
    if not 1 <= shape[0] <= 4096:
        raise DenseVSError(f"feature {state!r} has {shape[0]} numbers; expected 1 to 4096")
    names = list(_leaves(feature.get("names")))
    if len(names) != shape[0] or len(set(names)) != len(names):
        stem = state.rsplit(".", maxsplit=1)[-1]
        names = [f"{stem}_{k}" for k in range(shape[0])]
    return tuple(names)


def _leaves(names: Any) -> Iterator[str]:
    if isinstance(names, dict):
        for value in names.values():
            yield from _leaves(value)
    elif isinstance(names, (list, tuple)):
        for value in names:
            yield from _leaves(value)
    elif isinstance(names, str):
        yield names


def _json(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise DenseVSError(f"cannot read {path}: it holds no table")
    return content


def _json_lines(path: Path) -> list[dict[str, Any]]:
    if not path.is_file():
        return []
    rows = []
    try:
        lines = input_file(path, most=MOST_JSON).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DenseVSError(f"cannot read {path}: {error}") from error
    for k, line in enumerate(lines):
        if not line.strip():
            continue
        try:
            row = parse_json(line)
        except DenseVSError as error:
            raise DenseVSError(f"cannot read {path}, line {k + 1}: {error}") from error
        rows.append(row if isinstance(row, dict) else {})
    return rows


def _number(value: Any, default: float) -> float:
    try:
        return check_number("a number of info.json", value, least=0)
    except DenseVSError:
        return default
