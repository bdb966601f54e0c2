"""Scoring depth from masks on the ODMS benchmark (Griffin and Corso, ECCV 2020), by the published protocol.

A set is a file of mask sequences of an approaching camera, nearest view first. A robot sequence of 30 views gives 55
examples: for each length n of 10, 15, 20, 25 and 30 and each first view i of 0 .. 30 - n, the ten views
``linspace(i, i + n - 1, 10)``. A sequence of the other sets gives one: all its views, or ten spread evenly where there
are more. The score is the mean absolute relative error of the distance at the example's nearest view.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dense_vs.depth.mask_fit import Method, depth_from_regions
from dense_vs.depth.region_shape import RegionShape, mask_regions
from dense_vs.errors import DenseVSError
from dense_vs.files import file_path, read_arrays, stored_array

SETS = ("robot", "driving", "normal", "perturb")
VIEWS = 10  # of an example
_fields = ("sequence", "start", "height_width", "mask_bits", "camera_back", "depth")


@dataclass(frozen=True)
class Sequence:
    """A recorded approach.

    Attributes:
        name: of the recording.
        masks: ``(m, H, W)`` uint8, nearest view first.
        camera_back: ``(m,)`` [m].
        depth: ``(m,)`` true distances [m]; NaN where a recording does not tell it.
    """

    name: str
    masks: np.ndarray
    camera_back: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True)
class ExampleResult:
    """One scored example.

    Attributes:
        sequence: its name.
        views: indices of its views in the sequence.
        estimate: [m]; NaN where the method raised, which counts as an error of 100 %.
        truth: [m].
        failure: the error's message, empty where there was none.
        within: whether the method's interval held the truth; False where it gave none.
    """

    sequence: str
    views: tuple[int, ...]
    estimate: float
    truth: float
    failure: str
    within: bool

    @property
    def relative_error(self) -> float:
        """\\|estimate - truth\\| / truth."""
        return 1.0 if self.failure else abs(self.estimate - self.truth) / self.truth


def read_sequences(path: str | os.PathLike[str]) -> Iterator[Sequence]:
    """The sequences of a file, unpacked one at a time.

    Raises:
        DenseVSError: not such a file, or arrays that do not fit together.
    """
    content = read_arrays(path, "an ODMS set", _fields)
    missing = [name for name in _fields if name not in content]
    if missing:
        raise DenseVSError(f"{path} lacks {', '.join(missing)}; expected the arrays {', '.join(_fields)}")
    try:
        height, width = (int(n) for n in stored_array(content, "height_width", (2,), "iu"))
        names = stored_array(content, "sequence", (-1,), "U")
        start = stored_array(content, "start", (len(names) + 1,), "iu").astype(np.int64)
        if min(height, width) < 1 or start[0] != 0 or (np.diff(start) < 1).any():
            raise DenseVSError("its sequences are empty or its masks have no pixels")
        views = int(start[-1])
        bits = stored_array(content, "mask_bits", (views, -(-height * width // 8)), "u")
        depth = stored_array(content, "depth", (views,), finite=False)
        if bits.dtype != np.uint8 or (depth <= 0).any() or np.isinf(depth).any():
            raise DenseVSError("its masks are no bits, or a true distance is not above 0 and finite")
        stored_array(content, "camera_back", (views,))
    except DenseVSError as error:
        raise DenseVSError(f"{path} is damaged: {error}") from error
    for name, first, last in zip(content["sequence"], start[:-1], start[1:], strict=True):
        masks = np.unpackbits(bits[first:last], axis=1)[:, : height * width].reshape(-1, height, width)
        back = content["camera_back"][first:last].astype(np.float64)
        yield Sequence(str(name), masks, back, content["depth"][first:last].astype(np.float64))


def example_views(set_name: str, views: int) -> list[np.ndarray]:
    """The views of each example that a sequence of so many views gives in a set of this name."""
    if set_name == "robot":
        lengths = [n for n in (10, 15, 20, 25, 30) if n <= views]
        firsts = [(i, n) for n in lengths for i in range(views - n + 1)]
        return [np.linspace(i, i + n - 1, VIEWS, dtype=int) for i, n in firsts]
    return [np.arange(views) if views <= VIEWS else np.linspace(0, views - 1, VIEWS, dtype=int)]


def score_sequence(set_name: str, sequence: Sequence, methods: tuple[Method, ...]) -> dict[str, list[ExampleResult]]:
    """Every example of a sequence by every method, but for those whose true distance is not known."""
    regions = mask_regions(sequence.masks)
    image_size = (sequence.masks.shape[1], sequence.masks.shape[2])
    known = np.isfinite(sequence.depth)
    examples = [views for views in example_views(set_name, len(regions)) if known[_nearest(sequence, views)]]
    return {method: [_score(regions, sequence, views, image_size, method) for views in examples] for method in methods}


def set_paths(folder: str | os.PathLike[str], sets: tuple[str, ...] = SETS) -> dict[str, Path]:
    """The files of the sets in a folder.

    Raises:
        DenseVSError: the folder holds none of them.
    """
    found = {name: file_path(folder) / f"{name}.npz" for name in sets}
    found = {name: path for name, path in found.items() if path.is_file()}
    if not found:
        raise DenseVSError(f"{folder} holds no ODMS set; expected some of {', '.join(f'{name}.npz' for name in sets)}")
    return found


def _nearest(sequence: Sequence, views: np.ndarray) -> int:
    """Of some views, the one whose distance is asked for."""
    return int(views[np.argmin(sequence.camera_back[views])])


def _score(
    regions: list[list[RegionShape]], sequence: Sequence, views: np.ndarray, image_size: tuple[int, int], method: Method
) -> ExampleResult:
    back, truth = sequence.camera_back[views], float(sequence.depth[_nearest(sequence, views)])
    try:
        found = depth_from_regions([regions[view] for view in views], back, image_size, method)
    except DenseVSError as error:
        return ExampleResult(sequence.name, tuple(views.tolist()), float("nan"), truth, str(error), False)
    within = found.interval[0] <= truth <= found.interval[1]
    return ExampleResult(sequence.name, tuple(views.tolist()), found.distance, truth, "", within)
