"""Tables and progress as text that a pipe, a file and a terminal take alike."""

import re
import subprocess
import sys

import pytest

from dense_vs.view.tables import table

BAR = """
from dense_vs.view.progress import progress
with progress("fits", 3, "try") as bar:
    bar.set_description("fits of [b]one[/b] arm")
    for _ in range(3):
        bar.update()
"""


def test_columns_line_up():
    lines = table(["what", "px"], [["a point", "0.25"], ["b", "12.5"]]).splitlines()
    assert lines == ["what       px", "------- -----", "a point  0.25", "b        12.5"]


def test_nothing_is_cut_however_long():
    long = "x" * 700
    assert table(["what", long], [[long, "1"]]).count(long) == 2


@pytest.mark.parametrize("cell", ["[px]", "[red]wrong[/red]", ":smile:", "[/]"])
def test_brackets_stay_brackets(cell):
    assert cell in table(["figure"], [[cell]])


def test_no_rows():
    assert table(["a", "b"], []).splitlines()[0].split() == ["a", "b"]


def test_progress_in_a_pipe_is_plain_lines():
    done = subprocess.run([sys.executable, "-c", BAR], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert re.fullmatch(r"fits of \[b\]one\[/b\] arm: 3 of 3 tries in \d+\.\d s\n", done.stderr)


def test_progress_survives_a_reader_that_left():
    code = f"import os, sys; os.close(2); os.open('/dev/full', os.O_WRONLY)\n{BAR}\nprint('done')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "done\n"
