"""Pictures that the experiments share: an image with the mask's outline, and a grid of labeled images."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from dense_vs.files import atomic_write, output_folder

TILE = (320, 240)


def outlined(image: np.ndarray, mask: np.ndarray, target: Sequence[float] | None = None) -> np.ndarray:
    """A copy of an RGB image with the outline of a mask, and a cross at a target."""
    view = image.copy()
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(view, outlines, -1, (255, 0, 255), 2)
    if target is not None:
        cv2.drawMarker(view, (round(target[0]), round(target[1])), (0, 255, 0), cv2.MARKER_CROSS, 30, 3)
    return view


def write_tiles(tiles: Sequence[tuple[str, np.ndarray]], path: Path, *, columns: int = 4) -> None:
    """Write labeled RGB images as one PNG."""
    cells = []
    for label, image in tiles:
        cell = cv2.resize(image, TILE, interpolation=cv2.INTER_AREA)
        cv2.rectangle(cell, (0, 0), (TILE[0], 18), (0, 0, 0), -1)
        cv2.putText(cell, label, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 1, cv2.LINE_AA)
        cells.append(cell)
    if not cells:
        return
    while len(cells) % columns:
        cells.append(np.full_like(cells[0], 255))
    grid = np.vstack([np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)])
    _write_png(cv2.cvtColor(grid, cv2.COLOR_RGB2BGR), path)


class KeptImages:
    """Writes images and their masks one by one, to be looked at; nothing without a folder.

    Args:
        folder: made where missing; None keeps nothing.
    """

    def __init__(self, folder: Path | None):
        self._folder = None if folder is None else output_folder(folder)
        self._counts: Counter[str] = Counter()

    def add(self, name: str, image: np.ndarray, mask: np.ndarray) -> None:
        """Write ``NAME_000.png`` (RGB uint8 ``(H, W, 3)``) and ``NAME_000_mask.png``, then ``_001``, and so on."""
        if self._folder is None:
            return
        stem = f"{name.replace(' ', '-')}_{self._counts[name]:03d}"
        self._counts[name] += 1
        _write_png(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), self._folder / f"{stem}.png")
        _write_png(255 * mask.astype(np.uint8), self._folder / f"{stem}_mask.png")


def _write_png(image: np.ndarray, path: Path) -> None:
    encoded = cv2.imencode(".png", image)[1]
    with atomic_write(path) as stream:
        stream.write(encoded.tobytes())
