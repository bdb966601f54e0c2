"""Rows that an experiment reports: its figures beside those that the paper printed."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dense_vs.view.tables import table


@dataclass(frozen=True)
class Row:
    """One figure of an experiment.

    Attributes:
        name: what it is.
        paper: the value that the paper printed; None where it printed none.
        ours: the value measured in this run.
        unit: of both; ``""`` for a plain number.
        seeds: the seeds that the value stands on.
    """

    name: str
    paper: float | None
    ours: float
    unit: str
    seeds: tuple[int, ...]


def rows_table(rows: Sequence[Row]) -> str:
    """The rows as text, one a line."""
    cells = [
        [row.name, "-" if row.paper is None else f"{row.paper:.4g}", f"{row.ours:.4g}", row.unit, seeds_text(row.seeds)]
        for row in rows
    ]
    return table(["figure", "paper", "ours", "unit", "seeds"], cells)


def rows_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The rows as JSON-ready dictionaries."""
    return [asdict(row) for row in rows]


def seeds_text(seeds: Sequence[int]) -> str:
    """Seeds in short: ``0-4`` for a run of whole numbers, else ``3,7``."""
    ordered = sorted(seeds)
    if len(ordered) > 2 and ordered == list(range(ordered[0], ordered[-1] + 1)):
        return f"{ordered[0]}-{ordered[-1]}"
    return ",".join(str(seed) for seed in ordered)
