"""A parser that imports a command's module when that command is chosen, and not before."""

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any


class LazyParser(argparse.ArgumentParser):
    """A parser that declares its arguments when it is about to read some.

    Args:
        fill: declares them; called once, with this parser.
        options: of :class:`argparse.ArgumentParser`.
    """

    def __init__(self, *, fill: Callable[["LazyParser"], None] | None = None, **options: Any):
        super().__init__(**{"formatter_class": ParagraphHelp, **options})
        self._fill = fill

    def complete(self) -> None:
        """Declare the arguments now."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)

    # The base class declares it by overloads, which say no more than this.
    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """As the base class; also what it calls for a subcommand that was chosen."""
        self.complete()
        return super().parse_known_args(args, namespace)

    def _print_message(self, message: str, file: Any = None) -> None:
        """As the base class, which however says nothing where it cannot write."""
        if message:
            (file or sys.stderr).write(message)


class ParagraphHelp(argparse.HelpFormatter):
    """Wraps every paragraph of a description by itself."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = re.split(r"\n\s*\n", text.strip())
        return "\n\n".join(super(ParagraphHelp, self)._fill_text(part, width, indent) for part in paragraphs)


def from_module(home: str, before: Callable[[LazyParser], None] | None = None) -> Callable[[LazyParser], None]:
    """A function that fills a parser from a module with a docstring, ``add_arguments(parser)`` and ``run(arguments)``.

    Args:
        home: the module's import name.
        before: declares arguments that stand before the module's own.
    """

    def fill(parser: LazyParser) -> None:
        module = import_module(home)
        parser.description = description(module)
        if before is not None:
            before(parser)
        module.add_arguments(parser)

    return fill


def description(module: ModuleType) -> str:
    """A module's docstring without the command's own name before it and without backticks."""
    text = re.sub(r"^``dense-vs [^`]*``: *", "", (module.__doc__ or "").strip()).replace("``", "")
    return text[:1].upper() + text[1:]
