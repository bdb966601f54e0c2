"""Small tasks: a command of an installed package that writes how often it ran, waits, or fails."""

import os
import sys
import textwrap

import pytest

from dense_vs.sweep.task import Task

PROBE = """
    # A command for tests: notes that it ran, waits, and writes what it was asked.
    import json, os, time
    from pathlib import Path

    def add_arguments(parser):
        parser.add_argument("--seed", type=int, default=0)
        parser.add_argument("--wait", type=float, default=0.0)
        parser.add_argument("--fail", action="store_true")
        parser.add_argument("--notes", type=Path, required=True)
        parser.add_argument("--out", type=Path, required=True)

    def run(arguments):
        from dense_vs.errors import DenseVSError
        with open(arguments.notes, "a") as stream:
            stream.write(f"begin {arguments.seed} {os.getpid()}\\n")
        time.sleep(arguments.wait)
        if arguments.fail:
            raise DenseVSError("it was told to fail")
        arguments.out.mkdir()
        (arguments.out / "summary.json").write_text(json.dumps({"twice": 2 * arguments.seed, "text": "x"}))
        with open(arguments.notes, "a") as stream:
            stream.write(f"end {arguments.seed} {os.getpid()}\\n")
"""
COMMANDS = """
    from dense_vs.cli.commands import Command
    COMMANDS = {"probe": Command("dense_vs_probe.command", "a command for tests")}
"""
ENTRY = "[dense_vs.commands]\nprobe = dense_vs_probe:COMMANDS\n"


@pytest.fixture
def probe(tmp_path, monkeypatch):
    """Makes tasks of a command that is there for the time of a test, also in processes that are started."""
    site = tmp_path / "site"
    package, info = site / "dense_vs_probe", site / "dense_vs_probe-1.dist-info"
    package.mkdir(parents=True)
    info.mkdir()
    (package / "__init__.py").write_text(textwrap.dedent(COMMANDS))
    (package / "command.py").write_text(textwrap.dedent(PROBE))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: dense-vs-probe\nVersion: 1\n")
    (info / "entry_points.txt").write_text(ENTRY)
    monkeypatch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.syspath_prepend(str(site))
    yield Probe(tmp_path / "notes")
    for name in [name for name in sys.modules if name.startswith("dense_vs_probe")]:
        del sys.modules[name]


class Probe:
    def __init__(self, notes):
        self.notes = notes
        notes.touch()

    def task(self, seed, *options):
        arguments = ("probe", "--notes", str(self.notes), *options, "--seed", str(seed))
        return Task(f"probe-{seed}", "probe", arguments, seed)

    def noted(self, what):
        """Seeds of the runs that noted this, one for each time."""
        return [int(line.split()[1]) for line in self.notes.read_text().splitlines() if line.startswith(what)]
