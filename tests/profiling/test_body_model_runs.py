"""Runs of the body models' measurement: all that was asked for, gone on with where one was stopped, on one clock."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import body_model
from body_scores import BodyScore


def test_every_arm_camera_kind_of_images_and_seed_is_measured_once(monkeypatch, capsys, tmp_path):
    measured, reported, origins = [], [], []

    def measure(asked, options):
        measured.append((asked.arm, asked.camera, asked.images, asked.seed))
        if asked.arm == "arm":
            return replace(asked, failure="no body")
        return replace(asked, points_median=1.0, points_p90=np.inf, known_p90=2.0, overlap=0.5)

    def report(metrics, options, finished, rows, **began):
        reported.append((metrics, rows))
        origins.append(began)
        assert finished
        return 5

    monkeypatch.setattr(body_model, "measure", measure)
    monkeypatch.setattr(body_model, "report", report)
    words = "--arms arm,panda --cameras A,B --images clean,realistic --seeds 0,2"
    file = tmp_path / "body.json"
    monkeypatch.setattr(sys, "argv", ["body_model.py", *words.split(), "--json", str(file)])
    assert body_model.main() == 5
    stored = json.loads(file.read_text())  # of the last one; a report would add the metrics
    assert stored["finished"]
    assert len(stored["rows"]) == 12
    assert stored["arguments"]["seeds"] == "0,2"
    assert not body_model.content([BodyScore("arm", "", "clean", 0)], 2)["finished"]
    stored |= {"rows": stored["rows"][:5], "machine": {"cpu": "another"}, "date": "before"}
    file.write_text(json.dumps(stored))
    monkeypatch.setattr(sys, "argv", ["body_model.py", *words.split(), "--json", str(file), "--resume", "--jobs", "1"])
    assert body_model.main() == 5
    assert len(measured) == 12 + 7  # what the stopped run had is not measured again
    assert repr(reported[1]) == repr(reported[0])
    assert origins == [{}, {"machine": {"cpu": "another"}, "date": "before"}]  # where it began
    places = [("arm", ""), ("panda", "A"), ("panda", "B")]
    wanted = {(*place, images, seed) for place in places for images in ("clean", "realistic") for seed in (0, 2)}
    assert len(wanted) == 12
    assert set(measured[:12]) == set(measured) == wanted
    metrics, rows = reported[0]
    assert len(metrics) == 12 * 15
    assert [row["points_median"] for row in rows if not row["failure"]] == [1.0] * 8
    said = capsys.readouterr().out
    assert "panda B" in said
    assert "no body" in said


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("--images clean,foggy", "--images has foggy; expected some of clean, realistic, sensor"),
        ("--jobs 0", "--jobs and --joints are at least 1"),
        ("--joints 0", "--jobs and --joints are at least 1"),
    ],
)
def test_wrong_options_are_said_before_anything_is_measured(monkeypatch, capsys, words, error):
    monkeypatch.setattr(sys, "argv", ["body_model.py", *words.split()])
    with pytest.raises(SystemExit):
        body_model.main()
    assert error in capsys.readouterr().err


def test_joint_readings_that_come_late_are_put_on_the_images_clock():
    """A square that goes with one joint; readings 2 frames late are found to be, within a quarter of a frame."""
    q = 0.6 * np.sin(np.arange(150) * 0.21) + 0.3 * np.sin(np.arange(150) * 0.057)
    images = []
    texture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8), (0, 0), 1.5)
    for angle in q:
        shift = np.array([[1.0, 0.0, 40 * angle], [0.0, 1.0, 0.0]])
        images.append(cv2.warpAffine(texture, shift, (160, 120), borderMode=cv2.BORDER_REFLECT))
    late = np.concatenate([q[:1], q[:1], q[:-2]])[:, None]
    found = body_model.on_the_camera_clock(images, late)
    assert found.shape == (150, 1)
    speed = np.abs(np.gradient(q)).max()
    assert np.abs(found[5:-5, 0] - q[5:-5]).max() < 0.25 * speed
    assert np.abs(late[5:-5, 0] - q[5:-5]).max() > 1.5 * speed
