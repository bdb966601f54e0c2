"""Which tests reach which line, and how long each takes: one run of the suite under coverage."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from mutation.operators import Mutant

SECONDS = 40.0  # of tests a mutation, as they took without it; the quickest test is always asked
LEFT_OUT = ("tests/fuzz", "tests/tools")  # random calls, which name no line of their own; tests of this program


@dataclass(frozen=True)
class TestTime:
    """Seconds of a test.

    Attributes:
        setup: for what it needs; its file's tests share that.
        rest: for itself.
        slow: it is marked so.
    """

    setup: float
    rest: float
    slow: bool


@dataclass(frozen=True)
class Reach:
    """Tests by line.

    Attributes:
        lines: of each file, by its path in the project, the tests that reach each line.
        times: of each test that passed.
        failed: tests that failed without any mutation, which are not asked.
    """

    lines: dict[str, dict[int, set[str]]]
    times: dict[str, TestTime]
    failed: list[str]

    def tests_of(self, file: str, mutant: Mutant) -> list[str]:
        """Tests to ask, the quickest first.

        Of a line that runs when its module is imported, all that use the module. Tests marked slow are asked only where
        no other reaches the line.
        """
        lines = self.lines.get(file, {})
        tests = lines.get(mutant.line, set()) if mutant.function else set().union(*lines.values())
        quick = {test for test in tests if not self.times[test].slow}
        asked: list[str] = []
        total = 0.0
        for test in sorted(quick or tests, key=lambda name: (self.times[name].rest + self.times[name].setup, name)):
            total += self.times[test].rest + self.times[test].setup
            if asked and total > SECONDS:
                break
            asked.append(test)
        return asked

    def expected_seconds(self, tests: list[str]) -> float:
        """Seconds that these tests may take by themselves, each file's fixtures made anew."""
        files = {_file(test) for test in tests}
        setup = sum(time.setup for test, time in self.times.items() if _file(test) in files)
        return setup + sum(self.times[test].rest for test in tests)


def measure_reach(root: Path, work: Path, jobs: int, quick: bool, tests: list[str]) -> None:
    """Run the tests once under coverage, ``jobs`` of them side by side, and keep what they reached in ``work``.

    Args:
        root: of the project.
        work: folder for what is kept.
        jobs: processes side by side.
        quick: leave out tests marked slow.
        tests: files and folders; all unless given.
    """
    work.mkdir(parents=True, exist_ok=True)
    for left in work.glob("coverage*"):  # of a run that was stopped
        left.unlink()
    command = [sys.executable, "-m", "pytest", "-q", "-p", "mutation.times_plugin", "-p", "no:cacheprovider"]
    command += ["--cov", "--cov-context=test", "--cov-report=", "--cov-fail-under=0"]
    command += ["-n", str(jobs), "--dist", "worksteal"] if jobs > 1 else ["-p", "no:xdist"]
    command += ["-m", "not slow"] if quick else []
    command += [f"--ignore={folder}" for folder in LEFT_OUT] + tests
    tools = str(Path(__file__).parents[1])
    search = os.pathsep.join(part for part in (tools, os.environ.get("PYTHONPATH")) if part)
    own = {"COVERAGE_FILE": str(work / "coverage"), "MUTATION_TIMES": str(work / "times.json"), "PYTHONPATH": search}
    done = subprocess.run(command, cwd=root, env={**os.environ, **own}, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"the tests cannot run even without a mutation (pytest ended with {done.returncode})")


def read_reach(root: Path, work: Path) -> Reach:
    """What :func:`measure_reach` kept.

    A line that only the making of a fixture reached counts for all tests of that file, as they share the fixture.
    """
    from coverage import CoverageData

    stored = json.loads((work / "times.json").read_text(encoding="utf-8"))
    times = {
        test: TestTime(one["setup"], one["rest"], one["slow"])
        for test, one in stored.items()
        if one["outcome"] == "passed"
    }
    by_file: dict[str, list[str]] = {}
    for test in times:
        by_file.setdefault(_file(test), []).append(test)
    data = CoverageData(str(work / "coverage"))
    data.read()
    reach: dict[str, dict[int, set[str]]] = {}
    for measured in data.measured_files():
        file = (root / measured).resolve()  # it may have been found by a link
        lines = reach.setdefault(file.relative_to(root).as_posix() if file.is_relative_to(root) else measured, {})
        for line, contexts in data.contexts_by_lineno(measured).items():
            tests = lines.setdefault(line, set())
            for context in contexts:
                test, _, phase = context.rpartition("|")
                if phase == "setup":
                    tests.update(by_file.get(_file(test), []))
                elif test in times:
                    tests.add(test)
    return Reach(reach, times, [test for test, one in stored.items() if one["outcome"] == "failed"])


def _file(test: str) -> str:
    return test.partition("::")[0]
