"""Scores of body models: names, metrics, rows and what is said of several together."""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from body_scores import HEADER, UNITS, BodyScore, Summary, metrics_of, rows_of, summary

from dense_vs.files import write_json


def score(arm="panda", camera="A", images="clean", seed=3, **figures):
    return BodyScore(arm, camera, images, seed, **figures)


def test_a_score_is_named_by_what_it_has():
    assert score().name == "panda A clean 3"
    assert score("arm", "", "realistic", 0).name == "arm realistic 0"


def test_a_file_that_has_no_form_for_infinity_gives_it_back(tmp_path):
    file = tmp_path / "body.json"
    scores = [
        score(points_median=1.0, points_p90=np.inf, known_p90=2.0, tracks=3, depth=0.01),
        score(points_median=np.inf, points_p90=np.inf, known_p90=np.inf),
        score(failure="too few tracks"),
    ]
    write_json(file, [asdict(one) for one in scores])
    assert repr([BodyScore.of_row(row) for row in json.loads(file.read_text())]) == repr(scores)


def test_every_figure_is_a_metric_with_the_way_that_is_better():
    found = {metric.name: metric for metric in metrics_of([score(points_p90=2.0, overlap=0.5, known_share=0.9)])}
    assert len(found) == len(UNITS)
    px = found["body_model/panda A clean 3/points_p90"]
    assert (px.value, px.unit, px.better) == (2.0, "px", "lower")
    assert found["body_model/panda A clean 3/overlap"].better == "higher"
    assert found["body_model/panda A clean 3/known_share"].better == "higher"
    assert np.isnan(found["body_model/panda A clean 3/depth"].value)


def test_a_row_has_a_word_for_every_column():
    figures = {field: 0.1 * k for k, field in enumerate(UNITS, start=1)}
    (row,) = rows_of([score("arm", "", tracks=17, point_tracks=9, **figures)])
    assert len(row) == len(HEADER)
    told = dict(zip(HEADER[:3], row, strict=False))
    assert told == {"arm, camera": "arm", "images": "clean", "seed": "3"}
    assert row[3:8] == ["0.10", "0.20", "0.30", "0.50", "0.40"]  # known, then what nine in ten of these are off
    assert row[8:14] == ["0.600", "0.70", "0.80", "0.900", "1.00", "1.10"]
    assert row[14:] == ["17", "1.20", "9", "1.3", "1.4", "1.5"]


def test_several_are_told_by_the_middle_and_the_worst_of_those_found():
    several = Summary(
        [
            score(points_p90=3.0, overlap=0.9),
            score(points_p90=np.inf, overlap=0.5),
            score(points_p90=1.0, overlap=0.7),
            score(points_p90=2.0, overlap=0.6),
            score(failure="too few tracks"),
        ]
    )
    assert (several.count, several.found) == (5, 4)
    assert (several.middle("points_p90"), several.middle("overlap")) == (3.0, 0.6)  # the worse of two
    assert (several.worst("points_p90"), several.worst("overlap")) == (np.inf, 0.5)
    assert several.holding("points_p90", 2.0) == 2  # the border counts
    assert several.holding("overlap", 0.7) == 2


def test_none_found_is_no_figure():
    none = Summary([score(failure="no")])
    assert (none.count, none.found) == (1, 0)
    assert np.isnan([none.middle("overlap"), none.worst("depth")]).all()
    assert none.holding("points_p90", 1e9) == 0


def test_our_own_arms_and_kinds_of_images_stand_apart():
    scores = [
        score("arm", "", overlap=0.1),
        score("painted", "", overlap=0.2),
        score("panda", overlap=0.3),
        score("panda", images="realistic", overlap=0.4),
        score("arm", "", "realistic", overlap=0.5),
    ]
    assert summary(scores, True, "clean").worst("overlap") == 0.1
    assert summary(scores, False, "clean").worst("overlap") == 0.3
    assert summary(scores, False, "realistic").worst("overlap") == 0.4
    assert summary(scores, True, "realistic").worst("overlap") == 0.5
