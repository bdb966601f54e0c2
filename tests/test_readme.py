"""The README's program is an example, and its links lead somewhere."""

import re
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
