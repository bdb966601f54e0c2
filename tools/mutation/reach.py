"""Which tests reach which line, and how long each takes: the tests run once under coverage, a folder at a time.

What a folder's tests reached is kept, so that a run that is stopped goes on with the next folder.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mutation.operators import Mutant

SECONDS = 30.0  # of tests a mutation, as they took without it; the first test is always asked
NO_TESTS = 5  # pytest's code where all tests of a folder were left out
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
        """Tests to ask: those of the module's own folder first, the quickest before the others.

        Of a line that runs when its module is imported, all that use the module. Tests marked slow are asked only where
        no other reaches the line.
        """
        lines = self.lines.get(file, {})
        tests = lines.get(mutant.line, set()) if mutant.function else set().union(*lines.values())
        quick = {test for test in tests if not self.times[test].slow}
        asked: list[str] = []
        total = 0.0
        own = f"tests/{file.rpartition('/')[0]}/"

        def order(test: str) -> tuple[bool, float, str]:
            return not test.startswith(own), self.times[test].rest + self.times[test].setup, test

        for test in sorted(quick or tests, key=order):
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


def measure_reach(
    root: Path, work: Path, jobs: int, quick: bool, tests: Iterable[Path], sources: Iterable[str], reuse: bool
) -> None:
    """Run the tests once under coverage, ``jobs`` of them side by side, and keep what they reached in ``work``.

    Args:
        root: of the project.
        work: folder for what is kept.
        jobs: processes side by side.
        quick: leave out tests marked slow.
        tests: files and folders.
        sources: folders of the project to measure.
        reuse: run only tests of folders that are not kept, or where a test or what it reached has changed since.
    """
    if not reuse:
        shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True, exist_ok=True)
    kinds = ("quick",) if quick else ("quick", "slow")
    wanted = {
        _piece(work, root, kind, folder): files for folder, files in _by_folder(root, tests).items() for kind in kinds
    }
    for left in set(_pieces(work, kinds)) - set(wanted):
        shutil.rmtree(left)
    for piece, files in wanted.items():
        if not _is_fresh(root, piece, files):
            shutil.rmtree(piece, ignore_errors=True)
            piece.mkdir()
            _measure(root, piece, jobs, files, sources)


def _by_folder(root: Path, tests: Iterable[Path]) -> dict[Path, list[Path]]:
    """Test files of each folder, without those left out."""
    found: set[Path] = set()
    for path in tests:
        found.update(path.rglob("test_*.py") if path.is_dir() else [path])
    folders: dict[Path, list[Path]] = {}
    for file in sorted(found):
        if not file.relative_to(root).as_posix().startswith(LEFT_OUT):
            folders.setdefault(file.parent, []).append(file)
    return folders


def _piece(work: Path, root: Path, kind: str, folder: Path) -> Path:
    return work / f"{kind}-{folder.relative_to(root).as_posix().replace('/', '.')}"


def _pieces(work: Path, kinds: Iterable[str]) -> list[Path]:
    return sorted(piece for kind in kinds for piece in work.glob(f"{kind}-*"))


def _is_fresh(root: Path, piece: Path, files: list[Path]) -> bool:
    done = piece / "done.json"
    if not done.is_file():
        return False
    told = json.loads(done.read_text(encoding="utf-8"))
    if told["tests"] != [file.relative_to(root).as_posix() for file in files]:
        return False
    needed = [root / file for file in told["reached"]] + files
    return all(file.is_file() and file.stat().st_mtime < told["began"] for file in needed)


def _measure(root: Path, piece: Path, jobs: int, files: list[Path], sources: Iterable[str]) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "mutation.times_plugin", "-p", "no:cacheprovider"]
    command += [f"--cov={source}" for source in sources]
    command += ["--cov-context=test", "--cov-report=", "--cov-fail-under=0"]
    command += ["-n", str(jobs), "--dist", "worksteal"] if jobs > 1 else ["-p", "no:xdist"]
    command += ["-m", "slow" if piece.name.startswith("slow") else "not slow"]
    names = [file.relative_to(root).as_posix() for file in files]
    tools = str(Path(__file__).parents[1])
    search = os.pathsep.join(part for part in (tools, os.environ.get("PYTHONPATH")) if part)
    own = {"COVERAGE_FILE": str(piece / "coverage"), "MUTATION_TIMES": str(piece / "times.json"), "PYTHONPATH": search}
    began = time.time()
    done = subprocess.run([*command, *names], cwd=root, env={**os.environ, **own}, check=False)
    if done.returncode not in (0, 1, NO_TESTS):
        sys.exit(f"the tests cannot run even without a mutation (pytest ended with {done.returncode})")
    reached = sorted(name for name in _lines(root, piece) if (root / name).is_file())
    told = {"tests": names, "reached": reached, "began": began}
    (piece / "done.json").write_text(json.dumps(told), encoding="utf-8")


def read_reach(root: Path, work: Path, quick: bool) -> Reach:
    """What :func:`measure_reach` kept; of the quick tests alone where told.

    A line that only the making of a fixture reached counts for all tests of that file, as they share the fixture.
    """
    times: dict[str, TestTime] = {}
    failed: list[str] = []
    pieces = _pieces(work, ("quick",) if quick else ("quick", "slow"))
    for piece in pieces:
        stored = json.loads((piece / "times.json").read_text(encoding="utf-8"))
        failed += [test for test, one in stored.items() if one["outcome"] == "failed"]
        times |= {
            test: TestTime(one["setup"], one["rest"], one["slow"])
            for test, one in stored.items()
            if one["outcome"] == "passed"
        }
    by_file: dict[str, list[str]] = {}
    for test in times:
        by_file.setdefault(_file(test), []).append(test)
    reach: dict[str, dict[int, set[str]]] = {}
    for piece in pieces:
        for file, contexts_by_line in _lines(root, piece).items():
            lines = reach.setdefault(file, {})
            for line, contexts in contexts_by_line.items():
                tests = lines.setdefault(line, set())
                for context in contexts:
                    test, _, phase = context.rpartition("|")
                    if phase == "setup":
                        tests.update(by_file.get(_file(test), []))
                    elif test in times:
                        tests.add(test)
    return Reach(reach, times, failed)


def _lines(root: Path, piece: Path) -> dict[str, dict[int, list[str]]]:
    """Contexts by line, of every file by its path in the project."""
    from coverage import CoverageData

    if not (piece / "coverage").is_file():  # every test of the folder was left out
        return {}
    data = CoverageData(str(piece / "coverage"))
    data.read()
    found: dict[str, dict[int, list[str]]] = {}
    for measured in data.measured_files():
        file = (root / measured).resolve()  # it may have been found by a link
        name = file.relative_to(root).as_posix() if file.is_relative_to(root) else measured
        lines = found.setdefault(name, {})
        for line, contexts in data.contexts_by_lineno(measured).items():
            lines.setdefault(line, []).extend(contexts)
    return found


def _file(test: str) -> str:
    return test.partition("::")[0]
