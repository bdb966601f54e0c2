"""Ten thousand bad inputs, a batch a process: typed errors and right results, and nothing else.

``make fuzz`` runs a hundred thousand with other seeds.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SEED = int(os.environ.get("DENSE_VS_FUZZ_SEED", "0"))
TIMES = int(os.environ.get("DENSE_VS_FUZZ_TIMES", "1"))  # as many cases
CASES = {
    "servo": 2600,
    "loops": 900,
    "robot": 1500,
    "grasp": 2600,
    "image": 1800,
    "jacobian": 1200,
    "generative": 800,
    "sims": 350,
    "live": 900,
    "learning": 600,
    "files": 600,
    "commands": 80,
}
SECONDS = 500  # of a batch, then it hangs


@pytest.mark.parametrize("kind", CASES)
def test_bad_input(kind, tmp_path):
    pytest.importorskip("onnx", reason="one of the files is a network")
    for part in range(TIMES):
        result = tmp_path / f"{part}.json"
        command = [sys.executable, Path(__file__).with_name("batch.py"), kind, SEED + part, CASES[kind], result]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "TMPDIR": str(tmp_path)}
        done = subprocess.run(
            [str(word) for word in command], cwd=tmp_path, capture_output=True, env=environment, timeout=SECONDS,
            check=False,
        )  # fmt: skip
        last = result.with_suffix(".case")
        at = last.read_text() if last.is_file() else "the imports"
        assert done.returncode == 0, f"ended with {done.returncode} at {at}: {done.stderr[-500:]!r}"
        found = json.loads(result.read_text())
        assert not found["faults"], "\n".join(found["faults"][:20])
        assert sum(found["counts"].values()) >= CASES[kind]
