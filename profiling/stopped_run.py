"""A run that was stopped before its end, as its file has it, so that it can be gone on with."""

import json
from pathlib import Path
from typing import Any

OF_A_RUN = ("jobs", "limit", "resume")  # options that no figure depends on


def stopped_run(file: Path | None, origin: dict[str, Any]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The rows of a run that was stopped, and when and on which machine it began; nothing where there is no file.

    Args:
        file: that ``--json`` names.
        origin: commit and arguments of the run that goes on, see :func:`.provenance`.

    Raises:
        SystemExit: ``--json`` is not given, or the file is of another commit or other arguments.
    """
    if file is None:
        raise SystemExit("--resume goes on with what --json names; expected both")
    if not file.is_file():
        return [], {}
    stored = json.loads(file.read_text(encoding="utf-8"))
    for name in ("commit", "arguments"):
        had, has = (_of_figures(one.get(name)) for one in (stored, origin))
        if had != has:
            raise SystemExit(f"{file} has {name} {had}; expected {has}")
    return stored["rows"], {name: stored[name] for name in ("date", "machine")}


def _of_figures(told: Any) -> Any:
    """A commit as it is; of arguments those that figures depend on."""
    return {name: value for name, value in told.items() if name not in OF_A_RUN} if isinstance(told, dict) else told
