"""Tables of text, as commands print them: the same in a terminal, in a pipe and in a file."""

import io
from collections.abc import Sequence

from rich.box import Box
from rich.console import Console
from rich.table import Table
from rich.text import Text

_UNDERLINED = Box("    \n    \n -  \n    \n    \n    \n    \n    \n", ascii=True)
_WIDEST = 10_000  # characters; a terminal may wrap a line, but no column is cut short


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under an underlined header; the first column is aligned left, the others right."""
    grid = Table(box=_UNDERLINED, show_edge=False, pad_edge=False, padding=(0, 0, 0, 1))
    for number, title in enumerate(header):
        grid.add_column(Text(title), justify="right" if number else "left", no_wrap=True)
    for row in rows:
        grid.add_row(*(Text(cell) for cell in row))
    console = Console(file=io.StringIO(), width=_WIDEST, color_system=None)
    with console.capture() as captured:
        console.print(grid)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())
