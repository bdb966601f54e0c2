"""What the session reads: camera and robot as a page needs them, with the last image kept and readings watched."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.robot.protocols import Camera, Robot


@dataclass(frozen=True)
class LiveSource:
    """A camera and a robot to run.

    Attributes:
        camera, robot: of one robot, on one clock.
        name: what to call it on the page.
        commands: whether the robot follows commands; a recording does not.
        paced: whether the images come at the pace of their stamps already, as a camera's do.
        watchdog: how a process apart can tell the robot to hold, see :mod:`dense_vs.drivers.watchdog`; None
            where the robot holds by itself when nobody commands it.
    """

    camera: Camera
    robot: Robot
    name: str
    commands: bool = True
    paced: bool = True
    watchdog: Any = None


class CameraTap:
    """A camera that passes its images on and keeps the last one.

    Args:
        camera: the camera.

    Attributes:
        picture: the last image; None before the first.
        time: its stamp [s].
    """

    def __init__(self, camera: Camera):
        self._camera = camera
        self.picture: np.ndarray | None = None
        self.time = -np.inf
        self._repeat = False

    def again(self) -> np.ndarray:
        """The last image, which the next :meth:`read` gives once more: for a loop that begins anew."""
        if self.picture is None:
            self.read()
        assert self.picture is not None
        self._repeat = True
        return self.picture

    def read(self) -> tuple[np.ndarray, float]:
        """The next image.

        Raises:
            DenseVSError: the camera gave an image that is not newer than the last.
        """
        if self._repeat and self.picture is not None:
            self._repeat = False
            return self.picture, self.time
        image, time = self._camera.read()
        if time <= self.time:
            raise DenseVSError(f"the camera gave an old image: stamp {time:.3f} s after {self.time:.3f} s")
        # A copy: a driver may fill the same buffer again while the page still shows it.
        self.picture, self.time = np.array(image), float(time)
        return image, time
