"""How a command describes itself: by its module's docstring, paragraph by paragraph, without the markup."""

import argparse
import re
from types import ModuleType


def description(module: ModuleType) -> str:
    """A module's docstring without the command's own name before it and without backticks."""
    text = re.sub(r"^``dense-vs [^`]*``: *", "", (module.__doc__ or "").strip()).replace("``", "")
    return text[:1].upper() + text[1:]


class ParagraphHelp(argparse.HelpFormatter):
    """Wraps every paragraph of a description by itself."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = re.split(r"\n\s*\n", text.strip())
        return "\n\n".join(super(ParagraphHelp, self)._fill_text(part, width, indent) for part in paragraphs)
