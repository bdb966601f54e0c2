"""What has come of the trials so far: shares killed, survivors with their reasons, controls."""

import ast
import json
import math
import os
from collections import Counter
from pathlib import Path
from typing import Any

from mutation.operators import Mutant
from mutation.trials import Trial

REASONS = Path(__file__).with_name("reasons.json")
CONTINUOUS = "the border of a continuous value, which no run meets exactly"
COUNTING = ("len", "sum", "count", "count_nonzero", "round", "int")
SURE = 1.96  # standard deviations on either side: 95 % of samples


def identity(file: str, mutant: Mutant) -> tuple[str, int, str, str]:
    """What tells a mutation from all others."""
    return file, mutant.place, mutant.before, mutant.after


class Journal:
    """Outcomes as they come, a line each, so that a run that is stopped can go on.

    Args:
        path: the file.
        of: what a run must have in common with the one that goes on; another journal is begun anew.
        resume: whether to go on.
    """

    def __init__(self, path: Path, of: dict[str, Any], resume: bool):
        self._path = path
        self._lines: list[dict[str, Any]] = []
        of = json.loads(json.dumps(of))
        if resume and path.is_file():
            first, *lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
            told = {name: (first.get(name), of[name]) for name in of if first.get(name) != of[name]}
            if told:
                raise SystemExit(
                    f"the run to go on with differs: {told} (then, now); expected the same, or a run without --resume"
                )
            self._lines = lines
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(of) + "\n", encoding="utf-8")

    def outcomes(self) -> dict[tuple[str, int, str, str], str]:
        """Of the mutations that have one."""
        return {tuple(line["mutation"]): line["outcome"] for line in self._lines if line["mutation"]}

    def controls(self) -> list[dict[str, Any]]:
        """Controls that ran."""
        return [line["control"] for line in self._lines if not line["mutation"]]

    def add(self, trial: Trial, outcome: str) -> None:
        """Write an outcome down."""
        if trial.mutant is None:
            line: dict[str, Any] = {"mutation": None, "control": control(trial, outcome)}
        else:
            line = {"mutation": identity(trial.file, trial.mutant), "outcome": outcome}
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def control(trial: Trial, outcome: str) -> dict[str, Any]:
    """A control as it is written."""
    return {"file": trial.file, "outcome": outcome, "tests": trial.tests}


class Result:
    """What has come of the trials so far."""

    def __init__(
        self,
        counts: dict[str, int],
        drawn: int,
        failed: list[str],
        origin: dict[str, Any],
        controls: list[dict[str, Any]],
    ):
        self._counts = counts
        self._drawn = drawn
        self._failed = failed
        self._origin = origin
        self._mutations: list[dict[str, Any]] = []
        self._controls = controls
        self._last = ""
        self._reasons = json.loads(REASONS.read_text(encoding="utf-8")) if REASONS.is_file() else {}

    def add(self, trial: Trial, outcome: str) -> None:
        """Count a trial."""
        if trial.mutant is None:
            self._controls.append(control(trial, outcome))
            told = "passed" if outcome == "survived" else outcome
            self._last = f"control {told} {trial.file}"
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
        self._last = f"{len(self._mutations)}/{self._drawn} {outcome:9} {change}"

    def tell_last(self) -> None:
        """Print the last trial."""
        print(self._last, flush=True)

    def content(self) -> dict[str, Any]:
        """The result as it is written: shares of those with an outcome, survivors, controls, origin."""
        survivors = [one for one in self._mutations if one["outcome"] == "survived"]
        for one in survivors:
            one["reason"] = self._same(one) or _reason(one)
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

    def _same(self, survivor: dict[str, Any]) -> str:
        """Why a mutation does the same as what it stands for; empty where it does not."""
        place = " ".join(part for part in (survivor["file"], survivor["function"]) if part)
        known = self._reasons.get(f"{place}: {survivor['before']} -> {survivor['after']}", "")
        border = survivor["tests"] and at_continuous_border(survivor["before"], survivor["after"])
        return known or (CONTINUOUS if border else "")

    def _shares(self) -> dict[str, dict[str, Any]]:
        shares: dict[str, dict[str, Any]] = {}
        for group in [*self._counts, "all"]:
            counts = Counter(one["outcome"] for one in self._mutations if group in (one["group"], "all"))
            total = counts["killed"] + counts["timeout"] + counts["survived"]
            if total:
                killed = total - counts["survived"]
                same = sum(
                    bool(self._same(one))
                    for one in self._mutations
                    if one["outcome"] == "survived" and group in (one["group"], "all")
                )
                low, high = interval(killed, total)
                shares[group] = {
                    "of": sum(self._counts.values()) if group == "all" else self._counts[group],
                    "mutations": total,
                    "killed": killed,
                    "timeouts": counts["timeout"],
                    "share_killed": round(killed / total, 4),
                    "between": [round(low, 4), round(high, 4)],
                    "survived_but_the_same": same,
                    "share_killed_of_others": round(killed / max(total - same, 1), 4),
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
            low, high = (100 * end for end in share["between"])
            others, same = 100 * share["share_killed_of_others"], share["survived_but_the_same"]
            print(f"{group}: {killed} of {total} killed, {100 * killed / total:.1f} % ({low:.0f} to {high:.0f} %)")
            print(f"    without {same} that do the same: {others:.1f} %")
        wrong = [one for one in self._controls if one["outcome"] != "survived"]
        print(f"controls: {len(wrong)} of {len(self._controls)} failed without a mutation")


def at_continuous_border(before: str, after: str) -> bool:
    """Whether a mutation only moves the border of a comparison in which no whole number stands and nothing is counted.

    No run meets such a border exactly, unless a test is made for it.
    """
    both = [ast.parse(text, mode="eval").body for text in (before, after)]
    if not all(isinstance(one, ast.Compare) for one in both):
        return False
    old, new = both
    assert isinstance(old, ast.Compare)
    assert isinstance(new, ast.Compare)
    moved = {type(old.ops[0]), type(new.ops[0])} in ({ast.Lt, ast.LtE}, {ast.Gt, ast.GtE})
    counted = any(
        (isinstance(one, ast.Constant) and type(one.value) is int)
        or (isinstance(one, ast.Call) and ast.unparse(one.func).endswith(COUNTING))
        for one in ast.walk(old)
    )
    return moved and len(old.ops) == 1 and not counted


def _reason(survivor: dict[str, Any]) -> str:
    return "no test tells them apart yet" if survivor["tests"] else "no test reaches this line"


def interval(killed: int, total: int) -> tuple[float, float]:
    """Where the share of all mutations lies, with 95 % confidence: Wilson's interval of a random sample's share."""
    share, spread = killed / total, SURE**2 / total
    half = SURE * math.sqrt(share * (1 - share) / total + spread / (4 * total))
    return (share + spread / 2 - half) / (1 + spread), (share + spread / 2 + half) / (1 + spread)
