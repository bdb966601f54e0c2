"""A learned J as a file that a browser sends or gets: bounded, checked before anything is made from it, no pickle."""

import zipfile
from pathlib import Path

from dense_vs.errors import DenseVSError
from dense_vs.files import input_file, read_arrays
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.jacobian_file import stored_options

SIZES = ("height", "width", "joints", "worlds", "order")
SLACK = 1 << 20  # bytes beside the arrays: names, options, the archive's own tables


def most_bytes(estimator: DenseJacobian) -> int:
    """How large a state of this estimator's size may be [bytes]."""
    return sum(array.nbytes for array in estimator.filter.stored().values()) + SLACK


def load_state(path: Path, like: DenseJacobian) -> DenseJacobian:
    """Read a state for images and joints as ``like`` has them.

    Raises:
        DenseVSError: not such a file, larger than such a state may be once unpacked, or of another size.
    """
    try:
        with zipfile.ZipFile(input_file(path)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
    except Exception as error:  # whatever the reader of zip files raises, as in read_arrays
        raise DenseVSError(f"the file is not a saved Jacobian: {error}") from error
    if unpacked > most_bytes(like):
        raise DenseVSError(f"the file holds {unpacked} bytes; expected at most {most_bytes(like)}")
    stored = read_arrays(path, "a saved Jacobian")
    try:
        options = stored_options(stored)
    except DenseVSError as error:
        raise DenseVSError(f"the file is not a saved Jacobian: {error}") from error
    found, wanted = (tuple(getattr(one, name) for name in SIZES) for one in (options, like.options))
    if found != wanted:
        raise DenseVSError(f"the state has height, width, joints, worlds, order {found}; expected {wanted}")
    return DenseJacobian.load(path, device=like.device.alias, threads=like.threads)
