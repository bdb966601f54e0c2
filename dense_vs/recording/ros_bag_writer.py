"""ROS 2 bags out, in MCAP: ``sensor_msgs/JointState`` and JPEG images, each at its own stamp."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.recording.writer_checks import check_open, recorded_names, recorded_text
from dense_vs.robot.camera_image import check_rgb

JPEG_QUALITY = 95  # compression artifacts are flow errors
JOINT_TOPIC = "/joint_states"
LATEST = float(1 << 31)  # s, a message's stamp is a 32-bit number of seconds
START = 1000.0  # s; added where times count from 0, as a bag has none below it and takes 0 for "not stamped"


class RosBagWriter:
    """A :class:`~dense_vs.recording.RecordingWriter` of one camera.

    Args:
        folder: of the bag, made here.
        joint_names: N names.
        camera: its name; the topic is ``/CAMERA/image/compressed``.

    Raises:
        DenseVSError: rosbags is not installed, the folder cannot be made, or names that cannot be stored.
    """

    def __init__(self, folder: Path, joint_names: tuple[str, ...], *, camera: str = "camera"):
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise DenseVSError(
                "writing ROS bags needs rosbags, which is not installed; pip install 'dense-vs[recordings]'"
            ) from error
        self._folder, self._names = folder, list(recorded_names(joint_names))
        recorded_text("camera", camera)
        self._closed = False
        self._images = self._readings = 0
        self._base: float | None = None
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._types: Any = self._store.types
        try:
            if folder.is_dir():
                folder.rmdir()  # empty; the library makes it
            folder.parent.mkdir(parents=True, exist_ok=True)
            self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
            self._joint_topic = self._connection(JOINT_TOPIC, "sensor_msgs/msg/JointState")
            self._image_topic = self._connection(f"/{camera}/image/compressed", "sensor_msgs/msg/CompressedImage")
        except OSError as error:
            raise DenseVSError(f"cannot write {folder}: {error.strerror or error}") from error

    def add_image(self, image: np.ndarray, time: float) -> None:
        """Add an image."""
        check_open(self._closed, self._folder)
        image = check_rgb(image)
        stamp = self._on_bag("image time stamp", time)
        settings = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        done, content = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), settings)
        if not done:
            raise DenseVSError(f"image of {image.shape[1]} x {image.shape[0]} pixels cannot be stored as JPEG")
        message = self._types["sensor_msgs/msg/CompressedImage"]
        self._write(
            self._image_topic, message(self._header(stamp), "rgb8; jpeg compressed bgr8", content.ravel()), stamp
        )
        self._images += 1

    def add_joints(self, positions: np.ndarray, time: float) -> None:
        """Add a reading."""
        check_open(self._closed, self._folder)
        none = np.zeros(0)
        q = number_array(positions, "joint positions", (len(self._names),))
        stamp = self._on_bag("joint time stamp", time)
        message = self._types["sensor_msgs/msg/JointState"](self._header(stamp), self._names, q, none, none)
        self._write(self._joint_topic, message, stamp)
        self._readings += 1

    def close(self) -> None:
        """Complete the bag."""
        if self._closed:
            return
        if not self._images or self._readings < 2:
            self.abort()
            raise DenseVSError(
                f"{self._folder} got {self._images} images and {self._readings} joint readings; expected at least 1 "
                "and 2"
            )
        self._closed = True
        with self._write_errors():
            self._writer.close()

    def abort(self) -> None:
        """Leave no bag."""
        if self._closed:
            return
        self._closed = True
        with suppress(OSError):  # a folder that somebody removed
            self._writer.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _on_bag(self, name: str, time: float) -> float:
        """A time on the bag's clock [s]."""
        time = check_number(name, time)
        base = self._base if self._base is not None else 0.0 if time >= START else START
        check_number(name, time, least=-base, below=LATEST - base)
        self._base = base
        return time + base

    def _connection(self, topic: str, kind: str) -> Any:
        return self._writer.add_connection(topic, kind, typestore=self._store)

    def _write(self, connection: Any, message: Any, time: float) -> None:
        with self._write_errors():
            data = self._store.serialize_cdr(message, connection.msgtype)
            self._writer.write(connection, round(time * 1e9), data)

    @contextmanager
    def _write_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DenseVSError(f"cannot write {self._folder}: {error.strerror or error}") from error

    def _header(self, time: float) -> Any:
        nanoseconds = round(time * 1e9)
        stamp = self._types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        return self._types["std_msgs/msg/Header"](stamp, "")
