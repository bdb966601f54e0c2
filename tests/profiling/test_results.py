"""Every committed result says where it comes from, and every table of figures is what the results say."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "profiling" / "results"
ORIGIN = {"date", "commit", "arguments", "machine", "versions"}


def test_a_result_says_where_it_comes_from():
    for file in RESULTS.glob("*.json"):
        content = json.loads(file.read_text(encoding="utf-8"))
        for one in content.get("runs", [content]):
            said = set(one) >= ORIGIN and {"cpu", "cores", "caches", "gpus"} <= set(one["machine"])
            assert said, f"{file.name} lacks some of {', '.join(sorted(ORIGIN))}"


@pytest.mark.parametrize("name", ["readme_table.py", "paper_pages.py"])
def test_tables_are_those_of_the_results(name):
    script = ROOT / "profiling" / name
    assert subprocess.run([sys.executable, str(script), "--check"], check=False).returncode == 0


@pytest.mark.parametrize("page", ["README.md", "docs/performance.md"])
def test_an_altered_figure_is_found(page, tmp_path):
    copy = tmp_path / "copy"
    for folder in ("profiling", "docs"):
        (copy / folder).mkdir(parents=True)
    for file in [*ROOT.glob("profiling/*.py"), *ROOT.glob("docs/*.md"), ROOT / "README.md"]:
        (copy / file.relative_to(ROOT)).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    (copy / "profiling" / "results").symlink_to(RESULTS)
    script = [sys.executable, str(copy / "profiling" / "readme_table.py")]
    assert subprocess.run([*script, "--check"], check=False).returncode == 0
    text = (copy / page).read_text(encoding="utf-8")
    before, rest = text.split("<!-- measured: begin -->")
    altered = re.sub(r"\d\.\d+", lambda figure: f"{float(figure[0]) + 1:.3f}", rest, count=1)
    assert altered != rest
    (copy / page).write_text(f"{before}<!-- measured: begin -->{altered}", encoding="utf-8")
    assert subprocess.run([*script, "--check"], check=False).returncode == 1
    assert subprocess.run(script, check=False).returncode == 0
    assert (copy / page).read_text(encoding="utf-8") == text


def test_the_table_of_faults_is_that_of_its_result():
    script = ROOT / "profiling" / "faults.py"
    assert subprocess.run([sys.executable, str(script), "--page", "--check"], check=False).returncode == 0
