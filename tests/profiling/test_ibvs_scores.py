"""Scores of servo runs, on runs made by hand."""

import sys
from pathlib import Path

import numpy as np
import pytest

from dense_vs.errors import DenseVSError

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from ibvs_scores import cost, score, strongest

QUICK = [9.0, 0.9, 0.5, 0.4]  # below 1 px from the first move on
LATE = [9.0, 5.0, 2.0, 0.99]
AT_THE_BORDER = [9.0, 1.0, 1.0, 1.0]  # of 1 px, which is not below
CAME_AND_WENT = [9.0, 0.5, 0.5, 3.0]
NO_NUMBER = [9.0, 0.5, 0.5, np.nan]


@pytest.mark.parametrize(
    ("runs", "moves", "end_px", "over"),
    [
        ([QUICK], 1, 0.4, 0.0),
        ([LATE], 3, 0.99, 0.0),
        ([AT_THE_BORDER], np.inf, 1.0, 1.0),
        ([CAME_AND_WENT], 1, 3.0, 1.0),
        ([QUICK, QUICK, LATE, CAME_AND_WENT], 1, 0.695, 0.25),
        ([QUICK, LATE, AT_THE_BORDER], 3, 0.99, 1 / 3),
        ([QUICK, LATE], 2, 0.695, 0.0),
        ([[0.5, 0.4]], 0, 0.4, 0.0),
    ],
)
def test_a_score_counts_moves_ends_and_what_is_over(runs, moves, end_px, over):
    found = score(np.array(runs))
    assert found.tasks == len(runs)
    assert found.moves == moves
    assert found.end_px == pytest.approx(end_px)
    assert found.over == pytest.approx(over)


def test_an_end_that_is_no_number_is_over():
    assert score(np.array([QUICK, NO_NUMBER])).over == 0.5


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ([QUICK], 1.0),
        ([LATE], 3.0),
        ([AT_THE_BORDER], 3.0),
        ([CAME_AND_WENT], 3.0),
        ([NO_NUMBER], 3.0),
        ([QUICK, LATE, CAME_AND_WENT, QUICK], 2.0),
    ],
)
def test_a_run_that_does_not_end_there_costs_all_its_moves(runs, expected):
    assert cost(np.array(runs)) == expected


def test_the_strongest_is_there_with_the_fewest_moves_then_the_closest():
    quick, late, gone = (np.array([run]) for run in (QUICK, LATE, CAME_AND_WENT))
    assert strongest({"late": late, "quick": quick, "gone": gone}) == "quick"
    assert strongest({"gone": gone, "late": late}) == "late"  # as many moves, a smaller end
    assert strongest({"late": late, "gone": gone}) == "late"
    assert strongest({"gone": gone}) == "gone"


@pytest.mark.parametrize("errors", [np.zeros(3), np.zeros((0, 3)), np.zeros((3, 1))])
def test_no_run_has_no_score(errors):
    with pytest.raises(DenseVSError, match="expected \\(runs, moves \\+ 1\\)"):
        score(errors)
    with pytest.raises(DenseVSError, match="expected \\(runs, moves \\+ 1\\)"):
        cost(errors)


def test_nothing_tried_is_refused():
    with pytest.raises(DenseVSError, match="at least one"):
        strongest({})
