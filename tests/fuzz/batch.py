"""A batch of cases in a process of its own: a crash, a hang or a flood of memory ends this one alone.

    python tests/fuzz/batch.py KIND SEED COUNT RESULT.json

The file is written as far as the batch came: the parent names the case at which it ended.
"""

import contextlib
import json
import resource
import sys
import time
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))
sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
sys.path.insert(0, str(Path(__file__).parent))

from hostile import instead_of
from outcome import Tally, run_case

ROOM = 4 << 30  # bytes of addresses beyond what the imported libraries take


def main() -> None:
    """Run the batch."""
    kind, seed, count, path = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]).resolve()
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder, contextlib.chdir(folder):  # what bad names write stays out of the checkout
        run(kind, seed, count, path)


def run(kind: str, seed: int, count: int, path: Path) -> None:
    """Run so many cases of a kind, and write what came of them."""
    tally = Tally()
    progress = path.with_suffix(".case")
    started = time.monotonic()
    if kind == "files":
        import files

        _limit_memory()
        files.run(tally, seed, count, progress)
    elif kind == "commands":
        import commands

        commands.run(tally, seed, count, progress)
    else:
        calls(tally, kind, seed, count, progress)
    seconds = time.monotonic() - started
    path.write_text(json.dumps({"counts": tally.counts, "faults": tally.faults, "seconds": seconds}))


def calls(tally: Tally, group: str, seed: int, count: int, progress: Path) -> None:
    """Calls with spoiled arguments."""
    from calls import GROUPS

    targets = GROUPS[group]()
    weights = np.array([target.weight for target in targets])
    for target in targets:  # a good call must be good, and compiles what the others need
        run_case(tally, f"{target.name}, good", lambda target=target: target.call(**target.good()), may_be_nan=True)
    _limit_memory()
    for case in range(count):
        random = np.random.default_rng([seed, case])
        target = targets[int(random.choice(len(targets), p=weights / weights.sum()))]
        arguments = target.good()
        names = [name for name in arguments if name not in target.kept]
        spoiled, nonsense = [], False
        for name in random.choice(names, size=min(len(names), 1 + int(random.random() < 0.25)), replace=False):
            arguments[name], wrong = instead_of(arguments[name], random)
            spoiled.append(f"{name}={_shown(arguments[name])}")
            nonsense |= wrong
        name = f"{group} {seed} {case} {target.name}({', '.join(spoiled)})"
        progress.write_text(name, errors="replace")
        state = target.state
        run_case(
            tally,
            name,
            lambda target=target, arguments=arguments: target.call(**arguments),
            nonsense=nonsense,
            may_be_nan=target.may_be_nan,
            state=None if state is None else lambda state=state, one=arguments["self"]: state(one),
        )


def _shown(value: object) -> str:
    try:
        if isinstance(value, np.ndarray):
            return f"array {value.dtype} {value.shape} {value.reshape(-1)[:4]!s}"[:90]
        return repr(value)[:60]
    except Exception:
        return type(value).__name__


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + ROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


if __name__ == "__main__":
    main()
