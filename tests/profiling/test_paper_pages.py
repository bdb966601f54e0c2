"""Tables of the papers' pages, from runs made by hand."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import paper_pages


def run(seed: int, ours: float | None, **arguments: object) -> dict:
    row = {"name": "grasped of 20", "paper": None, "ours": ours, "unit": "", "seeds": [seed]}
    return {
        **{"paper": "generative", "experiment": "grasp", "seeds": [seed], "rows": [row]},
        **{"arguments": arguments, "date": "2026-01-02T03:04:05", "commit": "0123456789"},
    }


def test_runs_stand_beside_each_other_where_they_were_told_the_same():
    runs = [run(502, 19.0, independent=0.0), run(501, 20.0, independent=0.0), run(501, 7.0, independent=0.01)]
    assert paper_pages.page_tables(runs).splitlines() == [
        "### grasp",
        "",
        "`dense-vs reproduce generative grasp`; 2026-01-02, commit 0123456.",
        "",
        "| | paper | seed 501 | seed 502 | |",
        "|---|---|---|---|---|",
        "| grasped of 20 |  | 20 | 19 |  |",
        "",
        "### grasp: every motion of a joint off by N(0, 0.01 rad)",
        "",
        "`dense-vs reproduce generative grasp`; 2026-01-02, commit 0123456.",
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


def test_what_lies_between_markers_is_replaced_and_nothing_else():
    assert paper_pages._between("a<b>old<e>z", "<b>", "<e>", "new") == "a<b>\n\nnew\n<e>z"
