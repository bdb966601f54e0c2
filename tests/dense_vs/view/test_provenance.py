"""What is written beside a result, against what the system says."""

import argparse
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from dense_vs.kernels.launch import available_cores
from dense_vs.view import provenance as module
from dense_vs.view.provenance import commit, provenance, told

ROOT = Path(__file__).parents[3]


def test_everything_is_there_and_json():
    origin = provenance(argparse.Namespace(seed=3, json=Path("x")), leave_out=("json",))
    assert json.loads(json.dumps(origin)) == origin
    assert origin["arguments"] == {"seed": 3}
    assert origin["machine"]["cores"] == available_cores()
    assert set(origin) >= {"date", "commit", "versions"}
    assert {"python", "numpy", "warp-lang"} <= set(origin["versions"])


@pytest.mark.skipif(not (ROOT / ".git").exists() or shutil.which("git") is None, reason="needs a git checkout")
def test_commit_is_gits():
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert commit().removesuffix("+changes") == head.stdout.strip()


def test_no_commit_outside_of_a_checkout(tmp_path, monkeypatch):
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    stranger = tmp_path / "site-packages" / "provenance.py"
    stranger.parent.mkdir()
    stranger.write_text("")
    monkeypatch.setattr(module, "__file__", str(stranger))
    monkeypatch.delenv("DENSE_VS_COMMIT", raising=False)
    assert commit() is None
    monkeypatch.setenv("DENSE_VS_COMMIT", "abc")
    assert commit() == "abc"


def test_what_json_has_no_form_for_is_left_out():
    arguments = argparse.Namespace(run=print, out=Path("a/b"), seeds=[1, 2], scale=None, gain=0.5)
    assert told(arguments) == {"out": "b", "seeds": [1, 2], "scale": None, "gain": 0.5}
