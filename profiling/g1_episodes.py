"""The real humanoid's recordings for ``real_robot.py``, and what was marked by hand in them.

The recordings are read by the product from ``../shared/data/g1_reach`` (LeRobot v2.1); nothing of them is copied here
but the marks, which are ours.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "g1_reach"
MARKS = Path(__file__).with_name("g1_annotations.json")
TUNED, CONFIRMED = (5, 20, 37), (10, 28, 43)
ARM, ARM_AND_HAND = ["kRight[SEW]*"], ["kRight*"]
FPS = 30.0  # rows a second of the log
SIZE = (240, 320)


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
