"""Which code runs: a digest of the package's own files, which changes with any of them."""

import hashlib
from functools import cache
from importlib import import_module
from pathlib import Path

_PACKAGES = ("dense_vs", "dense_vs.kernels", "dense_vs.sims")
_KINDS = {".py", ".npz", ".onnx", ".xml"}


@cache
def source_version() -> str:
    """Sixteen hexadecimal digits that stand for all code and learned weights of the installed package."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        home = import_module(package).__file__
        assert home is not None  # packages with an __init__
        folder = Path(home).parent
        for file in sorted(folder.rglob("*")):
            if file.suffix in _KINDS and "__pycache__" not in file.parts:
                digest.update(f"{package}/{file.relative_to(folder).as_posix()}".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
