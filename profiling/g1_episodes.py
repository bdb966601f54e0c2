"""Episodes of a real humanoid for ``real_robot.py``: distinct images, joints, and what was marked by hand.

Read from ``../shared/data/g1_reach`` (LeRobot v2.1); nothing of it is copied here but the marks, which are ours.
"""

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dense_vs.recording.image_clock import even_stamps, smoothed

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "g1_reach"
MARKS = Path(__file__).with_name("g1_annotations.json")
TUNED, CONFIRMED = (5, 20, 37), (10, 28, 43)
ARM, HAND = list(range(7, 14)), list(range(20, 26))
SIZE = (240, 320)
LATENCY = 3.0  # log rows that an image is older than the joints in its row; found on the tuned episodes
SMOOTHING = 1.5  # log rows


@dataclass(frozen=True)
class Episode:
    """The distinct images of an episode and the joints when they were taken.

    Attributes:
        number: of the episode.
        rows: ``(T,)``, log row in which each image first appears.
        images: ``(T, 480, 640, 3)`` uint8 RGB.
        gray: ``(T, 240, 320)`` uint8.
        flow: ``(T - 1, 240, 320, 2)``, the judge: OpenCV's DIS medium between neighbors [px].
        joints: ``(T, 26)`` when the images were taken, by their even stamps; ``joints_as_logged`` in the same rows.
    """

    number: int
    rows: np.ndarray
    images: np.ndarray
    gray: np.ndarray
    flow: np.ndarray
    joints: np.ndarray
    joints_as_logged: np.ndarray


def read_episode(number: int) -> Episode:
    """Read and prepare an episode."""
    import av
    from pyarrow import parquet

    name = f"episode_{number:06d}"
    with av.open(str(DATA / "videos/chunk-000/observation.images.cam_high" / f"{name}.mp4")) as video:
        images = np.stack([frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)])
    table = parquet.read_table(DATA / "data/chunk-000" / f"{name}.parquet")
    log = np.array(table["observation.state"].to_pylist(), dtype=np.float64)
    size = SIZE[::-1]
    gray = np.stack(
        [cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY) for image in images]
    )
    rows = distinct(gray)
    judge = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    calculate: Any = judge.calc  # its stubs want an array where None means to begin from nothing
    flow = [-calculate(gray[now], gray[before], None) for before, now in pairwise(rows)]
    taken = np.clip(even_stamps(rows.astype(float)) - LATENCY, 0, len(log) - 1)
    even = smoothed(log, SMOOTHING)
    joints = np.stack([np.interp(taken, np.arange(len(log)), column) for column in even.T], axis=1)
    return Episode(number, rows, images[rows], gray[rows], np.stack(flow), joints, log[rows])


def distinct(gray: np.ndarray) -> np.ndarray:
    """Rows whose image is not the one before it again, identical or encoded anew.

    A repetition differs by its encoding only: the blocks that changed most changed by less than half of what those of
    its neighbors did.
    """
    count, height, width = gray.shape
    change = np.abs(np.diff(gray.astype(np.float32), axis=0))
    blocks = change.reshape(count - 1, height // 8, 8, width // 8, 8).mean(axis=(2, 4)).reshape(count - 1, -1)
    most = np.sort(blocks, axis=1)[:, -12:].mean(axis=1)
    neighbors = np.pad(most, 1)
    around = np.maximum(neighbors[:-2], neighbors[2:])
    repeated = (most < 0.2) | ((most < 4.5) & (most < 0.5 * around))
    return np.concatenate([[0], 1 + np.flatnonzero(~repeated)])


def marked_masks(number: int) -> dict[int, np.ndarray]:
    """Masks of the right arm and hand by row, bool ``(240, 320)``."""
    masks = {}
    for mark in json.loads(MARKS.read_text())["masks"]:
        if mark["episode"] == number:
            whole = np.zeros((480, 640), np.uint8)
            cv2.fillPoly(whole, [np.array(mark["polygon"], np.int32)], 1)
            masks[mark["frame"]] = cv2.resize(255 * whole, SIZE[::-1], interpolation=cv2.INTER_AREA) > 127
    return masks


def marked_points() -> list[dict[str, Any]]:
    """Points of the hand: episode, rows, and positions [px at 640x480]."""
    return json.loads(MARKS.read_text())["points"]
