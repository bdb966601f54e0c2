"""Committed results as the tables read them: values by name, and where they come from in words."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"
OPTIONAL: frozenset[str] = frozenset()  # files and figures that the tables may do without until they are measured


def present(name: str, found: bool) -> bool:
    """Whether a table can show a file or figure.

    Raises:
        LookupError: it is not there, and is not one of ``OPTIONAL``: a row would vanish without a word.
    """
    if not found and name not in OPTIONAL:
        raise LookupError(f"the committed results lack {name!r}; measure it, or name it in results_file.OPTIONAL")
    return found


def committed(name: str) -> bool:
    """Whether a result file of that name is there; raises as :func:`present` does."""
    return present(name, (RESULTS / f"{name}.json").is_file())


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

    def has(self, name: str) -> bool:
        """Whether it holds a figure; raises as :func:`present` does."""
        return present(name, name in self.values)

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


def seeds_in_words(seeds: str) -> str:
    """Seeds as a command is given them, by comma: "seed 62" or "seeds 63, 64"."""
    return f"seed{'s' if ',' in seeds else ''} {seeds.replace(',', ', ')}"


def in_words(facts: dict[str, float]) -> str:
    """The facts in one line."""
    return ", ".join(f"{name.replace(' [', f' {value:.3g} ').rstrip(']')}" for name, value in facts.items())


def runs() -> list[dict[str, Any]]:
    """Runs of experiments, as ``dense-vs reproduce --json`` wrote them."""
    return json.loads((RESULTS / "experiments.json").read_text(encoding="utf-8"))["runs"]
