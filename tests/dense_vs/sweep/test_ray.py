"""A Ray cluster of two nodes on this machine: workers and nodes that are lost cost no task and double none."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from dense_vs.cli import main
from dense_vs.sweep.run_sweep import run_sweep

ray = pytest.importorskip("ray")
cluster_utils = pytest.importorskip("ray.cluster_utils")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),  # of Ray's own code
]


@pytest.fixture
def cluster(probe):
    """Two nodes of two CPUs, which start with the probe's folder in their environment."""
    made = cluster_utils.Cluster()
    options = {"num_cpus": 2, "object_store_memory": 100 * 2**20}
    made.add_node(**options, include_dashboard=False)
    made.second = made.add_node(**options)
    yield made
    ray.shutdown()
    made.shutdown()


def test_killed_workers_and_a_lost_node(probe, cluster, tmp_path):
    tasks = [probe.task(seed, "--wait", "1.0") for seed in range(8)]
    lost = []

    def damage():
        end = time.monotonic() + 60
        while len(probe.noted("begin")) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        process = probe.notes.read_text().split()[2]
        worker = int(Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[1])
        os.kill(worker, signal.SIGKILL)
        lost.append(worker)
        time.sleep(1.0)
        cluster.remove_node(cluster.second, allow_graceful=False)
        lost.append("node")

    thread = threading.Thread(target=damage, daemon=True)
    thread.start()
    outcomes = run_sweep(tasks, tmp_path / "out", address=cluster.address)
    thread.join(60)
    assert len(lost) == 2
    assert [outcome.failure for outcome in outcomes] == [""] * 8
    assert sorted(os.listdir(tmp_path / "out" / "results")) == sorted(task.name for task in tasks)
    assert len(probe.noted("begin")) > 8  # something was lost and ran again
    again = run_sweep(tasks, tmp_path / "out")
    assert [outcome.seconds for outcome in again] == [0.0] * 8


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("127.0.0.1:1", "cannot reach a Ray cluster at '127.0.0.1:1': "),
        ("ray://127.0.0.1:1", "cannot reach a Ray cluster at 'ray://127.0.0.1:1': "),
        ("nowhere", "expected auto, local, HOST:PORT"),
        ("host:99999", "expected auto, local, HOST:PORT"),
    ],
)
def test_no_cluster_is_said(address, said, probe, tmp_path, capsys):
    plan = tmp_path / "sweep.toml"
    plan.write_text(f"[[experiment]]\ncommand = 'probe'\noptions = {{ notes = '{probe.notes}' }}\n")
    assert main(["sweep", str(plan), "--out", str(tmp_path / "out"), "--address", address]) == 2
    assert said in capsys.readouterr().err
