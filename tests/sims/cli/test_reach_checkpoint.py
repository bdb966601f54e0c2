"""``reach --checkpoint``: killed while it learns, it goes on with what it had learned."""

import json
import signal
import subprocess
import sys

import numpy as np
from sliding_scene import wait_for

from dense_vs.cli.main import main

COMMAND = ["reach", "--robot", "planar", "--device", "cpu", "--threads", "1", "--seed", "1", "--targets", "1"]
COMMAND += ["--no-video", "--height", "120", "--width", "160", "--max-frames", "60"]


def kept_seconds(path):
    if not path.is_file():
        return 0.0
    with np.load(path) as stored:
        return float(stored["seconds"])


def test_killed_and_restarted_it_goes_on(tmp_path, capsys):
    path = tmp_path / "kept.npz"
    files = ["--out", str(tmp_path / "out"), "--checkpoint", str(path)]
    process = subprocess.Popen([sys.executable, "-m", "dense_vs", *COMMAND, "--babble", "1000", *files])
    try:
        assert wait_for(lambda: kept_seconds(path) > 6.0 or process.poll() is not None, 120)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=10)
    seconds = kept_seconds(path)
    assert seconds > 6.0
    assert main([*COMMAND, "--babble", "8", *files]) in (None, 0)
    said = capsys.readouterr().out
    assert f"going on from {path}, learned in {seconds:.1f} s of motion" in said
    assert f"after {seconds + 3:.4g} s of babbling" in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["jacobian_error_median"] < 0.15
    assert summary["targets"][0]["true_error_px"] < 2.0
    assert main([*COMMAND, "--width", "200", *files]) == 2
    assert "expected (120, 200, 3, 1), or another file" in capsys.readouterr().err
