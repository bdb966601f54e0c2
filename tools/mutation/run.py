"""``make mutation``: do the tests notice when a score, a law or an estimator is wrong?

Mutations are drawn from the modules below, each is put in place of its module, and the tests that reach its line run
until one fails. A mutation that none notices has survived. Tests marked slow are asked where no other reaches the line.

Every :data:`CONTROL`-th trial is followed by one without a mutation: were its tests to fail, they would fail of
themselves, as on a busy machine, and kills could not be believed.

The result is written after every trial, so that a run that is stopped leaves what it has.
"""

import argparse
import fnmatch
import importlib
import json
import os
import random
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from mutation.operators import Mutant, mutants
from mutation.reach import Reach, measure_reach, read_reach
from mutation.trials import Trial, run_trials

ROOT = Path(__file__).resolve().parents[2]
REASONS = Path(__file__).with_name("reasons.json")
CONTROL = 20
PRELOADED = (
    "matplotlib.figure",
    "mujoco_warp",
    "pytest",
    "scipy.optimize",
    "scipy.spatial.transform",
    "sklearn.ensemble",
)
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
    if not arguments.reuse:
        measure_reach(root, work, arguments.jobs, arguments.quick, arguments.tests)
    reach = read_reach(root, work)
    groups = {"chosen": tuple(arguments.modules)} if arguments.modules else MODULES
    drawn = draw(root, groups, arguments.each, arguments.seed, arguments.only)
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:  # it imports modules that may be mutated
        result = Result(list(groups), len(drawn), reach.failed, pool.submit(_origin, arguments).result())
    preload(root)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    for trial, outcome in run_trials(trials(drawn, reach), root, work, arguments.jobs, 60 * arguments.minutes):
        result.add(trial, outcome)
        if arguments.json is not None:
            result.write(arguments.json)
    result.tell()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--minutes", type=float, default=60.0, help="time box without the tests' first run (default: 60)")
    add("--jobs", type=int, default=1, help="processes side by side, in the first run too (default: 1)")
    add("--each", type=int, default=12, help="mutations a module at most (default: 12)")
    add("--seed", type=int, default=0, help="of the draw (default: 0)")
    add("--only", default="*", metavar="PATTERN", help="of files, as 'dense_vs/grasp/*' (default: all)")
    add("--modules", nargs="+", metavar="PATTERN", help="files to draw from (default: scores, laws and estimators)")
    add("--tests", nargs="+", default=[], metavar="PATH", help="tests to ask (default: all)")
    add("--quick", action="store_true", help="leave out tests marked slow")
    add("--reuse", action="store_true", help="do not measure again which tests reach which lines")
    add("--root", type=Path, default=ROOT, help="of the project (default: this one)")
    add("--json", type=Path, help="write the result here")
    return parser


def _origin(arguments: argparse.Namespace) -> dict[str, Any]:
    from dense_vs.view.provenance import provenance

    return provenance(arguments, leave_out=("json", "reuse", "root"))


def draw(
    root: Path, groups: dict[str, tuple[str, ...]], each: int, seed: int, only: str
) -> list[tuple[str, str, Mutant]]:
    """Mutations of all modules, a module at a time in turn, so that a time box leaves none out."""
    drawn: list[list[tuple[str, str, Mutant]]] = []
    seen: set[str] = set()
    for group, patterns in groups.items():
        for path in (path for pattern in patterns for path in sorted(root.glob(pattern))):
            file = path.relative_to(root).as_posix()
            if file in seen or not fnmatch.fnmatch(file, only):
                continue
            seen.add(file)
            found = list(mutants(path.read_text(encoding="utf-8")))
            order = random.Random(f"{seed} {file}")
            chosen = order.sample(found, min(each, len(found)))
            drawn.append([(group, file, mutant) for mutant in chosen])
    return [ones[turn] for turn in range(each) for ones in drawn if turn < len(ones)]


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


class Result:
    """What has come of the trials so far."""

    def __init__(self, groups: list[str], drawn: int, failed: list[str], origin: dict[str, Any]):
        self._groups = groups
        self._drawn = drawn
        self._failed = failed
        self._origin = origin
        self._mutations: list[dict[str, Any]] = []
        self._controls: list[dict[str, Any]] = []
        self._reasons = json.loads(REASONS.read_text(encoding="utf-8")) if REASONS.is_file() else {}

    def add(self, trial: Trial, outcome: str) -> None:
        """Count a trial, and print it."""
        if trial.mutant is None:
            self._controls.append({"file": trial.file, "outcome": outcome, "tests": trial.tests})
            print(f"control {'passed' if outcome == 'survived' else outcome} {trial.file}", flush=True)
            return
        mutant = trial.mutant
        self._mutations.append(
            {
                "group": trial.group,
                "file": trial.file,
                "line": mutant.line,
                "function": mutant.function,
                "before": mutant.before,
                "after": mutant.after,
                "outcome": outcome,
                "tests": len(trial.tests),
            }
        )
        change = f"{trial.file}:{mutant.line} {mutant.before} -> {mutant.after}"
        print(f"{len(self._mutations)}/{self._drawn} {outcome:9} {change}", flush=True)

    def content(self) -> dict[str, Any]:
        """The result as it is written: shares of those with an outcome, survivors, controls, origin."""
        survivors = [one for one in self._mutations if one["outcome"] == "survived"]
        for one in survivors:
            one["reason"] = self._reasons.get(f"{one['file']}: {one['before']} -> {one['after']}") or _reason(one)
        return {
            "shares": self._shares(),
            "drawn": self._drawn,
            "survivors": survivors,
            "errors": [one for one in self._mutations if one["outcome"] == "error"],
            "controls": {
                "run": len(self._controls),
                "failed": [one for one in self._controls if one["outcome"] != "survived"],
            },
            "tests_failed_without_mutation": self._failed,
            **self._origin,
        }

    def _shares(self) -> dict[str, dict[str, Any]]:
        shares: dict[str, dict[str, Any]] = {}
        for group in [*self._groups, "all"]:
            counts = Counter(one["outcome"] for one in self._mutations if group in (one["group"], "all"))
            total = counts["killed"] + counts["timeout"] + counts["survived"]
            if total:
                killed = total - counts["survived"]
                shares[group] = {
                    "mutations": total,
                    "killed": killed,
                    "timeouts": counts["timeout"],
                    "share_killed": round(killed / total, 4),
                }
        return shares

    def write(self, path: Path) -> None:
        """Write it, whole or not at all."""
        partial = path.with_name(path.name + ".partial")
        partial.write_text(json.dumps(self.content(), indent=2) + "\n", encoding="utf-8")
        os.replace(partial, path)

    def tell(self) -> None:
        """Print the shares."""
        for group, share in self._shares().items():
            killed, total = share["killed"], share["mutations"]
            print(f"{group}: {killed} of {total} killed, {100 * share['share_killed']:.1f} %")
        wrong = [one for one in self._controls if one["outcome"] != "survived"]
        print(f"controls: {len(wrong)} of {len(self._controls)} failed without a mutation")


def _reason(survivor: dict[str, Any]) -> str:
    return "no test tells them apart yet" if survivor["tests"] else "no test reaches this line"


if __name__ == "__main__":
    main()
