"""``dense-vs estimate`` on a small recording: what it writes, and one line and exit code 2 for each bad input."""

import json
import os
import sys
from collections import Counter

import numpy as np
import pytest

from dense_vs import DenseJacobian, JointLog
from dense_vs.cli import main
from dense_vs.recording.video_reader import VideoReader

FRAMES = 40


def run(*arguments):
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def estimated(recording, tmp_path_factory):
    """Results of one run with everything on, and what it printed."""
    out = tmp_path_factory.mktemp("estimated") / "new" / "folder"

    code = run(
        "estimate", recording / "video.mp4", recording / "joints.csv", "--out", out, "--every", 15,
        "--truth", recording / "truth.npz", "--device", "cpu", "--threads", 2,
    )  # fmt: skip
    assert code == 0
    return out


def test_writes_its_results(estimated):
    assert sorted(os.listdir(estimated)) == [
        "estimate.mp4",
        "jacobian.npz",
        "jacobian_000015.npz",
        "jacobian_000030.npz",
        "report.png",
        "summary.json",
    ]
    last = DenseJacobian.load(estimated / "jacobian.npz", device="cpu")
    assert last.updates == FRAMES - 1
    assert DenseJacobian.load(estimated / "jacobian_000015.npz", device="cpu").updates == 14
    assert (last.options.height, last.options.width, last.options.joints) == (96, 128, 4)


def test_jacobian_is_near_the_truth(estimated, scene, postures):
    J = np.array(DenseJacobian.load(estimated / "jacobian.npz", device="cpu").jacobian)
    true = scene.jacobian(postures[FRAMES - 1])
    error = np.linalg.norm(J - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))
    assert np.median(error) < 0.4
    summary = json.loads((estimated / "summary.json").read_text())
    assert summary["jacobian_error_median"] == pytest.approx(np.median(error), rel=1e-4)


def test_summary(estimated):
    summary = json.loads((estimated / "summary.json").read_text())
    assert summary["frames"] == FRAMES
    assert summary["skipped_frames"] == 0
    assert summary["joints"] == ["x", "y", "turn", "zoom"]
    assert summary["size"] == [96, 128]
    assert summary["device"] == "cpu"
    assert len(summary["jacobian_errors"]) == 3
    assert {"python", "numpy", "warp-lang"} <= set(summary["versions"])
    assert summary["seconds"] > 0


def test_video_shows_every_estimated_frame(estimated):
    reader = VideoReader(estimated / "estimate.mp4")
    assert len(list(reader)) == FRAMES - 1
    assert reader.width >= 3 * 128


def test_chosen_joints_scale_and_no_video(recording, tmp_path, capsys):
    code = run(
        "estimate", recording / "video.mp4", recording / "joints.csv", "--out", tmp_path, "--joints", "turn,x,zoom,y",
        "--scale", 0.5, "--no-video", "--flow", "farneback", "--device", "cpu",
    )  # fmt: skip
    assert code == 0
    assert sorted(os.listdir(tmp_path)) == ["jacobian.npz", "report.png", "summary.json"]
    estimator = DenseJacobian.load(tmp_path / "jacobian.npz", device="cpu")
    assert (estimator.options.height, estimator.options.width) == (48, 64)
    assert json.loads((tmp_path / "summary.json").read_text())["joints"] == ["turn", "x", "zoom", "y"]
    assert f"{FRAMES} frames in" in capsys.readouterr().out


def test_rerun_file_holds_every_frame(recording, tmp_path):
    pytest.importorskip("rerun", reason="an .rrd file needs Rerun")
    from rerun.chunk import RrdReader

    code = run(
        "estimate", recording / "video.mp4", recording / "joints.csv", "--out", tmp_path, "--no-video", "--rerun",
        "--device", "cpu",
    )  # fmt: skip
    assert code == 0
    assert sorted(os.listdir(tmp_path)) == ["estimate.rrd", "jacobian.npz", "report.png", "summary.json"]
    rows = Counter()
    for chunk in RrdReader(tmp_path / "estimate.rrd").stream():
        rows[chunk.entity_path] += chunk.num_rows
    joints = ("x", "y", "turn", "zoom")
    assert rows["/camera"] == FRAMES
    assert all(rows[f"/joints/{name}"] == FRAMES for name in joints)
    assert all(rows[path] == FRAMES - 1 for path in ("/flow", "/camera/own", *(f"/jacobian/{n}" for n in joints)))
    assert 0 < rows["/explained_motion"] < FRAMES


def test_a_full_disk_leaves_no_rerun_file_and_one_line(recording, tmp_path, capsys, monkeypatch):
    rerun = pytest.importorskip("rerun", reason="an .rrd file needs Rerun")

    def full(stream):
        raise RuntimeError("No space left on device")

    monkeypatch.setattr(rerun.RecordingStream, "flush", full)
    arguments = ["estimate", recording / "video.mp4", recording / "joints.csv", "--out", tmp_path, "--rerun"]
    assert run(*arguments, "--device", "cpu", "--no-video") == 2
    assert "estimate.rrd: No space left on device" in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if "rrd" in path.name]


def test_rerun_that_is_not_installed_is_said(recording, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    arguments = ["estimate", recording / "video.mp4", recording / "joints.csv", "--out", tmp_path, "--rerun"]
    assert run(*arguments, "--device", "cpu", "--no-video") == 2
    assert "pip install 'dense-vs[rerun]'" in capsys.readouterr().err
    assert not (tmp_path / "estimate.rrd").exists()


def test_offset_is_in_seconds_added_to_the_log(recording, tmp_path):
    log = JointLog.read_csv(recording / "joints.csv").shifted(-3.0)
    early = tmp_path / "early.csv"
    rows = np.column_stack([log.times, log.positions])
    np.savetxt(early, rows, delimiter=",", header="time,x,y,turn,zoom", comments="")
    arguments = ["estimate", recording / "video.mp4", early, "--no-video", "--device", "cpu", "--out", tmp_path / "out"]
    assert run(*arguments, "--time-offset", "3.0") == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["frames"] == FRAMES
    assert run(*arguments) == 2


def changed_log(recording, folder, change):
    lines = (recording / "joints.csv").read_text().splitlines()
    path = folder / "joints.csv"
    path.write_text("\n".join(change(lines)) + "\n")
    return path


def backwards(lines):
    return [*lines[:5], lines[6], lines[5], *lines[7:]]


BAD_INPUT = {
    # name: (files and options of a run given the recording and a folder, what the line says)
    "empty video": (lambda r, f: [empty(f / "v.mp4"), r / "joints.csv"], "v.mp4 cannot be opened"),
    "truncated video": (lambda r, f: [shortened(r / "video.mp4", f), r / "joints.csv"], "short.mp4 cannot be opened"),
    "missing video": (lambda r, f: [f / "no.mp4", r / "joints.csv"], "no.mp4 does not exist"),
    "log as video": (lambda r, f: [r / "joints.csv", r / "joints.csv"], "cannot be opened"),
    "missing log": (lambda r, f: [r / "video.mp4", f / "no.csv"], "no.csv: No such file or directory"),
    "empty log": (lambda r, f: [r / "video.mp4", empty(f / "e.csv")], "e.csv is empty"),
    "video as log": (lambda r, f: [r / "video.mp4", r / "video.mp4"], "cannot read joint log"),
    "missing column": (
        lambda r, f: [r / "video.mp4", r / "joints.csv", "--joints", "x,elbow"],
        "joint 'elbow' is not in the log; expected one of x, y, turn, zoom",
    ),
    "joint twice": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--joints", "x,x"], "named twice"),
    "short row": (
        lambda r, f: [r / "video.mp4", changed_log(r, f, lambda lines: [*lines[:3], "0.5,1", *lines[3:]])],
        "row 3 after the header, has 2 columns; expected 5",
    ),
    "backward times": (lambda r, f: [r / "video.mp4", changed_log(r, f, backwards)], "times do not increase: row"),
    "clocks apart": (
        lambda r, f: [r / "video.mp4", r / "joints.csv", "--time-offset", "60"],
        "expected at least two frames within the log",
    ),
    "unknown flow": (
        lambda r, f: [r / "video.mp4", r / "joints.csv", "--flow", "raft"],
        "expected one of lucas-kanade, dis, ",
    ),
    "unknown device": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--device", "tpu"], "'tpu' is not present"),
    "threads": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--threads", "0"], "threads is 0"),
    "scale": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--scale", "3"], "scale is 3.0"),
    "tiny scale": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--scale", "0.1"], "expected a whole number of"),
    "every": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--every", "0"], "--every is 0"),
    "covariance": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--covariance", "x"], "covariance is 'x'"),
    "prediction": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--prediction", "x"], "prediction is 'x'"),
    "missing truth": (lambda r, f: [r / "video.mp4", r / "joints.csv", "--truth", f / "no.npz"], "no.npz"),
    "truth is a log": (
        lambda r, f: [r / "video.mp4", r / "joints.csv", "--truth", r / "joints.csv"],
        "as the truth of a recording",
    ),
    "out is a file": (
        lambda r, f: [r / "video.mp4", r / "joints.csv", "--out", empty(f / "out")],
        "cannot make the folder",
    ),
}


def empty(path):
    path.write_bytes(b"")
    return path


def shortened(video, folder):
    path = folder / "short.mp4"
    path.write_bytes(video.read_bytes()[:3000])
    return path


@pytest.mark.parametrize("case", BAD_INPUT)
def test_one_line_for_a_bad_input(case, recording, tmp_path, capfd):
    make, message = BAD_INPUT[case]
    arguments = make(recording, tmp_path)
    if "--device" not in arguments:
        arguments = [*arguments, "--device", "cpu"]
    if "--out" not in arguments:
        arguments = [*arguments, "--out", tmp_path / "results"]
    assert run("estimate", *arguments) == 2
    said = capfd.readouterr().err
    assert said.startswith("dense-vs: ")
    assert said.count("\n") == 1
    assert message in said
    results = tmp_path / "results"
    assert not results.exists() or os.listdir(results) == []


def test_missing_arguments_show_the_usage(capsys):
    with pytest.raises(SystemExit) as stopped:
        run("estimate", "video.mp4")
    assert stopped.value.code == 2
    assert "usage: dense-vs estimate" in capsys.readouterr().err
