"""Arguments of the commands that read a recording."""

import argparse
from pathlib import Path

from dense_vs.errors import DenseVSError
from dense_vs.recording import Recording, open_recording


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """``PATH``, ``JOINTS.csv``, ``--episode``, ``--camera`` and ``--joints``."""
    parser.add_argument("path", type=Path, metavar="PATH", help="video, LeRobot folder, ROS bag or folder of images")
    parser.add_argument(
        "joints",
        type=Path,
        nargs="?",
        metavar="JOINTS.csv",
        help="joint log of a video or a folder of images: time [s] first, then one named joint a column",
    )
    parser.add_argument("--episode", type=int, metavar="N", help="episode of the recording (default: the first)")
    parser.add_argument("--camera", metavar="NAME", help="camera of the recording (default: the first)")
    parser.add_argument(
        "--joints", dest="joint_names", metavar="A,B", help="joints to use, patterns as 'kRight*' too (default: all)"
    )


def open_chosen(arguments: argparse.Namespace) -> Recording:
    """The recording that the arguments name."""
    names = arguments.joint_names.split(",") if arguments.joint_names else None
    return open_recording(
        arguments.path, arguments.joints, episode=arguments.episode, camera=arguments.camera, joint_names=names
    )


def episode_numbers(text: str, present: tuple[int, ...]) -> list[int]:
    """Numbers of the episodes in ``A:B`` that are there; ``all`` stands for all of them.

    Raises:
        DenseVSError: not two numbers, or none of them there.
    """
    if text == "all":
        return list(present)
    first, colon, end = text.partition(":")
    try:
        low, high = int(first or 0), int(end) if end else max(present) + 1
    except ValueError:
        low = high = 0
    chosen = [number for number in present if low <= number < high]
    if not colon or not chosen:
        shown = ", ".join(str(number) for number in present[:20])
        raise DenseVSError(f"--episodes is {text!r}; expected all, or A:B with some of the episodes {shown} in it")
    return chosen
