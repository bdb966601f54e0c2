"""The table of what has changed since a body was learned, from a result made by hand."""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import results_file
from change_scores import ChangeScore
from readme_changes import change_lines


def score(changed, images="clean", named=True, among=True, error=0.001, before=0.3, after=0.1, seed=5):
    return ChangeScore("panda", "A", images, seed, changed, changed, named, among, offset_error=error, before=before,
                       after=after)  # fmt: skip


@pytest.fixture
def written(tmp_path, monkeypatch):
    def write(scores, finished=True):
        content = {
            "date": "2026-11-26T08:00:00", "commit": "abc123def4567", "machine": {"cores": 2, "cpu": "one"},
            "versions": {"warp": "1.19.0"}, "metrics": [], "finished": finished,
            "arguments": {"seeds": "5,6", "seconds": 10.0, "joints": 4}, "rows": [asdict(one) for one in scores],
        }  # fmt: skip
        (tmp_path / "body_changes.json").write_text(json.dumps(content))
        monkeypatch.setattr(results_file, "RESULTS", tmp_path)
        monkeypatch.setattr(results_file.Result, "origin", lambda result: "a machine")
        return change_lines()

    return write


def test_kinds_and_images_have_rows_of_their_own(written):
    head, _, names, _, *rows = written(
        [
            score("joint", error=0.001, before=0.3, after=0.1), score("joint", named=False, error=0.004, before=0.5),
            score("joint", named=False, among=False, error=0.002, after=0.2, seed=6),
            score("joint", "realistic", error=0.03), score("camera", before=0.6, after=0.15),
        ]
    )  # fmt: skip
    assert "from 10 s of babbling" in head
    assert "3 bodies" in head
    assert head.endswith("a machine):")
    assert names.count("|") == 8
    table = {
        tuple(cell.strip() for cell in row.split("|")[1:3]): [c.strip() for c in row.split("|")[3:-1]] for row in rows
    }
    joint = "one joint's zero, by 0.02 to 0.2 rad"
    assert table[joint, "clean"] == ["1 of 3", "2 of 3", "0.002 (0.004)", "0.300 (0.500)", "0.100 (0.200)"]
    assert "|  | realistic | 1 of 1 | 1 of 1 | 0.030 (0.030) | 0.300 (0.300) | 0.100 (0.100) |" in rows
    camera = "the camera, by up to 5 cm and 0.08 rad"
    assert table[camera, "clean"] == ["1 of 1", "1 of 1", "-", "0.600 (0.600)", "0.150 (0.150)"]
    assert table["nothing", "clean"] == ["-"] * 5
    assert len(rows) == 10


def test_what_is_not_there_is_said(written):
    lines = written([score("joint"), ChangeScore("ur5e", "A", "clean", 6, failure="too few tracks")], finished=False)
    assert "1 bodies" in lines[0]
    assert lines[0].endswith("the run was stopped early, and has not come to all:")
    assert lines[-2:] == ["", "Runs in which no body was found: 1."]
