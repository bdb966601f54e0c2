"""Joint positions over time, on their own clock ticks, interpolated to the camera's.

A camera and a robot's encoders report at different rates. ``dq`` of a frame is the joint displacement between
two image time stamps, so the positions are interpolated linearly to them.
"""

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from dense_vs.arrays import number_array, real_vector
from dense_vs.checks import check_names, check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.robot.joint_group import joint_indices

IMAGE_COLUMN = "image"  # of a joint log: name of the image that was taken at a row's time
MOST_BYTES = 1 << 30  # of a joint log, which is read whole


@dataclass(frozen=True)
class JointLog:
    """Positions of named joints over time.

    Attributes:
        names: N joint names.
        times: float64 ``(T,)`` [s], increasing.
        positions: float64 ``(T, N)`` [rad, m for a prismatic joint].
    """

    names: tuple[str, ...]
    times: np.ndarray
    positions: np.ndarray

    def __post_init__(self):
        object.__setattr__(self, "names", check_names("joint names", self.names))
        object.__setattr__(self, "times", number_array(self.times, "times of a joint log", finite=False))
        object.__setattr__(self, "positions", number_array(self.positions, "positions of a joint log", finite=False))
        if self.times.ndim != 1 or self.positions.shape != (len(self.times), len(self.names)):
            raise DenseVSError(
                f"joint log has times of shape {self.times.shape} and positions of shape {self.positions.shape}; "
                f"expected (T,) and (T, {len(self.names)})"
            )
        if len(self.times) < 2:
            raise DenseVSError(f"joint log has {len(self.times)} rows; expected at least 2")
        if not np.isfinite(self.times).all() or not np.isfinite(self.positions).all():
            raise DenseVSError("joint log has values that are not finite; expected finite times and positions")
        backward = np.flatnonzero(np.diff(self.times) <= 0)
        if backward.size:
            k = backward[0]
            raise DenseVSError(
                f"joint log times do not increase: row {k + 2} has {self.times[k + 1]} s after "
                f"{self.times[k]} s in row {k + 1}"
            )

    def at(self, times: np.ndarray) -> np.ndarray:
        """Positions at ``times`` ``(M,)`` [s], float64 ``(M, N)``.

        Raises:
            DenseVSError: a time outside the log.
        """
        times = number_array(times, "times", (-1,))
        if times.size and (times.min() < self.times[0] or times.max() > self.times[-1]):
            raise DenseVSError(
                f"times {times.min():.3f} to {times.max():.3f} s are not all in the joint log, "
                f"which covers {self.times[0]:.3f} to {self.times[-1]:.3f} s"
            )
        return np.stack([np.interp(times, self.times, q) for q in self.positions.T], axis=1)

    def select(self, names: Sequence[str]) -> "JointLog":
        """The log of some of the joints, in the order asked for.

        Raises:
            DenseVSError: a name that is not in the log, or twice in ``names``.
        """
        columns = joint_indices(names, self.names, "the log")
        return JointLog(tuple(names), self.times, self.positions[:, columns])

    def shifted(self, seconds: float) -> "JointLog":
        """The log with ``seconds`` added to its times.

        Raises:
            DenseVSError: not a finite number, or so many that the times no longer differ.
        """
        seconds = check_number("seconds", seconds)
        return JointLog(self.names, self.times + seconds, self.positions)

    def smoothed(self, seconds: float) -> "JointLog":
        """The log with its positions smoothed over time by a Gaussian; the ends are held.

        A recorder stamps a reading when it writes it, up to one of its own periods late, and encoders tremble; both
        make joint steps between neighboring images wrong, motion hardly.

        Args:
            seconds: standard deviation of the Gaussian [s]; 0 changes nothing.

        Raises:
            DenseVSError: a width that is not finite or less than 0.
        """
        seconds = check_number("smoothing", seconds, least=0)
        span = self.times[-1] - self.times[0]
        # Finer than the readings or a quarter of the width there is nothing to gain.
        period = float(np.median(np.diff(self.times)))
        step = max(min(period, seconds), seconds / 4)
        # A Gaussian that is far narrower than a period changes nothing, and would take ticks without end.
        if seconds < 0.01 * period or step >= span:
            return self
        ticks = np.linspace(self.times[0], self.times[-1], round(span / step) + 1)
        even = gaussian_filter1d(self.at(ticks), seconds * (len(ticks) - 1) / span, axis=0, mode="nearest")
        return JointLog(self.names, self.times, JointLog(self.names, ticks, even).at(self.times))

    @classmethod
    def read_csv(cls, path: str | os.PathLike[str]) -> "JointLog":
        """Read a CSV file: a header, time [s] in the first column, a named joint in every other one.

        A column named ``image`` may hold the file names of images; it is no joint.

        Raises:
            DenseVSError: no such file, no header, a row of another length, a cell that is not a finite
                number (with its line), times that do not increase.
        """
        rows = csv_rows(path)
        if not rows:
            raise DenseVSError(f"joint log {path} is empty; expected a header and rows of numbers")
        header = [cell.strip() for cell in rows[0]]
        if IMAGE_COLUMN in header[1:] and all(len(row) == len(header) for row in rows):
            images = header.index(IMAGE_COLUMN, 1)
            rows = [row[:images] + row[images + 1 :] for row in rows]
            header = header[:images] + header[images + 1 :]
        if len(header) < 2 or all(_is_number(cell) for cell in header):
            raise DenseVSError(
                f"joint log {path} starts with {','.join(header)!r}; expected a header naming the time column "
                "and at least one joint"
            )
        names = header[1:]
        if len(set(names)) != len(names) or not all(names):
            raise DenseVSError(f"joint log {path} names its joints {names}; expected each column a name of its own")
        numbers = np.empty((len(rows) - 1, len(header)))
        for k, row in enumerate(rows[1:]):
            if len(row) != len(header):
                raise DenseVSError(
                    f"joint log {path}, row {k + 1} after the header, has {len(row)} columns; expected {len(header)}"
                )
            for column, cell in enumerate(row):
                if not _is_number(cell) or not np.isfinite(float(cell)):
                    raise DenseVSError(
                        f"joint log {path}, row {k + 1} after the header, column {header[column]!r} holds {cell!r}; "
                        "expected a finite number"
                    )
                numbers[k, column] = float(cell)
        try:
            return cls(tuple(names), numbers[:, 0].copy(), numbers[:, 1:].copy())
        except DenseVSError as error:
            raise DenseVSError(f"{path}: {error}") from error


def csv_rows(path: str | os.PathLike[str]) -> list[list[str]]:
    """The rows of a joint log but empty ones, as text.

    Raises:
        DenseVSError: missing, no regular file, larger than 1 GiB, or no text.
    """
    path = input_file(path, most=MOST_BYTES)
    try:
        with open(path, newline="", encoding="utf-8-sig") as stream:
            return [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise DenseVSError(f"cannot read joint log {path}: {reason}") from error


class JointBuffer:
    """The last seconds of a live robot's joints, for interpolation to image time stamps.

    Args:
        joints: number of joints N.
        capacity: readings kept.
        most_gap: longest time between two readings [s]; after a longer one :meth:`clear` it.

    Raises:
        DenseVSError: no such numbers.
    """

    def __init__(self, joints: int, capacity: int = 256, most_gap: float = 2.0):
        joints = check_whole("joints", joints, least=1, most=1 << 12)
        capacity = check_whole("capacity", capacity, least=1, most=1 << 20)
        self._times = np.zeros(capacity)
        self._positions = np.zeros((capacity, joints))
        self._count = 0
        self._most_gap = check_number("most_gap", most_gap, above=0)

    def clear(self) -> None:
        """Forget all readings, as after a pause or when a clock was set."""
        self._count = 0

    def continues(self, time: float) -> bool:
        """Whether a reading of that time [s] would follow on the last one; any does where none is kept."""
        return not self._count or time - self.last_time <= self._most_gap

    def add(self, positions: np.ndarray, time: float) -> None:
        """Take a reading; one with the stamp of the last is the same reading again and is left out.

        Raises:
            DenseVSError: not N finite numbers, a time that is not finite, goes back, or jumps; nothing is taken then.
        """
        positions = real_vector(positions, "joint positions", (self._positions.shape[1],))
        time = check_number("joint time stamp", time)
        if self._count:
            last = float(self._times[self._count - 1])
            if time == last:
                return
            if time < last or not self.continues(time):
                raise DenseVSError(
                    f"joint time stamp is {time} s after {last} s; expected increasing stamps at most "
                    f"{self._most_gap:g} s apart, of one clock"
                )
        if self._count == len(self._times):
            kept = self._count // 2
            self._times[:kept] = self._times[self._count - kept :]
            self._positions[:kept] = self._positions[self._count - kept :]
            self._count = kept
        self._times[self._count] = time
        self._positions[self._count] = positions
        self._count += 1

    def stretch(self, joint: int, factor: float, since: float) -> None:
        """Make a joint's motion since a time [s] longer by a factor, beginning where it was at that time.

        Raises:
            DenseVSError: no such joint, or a factor or time that is not a finite number.
        """
        joint = check_whole("joint", joint, least=0, most=self._positions.shape[1] - 1)
        factor, since = check_number("factor", factor), check_number("since", since)
        if not self._count:
            return
        begin = self.at(since)[joint]
        later = self._positions[: self._count][self._times[: self._count] > since]
        later[:, joint] = begin + factor * (later[:, joint] - begin)
        self._positions[: self._count][self._times[: self._count] > since] = later

    def readings(self) -> tuple[np.ndarray, np.ndarray]:
        """Times ``(S,)`` [s] and positions ``(S, N)`` that are kept, the oldest first."""
        return self._times[: self._count].copy(), self._positions[: self._count].copy()

    @property
    def first_time(self) -> float:
        """Stamp of the oldest reading that is kept [s]; infinite before any."""
        return float(self._times[0]) if self._count else np.inf

    @property
    def last_time(self) -> float:
        """Stamp of the newest reading [s]; minus infinity before any."""
        return float(self._times[self._count - 1]) if self._count else -np.inf

    def at(self, time: float) -> np.ndarray:
        """Positions ``(N,)`` at ``time``, the first or last reading outside them.

        Raises:
            DenseVSError: no reading yet, or a time that is not a finite number.
        """
        if not self._count:
            raise DenseVSError("no joint reading yet; expected add() first")
        time = check_number("time", time)
        after = int(np.searchsorted(self._times[: self._count], time))
        around = slice(max(after - 1, 0), min(after + 1, self._count))
        return np.array([np.interp(time, self._times[around], q) for q in self._positions[around].T])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
