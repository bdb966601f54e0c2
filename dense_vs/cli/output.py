"""What commands print and write: progress, tables, JSON, versions."""

import json
import math
import platform
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.files import atomic_write


class _Silent:
    """Stands in for a progress bar where tqdm is not installed."""

    def update(self, _: int = 1) -> None:
        pass

    def set_description(self, _: str) -> None:
        pass

    def __enter__(self) -> "_Silent":
        return self

    def __exit__(self, *_: object) -> None:
        pass


def progress(description: str, total: int | None = None, unit: str = "frame") -> Any:
    """A progress bar on stderr, to be used as a context manager; ``update()`` after every step."""
    try:
        from tqdm import tqdm
    except ImportError:
        return _Silent()
    every = 0.1 if sys.stderr.isatty() else 10.0  # seconds; a log needs few lines
    return tqdm(total=total or None, desc=description, unit=unit, mininterval=every, dynamic_ncols=True)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under a header, columns aligned right."""
    cells = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file, whole or not at all; NumPy's numbers are welcome, and what JSON has no form for, as NaN,
    becomes null.
    """
    text = json.dumps(_plain(content), indent=2, allow_nan=False)
    with atomic_write(path, "w") as stream:
        stream.write(text)
        stream.write("\n")


def _plain(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _plain(value) for name, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_plain(value) for value in content]
    if isinstance(content, np.generic):
        content = content.item()
    return None if isinstance(content, float) and not math.isfinite(content) else content


def note_first_run() -> None:
    """Say so where no kernel has been compiled yet, as the first progress then waits for the compiler."""
    import warp as wp

    wp.init()
    folder = Path(str(wp.config.kernel_cache_dir))
    if not folder.is_dir() or not any(folder.iterdir()):
        print("first run: compiling kernels, which takes up to half a minute", flush=True)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the results, as far as installed."""
    found = {"python": platform.python_version()}
    for package in ("dense-vs", "warp-lang", "numpy", "opencv-python-headless", "mujoco", "mujoco-warp"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
