"""Tables of the papers' pages, from runs made by hand."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import paper_pages


def run(seed: int, ours: float | None, **arguments: object) -> dict:
    row = {"name": "grasped of 20", "paper": None, "ours": ours, "unit": "", "seeds": [seed]}
    return {
        **{"paper": "gothoskar", "experiment": "grasp", "seeds": [seed], "rows": [row]},
        **{"arguments": arguments, "date": "2026-01-02T03:04:05", "commit": "0123456789"},
    }


def test_runs_stand_beside_each_other_where_they_were_told_the_same():
    runs = [run(502, 19.0, independent=0.0), run(501, 20.0, independent=0.0), run(501, 7.0, independent=0.01)]
    assert paper_pages.page_tables(runs).splitlines() == [
        "### grasp",
        "",
        "`dense-vs reproduce gothoskar grasp` and `--seed`; 2026-01-02, commit 0123456.",
        "",
        "| | paper | seed 501 | seed 502 | |",
        "|---|---|---|---|---|",
        "| grasped of 20 |  | 20 | 19 |  |",
        "",
        "### grasp: every motion of a joint off by N(0, 0.01 rad)",
        "",
        "`dense-vs reproduce gothoskar grasp --independent 0.01` and `--seed`; 2026-01-02, commit 0123456.",
        "",
        "| | paper | seed 501 | |",
        "|---|---|---|---|",
        "| grasped of 20 |  | 7 |  |",
    ]


@pytest.mark.parametrize(
    ("arguments", "title"),
    [
        ({"postures": "uniform"}, "### grasp: postures uniform"),
        ({"postures": "normal", "independent": 0.5}, "### grasp: postures normal, every motion of a joint off by"),
        ({}, "### grasp"),
    ],
)
def test_a_section_says_what_its_runs_were_told(arguments, title):
    assert paper_pages.page_tables([run(1, None, **arguments)]).startswith(title)


@pytest.mark.parametrize(
    ("paper", "experiment", "arguments", "typed"),
    [
        ("vosvs", "trial", {"method": "robust"}, "vosvs trial --difficulty clean"),  # before there was another
        ("vosvs", "trial", {"method": "robust", "difficulty": "hard", "mask_seconds": None, "jobs": 4}, "vosvs trial"),
        ("vosvs", "learn", {"responses": 2, "threads": 1}, "vosvs learn --responses 2"),
        ("vosvs", "depth-log", {"log": "sugar_box_approach.csv"}, "vosvs depth-log"),
        ("dije", "reach", {"compliance": True, "halve": False}, "dije reach --compliance"),
        ("gothoskar", "few-samples", {"samples": [10, 50]}, "gothoskar few-samples --samples 10 50"),
    ],
)
def test_a_command_is_shown_with_the_options_that_it_was_given(paper, experiment, arguments, typed):
    one = {"paper": paper, "experiment": experiment, "arguments": arguments}
    assert paper_pages._command(one) == f"dense-vs reproduce {typed}"


def test_what_lies_between_markers_is_replaced_and_nothing_else():
    assert paper_pages._between("a<b>old<e>z", "<b>", "<e>", "new") == "a<b>\n\nnew\n<e>z"
