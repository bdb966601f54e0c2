"""``dense-vs body`` on small recordings, what ``dense-vs estimate`` makes of it, and the clear refusals of both."""

import argparse
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from shared_data import SHARED_DATA
from small_recordings import lerobot_v2

from dense_vs import DenseJacobian
from dense_vs.body_model import BodyModel, PostureMemory, load_body
from dense_vs.body_model.held_out import ExplainedFlow
from dense_vs.cli import body as body_command
from dense_vs.cli import main
from dense_vs.cli.body import Learned
from dense_vs.cli.body_recordings import SeenBody, read_recordings, recording_paths
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.recording import open_recording


def run(*arguments):
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def body(recording, tmp_path_factory):
    """The memory of a plane that shifts, turns and grows."""
    out = tmp_path_factory.mktemp("body") / "body.npz"
    video = recording / "video.mp4", recording / "joints.csv"
    assert run("body", *video, *video, "--out", out, "--time-offset", 0, "--kind", "posture") == 0
    return out


def test_j_is_remembered_by_posture(body, scene, postures):
    memory = load_body(body)
    assert isinstance(memory, PostureMemory)
    assert body.with_suffix(".png").is_file()
    J, true = memory.jacobian(postures[30]), scene.jacobian(postures[30])
    inner = np.s_[16:-16, 16:-16]
    assert np.linalg.norm(J[inner] - true[inner]) < 0.2 * np.linalg.norm(true[inner])


def test_the_kind_that_is_kept_is_said(recording, tmp_path, capsys):
    video = recording / "video.mp4", recording / "joints.csv"
    assert run("body", *video, "--out", tmp_path / "body.npz", "--time-offset", 0) == 0
    said = capsys.readouterr().out
    assert "held-out motion explained by postures" in said
    kept = load_body(tmp_path / "body.npz")
    assert ("a chain of links" in said) == isinstance(kept, BodyModel)
    assert ("J is remembered by posture" in said) == isinstance(kept, PostureMemory)
    assert kept.joint_count == 4


def test_a_memory_has_nothing_to_show_in_3d(recording, tmp_path, capsys, monkeypatch):
    video = recording / "video.mp4", recording / "joints.csv"
    arguments = ("body", *video, "--out", tmp_path / "body.npz", "--time-offset", 0, "--kind", "posture", "--rerun")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "rerun", None)
        assert run(*arguments) == 2
    assert "pip install 'dense-vs[rerun]'" in capsys.readouterr().err
    assert not (tmp_path / "body.npz").exists()
    pytest.importorskip("rerun", reason="an .rrd file needs Rerun")
    assert run(*arguments) == 0
    assert "no .rrd file was written" in capsys.readouterr().out
    assert not (tmp_path / "body.rrd").exists()


def test_what_explains_the_motion_held_out_is_kept():
    def kept(by_chain, by_memory, kind="auto", chain="chain", error=0.3):
        model = SimpleNamespace(error=error) if chain else None
        memory = None if kind == "chain" else "memory"
        shares = (SimpleNamespace(share=by_chain), SimpleNamespace(share=by_memory))
        found = Learned(model, memory, None, None, *shares, "no point to follow").kept(kind)
        return found if isinstance(found, str) else "chain"

    assert kept(0.95, 0.99) == "chain"
    assert kept(0.05, 0.7) == "memory"
    assert kept(0.45, 0.2) == "memory"  # half of the motion is the least that a chain has to explain
    assert kept(0.6, 0.8) == "memory"
    assert kept(0.95, 0.99, "posture") == "memory"
    assert kept(0.05, 0.7, "chain") == "chain"
    assert kept(np.nan, 0.7, chain=None) == "memory"
    assert kept(np.nan, np.nan) == "chain"  # nothing held out: by the tracks' error
    assert kept(np.nan, np.nan, error=0.8) == "memory"
    with pytest.raises(DenseVSError, match="no point to follow"):
        kept(np.nan, np.nan, "chain", chain=None)


def test_a_chain_that_explains_little_of_what_was_held_out_is_not_to_be_trusted():
    def doubt(share):
        return Learned(None, None, None, None, SimpleNamespace(share=share), SimpleNamespace(share=0.7), "").doubt

    assert "explains 0.31 of the motion held out; below 0.5" in doubt(0.31)
    assert not doubt(0.5)
    assert not doubt(np.nan)  # nothing was held out


@pytest.mark.parametrize("kind", ["auto", "chain"])
def test_a_chain_is_judged_by_what_was_held_out_also_where_it_is_asked_for(kind, recording, tmp_path, monkeypatch):
    parser = argparse.ArgumentParser()
    body_command.add_arguments(parser)
    video = recording / "video.mp4", recording / "joints.csv"
    given = [*video, "--out", tmp_path / "body.npz", "--time-offset", 0, "--kind", kind]
    arguments = parser.parse_args([str(one) for one in given])
    seen = read_recordings(arguments)
    still = SimpleNamespace(flow=lambda q, step: np.zeros((*seen.images[0].shape, 2)))
    monkeypatch.setattr(body_command, "_learn_chain", lambda *_: still)
    learned = body_command._learn(seen, arguments)
    assert learned.by_chain.share == pytest.approx(0.0)
    assert learned.doubt


def test_an_estimate_begins_with_a_body_or_a_saved_j(body, recording, tmp_path):
    video = recording / "video.mp4", recording / "joints.csv"
    common = ("--no-video", "--device", "cpu", "--threads", 1, "--time-offset", 0)
    first = {}
    saved = tmp_path / "nothing" / "jacobian.npz"
    for name, start in (("nothing", ()), ("body", ("--start", body)), ("j", ("--start", saved))):
        assert run("estimate", *video, "--out", tmp_path / name, *common, *start) == 0
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        first[name] = summary["explained_motion_by_quarter"][0]
    assert 1 - first["body"] < 0.5 * (1 - first["nothing"])
    assert 1 - first["j"] < 0.5 * (1 - first["nothing"])
    assert DenseJacobian.load(tmp_path / "j" / "jacobian.npz", device="cpu").updates > 60


def test_a_start_of_another_kind_or_shape_is_refused(body, recording, tmp_path, capfd):
    video = recording / "video.mp4", recording / "joints.csv"
    np.savez(tmp_path / "other.npz", format="dense-vs something else")
    np.savez(tmp_path / "silent.npz", a=1)
    (tmp_path / "text.npz").write_text("no arrays")
    for start, message in (
        ("other.npz", "dense-vs something else; expected a J that 'dense-vs estimate' saved, or a body"),
        ("silent.npz", "a file of unknown kind; expected"),
        ("text.npz", "cannot read"),
        ("absent.npz", "cannot read"),
    ):
        assert run("estimate", *video, "--out", tmp_path / "out", "--start", tmp_path / start) == 2
        assert message in capfd.readouterr().err
    for name in ("other.npz", "silent.npz"):
        with pytest.raises(DenseVSError, match="is not a saved body; expected"):
            load_body(tmp_path / name)
    assert run("estimate", *video, "--out", tmp_path / "out", "--start", body, "--joints", "x,y") == 2
    assert "the body is of 128 x 96 px and 4 joints; expected 128 x 96 px, or another scale of it, and 2 joints" in (
        capfd.readouterr().err
    )


def test_episodes_are_learned_together_and_whole_ones_held_out(tmp_path, capsys):
    pytest.importorskip("av", reason="writing video needs PyAV")
    pytest.importorskip("pyarrow", reason="LeRobot folders need PyArrow")
    folder = lerobot_v2(tmp_path / "data", episodes=3, frames=20)
    arguments = ("body", folder, "--out", tmp_path / "b.npz", "--time-offset", 0, "--kind", "posture")
    assert run(*arguments, "--episodes", "all") == 0
    said = capsys.readouterr().out
    assert "60" in next(line for line in said.splitlines() if line.startswith("images"))
    assert "held-out motion explained by postures" in said
    assert "J by posture" in said
    seen = SeenBody(("a",), images=[np.zeros((2, 2))] * 60, starts=[0, 20, 40])
    assert (seen.cut(0.2), seen.cut(0.6), seen.cut(0)) == (40, 20, 60)
    assert SeenBody(("a",), images=[np.zeros((2, 2))] * 60, starts=[0]).cut(0.2) == 48


def test_recordings_and_their_logs_come_in_turns(tmp_path, capfd):
    a, b, log = tmp_path / "a.mp4", tmp_path / "b", tmp_path / "j.csv"
    assert recording_paths([a, log, b]) == [(a, log), (b, None)]
    for bad in ([log, a], [a, log, log]):
        with pytest.raises(DenseVSError, match="is a joint log without a recording"):
            recording_paths(bad)
    for extra, message in (
        (("--held-out", 1), "--held-out is 1"),
        (("--episode", 1, "--episodes", "all"), "expected one of them"),
        (("--out", tmp_path / "absent" / "b.npz"), "cannot write"),
    ):
        assert run("body", a, "--out", tmp_path / "b.npz", *extra) == 2
        assert message in capfd.readouterr().err


def test_other_joints_and_sizes_are_refused():
    seen = SeenBody(("a", "b"), images=[np.zeros((48, 64), np.uint8)])
    log = SimpleNamespace(names=("a", "c"))
    source = SimpleNamespace(path="x.mp4")
    with pytest.raises(DenseVSError, match=r"x\.mp4 has the joints a, c; expected a, b as before"):
        seen.add(SimpleNamespace(log=log, source=source), 1.0)
    other = SimpleNamespace(
        log=SimpleNamespace(names=("a", "b")), source=source, images=lambda: SimpleNamespace(height=96, width=64)
    )
    with pytest.raises(DenseVSError, match=r"x\.mp4 has images of 64 x 96 px; expected 64 x 48 as before"):
        seen.add(other, 1.0)


def test_one_reach_of_a_real_humanoid_tells_of_another():
    """Trained on one recorded reach, judged on the next by its joints alone, at an eighth of the images' size."""
    folder = SHARED_DATA / "g1_reach"
    if not folder.is_dir():
        pytest.skip("the recordings of the humanoid are not beside this checkout")
    pytest.importorskip("av", reason="reading video needs PyAV")
    pytest.importorskip("pyarrow", reason="LeRobot folders need PyArrow")
    from dense_vs.body_model import Keyframes, MemoryFit, MemoryOptions

    recording = open_recording(folder, joint_names=["kRight[SEW]*"])
    seen = SeenBody(recording.joint_names)
    for number in (43, 37):
        seen.add(recording.episode(number).shifted(0.1), 0.125)
    size, cut = seen.images[0].shape, seen.starts[1]
    flow = FlowEstimator("dis-medium", *size)
    steps = list(seen.steps(0, cut))
    options = MemoryOptions(step=1, keyframes=64)
    keyframes = Keyframes.choose([seen.joints[k] for k, _ in steps], [dq for _, dq in steps], seen.learned, options)
    fit = MemoryFit(size, keyframes, options)
    for k, dq in steps:
        fit.add(flow(seen.images[k - 1], seen.images[k]), seen.joints[k], dq)
    memory, explained = fit.solved(), ExplainedFlow()
    for k, dq in seen.steps(cut, len(seen.images)):
        explained.add(flow(seen.images[k - 1], seen.images[k]), memory.flow(seen.joints[k], dq))
    assert explained.share > 0.4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scale", "1e-9"], "0 x 0 px at --scale 1e-09; expected at least 16 px a side"),
        (["--focal-length", "nan"], "--focal-length is nan"),
        (["--focal-length", "0"], "--focal-length is 0"),
        (["--focal-length", "-5"], "--focal-length is -5"),
        (["--picture", "."], "it is a folder"),
    ],
    ids=" ".join,
)
def test_options_that_cannot_be_are_refused_and_nothing_is_saved(options, message, recording, tmp_path, capfd):
    video = recording / "video.mp4", recording / "joints.csv"
    assert run("body", *video, "--out", tmp_path / "body.npz", *options) == 2
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())
