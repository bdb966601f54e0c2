"""Files that are whole or absent: written beside their place and moved there when complete, read without pickle."""

import errno
import json
import math
import os
import stat
import tempfile
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from dense_vs.checks import LONGEST_SHOWN, shown
from dense_vs.errors import DenseVSError
from dense_vs.memory import free_memory

try:
    import fcntl
except ImportError:  # a system without file locks; what a killed process leaves there stays
    fcntl = None

TEMPORARY = ".partial"
MOST_JSON = 64 << 20  # bytes of a JSON file, which is read whole
KINDS = {"f": "floating-point numbers", "i": "integers", "u": "unsigned integers", "b": "bools", "U": "text"}


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a temporary file that replaces ``path`` when the block ends without an error.

    What a process that was killed while it wrote ``path`` has left there is removed first.

    Raises:
        DenseVSError: the folder is missing or not writable, the disk is full, or the path is a folder, a device or a
            pipe; what was there stays.
    """
    path = file_path(path)
    _check_replaceable(path)
    encoding = None if "b" in mode else "utf-8"
    try:
        _remove_left(path)
        handle, temporary = _temporary(path)
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
            if fcntl is not None:
                os.replace(temporary, path)  # while it is locked: no other process takes it for left behind
        if fcntl is None:
            os.replace(temporary, path)  # some systems do not rename what is open
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise DenseVSError(f"cannot write {path}: {error.strerror or error}") from error
        raise


def check_writable(path: str | os.PathLike[str]) -> None:
    """Find out now whether a file can be written later; nothing is left of the trial.

    Raises:
        DenseVSError: its folder is missing or not writable, its disk is full, or it is a folder, a device or a pipe.
    """
    path = file_path(path)
    _check_replaceable(path)
    try:
        handle, temporary = _temporary(path)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(b"\0")
        finally:
            os.unlink(temporary)
    except OSError as error:
        raise DenseVSError(f"cannot write {path}: {error.strerror or error}") from error


def file_path(path: Any) -> Path:
    """A path as :class:`pathlib.Path`.

    Raises:
        DenseVSError: no path, or one that no system can have.
    """
    try:
        named = Path(os.fsdecode(path))
        os.lstat(named)
    except (TypeError, ValueError) as error:
        raise DenseVSError(f"path is a {type(path).__name__}; expected a file's path ({error})") from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise DenseVSError(f"path {shown(path)} of {len(os.fsdecode(path))} characters is too long") from error
    return named


def input_file(path: str | os.PathLike[str], what: str = "", *, most: int | None = None) -> Path:
    """The path of a file that is about to be read, as :class:`pathlib.Path`.

    A pipe would be waited for and a device read without end. What is not there, is a folder or may not be looked at is
    left to the reader to say.

    Args:
        path: of the file.
        what: the file is taken for, for the error.
        most: bytes that the reader takes, where it holds the whole file in memory.

    Raises:
        DenseVSError: no path, a device, a pipe or a socket, or a larger file.
    """
    path = file_path(path)
    try:
        found = os.stat(path)
    except OSError:
        return path
    cannot = f"cannot read {path} as {what}" if what else f"cannot read {path}"
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        raise DenseVSError(
            f"{cannot}: it is not a regular file but a device or a pipe, as /dev/stdin and a shell's <(...) "
            "are; expected a file on a disk"
        )
    if most is not None and stat.S_ISREG(found.st_mode) and found.st_size > most:
        raise DenseVSError(f"{cannot}: it has {found.st_size} bytes; expected at most {most}")
    return path


def _check_replaceable(path: Path) -> None:
    """Refuse a path that a file cannot take the place of: moved there, it would put an end to a device."""
    try:
        if path.is_dir():
            raise DenseVSError(f"cannot write {path}: it is a folder")
        if path.exists() and not path.is_file():
            raise DenseVSError(f"cannot write {path}: it is a device or a pipe; expected a file's name")
    except OSError:
        return  # its folder cannot be looked into, which writing will say


def _temporary(path: Path) -> tuple[int, str]:
    """An open file beside ``path`` and its name; locked, so that others see that it is being written."""
    while True:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=TEMPORARY, dir=path.parent)
        if fcntl is None:
            return handle, name
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.exists(name):
            return handle, name
        os.close(handle)  # removed by another process before it was locked


def _remove_left(path: Path) -> None:
    """Remove temporary files of ``path`` that nobody writes any more."""
    if fcntl is None:
        return
    # A name of any characters: glob patterns would read some of them as their own.
    start = f".{path.name}."
    for name in os.listdir(path.parent):
        if not (name.startswith(start) and name.endswith(TEMPORARY) and "." not in name[len(start) : -len(TEMPORARY)]):
            continue
        with suppress(OSError):
            handle = os.open(path.parent / name, os.O_RDWR)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while its writer lives
                os.unlink(path.parent / name)
            finally:
                os.close(handle)


def read_arrays(path: str | os.PathLike[str], what: str, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of an ``.npz`` file by name.

    Args:
        path: of the file.
        what: the file is taken for, for the error.
        names: of the arrays that are wanted; others are not read. All unless given.

    Raises:
        DenseVSError: missing, no regular file, not such a file, truncated, damaged, with pickled objects, or larger
            than the memory.
    """
    path = input_file(path, what)
    try:
        with open(path, "rb") as stream:
            with zipfile.ZipFile(stream) as archive:
                entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
                wanted = {name: entry for name, entry in entries.items() if names is None or name in names}
                total, free = sum(entry.file_size for entry in wanted.values()), free_memory()
                if total > free:
                    raise ValueError(f"its arrays take {total / 2**30:.1f} GiB; {free / 2**30:.1f} GiB are free")
                for entry in wanted.values():
                    _check_header(archive, entry)
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as stored:
                return {name: stored[name] for name in wanted}
    except Exception as error:  # whatever the readers of zip files, their compression and NumPy's headers raise
        raise DenseVSError(f"cannot read {path} as {what}: {str(error) or type(error).__name__}") from error


def read_format(
    path: str | os.PathLike[str],
    what: str,
    form: str,
    versions: Collection[int],
    *,
    writer: str,
    names: Collection[str] | None = None,
) -> dict[str, np.ndarray]:
    """The arrays of an ``.npz`` file that says by ``format`` and ``format_version`` what it is.

    Args:
        path, what, names: as of :func:`read_arrays`; ``names`` among them these two.
        form: its format, as written.
        versions: of the format that can be read.
        writer: what writes such files, for the error.

    Raises:
        DenseVSError: another file, another version, or as :func:`read_arrays`.
    """
    arrays = read_arrays(path, what, names)
    check_format(arrays, path, what, form, versions, writer=writer)
    return arrays


def check_format(
    arrays: Mapping[str, np.ndarray],
    path: str | os.PathLike[str],
    what: str,
    form: str,
    versions: Collection[int],
    *,
    writer: str,
) -> None:
    """Refuse arrays that do not say what they should be; arguments as of :func:`read_format`.

    Raises:
        DenseVSError: another format or version.
    """
    if str(arrays.get("format")) != form:
        raise DenseVSError(f"{path} is not {what}; expected a file that {writer} wrote")
    if str(arrays.get("format_version")) not in {str(version) for version in versions}:
        expected = " or ".join(str(version) for version in versions)
        found = short_text(str(arrays.get("format_version")))
        raise DenseVSError(f"{path} has format version {found}; expected {expected}")


def short_text(text: str) -> str:
    """A text that somebody else wrote, as far as an error has room for it."""
    return text if len(text) <= LONGEST_SHOWN else shown(text)


def stored_format(path: str | os.PathLike[str], what: str) -> str:
    """What an ``.npz`` file says that it is; empty if it does not say.

    Raises:
        DenseVSError: as :func:`read_arrays`.
    """
    arrays = read_arrays(path, what, ("format",))
    return str(arrays["format"]) if "format" in arrays else ""


def stored_array(
    arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...], kinds: str = "f", *, finite: bool = True
) -> np.ndarray:
    """An array of a file, if it is what it should be.

    Args:
        arrays: of the file.
        name: of the one that is wanted.
        shape: expected, -1 takes any length.
        kinds: that its dtype may be of, as NumPy's letters: f floating point, i and u whole numbers, b bools, U text.
        finite: whether numbers have to be.

    Raises:
        DenseVSError: missing, of another shape or kind, or with a value that is not finite.
    """
    if name not in arrays:
        raise DenseVSError(f"it has no {name}")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in kinds:
        shown = str(tuple("any" if n < 0 else n for n in shape)).replace("'", "")
        expected = " or ".join(KINDS[kind] for kind in kinds)
        raise DenseVSError(
            f"{name} has shape {array.shape} and dtype {array.dtype}; expected {expected} of shape {shown}"
        )
    if finite and array.dtype.kind == "f" and not np.isfinite(array).all():
        raise DenseVSError(f"{name} holds values that are not finite")
    return array


def _check_header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> None:
    """Refuse an array whose header claims more or less than its entry holds, before memory is taken for it."""
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
        if dtype.hasobject:
            raise ValueError(f"{entry.filename} holds pickled objects")
        size = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or dtype.itemsize < 1 or size != entry.file_size - stream.tell():
            raise ValueError(f"{entry.filename} claims the shape {shape}; its entry is of another size")


def output_folder(path: str | os.PathLike[str]) -> Path:
    """The folder, made if it is not there.

    Raises:
        DenseVSError: it is a file or cannot be made.
    """
    folder = file_path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DenseVSError(f"cannot make the folder {folder}: {error.strerror or error}") from error
    return folder


def read_json(path: str | os.PathLike[str]) -> Any:
    """What a JSON file holds.

    Raises:
        DenseVSError: missing, no regular file, larger than 64 MiB, no text, or as :func:`parse_json`.
    """
    path = input_file(path, most=MOST_JSON)
    try:
        return parse_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DenseVSError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise DenseVSError(f"cannot read {path}: {error}") from error


def parse_json(text: str) -> Any:
    """What a text in JSON says.

    Raises:
        DenseVSError: no JSON, nested too deeply, or with a number of more digits than Python reads.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DenseVSError(f"it is no JSON: {error}") from error


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
