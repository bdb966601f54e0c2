"""Scores of what is hidden, on cases made by hand that pass, are at the border and fail."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from hidden_scores import CoveredScore, HiddenReach, metrics_of, share_of_both

COVERED = CoveredScore(0, 0.4, 0.1, 0.12, 0.2, 0.24, 0.9, 0.85, 0.85, 0.82, 0.1, 0.3)
REACH = HiddenReach(0, "behind", 40, "reached", 1.0, "reached", 0.5, 38)


@pytest.mark.parametrize(
    ("change", "good"),
    [
        ({}, True),
        ({"j_after": 0.13, "covered_after": 0.26}, True),  # exactly 1.3 times
        ({"j_after": 0.1301}, False),
        ({"covered_after": 0.261}, False),  # the covered part alone has unlearned
        ({"covered_after": float("nan")}, False),
        ({"overlap_after": 0.8, "overlap_meanwhile": 0.8, "covered_overlap": 0.8}, True),
        ({"overlap_after": 0.799}, False),
        ({"overlap_meanwhile": 0.799}, False),
        ({"covered_overlap": 0.0}, False),
        ({"covered_overlap": float("nan")}, False),  # nothing was hidden
    ],
)
def test_what_was_covered_is_good_where_all_of_it_is(change, good):
    assert replace(COVERED, **change).good is good


def test_the_larger_ratio_counts():
    assert COVERED.ratio == pytest.approx(1.2)
    assert replace(COVERED, covered_after=0.6).ratio == pytest.approx(3.0)
    assert replace(COVERED, j_before=float("nan")).ratio == np.inf
    assert COVERED.ratio_without == pytest.approx(1.2)  # 0.12 to 0.1, 0.24 to 0.3
    assert replace(COVERED, covered_without=0.12).ratio_without == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("change", "good", "flagged", "wrong"),
    [
        ({}, True, False, False),
        ({"true_px": 2.999}, True, False, False),
        ({"true_px": 3.0}, False, False, True),
        ({"true_px": 9.0, "end": "lost"}, False, True, False),
        ({"true_px": 9.0, "end": "missed"}, False, True, False),
        ({"true_px": 0.5, "end": "lost"}, True, False, False),  # there, and not sure of it
        ({"away_px": 2.999}, True, False, False),
        ({"away_px": 3.0}, True, False, True),
        ({"away_px": 8.0}, True, False, True),  # said to be there behind the object, and was not
        ({"away_px": 8.0, "away_end": "lost"}, True, False, False),
        ({"true_px": float("nan")}, False, False, True),  # behind the camera
        ({"away_px": float("nan")}, True, False, True),
    ],
)
def test_reaches_are_counted_by_the_truth_and_by_what_is_said(change, good, flagged, wrong):
    reach = replace(REACH, **change)
    assert (reach.good, reach.flagged, reach.wrong) == (good, flagged, wrong)


def test_overlap_of_masks():
    mask = np.zeros((4, 5), bool)
    assert np.isnan(share_of_both(mask, mask))
    mask[1:3] = True
    assert share_of_both(mask, mask) == 1.0
    assert share_of_both(mask[::-1], np.roll(mask, 1, axis=0)) == pytest.approx(1 / 3)
    assert share_of_both(~mask, mask) == 0.0


def test_every_figure_has_a_metric():
    reaches = [REACH, replace(REACH, where="outside", true_px=5.0), replace(REACH, true_px=7.0, end="lost")]
    metrics = {metric.name: metric for metric in metrics_of([COVERED], reaches)}
    found = {name: metric.value for name, metric in metrics.items()}
    assert found["covered for 3 s, seed 0: J error after to before"] == pytest.approx(1.2)
    assert found["covered for 3 s, seed 0: label IoU of what is hidden"] == 0.82
    assert found["behind: reaches"] == 2
    assert found["behind: below 3 px"] == 1
    assert found["behind: not there, and said"] == 1
    assert found["behind: frames unseen, and said"] == 76
    assert found["outside: wrongly said reached"] == 1
    assert found["behind: frames unseen"] == 80
    for name, metric in metrics.items():
        assert metric.unit == ("1" if "covered" in name else "frames" if "unseen" in name else "reaches")
    assert (metrics["outside: wrongly said reached"].better, metrics["behind: reaches"].better) == ("lower", "higher")
