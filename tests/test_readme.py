"""The README's program is an example, and what it and the other pages lead to is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
CODE = re.compile(r"```.*?```|`[^`\n]*`", flags=re.DOTALL)


def test_its_program_is_the_example():
    """The example itself runs in ``test_examples.py``."""
    program = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    example = (README.parent / "examples" / "02_reach_a_point.py").read_text(encoding="utf-8")
    assert program == [example]


def links(page: Path) -> list[str]:
    """Files of this project that a page leads to or shows."""
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    return [link for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text) if "://" not in link]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_and_pictures_that_a_page_leads_to_are_there(page):
    for link in links(page):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", [README, ROOT / "docs" / "index.md", ROOT / "docs" / "papers" / "dije.md"])
def test_links_of_a_page_are_found(page):
    assert len(links(page)) > 3
