"""Committed results as the tables read them: values by name, and where they come from in words."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"


class Result:
    """A result file that ``metrics.py`` wrote.

    Args:
        name: of the file in ``profiling/results``, without its ending.
    """

    def __init__(self, name: str):
        content = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
        self.values: dict[str, float] = {metric["name"]: metric["value"] for metric in content["metrics"]}
        self.content = content

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def ranged(self, name: str) -> str:
        """A value and the range of several runs, where it was measured in several."""
        least, _, most = self.content.get("ranges", {}).get(name, (0.0, 0.0, 0.0))
        return f"{self[name]:.1f} ({least:.1f}-{most:.1f})" if most else f"{self[name]:.1f}"

    def origin(self) -> str:
        """Machine, date, commit and Warp's version."""
        return origin(self.content)

    def when(self) -> str:
        """Date and commit."""
        return when(self.content)


def origin(content: dict[str, Any]) -> str:
    """Where a result was measured, when, and from which commit, as far as its file says."""
    machine = content.get("machine", {})
    gpus = Counter(machine.get("gpus", []))
    words = [f"{count} {gpu}" if count > 1 else gpu for gpu, count in gpus.items()]
    words = words or [f"{machine.get('cores', '?')} cores of {machine.get('cpu', 'unknown')}"]
    caches = machine.get("caches", {})
    if caches and not machine.get("gpus"):
        words.append(", ".join(f"{name} {size}" for name, size in caches.items()))
    words.append(when(content))
    words.append(f"Warp {content['versions']['warp-lang']}")
    return ", ".join(words)


def when(content: dict[str, Any]) -> str:
    """Date and commit of a result, as far as its file says."""
    commit = f"commit {content['commit'][:10]}" if content.get("commit") else "commit not noted"
    return f"{content.get('date', 'date not noted')[:10]}, {commit}"


def in_words(facts: dict[str, float]) -> str:
    """The facts in one line."""
    return ", ".join(f"{name.replace(' [', f' {value:.3g} ').rstrip(']')}" for name, value in facts.items())


def runs() -> list[dict[str, Any]]:
    """Runs of experiments, as ``dense-vs reproduce --json`` wrote them."""
    return json.loads((RESULTS / "experiments.json").read_text(encoding="utf-8"))["runs"]
