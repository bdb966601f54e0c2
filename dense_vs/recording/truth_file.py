"""True Jacobians beside a simulated recording, to measure an estimate by."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.checks import check_names, check_number
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays, stored_array
from dense_vs.recording.frame import check_size
from dense_vs.recording.writer_checks import recorded_names
from dense_vs.robot.joint_group import joint_indices

STAMP_TOLERANCE = 1e-3  # s, between a video's time stamp and the simulator's time of the same frame


@dataclass(frozen=True)
class TruthFile:
    """Truth at some frames of a recording.

    Attributes:
        joint_names: N names.
        times: ``(M,)`` on the video's clock [s].
        jacobians: float32 ``(M, H, W, 2, N)`` [px/rad], zero off the robot.
        robot_masks: bool ``(M, H, W)``.
    """

    joint_names: tuple[str, ...]
    times: np.ndarray
    jacobians: np.ndarray
    robot_masks: np.ndarray

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: what :meth:`read` would refuse, or a file that cannot be written; what was there stays.
        """
        content = {"joint_names": np.array(recorded_names(self.joint_names))}
        for name in ("times", "jacobians", "robot_masks"):
            content[name] = plain_array(getattr(self, name), name, "an array")
        _check(content)
        with atomic_write(path) as stream:
            # NumPy's stub takes the names of arrays for options.
            np.savez_compressed(stream, allow_pickle=False, **content)  # pyright: ignore[reportArgumentType]

    @classmethod
    def read(cls, path: str | os.PathLike[str], joint_names: Sequence[str]) -> "TruthFile":
        """Read the truth of some joints, in the order asked for.

        Raises:
            DenseVSError: not such a file, or a joint that it does not have.
        """
        joint_names = check_names("joint names", joint_names)
        stored = read_arrays(path, "the truth of a recording", ("joint_names", "times", "jacobians", "robot_masks"))
        try:
            names, times, jacobians, masks = _check(stored)
        except DenseVSError as error:
            raise DenseVSError(f"cannot read {path} as the truth of a recording: {error}") from error
        return cls(joint_names, times, jacobians[..., joint_indices(joint_names, names, str(path))], masks)

    def at(self, time: float, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray] | None:
        """J ``(H, W, 2, N)`` [px/rad] and mask ``(H, W)`` for images scaled by ``scale``; None without truth then.

        Raises:
            DenseVSError: a time that is not a finite number, or a scale that makes no image.
        """
        time, scale = check_number("time", time), check_number("scale", scale, above=0, most=1 << 24)
        nearest = int(np.argmin(np.abs(self.times - time)))
        if abs(self.times[nearest] - time) > STAMP_TOLERANCE:
            return None
        true, mask = self.jacobians[nearest], self.robot_masks[nearest]
        if scale == 1.0:
            return true, mask
        height, width = round(mask.shape[0] * scale), round(mask.shape[1] * scale)
        check_size(width, height, f"the truth scaled by {scale:g}")
        planes = true.reshape(*mask.shape, -1)
        planes = np.stack(
            [cv2.resize(p, (width, height), interpolation=cv2.INTER_NEAREST) for p in np.moveaxis(planes, 2, 0)],
            axis=2,
        )
        true = planes.reshape(height, width, *true.shape[2:]) * scale
        return true, cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)


def _check(content: Mapping[str, np.ndarray]) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names, times, Jacobians and masks of a file, whose shapes fit one another."""
    names = [str(name) for name in stored_array(content, "joint_names", (-1,), "U")]
    times = stored_array(content, "times", (-1,))
    masks = stored_array(content, "robot_masks", (len(times), -1, -1), "b")
    jacobians = stored_array(content, "jacobians", (*masks.shape, 2, len(names)))
    if not masks.size:
        raise DenseVSError(f"robot_masks has shape {masks.shape}; expected at least one frame and pixel")
    return names, times, jacobians, masks
