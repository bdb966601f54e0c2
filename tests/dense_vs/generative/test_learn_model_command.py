"""``dense-vs learn-model`` on a recording, and on files that are none."""

import json

import numpy as np
import pytest
from arm_recordings import SIZE

from dense_vs.cli.main import main
from dense_vs.generative import GenerativeModel


def arrays(case):
    return {"pixels": case.pixels, "joints": case.joints, "image_sizes": [SIZE] * 2, "intrinsics": case.intrinsics}


def test_learns_and_reports(ur5, tmp_path, capsys):
    np.savez(tmp_path / "recording.npz", **arrays(ur5), intrinsics_sigma=(0.006, 5.0))
    out, report = tmp_path / "model.npz", tmp_path / "report.json"
    options = ["--out", str(out), "--json", str(report), "--held-out", "10"]
    assert main(["learn-model", str(tmp_path / "recording.npz"), *options]) == 0
    said = capsys.readouterr().out
    assert "end to end" in said
    assert "10 postures held out" in said
    written = json.loads(report.read_text())
    assert written["held_out_mean_error_px"] < 0.8
    assert written["expected_error_px"] < 0.3
    assert written["samples"] == 40
    assert ur5.validation_error(GenerativeModel.load(out)) < 0.75


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixels": None}, "array pixels is missing"),
        ({"angles": np.zeros(3)}, "arrays angles are unknown"),
        ({"image_sizes": np.ones((2, 2))}, "image_sizes has shape"),
        ({"joints": np.zeros((3, 6))}, "joints have shape"),
    ],
)
def test_says_what_is_wrong_with_a_recording(ur5, tmp_path, capsys, change, message):
    content = {k: v for k, v in (arrays(ur5) | change).items() if v is not None}
    np.savez(tmp_path / "recording.npz", **content)
    assert main(["learn-model", str(tmp_path / "recording.npz"), "--out", str(tmp_path / "m.npz")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "m.npz").exists()
