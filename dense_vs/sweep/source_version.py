"""Which code runs: a digest of the packages' own files, which changes with any of them."""

import hashlib
from functools import cache
from importlib import import_module, metadata
from pathlib import Path

_PACKAGES = ("dense_vs", "dense_vs.kernels")
_ADDED = "dense_vs.commands"  # entry points of packages with commands of their own
_KINDS = {".py", ".npz", ".onnx", ".xml"}


@cache
def source_version() -> str:
    """Sixteen hexadecimal digits that stand for all code and learned weights behind the program's commands."""
    digest = hashlib.sha256()
    homes = [entry_point.module.split(".") for entry_point in metadata.entry_points(group=_ADDED)]
    added = {".".join(home[: 2 if home[0] == "dense_vs" else 1]) for home in homes}
    for package in (*_PACKAGES, *sorted(added)):
        home = import_module(package).__file__
        assert home is not None  # packages with an __init__
        folder = Path(home).parent
        for file in sorted(folder.rglob("*")):
            if file.suffix in _KINDS and "__pycache__" not in file.parts:
                digest.update(f"{package}/{file.relative_to(folder).as_posix()}".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
