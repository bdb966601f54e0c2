"""The file of a saved estimate: what it holds, and whether that can be gone on from."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from dense_vs.checks import check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import parse_json, read_format, short_text
from dense_vs.jacobian.options import JacobianOptions
from dense_vs.jacobian.stored_state import DEPTH, STATE, check_stored

FORMAT = "dense-vs dense image Jacobian"
FORMAT_VERSION = 1
STORED = ("format", "format_version", "options", "updates", *STATE, *DEPTH)


def file_header(options: JacobianOptions, updates: int) -> dict[str, Any]:
    """What a file holds beside the arrays of the state."""
    header = {"format": FORMAT, "format_version": FORMAT_VERSION}
    return header | {"options": json.dumps(asdict(options)), "updates": updates}


def read_jacobian(path: str | os.PathLike[str]) -> tuple[JacobianOptions, int, dict[str, np.ndarray]]:
    """Options, number of updates and arrays of a saved estimate.

    Raises:
        DenseVSError: not such a file, another version of it, or arrays that do not fit its options.
    """
    what, writer = "a saved Jacobian", "DenseJacobian.save"
    content = read_format(path, what, FORMAT, (FORMAT_VERSION,), writer=writer, names=STORED)
    try:
        options = stored_options(content)
        updates = check_whole("updates", content["updates"].item(), least=0)
        check_stored(content, options)  # before memory is taken for sizes that the file only claims
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise DenseVSError(f"{path} is damaged: {error}") from error
    return options, updates, content


def stored_options(content: Mapping[str, np.ndarray]) -> JacobianOptions:
    """Options of an estimate in a file.

    Raises:
        DenseVSError: missing, or no options of an estimate.
    """
    if "options" not in content:
        raise DenseVSError("it has no options")
    try:
        return JacobianOptions(**parse_json(str(content["options"])))
    except TypeError as error:
        raise DenseVSError(f"its options are none of an estimate: {short_text(str(error))}") from error
