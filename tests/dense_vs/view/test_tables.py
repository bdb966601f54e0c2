"""Tables and progress as text that a pipe, a file and a terminal take alike."""

import re
import subprocess
import sys
from io import StringIO

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


def test_a_total_that_was_too_small_is_not_said_any_more():
    code = BAR.replace("range(3)", "range(4)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"fits of \[b\]one\[/b\] arm: 4 tries in \d+\.\d s\n", done.stderr)


def test_the_last_line_is_not_said_twice():
    code = BAR.replace(
        "with progress", "import dense_vs.view.progress\ndense_vs.view.progress.EVERY = 0.0\nwith progress"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert re.findall(r"\d of 3", done.stderr) == ["1 of 3", "2 of 3", "3 of 3"]


@pytest.mark.parametrize(("steps", "shown"), [(3, "3/3"), (4, "4/?")])
def test_a_bar_drops_a_total_that_was_too_small_too(monkeypatch, steps, shown):
    from rich.console import Console

    from dense_vs.view import progress

    stream = StringIO()
    console = Console(file=stream, force_terminal=True, width=120)
    monkeypatch.setattr(progress, "Console", lambda stderr: console)
    with progress.progress("fits", 3, "try") as bar:
        for _ in range(steps):
            bar.update()
    assert shown in re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", stream.getvalue()).replace(" ", "")


def test_progress_survives_a_reader_that_left():
    code = f"import os, sys; os.close(2); os.open('/dev/full', os.O_WRONLY)\n{BAR}\nprint('done')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "done\n"
