"""``make mutation``: do the tests notice when a score, a law or an estimator is wrong?

A random sample of the mutations of each group of modules is drawn. Each is put in place of its module, and the tests of
its room that reach its line run, the quickest first, until one fails. A mutation that none notices has survived. Tests
marked slow are asked where no other reaches the line.

Every :data:`CONTROL`-th trial is followed by one without a mutation: were its tests to fail, they would fail of
themselves, as on a busy machine, and kills could not be believed.

The result is written after every trial, so that a run that is stopped leaves what it has; ``--resume`` goes on.
"""

import argparse
import importlib
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from mutation.operators import Mutant
from mutation.reach import Reach, measure_reach, read_reach
from mutation.result import Journal, Result, identity
from mutation.sample import MODULES, draw, groups_of, tests_of
from mutation.trials import Trial, run_trials

ROOT = Path(__file__).resolve().parents[2]
CONTROL = 20
PRELOADED = (
    "matplotlib.figure",
    "mujoco_warp",
    "pytest",
    "scipy.optimize",
    "scipy.spatial.transform",
    "sklearn.ensemble",
)


def main() -> None:
    """Run, and write the result."""
    arguments = _parser().parse_args()
    root = arguments.root.resolve()
    if arguments.json is not None:
        arguments.json = arguments.json.resolve()
    work = root / "out" / "mutation"
    os.chdir(root)
    # Forked processes cannot use a GPU, and as many as there are cores would not fit on one.
    os.environ.update(CUDA_VISIBLE_DEVICES="", OMP_NUM_THREADS="1")
    for name in [name for name in os.environ if name.startswith("PYTEST_")]:  # of a test that runs this
        del os.environ[name]
    if sys.flags.safe_path:
        os.environ["PYTHONSAFEPATH"] = "1"
    groups = {"chosen": tuple(arguments.modules)} if arguments.modules else MODULES
    files = groups_of(root, groups, arguments.only)
    tests = [root / test for test in arguments.tests] or tests_of(root, files)
    sources = sorted({file.split("/")[0] for names in files.values() for file in names})
    go_on = arguments.resume or arguments.again
    measure_reach(root, work / "reach", arguments.jobs, arguments.quick, tests, sources, reuse=arguments.reuse or go_on)
    reach = read_reach(root, work / "reach", arguments.quick)
    drawn, counts = draw(root, files, arguments.sample, arguments.seed)
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:  # it imports modules that may be mutated
        origin = pool.submit(_origin, arguments).result()
    journal = Journal(work / "trials.jsonl", _shared(origin, again=arguments.again), resume=go_on)
    known = journal.outcomes()
    if arguments.again:
        known = {which: outcome for which, outcome in known.items() if outcome not in ("survived", "error")}
    result = Result(counts, len(drawn), reach.failed, origin, journal.controls())
    left: list[tuple[str, str, Mutant]] = []
    for one in drawn:
        outcome = known.get(identity(*one[1:]))
        if outcome is None:
            left.append(one)
        else:
            result.add(Trial(*one, reach.tests_of(*one[1:]), 0.0), outcome)
    preload(root)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    for trial, outcome in run_trials(trials(left, reach), root, work, arguments.jobs, 60 * arguments.minutes):
        journal.add(trial, outcome)
        result.add(trial, outcome)
        result.tell_last()
        if arguments.json is not None:
            result.write(arguments.json)
    if arguments.json is not None:
        result.write(arguments.json)
    result.tell()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--minutes", type=float, default=60.0, help="time box without the tests' first run (default: 60)")
    add("--jobs", type=int, default=1, help="processes side by side, in the first run too (default: 1)")
    add("--sample", type=int, default=80, metavar="N", help="mutations of each group (default: 80)")
    add("--seed", type=int, default=0, help="of the draw (default: 0)")
    add("--only", default="*", metavar="PATTERN", help="of files, as 'dense_vs/grasp/*' (default: all)")
    add("--modules", nargs="+", metavar="PATTERN", help="files to draw from (default: scores, laws and estimators)")
    add("--tests", nargs="+", default=[], metavar="PATH", help="tests to ask (default: the folders of the modules')")
    add("--quick", action="store_true", help="leave out tests marked slow")
    add("--reuse", action="store_true", help="measure which tests reach which lines only where one of both changed")
    add("--resume", action="store_true", help="go on with a run that was stopped, of the same commit and arguments")
    add("--again", action="store_true", help="go on, and try once more what has survived, with the tests as they are")
    add("--root", type=Path, default=ROOT, help="of the project (default: this one)")
    add("--json", type=Path, help="write the result here")
    return parser


def _origin(arguments: argparse.Namespace) -> dict[str, Any]:
    from dense_vs.view.provenance import provenance

    return provenance(arguments, leave_out=("json", "reuse", "resume", "again", "root"))


def _shared(origin: dict[str, Any], again: bool) -> dict[str, Any]:
    """What a run has in common with the one that goes on with it."""
    arguments = {name: value for name, value in origin["arguments"].items() if name not in ("minutes", "jobs")}
    return {"arguments": arguments} | ({} if again else {"commit": origin["commit"]})


def trials(drawn: list[tuple[str, str, Mutant]], reach: Reach) -> Iterator[Trial]:
    """A trial a mutation, and the controls among them."""
    asked = 0
    for group, file, mutant in drawn:
        tests = reach.tests_of(file, mutant)
        seconds = reach.expected_seconds(tests)
        yield Trial(group, file, mutant, tests, seconds)
        asked += bool(tests)
        if tests and asked % CONTROL == 1:
            yield Trial(group, file, None, tests, seconds)


def preload(root: Path) -> None:
    """Import what the tests need and no mutation changes, before forking; what is not installed is left out."""
    importlib.import_module("pytest")
    if root != ROOT:
        return
    for name in PRELOADED:
        with suppress(ImportError):
            importlib.import_module(name)
    import cv2
    import warp as wp

    cv2.setNumThreads(1)
    wp.config.quiet = True
    wp.init()


if __name__ == "__main__":
    main()
