"""``dense-vs info`` and the estimate of several episodes, on a small LeRobot folder."""

import json
import os

import numpy as np
import pytest
from small_recordings import lerobot_v2

from dense_vs import DenseJacobian
from dense_vs.cli import main

pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return lerobot_v2(tmp_path_factory.mktemp("lerobot"), episodes=3, frames=24, names=["elbow", "wrist"])


def test_info(dataset, capsys):
    assert main(["info", str(dataset), "--episode", "1"]) == 0
    said = capsys.readouterr().out
    for part in (
        "LeRobot v2.1",
        "3: 0, 1, 2",
        "observation.images.front",
        "128 x 96 px",
        "24 images at 30.0 a second",
        "0 gaps",
        "24 at 30.0 a second",
        "elbow",
        "wrist",
    ):
        assert part in said


def test_several_episodes_carry_j_on(dataset, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["estimate", str(dataset), "--episodes", "0:2", "--out", str(out), "--no-video", "--device", "cpu"]
    assert main([*arguments, "--time-offset", "0"]) == 0
    assert sorted(os.listdir(out)) == ["episode_000000", "episode_000001", "jacobian.npz", "summary.json"]
    summaries = json.loads((out / "summary.json").read_text())["episodes"]
    assert [summary["episode"] for summary in summaries] == [0, 1]
    updates = [
        DenseJacobian.load(out / folder / "jacobian.npz", device="cpu").updates
        for folder in ("episode_000000", "episode_000001")
    ]
    assert updates[1] > updates[0] > 0
    assert "E after it" in capsys.readouterr().out
    one = tmp_path / "one"
    start = ["--start", str(out / "episode_000000" / "jacobian.npz")]
    single = ["estimate", str(dataset), "--episode", "1", "--out", str(one), "--no-video", "--device", "cpu"]
    assert main([*single, *start, "--time-offset", "0"]) == 0
    assert DenseJacobian.load(one / "jacobian.npz", device="cpu").updates == updates[1]
    summary = json.loads((one / "summary.json").read_text())
    for name in (
        "explained_motion",
        "explained_motion_by_quarter",
        "explained_motion_by_joint",
        "repeated_images",
        "time_offset_s",
        "time_offset_confidence",
        "excitation_by_joint",
        "share_of_pixels_known",
        "joints_moved_together",
        "advice",
    ):
        assert name in summary
    assert (one / "report.png").read_bytes().startswith(b"\x89PNG")


def test_episodes_side_by_side(dataset, tmp_path, capsys):
    out = tmp_path / "side"
    arguments = ["estimate", str(dataset), "--episodes", "all", "--jobs", "2", "--out", str(out), "--no-video"]
    assert main([*arguments, "--device", "cpu", "--time-offset", "0"]) == 0
    assert "E after it" in capsys.readouterr().out
    summaries = json.loads((out / "summary.json").read_text())["episodes"]
    assert [summary["episode"] for summary in summaries] == [0, 1, 2]
    alone = tmp_path / "alone"
    one = ["estimate", str(dataset), "--episode", "2", "--out", str(alone), "--no-video"]
    assert main([*one, "--device", "cpu", "--time-offset", "0"]) == 0
    stored = [DenseJacobian.load(f / "jacobian.npz") for f in (alone, out / "results" / "episode_000002" / "out")]
    np.testing.assert_array_equal(*(np.array(J.jacobian) for J in stored))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["info", "{}/nothing"], "does not exist; expected a video file"),
        (["info", "{}", "--camera", "wrist"], "camera 'wrist' is not in"),
        (["estimate", "{}", "--out", "o", "--episodes", "7:9"], "--episodes is '7:9'; expected all, or A:B"),
        (["estimate", "{}", "--out", "o", "--episodes", "x"], "--episodes is 'x'; expected all, or A:B"),
        (["estimate", "{}", "--out", "o", "--episodes", "0:2", "--episode", "1"], "expected one of them"),
        (["estimate", "{}", "--out", "o", "--jobs", "2"], "expected --episodes A:B or all as well"),
        (["estimate", "{}", "--out", "o", "--jobs", "0"], "--jobs is 0"),
        (["estimate", "{}", "--out", "o", "--time-offset", "soon"], "expected auto or seconds"),
        (["estimate", "{}", "--out", "o", "--start", "no.npz"], "cannot read no.npz"),
        (["estimate", "{}", "--out", "o", "--joints", "kRight*"], "joint 'kRight*' is not in the log"),
    ],
)
def test_one_line_for_a_bad_choice(dataset, tmp_path, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main([argument.format(dataset) for argument in arguments]) == 2
    said = capfd.readouterr().err
    assert said.startswith("dense-vs: ")
    assert said.count("\n") == 1
    assert message in said
