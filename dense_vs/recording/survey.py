"""Summary of an episode from one pass over it: rates, repeated and missing images, the clock, the joints' motion."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.clock_offset import ClockOffset, MotionSamples, find_clock_offset
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.recording.frame import rate_of
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.recording import Episode

MOVES = 20.0  # excitation from which a joint moved enough; trembling of a real arm held still makes 8 to 40
MOST = 9999.0  # excitation that is shown; a simulated joint has no noise at all
DISTINCT = 5  # readings; an encoder at rest jumps between two or three
TOGETHER = 0.98  # correlation of two joints' steps from which they moved as one
STEP_SECONDS = 0.2  # of the joint steps that are compared


@dataclass(frozen=True)
class JointMotion:
    """How one joint moved.

    Attributes:
        name: of the joint.
        low, high: its range, in its own unit.
        noise: standard deviation of a reading that its jitter tells, in its own unit.
        excitation: root mean square change within 0.2 s over what noise alone would give; 1 is none.
        moves: whether it moved enough to be learned.
    """

    name: str
    low: float
    high: float
    noise: float
    excitation: float
    moves: bool


@dataclass(frozen=True)
class Survey:
    """Result of one pass over an episode.

    Attributes:
        images: number of images.
        seconds: from the first to the last image [s].
        fps: usual image rate [Hz].
        distinct_fps: images that are no repetition, a second [Hz].
        repeated: images that repeat the one before.
        missing: images that are missing between stamps too far apart.
        gaps: times after which images are missing [s].
        joint_rate: readings a second [Hz].
        height, width: of the images [px].
        offset: of the clocks.
        joints: how each joint moved.
        together: groups of joints that always moved as one.
    """

    images: int
    seconds: float
    fps: float
    distinct_fps: float
    repeated: int
    missing: int
    gaps: tuple[float, ...]
    joint_rate: float
    height: int
    width: int
    offset: ClockOffset
    joints: tuple[JointMotion, ...]
    together: tuple[tuple[str, ...], ...]


def survey_episode(episode: Episode, on_image: Callable[[], object] | None = None) -> Survey:
    """Read an episode's images once.

    Args:
        episode: with the joints to look at.
        on_image: called after every image, for a progress bar.

    Raises:
        DenseVSError: no episode, or damaged images.
    """
    if not isinstance(getattr(episode, "log", None), JointLog) or not hasattr(episode, "images"):
        raise DenseVSError(f"episode is a {type(episode).__name__}; expected an Episode, as Recording.episode() gives")
    stream = episode.images()
    motion, times = MotionSamples(), []

    def stamped() -> Iterator[tuple[np.ndarray, float]]:
        for image, time in stream:
            times.append(time)
            yield image, time
            if on_image is not None:
                on_image()

    distinct = DistinctImages(stamped(), stream.fps)
    for found in distinct:
        if found.after_gap:
            motion.restart()
        motion.add(found.gray, found.time)
    steps = np.diff(times)
    usual = float(np.median(steps)) if steps.size else 1 / stream.fps
    lost = np.round(steps / usual).astype(int) - 1 if usual > 0 else np.zeros(0, int)
    seconds = float(times[-1] - times[0]) if times else 0.0
    joints = joint_motions(episode.log)
    moving = [joint.name for joint in joints if joint.moves]
    offset = find_clock_offset(motion, episode.log.select(moving)) if moving else None
    return Survey(
        images=len(times),
        seconds=seconds,
        fps=1 / usual if usual > 0 else stream.fps,
        distinct_fps=(len(times) - distinct.repeated - 1) / seconds if seconds > 0 else 0.0,
        repeated=distinct.repeated,
        missing=int(lost.sum()),
        gaps=tuple(distinct.gaps),
        joint_rate=rate_of(episode.log.times),
        height=stream.height,
        width=stream.width,
        offset=offset or ClockOffset(0.0, 0.0, float("nan"), reason="no joint moves"),
        joints=joints,
        together=moved_together(episode.log, moving),
    )


def joint_motions(log: JointLog) -> tuple[JointMotion, ...]:
    """How each joint of a log moved, whatever its unit."""
    rate = rate_of(log.times) or 1.0
    ticks = np.arange(log.times[0], log.times[-1], 1 / rate)
    even = log.at(ticks) if ticks.size > 2 else log.positions
    # Motion is smooth from reading to reading; what is not is noise. Fourth differences leave nothing of slow motion,
    # the quietest quarter leaves out the fast one. Quantization gives zeros between jumps.
    jitter = np.diff(even, n=4, axis=0) if len(even) > 4 else np.zeros((1, even.shape[1]))
    noise = np.quantile(np.abs(jitter), 0.25, axis=0) / (0.3186 * np.sqrt(70))
    noise = np.maximum(noise, 1e-9 * np.maximum(np.abs(even).max(axis=0), 1e-30))
    span = max(1, min(round(STEP_SECONDS * rate), len(even) - 1))
    change = np.sqrt(np.mean((even[span:] - even[:-span]) ** 2, axis=0))
    excitation = change / (np.sqrt(2) * noise)
    excitation = np.minimum(excitation, MOST)
    low, high = log.positions.min(axis=0), log.positions.max(axis=0)
    moves = excitation > MOVES
    moves &= [np.unique(column[:: max(1, len(column) // 10_000)]).size >= DISTINCT for column in log.positions.T]
    # Trembling is no motion either: it changes as much from one reading to the next as over a fifth of a second.
    moves &= change > 1.5 * np.sqrt(np.mean(np.diff(even, axis=0) ** 2, axis=0))
    return tuple(
        JointMotion(name, float(low[n]), float(high[n]), float(noise[n]), float(excitation[n]), bool(moves[n]))
        for n, name in enumerate(log.names)
    )


def moved_together(log: JointLog, names: list[str]) -> tuple[tuple[str, ...], ...]:
    """Groups of joints whose steps over 0.2 s are nearly proportional: an image cannot tell them apart."""
    if len(names) < 2:
        return ()
    chosen = log.select(names)
    ticks = np.arange(log.times[0], log.times[-1], STEP_SECONDS / 2)
    if ticks.size < 8:
        return ()
    steps = chosen.at(ticks)[2:] - chosen.at(ticks)[:-2]
    size = np.linalg.norm(steps, axis=0)
    likeness = np.abs(steps.T @ steps) / np.maximum(np.outer(size, size), 1e-300)
    groups: list[set[int]] = []
    for a in range(len(names)):
        alike = {b for b in range(len(names)) if likeness[a, b] >= TOGETHER and size[b] > 0} | {a}
        touching = [group for group in groups if group & alike]
        for group in touching:
            alike |= group
            groups.remove(group)
        groups.append(alike)
    return tuple(tuple(names[n] for n in sorted(group)) for group in groups if len(group) > 1)
