"""The README's program is an example, its links lead somewhere, and its figures are those of the results."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def test_its_program_is_the_example():
    """The example itself runs in ``test_examples.py``."""
    program = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    example = (README.parent / "examples" / "02_reach_a_point.py").read_text(encoding="utf-8")
    assert program == [example]


def test_pages_it_leads_to_are_there():
    links = re.findall(r"\]\(([^):#]+)\)", README.read_text(encoding="utf-8"))
    assert links
    for link in links:
        assert (README.parent / link).exists(), link


def test_figures_are_those_of_the_results():
    script = README.parent / "profiling" / "readme_table.py"
    assert subprocess.run([sys.executable, str(script), "--check"], check=False).returncode == 0
