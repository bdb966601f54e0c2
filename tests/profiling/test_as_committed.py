"""Committed results are measured again with the arguments that they name."""

import json
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import as_committed

PROFILING = as_committed.FOLDER
RESULTS = PROFILING / "results"
MEASURED = re.findall(r"^ +measure (\w+) (\w+)", (PROFILING / "measure_again.sh").read_text(encoding="utf-8"), re.M)
ELSEWHERE = {"experiments", "mutation"}  # from many runs of its own; by make mutation


def typed(program: str, name: str) -> list[str]:
    source = (PROFILING / f"{program}.py").read_text(encoding="utf-8")
    arguments = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))["arguments"]
    return as_committed.options_of(arguments, source)


def test_every_committed_result_can_be_measured_again():
    assert {name for _, name in MEASURED} | ELSEWHERE == {file.stem for file in RESULTS.glob("*.json")}


@pytest.mark.parametrize(("program", "name"), MEASURED)
def test_a_program_still_has_the_options_of_its_result(program, name):
    source = (PROFILING / f"{program}.py").read_text(encoding="utf-8")
    for word in typed(program, name):
        assert not word.startswith("--") or f'"{word}"' in source, f"{program}.py has no {word}"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seeds": "63,64", "joints": 4}, ["--seeds", "63,64", "--joints", "4"]),
        ({"tuned_on": [400, 401]}, ["--tuned-on", "400", "401"]),
        ({"objects": ["Power Drill", "Mug"]}, ["--objects", "Power Drill", "Mug"]),
        ({"budget": None, "world_device": ""}, []),
        ({"jobs": 40, "limit": 560.0, "out": "there", "data": "data"}, []),
        ({"body": True}, ["--body"]),
        ({"body": False}, []),
        ({"exact": True}, []),
        ({"exact": False}, ["--no-exact"]),
        ({"body_model": False}, ["--no-model"]),
    ],
)
def test_arguments_as_they_are_typed(arguments, words):
    assert as_committed.options_of(arguments, 'add("--body") add("--no-exact") add("--no-model")') == words


def test_a_flag_that_the_program_does_not_have_is_named():
    with pytest.raises(SystemExit, match="no option for shadows; expected --shadows or --no-shadows"):
        as_committed.options_of({"shadows": True}, "")


def test_the_program_is_run_with_them_and_with_what_is_added(monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(as_committed.os, "execv", lambda program, words: ran.append((program, words)))
    monkeypatch.setattr(sys, "argv", ["as_committed.py", "depth_row", "depth_row_realistic", "--json", "out.json"])
    as_committed.main()
    told = json.loads((RESULTS / "depth_row_realistic.json").read_text(encoding="utf-8"))["arguments"]
    (program, words) = ran[0]
    assert program == words[0] == sys.executable
    assert words[1] == str(PROFILING / "depth_row.py")
    assert words[words.index("--seeds") + 1] == told["seeds"]
    assert words[-2:] == ["--json", "out.json"]
    assert "depth_row.py" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["as_committed.py"])
    with pytest.raises(SystemExit, match="Run a measuring program"):
        as_committed.main()
