"""One run of a command, and the key under which its result is found again."""

import hashlib
import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """One run of a ``dense-vs`` command.

    Attributes:
        name: of the folder that holds its result, unique among the tasks of one folder.
        group: what it shares with runs that differ from it in their seed alone.
        arguments: of the command line, without those that say where results go.
        seed: of the run; None where the command takes none.
    """

    name: str
    group: str
    arguments: tuple[str, ...]
    seed: int | None = None

    def key(self, version: str) -> str:
        """Digest of what was asked of which code; a result with another key is not this task's.

        Args:
            version: of the code, as :func:`~dense_vs.sweep.source_version.source_version` tells it.
        """
        return hashlib.sha256(json.dumps([version, *self.arguments]).encode()).hexdigest()[:16]

    def command_line(self, out: str, figures: str) -> list[str]:
        """Arguments of the process that runs it.

        Args:
            out: folder for its files.
            figures: file for its figures where the command writes such a file.
        """
        json_file = ["--json", figures] if self.arguments[0] == "reproduce" else []
        return [*self.arguments, "--out", out, *json_file]


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes:
        task: the one that ended.
        failure: the last line that it said, or why it could not be run; empty where it succeeded.
        log: file with everything that it printed.
        seconds: that it took; 0 where its result was there already.
    """

    task: Task
    failure: str
    log: str
    seconds: float
