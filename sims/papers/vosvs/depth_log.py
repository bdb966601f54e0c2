"""``dense-vs reproduce vosvs depth-log``: VOS-DE (20) on the recorded approach to the sugar box (VOS-VS, Fig. 6).

The log is a CSV file with the columns mask_area_px and camera_z_m, a row a view. The figure shows the estimate after
every view, and the linear relation VOS-VS (18) between camera height and the inverse square root of the area.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.depth import DepthEstimate, DepthUnobservableError, depth_from_areas
from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.sims.papers.rows import Row
from dense_vs.view.canvas import new_figure, save_figure
from dense_vs.view.progress import progress

LOG = Path("../shared/data/sugar_box_approach.csv")
COLUMNS = ("mask_area_px", "camera_z_m")
MOST_BYTES = 64 << 20  # of a log, which is read whole
PUBLISHED_Z = 0.17978791  # m, the authors' least-squares answer after the last view of this log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's own arguments."""
    parser.add_argument(
        "--log",
        type=Path,
        default=LOG,
        metavar="CSV",
        help="areas and camera heights of one approach (default: %(default)s)",
    )


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment. The log is a recording: nothing in it depends on a seed."""
    areas, camera_z = read_log(arguments.log)
    estimates: list[DepthEstimate | None] = []
    with progress("depth", len(areas), unit="view") as bar:
        for views in range(1, len(areas) + 1):
            estimates.append(_estimate(areas[:views], camera_z[:views]))
            bar.update()
    final = depth_from_areas(areas, camera_z)
    _draw(areas, camera_z, estimates, arguments.out / "depth_log.png")
    halfway = estimates[(len(areas) - 1) // 2]
    published = PUBLISHED_Z if arguments.log.name == LOG.name else None
    rows = [Row("z_object", published, final.z_object, "m", ())]
    if published is not None:
        rows.append(Row("difference from the published z_object", None, abs(final.z_object - published), "m", ()))
    rows += [
        Row("standard error of z_object", None, final.distance_std, "m", ()),
        Row("c_object", None, final.c_object, "m px", ()),
        Row("distance at the last view", None, float(camera_z[-1]) - final.z_object, "m", ()),
        Row("views", None, float(len(areas)), "", ()),
    ]
    if halfway is not None:
        rows.append(Row("z_object after half of the views", None, halfway.z_object, "m", ()))
    return rows


def read_log(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Areas [px] and camera positions [m] of a log.

    Raises:
        DenseVSError: missing, or not such a file.
    """
    expected = f"a CSV file with the columns {','.join(COLUMNS)} (--log names another file)"
    path = input_file(path, most=MOST_BYTES)
    try:
        with open(path, encoding="utf-8") as stream:
            header = tuple(name.strip() for name in stream.readline().split(","))
            table = np.loadtxt(stream, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise DenseVSError(f"cannot read {path}: {error}; expected {expected}") from error
    if header != COLUMNS or table.shape[1:] != (2,):
        raise DenseVSError(f"{path} has the columns {','.join(header)}; expected {expected}")
    return table[:, 0], table[:, 1]


def _estimate(areas: np.ndarray, camera_z: np.ndarray) -> DepthEstimate | None:
    try:
        return depth_from_areas(areas, camera_z)
    except DepthUnobservableError:
        return None


def _draw(areas: np.ndarray, camera_z: np.ndarray, estimates: list[DepthEstimate | None], path: Path) -> None:
    final: Any = estimates[-1]
    figure = new_figure(10, 4)
    left, right = figure.subplots(1, 2)
    shown = [(k, e.z_object, e.distance_std) for k, e in enumerate(estimates, 1) if e is not None]
    views, z, spread = (np.array(column) for column in zip(*shown, strict=True))
    bounded = np.isfinite(spread)
    left.fill_between(views[bounded], (z - spread)[bounded], (z + spread)[bounded], alpha=0.25, label="standard error")
    left.plot(views, z, label="z object (20)")
    left.plot(np.arange(1, len(camera_z) + 1), camera_z, "k--", label="z camera")
    left.set(xlabel="views", ylabel="z [m]", title="Estimate after each view", ylim=(0.0, 1.1 * camera_z.max()))
    left.legend()
    seen = areas > 0
    inverse = 1.0 / np.sqrt(areas[seen])
    right.plot(inverse, camera_z[seen], "o", label="views")
    line = np.array([0.0, inverse.max()])
    right.plot(line, final.z_object + final.c_object * line, label="z object + c object / sqrt(area)")
    right.set(xlabel="1 / sqrt(mask area) [1/px]", ylabel="z camera [m]", title="Linear relation (18)")
    right.locator_params(axis="x", nbins=5)
    right.legend()
    save_figure(figure, path)
