"""Runs on this machine: each done once, found again, done anew for other code, and failures told apart."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dense_vs.cli import main
from dense_vs.errors import DenseVSError
from dense_vs.sweep import run_sweep as module
from dense_vs.sweep.figures import gathered
from dense_vs.sweep.run_sweep import run_sweep
from dense_vs.sweep.run_task import FAILED, RUNNING, is_done, result_folder
from dense_vs.sweep.source_version import source_version


def test_only_what_is_missing_runs(probe, tmp_path, monkeypatch):
    tasks = [probe.task(seed) for seed in range(3)]
    out = tmp_path / "out"
    assert [outcome.failure for outcome in run_sweep(tasks[:2], out, jobs=2)] == ["", ""]
    outcomes = run_sweep(tasks, out, jobs=2)
    assert [bool(outcome.seconds) for outcome in outcomes] == [False, False, True]
    assert sorted(probe.noted("end")) == [0, 1, 2]
    assert not (out / RUNNING).exists()
    monkeypatch.setattr(module, "source_version", lambda: "other code")
    run_sweep(tasks[:1], out)
    assert sorted(probe.noted("end")) == [0, 0, 1, 2]
    (figure,) = gathered(out, tasks)
    assert (figure.name, figure.values, figure.spread()) == ("twice", (0, 2, 4), (0, 2, 4))


def test_a_failure_is_told_and_tried_again(probe, tmp_path, capsys):
    tasks = [probe.task(0), probe.task(1, "--fail")]
    first = run_sweep(tasks, tmp_path / "out")
    assert first[0].failure == ""
    assert first[1].failure == "dense-vs: it was told to fail (exit code 2)"
    assert "it was told to fail" in Path(first[1].log).read_text()
    assert "failed: probe" in capsys.readouterr().out
    run_sweep(tasks, tmp_path / "out")
    assert probe.noted("begin") == [0, 1, 1]
    well = probe.task(1)  # asked for without what made it fail
    assert run_sweep([well], tmp_path / "out")[0].failure == ""
    assert not (tmp_path / "out" / FAILED / "probe-1").exists()


def test_a_task_that_is_killed_leaves_no_result(probe, tmp_path):
    out, task = tmp_path / "out", probe.task(0, "--wait", "60")
    code = (
        "from pathlib import Path; from dense_vs.sweep.run_sweep import run_sweep; "
        "from dense_vs.sweep.task import Task; "
        f"run_sweep([Task({task.name!r}, 'probe', {task.arguments!r}, 0)], Path({str(out)!r}))"
    )
    driver = subprocess.Popen([sys.executable, "-c", code])
    try:
        until(lambda: probe.noted("begin") == [0])
        with pytest.raises(DenseVSError, match="another sweep runs in"):
            run_sweep([task], out)
    finally:
        driver.send_signal(signal.SIGKILL)
        driver.wait(30)
    worker = int(probe.notes.read_text().split()[2])
    until(lambda: not alive(worker))  # its process ends with the driver
    assert not is_done(out, task, source_version())
    assert list((out / RUNNING).iterdir())
    quick = probe.task(0)
    assert run_sweep([quick], out)[0].failure == ""
    assert not (out / RUNNING).exists()
    assert probe.noted("end") == [0]


def test_a_damaged_result_is_none(probe, tmp_path):
    task = probe.task(0)
    run_sweep([task], tmp_path)
    file = result_folder(tmp_path, task) / "task.json"
    for content in ("", "[1]", "{}"):
        file.write_text(content)
        assert not is_done(tmp_path, task, source_version())


def test_the_command(probe, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    plan = tmp_path / "sweep.toml"
    options = f"options = {{ notes = '{probe.notes}', wait = [0.0, 0.01] }}"
    plan.write_text(f"[[experiment]]\ncommand = 'probe'\nseeds = '0:2'\n{options}\n")
    out = tmp_path / "out"
    assert main(["sweep", str(plan), "--out", str(out), "--jobs", "2"]) == 0
    said = capsys.readouterr().out
    assert "4 of 4 runs done, 0 of them before" in said
    assert "twice" in said
    assert (out / "probe.png").stat().st_size > 1000
    summary = json.loads((out / "summary.json").read_text())
    assert [run["failure"] for run in summary["runs"]] == [None] * 4
    assert [figure["values"] for figure in summary["figures"]] == [[0.0, 2.0], [0.0, 2.0]]
    assert main(["sweep", str(plan), "--out", str(out)]) == 0
    assert "4 of 4 runs done, 4 of them before" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("nothing = 1", "unrecognized arguments: --nothing 1"),
        ("wait = 'long'", "invalid float value"),
    ],
)
def test_a_slip_is_found_before_the_first_run(options, said, probe, tmp_path, capsys):
    plan = tmp_path / "sweep.toml"
    plan.write_text(
        f"[[experiment]]\ncommand = 'probe'\noptions = {{ notes = '{probe.notes}' }}\n"
        f"[[experiment]]\ncommand = 'probe'\noptions = {{ notes = '{probe.notes}', {options} }}\n"
    )
    assert main(["sweep", str(plan), "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert probe.noted("begin") == []


def test_a_failed_run_is_the_exit_code(probe, tmp_path, capsys):
    plan = tmp_path / "sweep.toml"
    plan.write_text(f"[[experiment]]\ncommand = 'probe'\noptions = {{ notes = '{probe.notes}', fail = true }}\n")
    assert main(["sweep", str(plan), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert "1 of 1 runs failed" in said.err
    assert "output.log" in said.out


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def alive(process):
    try:  # a process that has ended and was not waited for is still listed
        return ") Z" not in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
