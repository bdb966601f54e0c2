"""Rows of the tables: one origin for what stands under it, and no row that vanishes without a word."""

import json
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import readme_experiments
import readme_frames
import readme_live
import readme_program
import readme_real_robot
import readme_table
import results_file


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A copy of the committed results that a test may take from."""
    copy = tmp_path / "results"
    shutil.copytree(results_file.RESULTS, copy)
    for module in (results_file, readme_program):
        monkeypatch.setattr(module, "RESULTS", copy)
    return copy


def rewrite(file: Path, change) -> None:
    content = json.loads(file.read_text(encoding="utf-8"))
    change(content)
    file.write_text(json.dumps(content), encoding="utf-8")


def without(name: str):
    """Takes every figure away whose name begins so."""

    def change(content: dict) -> None:
        content["metrics"] = [metric for metric in content["metrics"] if not metric["name"].startswith(name)]

    return change


def test_times_of_a_frame_are_of_the_run_that_is_named_above_them(results):
    def change(content: dict) -> None:
        for metric in content["metrics"]:
            metric["value"] = 4321.0

    rewrite(results / "frame_budget.json", change)
    lines = readme_table._speed()
    rows = lines[next(k for k, line in enumerate(lines) if "frame_budget.py" in line) + 4 :]
    assert len(rows) == len(readme_table.FRAME)
    assert all(row.split("|")[-2].strip().startswith("4321") for row in rows)


@pytest.mark.parametrize(("arm", "row"), [("panda", 0), ("ur5e", 2)])
@pytest.mark.parametrize(("file", "later"), [("frame_budget_{}", 0), ("frame_budget_{}_60", 1)])
def test_a_frame_of_a_commercial_arm_is_of_its_own_run(results, arm, row, file, later):
    def change(content: dict) -> None:
        content["arguments"] |= {"motion": 1.25, "joints": 3}
        for metric in content["metrics"]:
            metric["value"] = {"frame_fps_320x240": 11.4, "frame_fps_320x240_body": 7.6}.get(metric["name"], 99.0)

    before = readme_frames.arm_frame_lines()
    rewrite(results / f"{file.format(arm)}.json", change)
    lines = readme_frames.arm_frame_lines()
    name = readme_frames.ARMS[arm]
    assert lines[-4 + row + later] == f"| {name}, first 3 joints | 1.25 | 11 | 8 | 99 |"
    assert sum(a != b for a, b in zip(before, lines, strict=True)) == 1
    (few,) = readme_frames.few_arm_frame_lines()
    assert ("1.25 px" in few, " 8 " in few) == ((arm == "panda"),) * 2


@pytest.mark.parametrize(
    ("reaches", "share", "text"),
    [(100, 0.93, "93 of 100"), (40.0, 0.975, "39 of 40"), (7, 2 / 7, "2 of 7"), (5, 0.0, "0 of 5"), (3, 1.0, "3 of 3")],
)
def test_reaches_are_those_below_2_px_of_all(reaches, share, text):
    assert readme_table._reaches({"reaches": reaches, "reaches below 2 px": share}) == text


@pytest.mark.parametrize(
    ("file", "figure", "lines"),
    [
        ("real_robot", "E, flow dis", readme_real_robot.real_robot_lines),
        ("peers", "predict_update_vs_torch", readme_table._speed),
        ("peers", "frame_vs_paper_with_labels", readme_table._speed),
        ("peers", "predict_update_vs_opencv", readme_table.few),
    ],
)
def test_a_figure_that_is_missing_is_named(results, monkeypatch, file, figure, lines):
    before = lines()
    rewrite(results / f"{file}.json", without(figure))
    with pytest.raises(LookupError, match=figure):
        lines()
    found = {figure, f"{figure}, tuned"}
    monkeypatch.setattr(results_file, "OPTIONAL", frozenset(found))
    assert lines() != before


@pytest.mark.parametrize(
    ("file", "lines"),
    [
        ("live_growth.json", readme_live.live_lines),
        ("tracking.json", readme_table.tracking_lines),
        ("tracking.json", readme_table.few_tracking_lines),
        ("scaling_cpu.json", readme_table._scaling),
        ("gpu_tests.txt", readme_program.gpu_test_lines),
    ],
)
def test_a_file_that_is_missing_is_named(results, monkeypatch, file, lines):
    before = len(lines())
    (results / file).unlink()
    name = Path(file).stem
    with pytest.raises(LookupError, match=name):
        lines()
    monkeypatch.setattr(results_file, "OPTIONAL", frozenset({name}))
    assert len(lines()) < before


def test_an_experiment_that_is_missing_is_named(results, monkeypatch):
    before = len(readme_experiments.experiment_lines())
    rewrite(
        results / "experiments.json",
        lambda content: content.update(runs=[run for run in content["runs"] if run["experiment"] != "pick-place"]),
    )
    with pytest.raises(LookupError, match="pick-place: objects in the bin"):
        readme_experiments.experiment_lines()
    lost = [
        f"pick-place: {text}" for text, experiment, *_ in readme_experiments.EXPERIMENTS if experiment == "pick-place"
    ]
    monkeypatch.setattr(results_file, "OPTIONAL", frozenset(lost))
    assert len(readme_experiments.experiment_lines()) == before - len(lost)


@pytest.mark.parametrize(("seeds", "words"), [("62", "seed 62"), ("63,64", "seeds 63, 64")])
def test_seeds_in_words(seeds, words):
    assert results_file.seeds_in_words(seeds) == words
