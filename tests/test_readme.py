"""The README's program does what it says."""

import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).parent.parent / "README.md"


@pytest.fixture(scope="module")
def first_program():
    program = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)[0]
    names = {}
    exec(compile(program, "README.md", "exec"), names)
    return names


def test_the_tip_reaches_the_target(first_program):
    # Dither and 100 frames of motion: within the 2 px that a reach counts by.
    assert np.hypot(*(first_program["world"].project("tip") - first_program["target"])) < 2.0


def test_it_fits_20_lines():
    program = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)[0]
    lines = [line for line in program.splitlines() if line.strip() and not line.startswith(("import", "from"))]
    assert len(lines) <= 20
