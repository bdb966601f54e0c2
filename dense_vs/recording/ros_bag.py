"""ROS 1 and ROS 2 bags (.bag, .mcap, sqlite3) by the rosbags package; no ROS is needed.

Joints are ``sensor_msgs/JointState``; cameras are ``sensor_msgs/Image``, ``CompressedImage`` (JPEG, PNG, H.264, HEVC),
``CompressedVideo`` and ``FFMPEGPacket``. Only these types are decoded, by definitions of our own: what a bag says about
its types would become code. Times are the headers' stamps, or those of arrival where a camera or the joints have none.
"""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.recording.frame import ImageStream, rate_of
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.ros_images import ImageDecoder

JOINTS = "sensor_msgs/msg/JointState"
CAMERAS = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "foxglove_msgs/msg/CompressedVideo",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
)
VIDEO_TYPES = {
    CAMERAS[2]: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    CAMERAS[3]: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
}
USUAL_JOINT_TOPIC = "joint_states"
MAX_READINGS = 50_000_000  # numbers of all joints
NOT_STAMPED = 1.0  # s since 1970; header stamps below it were never set


class RosBag:
    """A :class:`~dense_vs.recording.RecordingFormat` of one episode, with a camera an image topic.

    Of several topics with joints, those called ``joint_states`` are used, or else the one with most readings.

    Args:
        path: bag file, or folder of a ROS 2 bag with its ``metadata.yaml``.

    Raises:
        DenseVSError: rosbags is not installed; no bag, damaged, or without joints.
    """

    episodes: tuple[int, ...] = (0,)

    def __init__(self, path: Path):
        for file in sorted(path.iterdir()) if path.is_dir() else [path]:
            if not file.is_dir():
                input_file(file)  # the library would wait for a pipe that it is told to open
        self.path = path
        self._ros1 = path.suffix.lower() == ".bag"
        self._store = _type_store(self._ros1)
        self._stamped, self._origin = False, 0.0
        with self._opened() as reader:
            kind = "ROS 1 bag" if self._ros1 else "ROS 2 bag"
            self.name = kind
            self.cameras = tuple(sorted({c.topic for c in reader.connections if c.msgtype in CAMERAS}))
            topics = {c.topic: c.msgcount for c in reader.connections if c.msgtype == JOINTS}
            present = sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})
        if not topics:
            raise DenseVSError(f"{path} has no topic of type {JOINTS}; it has {', '.join(present) or 'none'}")
        usual = [topic for topic in topics if topic.split("/")[-1] == USUAL_JOINT_TOPIC]
        self.joint_topics = tuple(usual or [max(topics, key=lambda topic: topics[topic])])
        self._stamped = self._has_stamps((*self.joint_topics, *self.cameras))
        first = next(self.messages(self.cameras), None)
        self._origin = first[1] if first else 0.0
        self._log = self._read_joints()
        self.joint_names = self._log.names

    def log(self, episode: int) -> JointLog:
        """All joints; time 0 is the first image's."""
        return self._log

    def images(self, episode: int, camera: str) -> ImageStream:
        """The images of a topic, on the joints' clock."""
        return _BagImages(self, camera)

    def messages(self, topics: tuple[str, ...]) -> Iterator[tuple[str, float, Any]]:
        """Topic, time on the bag's clock [s] and message of some topics, in the order of arrival.

        Raises:
            DenseVSError: a damaged bag.
        """
        with self._opened() as reader:
            chosen = [c for c in reader.connections if c.topic in topics and c.msgtype in (JOINTS, *CAMERAS)]
            decode = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
            for connection, arrived, data in reader.messages(connections=chosen):
                message: Any = decode(data, connection.msgtype)
                time = _stamp(message) if self._stamped else arrived * 1e-9
                yield connection.topic, time - self._origin, message

    def _has_stamps(self, topics: tuple[str, ...]) -> bool:
        """Whether the first message of every topic has a header stamp that was set."""
        missing = set(topics)
        for topic, _, message in self.messages(topics):
            if topic in missing and _stamp(message) < NOT_STAMPED:
                return False
            missing.discard(topic)
            if not missing:
                break
        return True

    def _read_joints(self) -> JointLog:
        times: dict[str, list[float]] = defaultdict(list)
        values: dict[str, list[float]] = defaultdict(list)
        readings = 0
        for topic, time, message in self.messages(self.joint_topics):
            if len(message.name) != len(message.position):
                if len(message.position) == 0:  # only velocities or efforts
                    continue
                raise DenseVSError(
                    f"{self.path} has a message on {topic} with {len(message.name)} names and "
                    f"{len(message.position)} positions"
                )
            readings += len(message.name)
            if readings > MAX_READINGS:
                raise DenseVSError(f"{self.path} has more than {MAX_READINGS} joint readings; expected a shorter bag")
            for name, position in zip(message.name, message.position, strict=True):
                if not times[name] or time > times[name][-1]:  # a reading that was sent twice counts once
                    times[name].append(time)
                    values[name].append(float(position))
        names = tuple(name for name in times if len(times[name]) > 1)
        if not names:
            raise DenseVSError(f"{self.path} has no joint with two positions on {', '.join(self.joint_topics)}")
        ticks = np.unique(np.concatenate([np.array(times[name]) for name in names]))
        # Joints may come in messages of their own; what all of them cover is kept.
        ticks = ticks[(ticks >= max(times[n][0] for n in names)) & (ticks <= min(times[n][-1] for n in names))]
        positions = [np.interp(ticks, times[name], values[name]) for name in names]
        if ticks.size < 2:
            raise DenseVSError(f"{self.path} has no time that all of its joints cover: {', '.join(names)}")
        try:
            return JointLog(names, ticks, np.stack(positions, axis=1))
        except DenseVSError as error:
            raise DenseVSError(f"{self.path}: {error}") from error

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        """A rosbags reader; what it and the message decoder raise about a damaged bag becomes one clear line."""
        from apsw import Error as SqliteError
        from rosbags import rosbag1, rosbag2

        try:
            with rosbag1.Reader(self.path) if self._ros1 else rosbag2.Reader(self.path) as reader:
                yield reader
        except (DenseVSError, GeneratorExit, KeyboardInterrupt):
            raise
        except (Exception, SqliteError) as error:
            # The library reads a damaged file until something breaks, in any of many ways.
            reason = " ".join(str(error).split())[:300]
            raise DenseVSError(f"{self.path} cannot be read as a ROS bag: {type(error).__name__}: {reason}") from error


class _BagImages:
    def __init__(self, bag: RosBag, topic: str):
        self._bag, self._topic = bag, topic
        times, first = [], None
        for image, time in self:
            times.append(time)
            first = image if first is None else first
            if len(times) == 30:
                break
        if first is None:
            raise DenseVSError(f"{bag.path} has no image on {topic} that can be decoded")
        self.height, self.width = first.shape[:2]
        self.fps, self.start = rate_of(times) or 30.0, times[0]
        with bag._opened() as reader:
            self.frame_count = sum(c.msgcount for c in reader.connections if c.topic == topic)

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        last, size = -np.inf, None
        for image, stamp in self._decoded():
            if stamp <= last:  # sent twice
                continue
            last, size = stamp, size or image.shape
            if image.shape != size:
                raise DenseVSError(
                    f"{self._bag.path} changes the image size on {self._topic} from {size[1]} x {size[0]} to "
                    f"{image.shape[1]} x {image.shape[0]} at {stamp:.3f} s"
                )
            yield image, stamp

    def _decoded(self) -> Iterator[tuple[np.ndarray, float]]:
        decoder = ImageDecoder(f"{self._bag.path}, {self._topic}")
        for _, time, message in self._bag.messages((self._topic,)):
            yield from decoder.decode(message, time)
        yield from decoder.flush()


def _stamp(message: Any) -> float:
    header = getattr(message, "header", None)
    stamp = header.stamp if header is not None else message.timestamp
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _type_store(ros1: bool) -> Any:
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise DenseVSError(
            "reading ROS bags needs rosbags, which is not installed; pip install 'dense-vs[recordings]'"
        ) from error
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    for name, definition in VIDEO_TYPES.items():
        store.register(get_types_from_msg(definition, name))
    return store
