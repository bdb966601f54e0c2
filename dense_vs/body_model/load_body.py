"""A body from its file, whichever kind it is: a chain of links, or J remembered by posture."""

import os

from dense_vs.body_model.model import BodyModel
from dense_vs.body_model.model_file import FORMAT as CHAIN
from dense_vs.body_model.posture_memory import FORMAT as MEMORY
from dense_vs.body_model.posture_memory import PostureMemory
from dense_vs.errors import DenseVSError
from dense_vs.files import short_text, stored_format


def load_body(path: str | os.PathLike[str]) -> BodyModel | PostureMemory:
    """Read what ``dense-vs body``, :meth:`BodyModel.save` or :meth:`PostureMemory.save` wrote.

    Raises:
        DenseVSError: another file, another version of one of these, or damaged.
    """
    found = stored_format(path, "a saved body")
    if found == CHAIN:
        return BodyModel.load(path)
    if found == MEMORY:
        return PostureMemory.load(path)
    got = short_text(found) or "no format at all"
    raise DenseVSError(f"{path} is not a saved body; expected a file that 'dense-vs body' wrote, got {got}")
