"""Scores of the measuring programs on cases made by hand."""

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.files import write_json

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import accuracy
import results_file
import surface_table
import surfaces
from surface_scores import ReachScore, Tally, ViewScore, label_quality, mean_of, metrics_of


def reach(true_error, believed=True, frames=10):
    return SimpleNamespace(true_error_px=true_error, reach=SimpleNamespace(reached=believed, frames=frames))


def view(arm, camera="", images="clean", seed=0, reaches=(), targets=None, **figures):
    """A view that has come to its end, of so many targets as it has reaches unless told."""
    state = {"finished": True, "targets": len(reaches) if targets is None else targets, **figures}
    return ViewScore(arm, camera, images, seed, 4, reaches=list(reaches), **state)


THERE = ReachScore("reached", 1.99, 0.5, 20)
WRONG = ReachScore("reached", 2.0, 0.5, 20)  # exactly 2 px off
ASTRAY = ReachScore("missed", 9.0, 3.1, 150)
MISSED = ReachScore("missed", 9.0, 3.0, 150)
LOST = ReachScore("lost", 40.0, 30.0, 9)
LOST_THERE = ReachScore("lost", 0.1, 0.1, 9)
BEHIND = ReachScore("missed", float("nan"), float("nan"), 150)


def test_reaches_are_counted_by_the_truth_and_by_what_is_said():
    reaches = [THERE, WRONG, ASTRAY, MISSED, LOST, LOST_THERE, BEHIND]
    tally = Tally.of([view("panda", reaches=reaches[:3]), view("ur5e", reaches=reaches[3:])])
    assert tally == Tally(asked=7, made=7, good=2, said=2, wrong=1, lost=2, missed=3, unsaid=2)


def test_reaches_that_did_not_come_about_count_unless_time_ran_out():
    failed = view("panda", reaches=[THERE], targets=5, finished=False, failure="the tip is hidden")
    stopped = view("panda", reaches=[THERE, LOST], targets=5, finished=False)
    assert Tally.of([failed]).asked == 5
    assert Tally.of([stopped]).asked == 2
    assert Tally.of([failed, stopped]).good == 2


def test_figures_of_arms_and_their_means():
    views = [
        view("panda", "A", j_median=0.2, j_p90=0.5, overlap=0.9, reaches=[THERE, WRONG]),
        view("panda", "A", seed=1, j_median=0.4, j_p90=0.7, overlap=0.7, reaches=[LOST]),
        view("ur5e", "B", j_median=0.6, j_p90=0.9, overlap=0.5, reaches=[THERE]),
        view("fetch", "B", targets=1, failure="no such arm"),
        view("arm", j_median=0.05, j_p90=0.1, overlap=0.99, reaches=[THERE]),  # ours: in no mean
        view("panda", "A", "realistic", j_median=0.8, j_p90=1.0, overlap=0.4),
    ]
    values = {metric.name: metric.value for metric in metrics_of(views)}
    assert values["panda A, clean: J error"] == pytest.approx(0.3)
    assert values["panda A, clean: reaches below 2 px"] == 1
    assert values["panda A, clean: wrongly said reached"] == 1
    assert values["panda A, clean: said lost"] == 1
    assert values["all arms, clean: J error"] == pytest.approx(0.4)  # every seed of every view alike
    assert values["all arms, clean: J error of the worst view"] == pytest.approx(0.6)
    assert values["all arms, clean: label IoU"] == pytest.approx(0.7)
    assert values["all arms, clean: reaches"] == 5
    assert values["all arms, clean: reaches below 2 px"] == 2
    assert values["all arms, realistic: J error"] == pytest.approx(0.8)
    assert "all arms, realistic: reaches" not in values
    assert values["arm, clean: J error"] == 0.05


def test_the_table_says_what_failed_and_what_is_not_known():
    views = [
        view("arm", j_median=0.05, j_p90=0.1, exact_median=0.02, overlap=0.99, reaches=[THERE]),
        view("panda", "A", j_median=0.2, j_p90=0.5, overlap=0.9, reaches=[THERE, WRONG, LOST, ASTRAY]),
        view("panda", "B", targets=5, finished=False, failure="gone"),
    ]
    lines = surface_table.table_lines(views)[2:]
    assert lines == [
        "| panda A | clean | 0.20 (0.50) | - | 0.90 | 1 of 4 | 2 | 1 | 1 | 1 | 1 |",
        "| panda B (1 of 1 failed) | clean | - (-) | - | - | 0 of 5 | 0 | 0 | 0 | 0 | 0 |",
        "| arm | clean | 0.05 (0.10) | 0.02 | 0.99 | 1 of 1 | 1 | 0 | 0 | 0 | 0 |",
        "| **all commercial arms** (1 of 2 failed) | clean | 0.20 (0.50) | - | 0.90 | 1 of 9 | 2 | 1 | 1 | 1 | 1 |",
    ]


def test_a_view_comes_back_from_its_file(tmp_path, monkeypatch):
    views = [
        view("panda", "A", j_median=0.2, j_p90=0.5, overlap=0.9, reaches=[THERE, WRONG, BEHIND]),
        view("panda", "A", "realistic", targets=5, failure="gone"),
        view("arm", j_median=0.05, j_p90=0.1, finished=False),
    ]
    told = {"seeds": "0,1", "joints": 4, "seconds": 10.0}
    content = {"date": "2026-11-22T02:00", "commit": "0123456789ab", "arguments": told, "machine": {"cpu": "x"}}
    content |= {"versions": {"warp-lang": "1.19.0"}, "finished": False, "rows": [asdict(one) for one in views]}
    write_json(tmp_path / "surfaces.json", content)
    monkeypatch.setattr(surface_table, "RESULTS", tmp_path)
    monkeypatch.setattr(results_file, "OPTIONAL", frozenset(surface_table.FILES))
    back = [surface_table.view_score(row) for row in surface_table.committed("surfaces")["rows"]]
    assert [repr(one) for one in back] == [repr(one) for one in views]  # NaN is not equal to NaN
    text = "\n".join(surface_table.surface_lines())
    assert "seeds 0, 1" in text
    assert "stopped early" in text
    assert surface_table.table_lines(views)[2] in text
    assert surface_table.few_surface_lines() == [
        "| J error on 1 commercial arms as they come, clean / realistic images | 0.20 / - |",
        "| their reaches within 2 px over the whole range | 1 of 3 / 0 of 5 |",
        "| said to be there (of these wrongly) | 2 (1) / 0 (0) |",
    ]  # it was ours that was stopped
    content["rows"] = [asdict(views[0]), asdict(view("panda", "B", j_median=0.2, j_p90=0.5, finished=False))]
    write_json(tmp_path / "surfaces.json", content)
    assert "of those made until the run was stopped" in surface_table.few_surface_lines()[1]
    content["rows"] = [asdict(one) for one in views[:2]]
    write_json(tmp_path / "surfaces.json", content)
    assert "stopped" not in "\n".join([*surface_table.surface_lines(), *surface_table.few_surface_lines()])
    monkeypatch.setattr(surface_table, "RESULTS", tmp_path / "nowhere")
    assert surface_table.surface_lines() == surface_table.few_surface_lines() == []


def test_a_view_that_failed_is_known_whether_it_has_learned_or_not():
    learned = view("panda", "A", j_median=0.2, finished=False)
    failed = view("panda", "B", finished=False, failure="gone")
    learned_and_failed = view("ur5e", "A", j_median=0.3, finished=False, failure="no tip in view")
    unknown = view("ur5e", "B", finished=False)
    known = surfaces._known([learned, failed, unknown, learned_and_failed])
    assert [one is other for one, other in zip(known, [learned, failed, learned_and_failed], strict=True)] == [True] * 3


def test_what_a_view_learned_before_it_failed_is_in_the_means():
    learned = view("panda", "A", j_median=0.2, overlap=0.9)
    failed = view("panda", "B", j_median=0.6, overlap=0.5, finished=False, failure="no tip in view")
    unlearned = view("panda", "C", finished=False, failure="gone")
    assert mean_of([learned, failed, unlearned], "j_median") == pytest.approx(0.4)
    assert mean_of([learned, failed, unlearned], "overlap") == pytest.approx(0.7)
    assert np.isnan(mean_of([unlearned], "j_median"))


def test_rows_of_the_readme_hold_every_view_that_is_known(monkeypatch):
    """One that was learned and then failed counts with all targets, one that was stopped with the reaches it made."""
    views = [
        view("panda", "A", j_median=0.2, reaches=[THERE, WRONG]),
        view("panda", "B", j_median=0.3, reaches=[LOST], targets=5, finished=False, failure="no tip in view"),
        view("ur5e", "A", j_median=0.7, reaches=[THERE, THERE, LOST], targets=5, finished=False),
        view("ur5e", "B", targets=5, finished=False),  # it had only begun
        view("fetch", "A", targets=4, finished=False, failure="gone"),
        view("arm", j_median=0.01, reaches=[THERE]),  # ours
    ]
    content = {"rows": [asdict(one) for one in views]}
    monkeypatch.setattr(surface_table, "committed", lambda name: content)
    errors, reaches, said, elsewhere = surface_table.few_surface_lines()
    assert errors == "| J error on 3 commercial arms as they come, clean / realistic images | 0.40 / - |"
    assert "of those made until the run was stopped" in reaches
    assert reaches.endswith("| 3 of 14 / 0 of 0 |")
    assert said.endswith("| 4 (1) / 0 (0) |")
    assert elsewhere.endswith("| -; 0 of 0; 0 (0) |")  # none of the images are realistic
    views = [
        view("panda", "C", "realistic", j_median=0.2, reaches=[THERE, WRONG, LOST]),
        view("ur5e", "C", "realistic", j_median=0.4, reaches=[THERE], targets=3, finished=False),
        view("ur5e", "D", "realistic", targets=3, finished=False, failure="gone"),
        view("ur5e", "E", "realistic", targets=3, finished=False),  # it had only begun
        view("ur5e", "D", j_median=0.9, reaches=[LOST]),
    ]
    content["rows"] = [asdict(one) for one in views]
    (elsewhere,) = surface_table.few_surface_lines()[3:]
    assert elsewhere.startswith("| 2 arms before 2 other cameras, realistic images: J error; ")
    assert elsewhere.endswith("| 0.30; 2 of 7; 3 (1) |")


def test_labels_against_the_true_robot():
    mask, labels = np.zeros((10, 10), bool), np.zeros((10, 10), bool)
    mask[:, :4] = True
    labels[:, 3:5] = True
    assert label_quality(labels, mask) == pytest.approx((0.2, 0.5, 0.25))
    assert label_quality(mask, mask) == (1.0, 1.0, 1.0)
    assert label_quality(np.zeros_like(mask), mask) == (0.0, 0.0, 0.0)


def views_by(options):
    from unittest.mock import patch

    with patch.object(sys, "argv", ["surfaces.py", *options]):
        return surfaces._views(surfaces._arguments())


def test_every_view_kind_and_seed_is_measured_once():
    views = views_by(["--arms", "planar,arm", "--seeds", "3,4", "--images", "clean,realistic", "--targets", "2"])
    assert {one.key for one in views} == {
        (arm, "", images, seed) for arm in ("planar", "arm") for images in ("clean", "realistic") for seed in (3, 4)
    }
    assert len(views) == 8
    with pytest.raises(SystemExit):
        views_by(["--images", "blurry"])


def test_views_run_side_by_side_and_the_file_holds_what_is_known(tmp_path):
    """Two views in processes of their own, started by python -P; the one that cannot run says so."""
    file = tmp_path / "surfaces.json"
    script = Path(surfaces.__file__)
    options = [
        "--arms",
        "planar,nobody",
        "--images",
        "clean",
        "--seconds",
        "1",
        "--targets",
        "0",
        "--jobs",
        "2",
        "--cameras",
        "A",
    ]
    command = [sys.executable, "-P", str(script), *options, "--no-exact", "--json", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "| planar | clean |" in done.stdout
    content = json.loads(file.read_text())
    rows = {row["arm"]: row for row in content["rows"]}
    assert rows["planar"]["finished"]
    assert 0 < rows["planar"]["j_median"] < 2
    assert rows["planar"]["exact_median"] is None
    assert "'nobody' is neither a robot of ours nor a file" in rows["nobody"]["failure"]
    assert content["finished"]  # to the end: what failed was not stopped
    again = json.loads(file.read_text())
    stopped = {"planar": {"finished": False, "j_median": 9.0}, "nobody": {"failure": "it had failed before"}}
    again["rows"] = [row | stopped[row["arm"]] for row in content["rows"]]
    file.write_text(json.dumps(again | {"date": "before"}))
    done = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1, done.stderr
    resumed = json.loads(file.read_text())
    anew = {row["arm"]: row for row in resumed["rows"]}
    assert anew["planar"]["j_median"] == rows["planar"]["j_median"]
    assert anew["nobody"]["failure"] == "it had failed before"
    assert resumed["date"] == "before"
    assert {"date", "commit", "arguments", "machine", "versions", "metrics"} <= set(content)


def test_shares_of_reaches():
    near = [reach(0.5, frames=20), reach(1.0, frames=25), reach(1.9, frames=90)]
    found = accuracy.reach_metrics([*near, reach(2.0, frames=30), reach(30.0)])
    values = {metric.name: metric.value for metric in found}
    assert values["reaches"] == 5
    assert values["reaches below 2 px"] == 0.6
    assert values["reach error, median"] == 1.9
    assert values["reach error, worst"] == 30.0
    assert values["reach frames, median"] == 25
    assert accuracy.reach_metrics([]) == []
    told = {metric.name: (metric.unit, metric.better, metric.tolerance) for metric in found}
    assert told == {  # and by which share a figure may get worse without being told
        "reaches": ("1", "higher", 0.1),
        "reaches below 2 px": ("1", "higher", 0.05),
        "reach error, median": ("px", "lower", 0.1),
        "reach error, worst": ("px", "lower", 1.0),
        "reach frames, median": ("frames", "lower", 0.1),
    }
