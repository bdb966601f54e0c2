"""The commands on a simulated robot, as a user runs them, against the simulator's truth."""

import json
import re
from contextlib import redirect_stderr
from io import StringIO

import cv2
import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.sims import SimWorld
from dense_vs.sims.papers.dije.reaching import ReachingExperiment

SECONDS = 6.0
OFFSET = 0.015


@pytest.fixture(scope="module")
def reached(tmp_path_factory):
    pytest.importorskip("av", reason="writing video needs PyAV")
    pytest.importorskip("matplotlib", reason="plots need Matplotlib")
    out = tmp_path_factory.mktemp("reach")
    arguments = ["reach", "--robot", "planar", "--targets", "2", "--babble", "5", "--seed", "3", "--device", "cpu"]
    with redirect_stderr(StringIO()) as said:
        assert main([*arguments, "--out", str(out)]) == 0
    (out / "said.txt").write_text(said.getvalue())
    return out


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    pytest.importorskip("av", reason="writing video needs PyAV")
    recording, out = tmp_path_factory.mktemp("recording"), tmp_path_factory.mktemp("estimate")
    times = ["--time-offset", str(OFFSET)]
    record = ["record", "--robot", "planar", "--seed", "3", "--device", "cpu", "--truth-every", "1000"]
    assert main([*record, "--seconds", str(SECONDS + 1 / 30), *times, "--out", str(recording)]) == 0
    files = [str(recording / name) for name in ("video.mp4", "joints.csv")]
    truth = ["--truth", str(recording / "truth.npz"), "--device", "cpu", "--every", "60", "--flow", "lucas-kanade"]
    assert main(["estimate", *files, *times, *truth, "--out", str(out)]) == 0
    return recording, out


def test_reach_ends_at_the_targets(reached):
    summary = json.loads((reached / "summary.json").read_text())
    assert len(summary["targets"]) == 2
    for target in summary["targets"]:
        assert target["reached"]
        assert not target["lost"]
        assert target["true_error_px"] < 2.0
        # What the loop believes and what is true differ by the tracker's drift only.
        assert abs(target["true_error_px"] - target["estimated_error_px"]) < 0.3
    assert summary["jacobian_error_median"] < 0.12
    assert {"seconds", "fps", "device", "seed", "versions"} <= set(summary)


def test_its_progress_counts_what_there_is(reached):
    counts = re.findall(r"^(\w+): (\d+) of (\d+) (\w+) in", (reached / "said.txt").read_text(), re.MULTILINE)
    last = {name: (int(done), int(total), unit) for name, done, total, unit in counts}
    assert last == {"babble": (150, 150, "frames"), "reach": (2, 2, "targets")}


def test_reach_leaves_a_video_and_a_plot(reached):
    video = cv2.VideoCapture(str(reached / "reach.mp4"))
    frames = sum(1 for _ in iter(lambda: video.read()[0], False))
    steps = sum(target["steps"] for target in json.loads((reached / "summary.json").read_text())["targets"])
    assert 150 + 3 + steps <= frames <= 150 + 45 + steps  # it comes to rest between babbling and the first target
    plot = cv2.imread(str(reached / "reach.png"))
    assert plot.std() > 10  # drawn, not blank


def test_recording_is_as_good_as_the_live_loop(estimated):
    world = SimWorld("planar", seed=3, device="cpu")
    experiment = ReachingExperiment(world, seed=3, babble_seconds=SECONDS, body_model=False)  # estimate has none
    live = experiment.learn().median
    summary = json.loads((estimated[1] / "summary.json").read_text())
    # Compression, a log at 100 Hz with jitter, and the clocks' offset, by the same flow: at most a fifth worse.
    assert summary["jacobian_error_median"] < 1.2 * live
    assert summary["skipped_frames"] == 0


def test_the_offset_matters(estimated, tmp_path):
    recording, out = estimated
    files = [str(recording / name) for name in ("video.mp4", "joints.csv")]
    truth = ["--truth", str(recording / "truth.npz"), "--device", "cpu", "--no-video", "--flow", "lucas-kanade"]
    assert main(["estimate", *files, *truth, "--time-offset", "0.0151", "--out", str(tmp_path)]) == 0
    assert main(["estimate", *files, *truth, "--time-offset", "-0.035", "--out", str(tmp_path / "late")]) in (0, 2)
    right = json.loads((out / "summary.json").read_text())["jacobian_errors"][-1]["median"]
    late = json.loads((tmp_path / "late" / "summary.json").read_text())
    assert late["skipped_frames"] > 0 or late["jacobian_error_median"] > 1.5 * right


def test_offset_and_rounding_leave_the_log_over_the_whole_video(estimated):
    assert json.loads((estimated[1] / "summary.json").read_text())["frames"] == 181


def test_estimate_saves_jacobians(estimated):
    from dense_vs import DenseJacobian

    saved = sorted(path.name for path in estimated[1].glob("jacobian*.npz"))
    updates = DenseJacobian.load(estimated[1] / "jacobian.npz", device="cpu").updates
    # The arm sets off slowly: images in which nothing has visibly moved yet are joined with the next.
    assert 170 <= updates <= 180
    assert saved == ["jacobian.npz", *(f"jacobian_{used:06d}.npz" for used in range(60, updates + 2, 60))]


def test_joint_log_has_its_own_rate_and_jitter(estimated):
    log = np.loadtxt(estimated[0] / "joints.csv", delimiter=",", skiprows=1)
    steps = np.diff(log[:, 0])
    assert 0.009 < steps.mean() < 0.011
    assert 0.001 < steps.std() < 0.005
    assert log[0, 0] == pytest.approx(-OFFSET, abs=0.01)


@pytest.mark.parametrize(
    "arguments",
    [
        ["reach", "--robot", "nobody"],
        ["reach", "--joints", "joint1,knee"],
        ["reach", "--point", "nose"],
        ["reach", "--tracker", "psychic"],
        ["reach", "--targets", "0"],
        ["reach", "--babble", "-1"],
        ["reach", "--flow", "none"],
        ["reach", "--device", "tpu"],
        ["reach", "--camera", "none"],
        ["record", "--seconds", "nan"],
        ["record", "--jitter", "-1"],
        ["record", "--robot", "nobody"],
    ],
    ids=" ".join,
)
def test_bad_arguments_are_one_line(arguments, tmp_path, capfd):
    robot = [] if "--robot" in arguments else ["--robot", "planar"]
    assert main([*arguments, *robot, "--out", str(tmp_path / "out")]) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("dense-vs: ")]
    assert len(lines) == 1
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize("seed", ["-1", str(1 << 32), "9" * 30])
@pytest.mark.parametrize("experiment", ["vosvs trial", "vosvs learn", "gothoskar grasp", "dije labels"])
def test_a_seed_that_cannot_be_ends_an_experiment_before_it_begins(experiment, seed, tmp_path, capfd):
    assert main(["reproduce", *experiment.split(), "--seed", "1", seed, "--out", str(tmp_path / "out")]) == 2
    assert f"--seed is {seed[:20]}" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_figures_that_cannot_be_written_end_an_experiment_before_it_begins(tmp_path, capfd):
    assert main(["reproduce", "vosvs", "learn", "--json", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "it is a folder" in capfd.readouterr().err
