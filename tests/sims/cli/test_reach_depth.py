"""``reach --depth``: targets are places in space, and a checkpoint says whether it knows depth."""

import json

from dense_vs.cli.main import main

COMMAND = [
    "reach",
    "--device",
    "cpu",
    "--seed",
    "1",
    "--targets",
    "1",
    "--no-video",
    "--height",
    "120",
    "--width",
    "160",
]
COMMAND += ["--babble", "4", "--max-frames", "60"]


def test_a_place_in_space_is_reached_and_depth_is_kept(tmp_path, capsys):
    files = ["--out", str(tmp_path / "out"), "--checkpoint", str(tmp_path / "kept.npz")]
    assert main([*COMMAND, "--depth", "--tolerance", "0.9", *files]) in (None, 0)
    assert "in space [mm]" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["tolerance_px"] == 0.9  # what is called reached goes by it
    target = summary["targets"][0]
    assert len(target["target"]) == 3
    assert 0.5 < target["target"][2] < 1.5
    assert target["true_error_m"] < 0.012  # a pixel is 7 mm in these images
    assert main([*COMMAND, *files]) == 2
    assert "was learned with depth; expected the same, or another file" in capsys.readouterr().err
