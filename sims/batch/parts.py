"""Files of a batch run: each process writes those of its own worlds, any process reads the worlds that it wants.

A file is whole or absent and holds worlds ``first`` to ``first + count - 1`` of a case. Worlds are independent, so
parts that other numbers of processes wrote, also at other frames, go together: of each world the latest counts.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, output_folder, read_arrays, stored_array
from dense_vs.sims.batch.batch_state import FRAMES
from dense_vs.sims.batch.case import BatchCase
from dense_vs.sims.batch.episode import ENDS, BatchResults

CHECKPOINT, RESULTS = "checkpoint", "results"
_NAME = re.compile(r"(\d+)-(\d+)\.npz")
_CASE = "case"


def write_part(folder: Path, kind: str, case: BatchCase, first: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays (count, ...) of the worlds from ``first`` on.

    Raises:
        DenseVSError: the folder cannot be written.
    """
    worlds = len(arrays[FRAMES])
    path = output_folder(folder / kind) / f"{first:07d}-{first + worlds:07d}.npz"
    with atomic_write(path) as stream:
        # NumPy's stub takes the names of arrays for options.
        np.savez(stream, **{_CASE: np.array(case.key())}, **arrays)  # pyright: ignore[reportArgumentType]


def read_worlds(folder: Path, kind: str, case: BatchCase, worlds: Sequence[int]) -> dict[str, np.ndarray] | None:
    """Arrays of these worlds, the latest of each; None where one is in no file.

    Raises:
        DenseVSError: files of another case, or damaged ones.
    """
    wanted = np.asarray(worlds)
    source, row, latest = (np.full(len(wanted), value) for value in (-1, 0, -1))
    parts = _parts(folder / kind)
    for number, (path, first, end) in enumerate(parts):
        here = (wanted >= first) & (wanted < end)
        if not here.any():
            continue
        head = _read(path, case, {_CASE, FRAMES})
        frames = head[FRAMES]
        if frames.shape != (end - first,):
            raise DenseVSError(f"{path} holds {FRAMES} of shape {frames.shape}; expected {(end - first,)}")
        rows = np.where(here, wanted - first, 0)
        later = here & (frames[rows] > latest)
        source[later], row[later], latest[later] = number, rows[later], frames[rows[later]]
    if (source < 0).any():
        return None
    joined: dict[str, np.ndarray] = {}
    for number in np.unique(source):
        arrays = _read(parts[number][0], case, None)
        chosen = source == number
        for name, array in arrays.items():
            if name not in joined:
                joined[name] = np.empty((len(wanted), *array.shape[1:]), dtype=array.dtype)
            if joined[name].shape[1:] != array.shape[1:] or len(array) != parts[number][2] - parts[number][1]:
                raise DenseVSError(
                    f"{parts[number][0]} holds {name} of shape {array.shape}, unlike the files beside it"
                )
            joined[name][chosen] = array[row[chosen]]
    return joined


def result_arrays(results: BatchResults, frames: int) -> dict[str, np.ndarray]:
    """Results after that many frames as arrays for :func:`write_part`."""
    outcome = np.array([[ENDS.index(end) for end in row] for row in results.outcome])
    return {**vars(results), "outcome": outcome, FRAMES: np.full(len(outcome), frames)}


def results_of(arrays: Mapping[str, np.ndarray]) -> BatchResults:
    """What :func:`result_arrays` stored.

    Raises:
        DenseVSError: an array is missing or is not what it should be.
    """
    worlds = len(arrays[FRAMES])
    outcome = stored_array(arrays, "outcome", (worlds, -1), "i")
    if not ((outcome >= 0) & (outcome < len(ENDS))).all():
        raise DenseVSError(f"outcome holds {outcome.min()} to {outcome.max()}; expected 0 to {len(ENDS) - 1}")
    return BatchResults(
        outcome=np.array(ENDS, dtype=object)[outcome],
        frames=stored_array(arrays, "frames", outcome.shape, "i"),
        error_px=stored_array(arrays, "error_px", outcome.shape, finite=False),
        true_error_px=stored_array(arrays, "true_error_px", outcome.shape, finite=False),
        restarts=stored_array(arrays, "restarts", (worlds,), "i"),
    )


def _parts(folder: Path) -> list[tuple[Path, int, int]]:
    found = []
    for path in sorted(folder.glob("*.npz")) if folder.is_dir() else []:
        match = _NAME.fullmatch(path.name)
        if match:
            found.append((path, int(match[1]), int(match[2])))
    return found


def _read(path: Path, case: BatchCase, names: set[str] | None) -> dict[str, np.ndarray]:
    arrays = read_arrays(path, "a part of a batch run", names)
    key = str(arrays.pop(_CASE, ""))
    if key != case.key():
        raise DenseVSError(f"{path} is of another run{_difference(key, case)}; expected one of the same case")
    return arrays


def _difference(key: str, case: BatchCase) -> str:
    """First option that differs, in words."""
    try:
        theirs, ours = json.loads(key), json.loads(case.key())
        names = [name for name in ours if theirs.get(name) != ours[name]]
        return f" with {names[0]} {theirs.get(names[0])} in place of {ours[names[0]]}"
    except (ValueError, AttributeError, IndexError):
        return ""
