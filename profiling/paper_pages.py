"""The tables of docs/papers, from what ``dense-vs reproduce --json`` wrote: the paper's figure beside ours, all rows.

python profiling/paper_pages.py            # rewrites the tables between their markers
python profiling/paper_pages.py --check    # fails where a page is not what the results say
"""

import argparse
import json
import math
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

from experiments import EARLIER
from ibvs_table import visp_lines

from dense_vs.cli.parsing import LazyParser, from_module
from dense_vs.sims.papers import PAPERS

RESULTS = Path(__file__).parent / "results" / "experiments.json"
PAGES = Path(__file__).parent.parent / "docs" / "papers"
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
UNSAID = ("jobs", "keep")  # options that change no figure
BESIDE = {"gothoskar": {"visp": visp_lines}}  # page -> name of the markers -> lines between them


def page_tables(runs: list[dict[str, Any]]) -> str:
    """Markdown of all experiments of a paper: a section an experiment, a column a run.

    Runs of one experiment stand beside each other where they were told the same and have the same rows.
    """
    grouped: dict[tuple[str, str, tuple[str, ...]], list[dict[str, Any]]] = defaultdict(list)
    for run in runs:
        grouped[run["experiment"], _told(run), tuple(row["name"] for row in run["rows"])].append(run)
    return "\n".join(_section(experiment, told, members) for (experiment, told, _), members in sorted(grouped.items()))


def _between(text: str, begin: str, end: str, content: str) -> str:
    """The text with other content between its markers."""
    before, rest = text.split(begin)
    return f"{before}{begin}\n\n{content}\n{end}{rest.split(end)[1]}"


def _section(experiment: str, told: str, runs: list[dict[str, Any]]) -> str:
    runs = sorted(runs, key=lambda run: run["seeds"])
    seeds = ["seeds " + _range(run["seeds"]) if len(run["seeds"]) > 1 else f"seed {run['seeds'][0]}" for run in runs]
    lines = [
        f"### {experiment}{': ' + told if told else ''}",
        "",
        f"`{_command(runs[0])}` and `--seed`; {_made(runs)}.",
        "",
        f"| | paper | {' | '.join(seeds)} | |",
        f"|---|---|{'---|' * (len(runs) + 1)}",
    ]
    for index, row in enumerate(runs[0]["rows"]):
        ours = [_shown(run["rows"][index]["ours"]) for run in runs]
        paper = "" if row["paper"] is None else _shown(row["paper"])
        lines.append(f"| {row['name'].strip()} | {paper} | {' | '.join(ours)} | {row['unit']} |")
    return "\n".join([*lines, ""])


def _told(run: dict[str, Any]) -> str:
    """What tells runs of one experiment apart."""
    arguments = run.get("arguments") or {}
    if run["experiment"] == "trial":
        return arguments.get("difficulty", "clean")  # there was no other before
    told = [f"postures {arguments['postures']}"] if arguments.get("postures") else []
    if arguments.get("compliance"):
        told.append("soft joints")
    if arguments.get("independent"):
        told.append(f"every motion of a joint off by N(0, {arguments['independent']:g} rad)")
    return ", ".join(told)


def _command(run: dict[str, Any]) -> str:
    """What a run was begun with, as it is typed: every option that is not as it would be without; seeds aside."""
    words = ["dense-vs reproduce", run["paper"], run["experiment"]]
    told = {**EARLIER.get(run["experiment"], {}), **(run.get("arguments") or {})}
    parser = LazyParser()
    from_module(PAPERS[run["paper"]].experiments[run["experiment"]].home)(parser)
    for action in parser._actions:
        value = told.get(action.dest)
        default = action.default.name if isinstance(action.default, Path) else action.default  # as results name files
        if not action.option_strings or action.dest in UNSAID or action.dest not in told or value == default:
            continue
        values = [] if value is True else value if isinstance(value, list) else [value]
        words += [action.option_strings[-1], *map(str, values)]
    return " ".join(words)


def _made(runs: list[dict[str, Any]]) -> str:
    """When and with which commit, where the run says so."""
    dates = sorted({run["date"][:10] for run in runs if "date" in run})
    commits = sorted({run["commit"][:7] for run in runs if run.get("commit")})
    when = " to ".join(dict.fromkeys((dates[0], dates[-1]))) if dates else "date not recorded"
    return f"{when}, commit {', '.join(commits)}" if commits else when


def _range(seeds: list[int]) -> str:
    return f"{seeds[0]}-{seeds[-1]}" if seeds == list(range(seeds[0], seeds[-1] + 1)) else ", ".join(map(str, seeds))


def _shown(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "none"
    whole = (value == round(value) or abs(value) >= 1000) and abs(value) < 1e6
    return f"{value:.0f}" if whole else f"{value:.3g}"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Write the papers' tables into docs/papers.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail where a page differs")
    check = parser.parse_args().check
    runs = json.loads(RESULTS.read_text(encoding="utf-8"))["runs"]
    stale = []
    for paper in PAPERS:
        page = PAGES / f"{paper}.md"
        text = page.read_text(encoding="utf-8")
        whole = _between(text, BEGIN, END, page_tables([run for run in runs if run["paper"] == paper]))
        for what, lines in BESIDE.get(paper, {}).items():
            whole = _between(whole, f"<!-- {what}: begin -->", f"<!-- {what}: end -->", "\n".join([*lines(), ""]))
        if whole != text:
            stale.append(page.name)
            if not check:
                page.write_text(whole, encoding="utf-8")
    if check and stale:
        print(f"not what the results say: {', '.join(stale)}; run python profiling/paper_pages.py", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
