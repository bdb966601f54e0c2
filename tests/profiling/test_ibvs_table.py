"""The table of ViSP beside the model, from scores made by hand."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from ibvs_table import visp_table


def row(noise: str, law: str, moves: float | None, end_px: float | None, over: float) -> dict:
    return {"noise": noise, "law": law, "tasks": 8, "moves": moves, "end_px": end_px, "over": over}


def test_a_line_a_law_and_a_column_a_noise():
    rows = [
        row("exact", "model", 1.0, 0.354, 0.0225),
        row("exact", "ViSP", 6.5, 0.3, 0.0),
        row("independent", "model", None, 5.1, 1.0),
        row("independent", "ViSP", None, None, 0.5),
        row("proportional", "model", 2.0, 0.46, 0.125),
        row("proportional", "ViSP", 4.0, 0.509, 0.005),
    ]
    chosen = {noise: {"ViSP": f"set for {noise}"} for noise in ("exact", "independent", "proportional")}
    assert visp_table(rows, chosen, 0.02) == [
        "| | exact joints (Fig. 8) | noise 0.02 rad a rad of the move (Fig. 9) | noise 0.02 rad every move (Fig. 9) |",
        "|---|---|---|---|",
        "| model | 1; 0.35; 2.25 % | 2; 0.46; 12.5 % | never; 5.10; 100 % |",
        "| ViSP | 6.5; 0.30; 0 % (set for exact) | 4; 0.51; 0.5 % (set for proportional) "
        "| never; not finite; 50 % (set for independent) |",
    ]
