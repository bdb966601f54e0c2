"""One form for everything that is measured: a named number with its unit, printed as a table, written as JSON."""

import argparse
import json
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import warp as wp

from dense_vs.cli.output import table
from dense_vs.files import atomic_write
from dense_vs.kernels.launch import available_cores

PACKAGES = (
    "dense-vs",
    "mujoco",
    "mujoco-warp",
    "numpy",
    "opencv-python-headless",
    "scipy",
    "taichi",
    "warp-lang",
)


@dataclass(frozen=True)
class Metric:
    """One measured figure.

    Attributes:
        name: what it is, the same in every run.
        value: the figure.
        unit: ``"ms"``, ``"fps"``, ``"px"``, ``"x"`` (a ratio).
        better: which way is better.
        tolerance: share of the value that two runs on one quiet machine may differ by.
    """

    name: str
    value: float
    unit: str
    better: Literal["higher", "lower"]
    tolerance: float = 0.1


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    """Give a command the option ``--json FILE``."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the metrics here")


def report(metrics: Sequence[Metric], json_path: Path | None) -> None:
    """Print the metrics; write them to ``json_path`` with machine, versions and date, where one is given."""
    rows = [[m.name, f"{m.value:.4g}", m.unit, m.better] for m in metrics]
    print("\n" + table(("metric", "value", "unit", "better"), rows))
    if json_path is not None:
        content = {**_header(), "metrics": [asdict(metric) for metric in metrics]}
        with atomic_write(json_path, "w") as stream:
            json.dump(content, stream, indent=2)
            stream.write("\n")


def _header() -> dict[str, Any]:
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {
            "cpu": _cpu_name(),
            "cores": available_cores(),
            "gpus": [device.name for device in wp.get_cuda_devices()],
            "system": platform.platform(),
        },
        "versions": versions,
    }


def _cpu_name() -> str:
    """The processor's model where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
