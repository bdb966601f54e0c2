"""``make mutation``: do the tests notice when a score, a law or an estimator is wrong?

Mutations are drawn from the modules below, one at a time is put in place of its module, and the tests that reach its
line run until one fails. A mutation that none notices has survived.

Known tools start a program a mutation, which here is five seconds of imports each; this one imports the libraries once
and forks. Kernel bodies are left out, as Warp reads their source from the file.

Only tests that are not marked slow are asked, the quickest first, and for :data:`SECONDS` at most.
"""

import argparse
import fnmatch
import importlib.abc
import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import CodeType
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(Path(__file__).parent))

from operators import Mutant, mutants  # noqa: E402

WORK = ROOT / "out" / "mutation"
REASONS = Path(__file__).with_name("reasons.json")
SECONDS = 40.0  # of tests a mutation, as they took without it
PATIENCE = 4.0  # times as long until a mutation that hangs is stopped; it counts as noticed
MODULES = {
    "scores": (
        "sims/papers/*/*.py",
        "sims/batch/*.py",
        "dense_vs/jacobian/error.py",
        "dense_vs/pipeline/explained_motion.py",
        "dense_vs/body/cluster_evaluation.py",
        "dense_vs/segmentation/mask_features.py",
        "dense_vs/segmentation/mask_quality.py",
        "dense_vs/depth/odms.py",
        "sims/marked_arm/*.py",
    ),
    "laws": (
        "dense_vs/point_servo/*.py",
        "dense_vs/mask_servo/*.py",
        "dense_vs/grasp/*.py",
        "dense_vs/robot/*.py",
    ),
    "estimators": (
        "dense_vs/jacobian/*.py",
        "dense_vs/body/*.py",
        "dense_vs/depth/*.py",
        "dense_vs/pipeline/*.py",
        "dense_vs/generative/*.py",
        "dense_vs/generative/*/*.py",
        "dense_vs/recording/clock_offset.py",
        "dense_vs/recording/joint_log.py",
        "dense_vs/recording/joint_delay.py",
        "dense_vs/recording/repeated_images.py",
    ),
}


def main() -> None:
    """Run, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--minutes", type=float, default=60.0, help="time box without the tests' first run (default: 60)"
    )
    parser.add_argument("--each", type=int, default=12, help="mutations a module at most (default: 12)")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (default: 0)")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="of files, as 'dense_vs/grasp/*' (default: all)")
    parser.add_argument("--reuse", action="store_true", help="do not measure again which tests reach which lines")
    parser.add_argument("--json", type=Path, help="write the result here")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    if not arguments.reuse:
        measure_reach()
    reach, seconds = read_reach()
    chosen = draw(arguments.each, arguments.seed, arguments.only)
    preload()
    end = time.monotonic() + 60 * arguments.minutes
    results: list[dict[str, Any]] = []
    for number, (group, file, mutant) in enumerate(chosen):
        if time.monotonic() > end:
            break
        tests = tests_of(file, mutant, reach, seconds)
        outcome = survived_by(file, mutant, tests, sum(seconds.get(test, 1.0) for test in tests))
        results.append(
            {
                "group": group,
                "file": file,
                "line": mutant.line,
                "function": mutant.function,
                "before": mutant.before,
                "after": mutant.after,
                "outcome": outcome,
                "tests": len(tests),
            }
        )
        print(
            f"{number + 1}/{len(chosen)} {outcome:9} {file}:{mutant.line} {mutant.before} -> {mutant.after}", flush=True
        )
    report(results, arguments, len(chosen))


def measure_reach() -> None:
    """Run the quick tests once under coverage, with the test that reached each line and how long each took."""
    WORK.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-m", "not slow", "--cov", "--cov-context=test"]
    command += ["--cov-report=", f"--junitxml={WORK / 'tests.xml'}", "--ignore=tests/fuzz", "--cov-fail-under=0"]
    done = subprocess.run(command, env={**os.environ, "COVERAGE_FILE": str(WORK / "coverage")}, check=False)
    if done.returncode:
        sys.exit("the tests fail without any mutation; nothing to measure")


def read_reach() -> tuple[dict[str, dict[int, set[str]]], dict[str, float]]:
    """Which tests reach each line of each file, and the seconds that each test takes.

    A line that only the making of a fixture reached counts for all tests of that file, as they share the fixture.
    """
    from coverage import CoverageData

    seconds: dict[str, float] = {}
    for case in ElementTree.parse(WORK / "tests.xml").iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None or case.find("skipped") is not None:
            continue
        parts = (case.get("classname") or "").split(".")
        file = "/".join(parts) + ".py"
        seconds[f"{file}::{case.get('name')}"] = float(case.get("time") or 0.0)
    by_file: dict[str, list[str]] = {}
    for test in seconds:
        by_file.setdefault(test.partition("::")[0], []).append(test)
    data = CoverageData(str(WORK / "coverage"))
    data.read()
    reach: dict[str, dict[int, set[str]]] = {}
    for measured in data.measured_files():
        file = Path(measured)
        name = (file.relative_to(ROOT) if file.is_absolute() else file).as_posix()
        lines = reach.setdefault(name, {})
        for line, contexts in data.contexts_by_lineno(measured).items():
            tests = lines.setdefault(line, set())
            for context in contexts:
                test, _, phase = context.partition("|")
                if phase == "setup":
                    tests.update(by_file.get(test.partition("::")[0], []))
                elif test in seconds:
                    tests.add(test)
    return reach, seconds


def draw(each: int, seed: int, only: str) -> list[tuple[str, str, Mutant]]:
    """Mutations of all modules, a module at a time in turn, so that a time box leaves none out."""
    drawn: list[list[tuple[str, str, Mutant]]] = []
    seen: set[str] = set()
    for group, patterns in MODULES.items():
        for pattern in patterns:
            for path in sorted(ROOT.glob(pattern)):
                file = path.relative_to(ROOT).as_posix()
                if file in seen or not fnmatch.fnmatch(file, only):
                    continue
                seen.add(file)
                found = list(mutants(path.read_text(encoding="utf-8")))
                order = random.Random(f"{seed} {file}")
                chosen = order.sample(found, min(each, len(found)))
                drawn.append([(group, file, mutant) for mutant in chosen])
    return [ones[turn] for turn in range(each) for ones in drawn if turn < len(ones)]


def tests_of(file: str, mutant: Mutant, reach: dict[str, dict[int, set[str]]], seconds: dict[str, float]) -> list[str]:
    """Tests to ask, the quickest first; of a line that runs when its module is imported, all that use the module."""
    lines = reach.get(file, {})
    tests = lines.get(mutant.line, set()) if mutant.function else set().union(*lines.values())
    asked, total = [], 0.0
    for test in sorted(tests, key=lambda name: seconds[name]):
        total += seconds[test]
        if asked and total > SECONDS:
            break
        asked.append(test)
    return asked


def preload() -> None:
    """Import what the tests need and no mutation changes, before forking."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import cv2
    import matplotlib.figure  # noqa: F401
    import mujoco_warp  # noqa: F401
    import pytest  # noqa: F401
    import scipy.optimize
    import scipy.spatial.transform  # noqa: F401
    import sklearn.ensemble  # noqa: F401
    import warp as wp

    cv2.setNumThreads(1)
    wp.config.quiet = True
    wp.init()


def survived_by(file: str, mutant: Mutant, tests: list[str], expected_seconds: float) -> str:
    """``killed``, ``timeout`` (which counts as killed) or ``survived``."""
    if not tests:
        return "survived"
    child = os.fork()
    if child == 0:
        os.setsid()
        os._exit(_in_child(file, mutant, tests))
    end = time.monotonic() + 30.0 + PATIENCE * expected_seconds
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return "survived" if status == 0 else "killed"
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "timeout"


def _in_child(file: str, mutant: Mutant, tests: list[str]) -> int:
    null = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(null, number)
    sys.meta_path.insert(0, _Mutated(file, mutant))
    import pytest

    code = 1
    try:
        code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:cov", *tests]))
    finally:
        os._exit(code)


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Gives the mutated module in place of the file's."""

    def __init__(self, file: str, mutant: Mutant):
        self._path = ROOT / file
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        self._name = name if name.startswith("dense_vs") else f"dense_vs.{name}"
        self._mutant = mutant
        self._package = file.endswith("__init__.py")

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname != self._name:
            return None
        spec = importlib.util.spec_from_file_location(fullname, self._path, loader=self)
        if spec is not None and self._package:
            spec.submodule_search_locations = [str(self._path.parent)]
        return spec

    def get_source(self, fullname: str) -> str:
        return self._path.read_text(encoding="utf-8")

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._mutant.mutated(self.get_source(fullname)), str(self._path), "exec")

    def is_package(self, fullname: str) -> bool:
        return self._package


def report(results: list[dict[str, Any]], arguments: argparse.Namespace, drawn: int) -> None:
    """Print the shares and the survivors, and write them."""
    from dense_vs.files import write_json
    from dense_vs.view.provenance import provenance

    reasons = json.loads(REASONS.read_text(encoding="utf-8")) if REASONS.is_file() else {}
    shares: dict[str, dict[str, Any]] = {}
    for group in [*MODULES, "all"]:
        counts = Counter(one["outcome"] for one in results if group in (one["group"], "all"))
        total = sum(counts.values())
        if total:
            share = 1 - counts["survived"] / total
            shares[group] = {"mutations": total, "killed": total - counts["survived"], "share_killed": round(share, 4)}
            print(f"{group}: {total - counts['survived']} of {total} killed, {100 * share:.1f} %")
    survivors = [one for one in results if one["outcome"] == "survived"]
    for one in survivors:
        one["reason"] = reasons.get(f"{one['file']}: {one['before']} -> {one['after']}", "no test tells them apart yet")
    content = {
        "shares": shares,
        "drawn": drawn,
        "survivors": survivors,
        **provenance(arguments, leave_out=("json", "reuse")),
    }
    if arguments.json is not None:
        write_json(arguments.json, content)


if __name__ == "__main__":
    main()
