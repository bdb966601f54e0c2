"""Files that are whole or absent: written beside their place and moved there when complete, read without pickle."""

import json
import math
import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from dense_vs.errors import DenseVSError


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a temporary file that replaces ``path`` when the block ends without an error.

    Raises:
        DenseVSError: the folder is missing or not writable, or the disk is full; what was there stays.
    """
    path = Path(path)
    encoding = None if "b" in mode else "utf-8"
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise DenseVSError(f"cannot write {path}: {error.strerror or error}") from error
    try:
        with os.fdopen(handle, mode, encoding=encoding) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)  # mkstemp makes files that only their owner can read
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise DenseVSError(f"cannot write {path}: {error.strerror or error}") from error
        raise


def read_arrays(path: str | os.PathLike[str], what: str) -> dict[str, np.ndarray]:
    """The arrays of an ``.npz`` file by name.

    Args:
        path: of the file.
        what: the file is taken for, for the error.

    Raises:
        DenseVSError: missing, not such a file, truncated, damaged or with pickled objects.
    """
    try:
        with open(path, "rb") as stream:
            stored = np.load(stream, allow_pickle=False)
            if isinstance(stored, np.ndarray):
                raise ValueError("it holds a single array")
            with stored:
                return {name: stored[name] for name in stored.files}
    # NotImplementedError is zipfile's word for a compression that it does not know.
    except (OSError, ValueError, KeyError, EOFError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise DenseVSError(f"cannot read {path} as {what}: {error}") from error


def output_folder(path: str | os.PathLike[str]) -> Path:
    """The folder, made if it is not there.

    Raises:
        DenseVSError: it is a file or cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DenseVSError(f"cannot make the folder {folder}: {error.strerror or error}") from error
    return folder


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
