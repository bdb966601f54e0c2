"""What counts as a change that is named rightly, and how changes are told together: hand-made cases."""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from change_scores import HEADER, Case, ChangeScore, median_of, metrics_of, rows_of, summary_rows

from dense_vs.body_model import BodyChange, ChangeKind
from dense_vs.files import write_json

NONE = np.zeros(3)
NOTHING, JOINT, CAMERA = ChangeKind.NOTHING, ChangeKind.JOINT, ChangeKind.CAMERA


def change(kind, offsets=NONE, rivals=()):
    return BodyChange(kind, np.array(offsets, float), NONE, NONE, 0.9, 0.5, 3.0, 100, tuple(rivals), ("rad",) * 3)


def case(kind, offsets=NONE):
    return Case(kind, np.array(offsets, float))


@pytest.mark.parametrize(
    ("true", "found", "named", "among"),
    [
        (case(NOTHING), change(NOTHING), True, True),
        (case(NOTHING), change(JOINT, [0, 0.01, 0]), False, False),
        (case(JOINT, [0, -0.1, 0]), change(JOINT, [0, -0.09, 0]), True, True),
        (case(JOINT, [0, -0.1, 0]), change(JOINT, [0, 0.1, 0]), True, True),  # its error says the rest
        (case(JOINT, [0, -0.1, 0]), change(JOINT, [0.1, 0, 0]), False, False),
        (case(JOINT, [0, -0.1, 0]), change(CAMERA), False, False),
        (case(JOINT, [0, -0.1, 0]), change(NOTHING), False, False),
        (case(JOINT, [0, 0.1, 0]), change(CAMERA, rivals=[change(JOINT, [0, 0.1, 0])]), False, True),
        (case(JOINT, [0, 0.1, 0]), change(CAMERA, rivals=[change(JOINT, [0.1, 0, 0])]), False, False),
        (case(CAMERA), change(CAMERA), True, True),
        (case(CAMERA), change(JOINT, [0.1, 0, 0], [change(JOINT, [0, 0, 0.1]), change(CAMERA)]), False, True),
        (case(ChangeKind.JOINTS, [0.1, 0.1, 0]), change(ChangeKind.JOINTS, [0.1, 0.1, 0]), True, True),
        (case(ChangeKind.JOINTS, [0.1, 0.1, 0]), change(JOINT, [0.1, 0, 0]), False, False),
        (case(ChangeKind.UNKNOWN), change(ChangeKind.UNKNOWN), True, True),
        (case(ChangeKind.UNKNOWN), change(CAMERA), False, False),
    ],
)
def test_a_change_is_named_by_its_kind_and_its_joint(true, found, named, among):
    assert true.named(found) is named
    assert true.among(found) is among


def score(changed=JOINT, named=True, among=True, after=0.1, **more):
    return ChangeScore("panda", "A", "clean", 3, changed, JOINT, named, among, after=after, **more)


def test_a_file_gives_scores_back(tmp_path):
    scores = [score(offset=0.1, before=0.3), ChangeScore("arm", "", "clean", 0, failure="too few tracks")]
    write_json(tmp_path / "scores.json", [asdict(one) for one in scores])
    again = [ChangeScore.of_row(row) for row in json.loads((tmp_path / "scores.json").read_text())]
    assert repr(again).replace("<ChangeKind.JOINT: 'joint'>", "'joint'") == repr(scores).replace(
        "<ChangeKind.JOINT: 'joint'>", "'joint'"
    )
    assert [one.body for one in again] == ["panda A clean 3", "arm clean 0"]


def test_kinds_are_told_apart_and_in_their_order():
    scores = [
        score(CAMERA, after=0.4), score(JOINT, after=0.1), score(JOINT, named=False, after=0.3),
        score(JOINT, named=False, among=False, after=0.2), ChangeScore("arm", "", "clean", 0, failure="none"),
    ]  # fmt: skip
    assert summary_rows(scores) == [["joint", "3", "1", "2"], ["camera", "1", "1", "1"]]
    found = {metric.name: (metric.value, metric.better) for metric in metrics_of(scores)}
    assert found == {
        "body_changes/joint/named": (pytest.approx(1 / 3), "higher"),
        "body_changes/joint/after": (0.2, "lower"),
        "body_changes/camera/named": (1.0, "higher"),
        "body_changes/camera/after": (0.4, "lower"),
    }


def test_of_two_in_the_middle_the_worse_counts():
    assert median_of([score(after=value) for value in (0.1, 0.4, 0.2, 0.3)], "after") == 0.3
    assert np.isnan(median_of([], "after"))


def test_a_row_has_a_word_for_every_column():
    figures = {"offset": 0.1, "offset_error": 0.002, "off": 7.25, "agreement_before": 0.5, "agreement": 0.9,
               "before": 0.3}  # fmt: skip
    told = rows_of([score(**figures), score(named=False, **figures), score(named=False, among=False, **figures)])
    assert {len(row) for row in told} == {len(HEADER)}
    assert told[0][:3] == ["panda A", "clean", "3"]
    assert told[0][3:] == ["joint", "joint", "yes", "0.100", "0.002", "7.2", "0.50", "0.90", "0.300", "0.100"]
    assert [row[5] for row in told] == ["yes", "among", "no"]
    (failed,) = rows_of([ChangeScore("arm", "", "clean", 0, failure="too few tracks")])
    assert failed[3] == "too few tracks"
    assert len(failed) == len(HEADER)
