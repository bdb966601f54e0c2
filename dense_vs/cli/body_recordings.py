"""What 'dense-vs body' reads: the images of one or several recordings with their joints, on one clock each."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from dense_vs.checks import check_number
from dense_vs.cli.recording_options import episode_numbers
from dense_vs.errors import DenseVSError
from dense_vs.pipeline.recorded import JOINT_SMOOTHING, recorded_excitation
from dense_vs.recording import Episode, open_recording, survey_episode
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.view.progress import progress

LEAST_SIDE = 16  # px, of an image that something can be followed in


@dataclass
class SeenBody:
    """Images without repetitions, of all episodes in their order.

    Attributes:
        images: K gray images uint8 ``(H, W)``.
        joints: K joint positions ``(N,)`` [rad].
        begins: K flags, whether nothing is known of the motion before the image.
        starts: index of the first image of each episode.
        learned: bool ``(N,)``, joints that move more than their noise.
        names: of the joints.
        last: the last image in color, RGB uint8 ``(H, W, 3)``.
    """

    names: tuple[str, ...]
    images: list[np.ndarray] = field(default_factory=list)
    joints: list[np.ndarray] = field(default_factory=list)
    begins: list[bool] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    learned: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    last: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3), np.uint8))

    def add(self, episode: Episode, scale: float) -> None:
        """Read an episode, its clocks aligned already.

        Raises:
            DenseVSError: other joints or another image size than before, or no image within the log.
        """
        log = episode.log
        if log.names != self.names:
            raise DenseVSError(
                f"{episode.source.path} has the joints {', '.join(log.names)}; expected {', '.join(self.names)} as "
                "before"
            )
        images = episode.images()
        size = round(images.height * scale), round(images.width * scale)
        if min(size) < LEAST_SIDE:
            raise DenseVSError(
                f"{episode.source.path} has images of {size[1]} x {size[0]} px at --scale {scale:g}; expected at least "
                f"{LEAST_SIDE} px a side"
            )
        if self.images and self.images[0].shape != size:
            height, width = self.images[0].shape
            raise DenseVSError(
                f"{episode.source.path} has images of {size[1]} x {size[0]} px; expected {width} x {height} as before"
            )
        smooth, first = log.smoothed(JOINT_SMOOTHING), len(self.images)
        for found in DistinctImages(((frame.image, frame.time) for frame in episode), images.fps):
            used = smooth if found.evened else log
            self.begins.append(found.after_gap or len(self.images) == first)
            self.joints.append(used.at(np.clip([found.time], log.times[0], log.times[-1]))[0])
            self.images.append(_scaled(found.gray, size))
            self.last = _scaled(found.image, size)
        if len(self.images) == first:
            raise DenseVSError(f"episode {episode.number} of {episode.source.path} has no image within its joint log")
        self.starts.append(first)
        seen = recorded_excitation(episode, images.fps).learned
        self.learned = seen if first == 0 else self.learned | seen

    def steps(self, begin: int, end: int) -> Iterator[tuple[int, np.ndarray]]:
        """Images from one index to before another whose motion is known, with their joint step ``(N,)`` [rad]."""
        for k in range(begin, end):
            if not self.begins[k]:
                yield k, self.joints[k] - self.joints[k - 1]

    def cut(self, share: float) -> int:
        """Index of the first image to hold out: about the last share, whole episodes where there are several."""
        index = round((1 - share) * len(self.images))
        if len(self.starts) == 1 or share == 0:
            return index
        return min(self.starts[1:], key=lambda start: abs(start - index))


def read_recordings(arguments: argparse.Namespace) -> SeenBody:
    """The images and joints of all recordings and episodes that the arguments name.

    Raises:
        DenseVSError: what cannot be read, or does not fit together.
    """
    scale = check_number("--scale", arguments.scale, above=0, most=1)
    names = arguments.joint_names.split(",") if arguments.joint_names else None
    seen = None
    for path, log in recording_paths(arguments.recordings):
        recording = open_recording(path, log, episode=arguments.episode, camera=arguments.camera, joint_names=names)
        chosen = episode_numbers(arguments.episodes, recording.episodes) if arguments.episodes else [None]
        for number in chosen:
            seen = seen or SeenBody(recording.joint_names)
            seen.add(_on_one_clock(recording.episode(number), arguments.time_offset), scale)
    assert seen is not None
    return seen


def recording_paths(words: list[Path]) -> list[tuple[Path, Path | None]]:
    """Recordings with their joint logs: a CSV file belongs to the video or folder before it.

    Raises:
        DenseVSError: a CSV file with nothing before it.
    """
    found: list[tuple[Path, Path | None]] = []
    for word in words:
        if word.suffix.lower() != ".csv":
            found.append((word, None))
        elif found and found[-1][1] is None:
            found[-1] = found[-1][0], word
        else:
            raise DenseVSError(f"{word} is a joint log without a recording; expected RECORDING JOINTS.csv, in turns")
    return found


def _on_one_clock(episode: Episode, offset: str) -> Episode:
    if offset == "auto":
        with progress(f"clock, episode {episode.number}", episode.images().frame_count) as bar:
            return episode.shifted(survey_episode(episode, on_image=bar.update).offset)
    try:
        return episode.shifted(float(offset))
    except ValueError:
        raise DenseVSError(f"--time-offset is {offset!r}; expected auto or seconds") from None


def _scaled(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return image if image.shape[:2] == size else cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
