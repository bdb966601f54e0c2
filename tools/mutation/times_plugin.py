"""A pytest plugin for the first run: how long each test takes, what became of it, and whether it is marked slow.

With several workers it runs in each, where it keeps the worker to a share of the cores, as one mutation's tests get
later, and in their controller, which writes the file named by ``MUTATION_TIMES``.
"""

import json
import os
from pathlib import Path
from typing import Any

from mutation.shares import keep_to_share


def pytest_configure(config: Any) -> None:
    """Begin to listen, or keep a worker to its share."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is not None:
        keep_to_share(int(worker.removeprefix("gw")), int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
        return
    config.pluginmanager.register(_Times(Path(os.environ["MUTATION_TIMES"])), "mutation-times")


class _Times:
    def __init__(self, path: Path):
        self._path = path
        self._tests: dict[str, dict[str, Any]] = {}

    def pytest_runtest_logreport(self, report: Any) -> None:
        new = {"setup": 0.0, "rest": 0.0, "outcome": "passed", "slow": "slow" in report.keywords}
        test = self._tests.setdefault(report.nodeid, new)
        test["setup" if report.when == "setup" else "rest"] += report.duration
        if report.outcome != "passed":
            test["outcome"] = report.outcome

    def pytest_sessionfinish(self) -> None:
        self._path.write_text(json.dumps(self._tests, indent=1), encoding="utf-8")
