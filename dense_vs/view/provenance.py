"""Where a result comes from, written beside it: date, commit, arguments, machine and versions."""

import argparse
import os
import platform
import shutil
import subprocess
from collections.abc import Collection
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import warp as wp

from dense_vs.kernels.launch import available_cores

PACKAGES = (
    "dense-vs",
    "mujoco",
    "mujoco-warp",
    "numpy",
    "onnxruntime",
    "opencv-python-headless",
    "scikit-learn",
    "scipy",
    "taichi",
    "torch",
    "warp-lang",
)
_CACHES = Path("/sys/devices/system/cpu/cpu0/cache")


def provenance(arguments: argparse.Namespace, leave_out: Collection[str] = ()) -> dict[str, Any]:
    """Date (UTC), commit, arguments, machine and versions, as JSON takes them.

    Args:
        arguments: what the program was told; what JSON has no form for, as a function, is left out.
        leave_out: names of arguments that are no part of the result's origin, as a file to write.
    """
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "arguments": told(arguments, leave_out),
        "machine": machine(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the results, as far as installed."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str | None:
    """Commit of the source that runs, with ``+changes`` where tracked files differ.

    Outside of a checkout, what the environment variable ``DENSE_VS_COMMIT`` says, as whoever built a wheel knows what
    from; else None.
    """
    source = Path(__file__)
    # A copy installed into an environment that lies inside some other checkout is not that checkout's.
    if shutil.which("git") is None or _git(source.parent, "ls-files", "--error-unmatch", source.name) is None:
        return os.environ.get("DENSE_VS_COMMIT")
    revision = _git(source.parent, "rev-parse", "HEAD")
    changed = _git(source.parent, "status", "--porcelain", "--untracked-files=no")
    return revision and revision + ("+changes" if changed else "")


def told(arguments: argparse.Namespace, leave_out: Collection[str] = ()) -> dict[str, Any]:
    """Arguments by name, without those left out; of a path the last part, as the rest is this machine's."""
    named = {name: value for name, value in vars(arguments).items() if name not in leave_out}
    named = {name: value.name if isinstance(value, Path) else value for name, value in named.items()}
    return {name: value for name, value in named.items() if isinstance(value, str | int | float | list | None)}


def machine() -> dict[str, Any]:
    """Processor, the cores that may be used, its caches, GPUs and the system."""
    return {
        "cpu": _cpu_name(),
        "cores": available_cores(),
        "caches": _cache_sizes(),
        "gpus": [device.name for device in wp.get_cuda_devices()],
        "system": platform.platform(),
    }


def _git(folder: Path, *arguments: str) -> str | None:
    done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def _cpu_name() -> str:
    """The processor's model where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def _cache_sizes() -> dict[str, str]:
    """Sizes of the first core's caches by name, as ``{"L1 data": "32K"}``, where Linux tells them."""
    sizes = {}
    for index in sorted(_CACHES.glob("index*")):
        try:
            level, kind, size = ((index / name).read_text().strip() for name in ("level", "type", "size"))
        except OSError:
            continue
        sizes[f"L{level}" + ("" if kind == "Unified" else f" {kind.lower()}")] = size
    return sizes
