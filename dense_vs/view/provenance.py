"""What a result was made with, written beside it."""

import platform
from importlib import metadata


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the results, as far as installed."""
    found = {"python": platform.python_version()}
    for package in ("dense-vs", "warp-lang", "numpy", "opencv-python-headless", "mujoco", "mujoco-warp"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
