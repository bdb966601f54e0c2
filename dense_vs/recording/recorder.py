"""Records a robot while a loop runs it: stands between the loop and the robot's own camera and joints."""

import os

import numpy as np

from dense_vs.arrays import number_array, plain_array
from dense_vs.errors import DenseVSError
from dense_vs.recording.writers import QUALITY, open_writer
from dense_vs.robot import Camera, JointGroup, Robot, WrappedRobot
from dense_vs.robot.per_joint import stamp_of


class Recorder(WrappedRobot):
    """Camera and robot that pass everything on and write it down; use as a context manager::

        with Recorder(camera, robot, "run", form="lerobot") as recorder:
            ServoLoop(recorder, recorder).babble(20)

    Args:
        camera, robot: what is recorded.
        path: folder of the recording.
        form: ``"video"``, ``"lerobot"`` or ``"mcap"``, see :func:`open_writer`.
        fps: of the camera, in the formats that store one [Hz].
        quality: of the video.

    Raises:
        DenseVSError: an object that lacks a member of :class:`Robot`, another format, or a folder that cannot be
            written to.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        path: str | os.PathLike[str],
        *,
        form: str = "lerobot",
        fps: float = 30.0,
        quality: int = QUALITY,
    ):
        JointGroup.of_robot(robot)
        super().__init__(robot)
        self._camera = camera
        self._writer = open_writer(form, path, tuple(robot.joint_names), fps=fps, quality=quality)

    def read(self) -> tuple[np.ndarray, float]:
        """The camera's next image, written down.

        Raises:
            DenseVSError: no camera, or what is no image and its stamp.
        """
        if not isinstance(self._camera, Camera):
            raise DenseVSError(f"camera is a {type(self._camera).__name__} without read; expected a Camera")
        image, time = self._camera.read()
        shown = plain_array(image, "image", "RGB uint8 of shape (H, W, 3) or gray (H, W)")
        self._writer.add_image(np.repeat(shown[..., None], 3, axis=2) if shown.ndim == 2 else shown, time)
        return image, time

    def joints(self) -> tuple[np.ndarray, float]:
        """The robot's joints, written down; a reading that is not finite is only passed on, as no log takes it."""
        positions, time = super().joints()
        q = number_array(positions, "joint positions", finite=False)
        if np.isfinite(q).all() and np.isfinite(stamp := stamp_of("joint stamp", time)):
            self._writer.add_joints(q, stamp)
        return positions, time

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None or issubclass(kind, KeyboardInterrupt):  # a run that was interrupted is worth keeping
            self._writer.close()
        else:
            self._writer.abort()
