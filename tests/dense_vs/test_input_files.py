"""Readers take regular files alone: a pipe would be waited for, a device read without end; and JSON of any kind."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from small_recordings import lerobot_v2

from dense_vs import DenseJacobian, DenseVSError, JointLog
from dense_vs.body_model import BodyModel, PostureMemory, load_body
from dense_vs.cli.learn_model import read_recording
from dense_vs.cli.live import _ports
from dense_vs.cli.main import main
from dense_vs.depth.learned_depth import LearnedDepth
from dense_vs.depth.odms import read_sequences, set_paths
from dense_vs.files import input_file, parse_json, read_arrays, read_format, read_json
from dense_vs.generative import GenerativeModel
from dense_vs.live.state_file import load_state
from dense_vs.recording import TruthFile, open_recording
from dense_vs.recording.ros_bag import RosBag
from dense_vs.recording.stored_image import read_image as read_stored_image
from dense_vs.segmentation import FewShotSegmenter, OnnxSegmenter, read_image, read_mask
from dense_vs.sims.papers.vosvs.depth_log import read_log
from dense_vs.sweep.figures import _read
from dense_vs.sweep.plan import read_plan

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without pipes in folders")

SMALL = {"device": "cpu", "threads": 1}
READERS = {
    "arrays": lambda path: read_arrays(path, "a test"),
    "json": read_json,
    "jacobian": lambda path: DenseJacobian.load(path, **SMALL),
    "state": lambda path: load_state(path, DenseJacobian(height=8, width=8, joints=2, **SMALL)),
    "body": load_body,
    "body model": BodyModel.load,
    "memory": PostureMemory.load,
    "generative": GenerativeModel.load,
    "few shot": FewShotSegmenter.load,
    "network": OnnxSegmenter,
    "sequences": lambda path: list(read_sequences(path)),
    "truth": lambda path: TruthFile.read(path, ["a"]),
    "depth weights": LearnedDepth.load,
    "features": read_recording,
    "image": read_image,
    "mask": read_mask,
    "stored image": lambda path: read_stored_image(Path(path), "image"),
    "joint log": JointLog.read_csv,
    "plan": read_plan,
    "bag": lambda path: RosBag(Path(path)),
    "depth log": lambda path: read_log(Path(path)),
}


@pytest.fixture
def pipe(tmp_path):
    """A pipe that nobody writes to; whoever waits for it is interrupted."""

    def waited(*_):
        raise AssertionError("waits for a pipe")

    os.mkfifo(tmp_path / "pipe.bag")
    before = signal.signal(signal.SIGALRM, waited)
    signal.alarm(20)
    yield tmp_path / "pipe.bag"
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", READERS)
def test_what_is_no_regular_file_is_not_read(pipe, name):
    for path in (pipe, "/dev/null"):
        with pytest.raises(DenseVSError, match="not a regular file"):
            READERS[name](path)
    (pipe.parent / "folder").mkdir()
    with pytest.raises(DenseVSError, match=r"folder"):
        READERS[name](pipe.parent / "folder")


def test_commands_and_recordings_do_not_wait_for_a_pipe(pipe, tmp_path, capsys):
    pytest.importorskip("av", reason="video needs PyAV")
    from small_recordings import encode, moving_images

    video = encode(tmp_path / "video.mp4", moving_images(4, size=(48, 64)))
    with pytest.raises(DenseVSError, match="not a regular file"):
        open_recording(video, pipe)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    os.mkfifo(tmp_path / "bag" / "a.mcap")
    with pytest.raises(DenseVSError, match="not a regular file"):
        open_recording(tmp_path / "bag")
    for words in (["info", str(video), str(pipe)], ["segment", str(video), "--model", str(pipe), "--out", "o"]):
        assert main(words) == 2
        assert "a device or a pipe, as /dev/stdin and a shell's <(...) are" in capsys.readouterr().err


def test_a_file_of_any_other_kind_is_left_to_its_reader(tmp_path):
    assert input_file(tmp_path / "none") == tmp_path / "none"
    (tmp_path / "file").write_bytes(b"1234")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert input_file(tmp_path / "link", most=4) == tmp_path / "link"
    with pytest.raises(DenseVSError, match="it has 4 bytes; expected at most 3"):
        input_file(tmp_path / "file", most=3)
    with pytest.raises(DenseVSError, match="is too long"):
        set_paths("a" * 5000)


@pytest.mark.parametrize("name", ["image", "mask", "joint log", "plan", "json", "depth log", "network"])
def test_a_file_that_is_read_whole_has_a_size(tmp_path, name):
    """Sparse files take no room, and claim a terabyte."""
    with open(tmp_path / "large", "wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(DenseVSError, match="has 1099511627776 bytes; expected at most"):
        READERS[name](tmp_path / "large")


@pytest.mark.parametrize("text", ["", "[" * 100_000, "9" * 5000, "{'a': 1}", '{"a": ' + "1" * 5000 + "}"])
def test_what_is_no_json_says_so(tmp_path, text):
    with pytest.raises(DenseVSError, match="it is no JSON"):
        parse_json(text)
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DenseVSError, match=r"cannot read .*a\.json: it is no JSON"):
        read_json(tmp_path / "a.json")
    assert _read(tmp_path / "a.json") is None


def test_a_json_file_is_there_and_is_text(tmp_path):
    with pytest.raises(DenseVSError, match="No such file"):
        read_json(tmp_path / "none.json")
    (tmp_path / "a.json").write_bytes(b'"\xff"')
    with pytest.raises(DenseVSError, match="cannot read"):
        read_json(tmp_path / "a.json")


def changed(path, **changes):
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files} | changes
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("options", ["[" * 100_000, "9" * 5000, "[]", '{"a": 1}', '{"height": 8}'])
def test_options_of_a_saved_jacobian_that_are_none(tmp_path, options):
    like = DenseJacobian(height=8, width=8, joints=2, **SMALL)
    like.save(tmp_path / "j.npz")
    path = changed(tmp_path / "j.npz", options=np.array(options))
    for read in (lambda: DenseJacobian.load(path, **SMALL), lambda: load_state(path, like)):
        with pytest.raises(DenseVSError, match=r"is damaged|is not a saved Jacobian|holds .* bytes"):
            read()


def test_what_a_file_says_is_quoted_in_part(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, format="dense-vs thing", format_version="1" * 100_000)
    with pytest.raises(DenseVSError, match="has format version '111") as said:
        read_format(path, "a thing", "dense-vs thing", (1,), writer="Thing.save")
    assert len(str(said.value)) < 1000
    np.savez(path, format="x" * 100_000)
    with pytest.raises(DenseVSError, match="got 'xxx") as said:
        load_body(path)
    assert len(str(said.value)) < 1000


@pytest.mark.parametrize("told", [["9" * 5000], ["65536"], ["80", "81"], ["/dev/a", "²"]])
def test_a_port_that_is_none(told):
    with pytest.raises(DenseVSError, match=r"--port is .*; expected one number of 0 to 65535") as said:
        _ports(told)
    assert len(str(said.value)) < 1000


def test_a_port_and_a_path():
    assert _ports(["0", "²"]) == (0, "²")


@pytest.mark.parametrize(
    "text",
    [
        '[[experiment]]\ncommand = "reach"\nseeds = "0:' + "9" * 5000 + '"\n',
        '[[experiment]]\ncommand = "reach"\nseeds = [' + "9" * 5000 + "]\n",
        '[[experiment]]\ncommand = "reach"\nseeds = [0x' + "f" * 5000 + "]\n",
        '[[experiment]]\ncommand = "reach"\narguments = [0x' + "f" * 5000 + "]\n",
        "a = " + "[" * 100_000,
    ],
)
def test_numbers_of_a_plan_without_end(tmp_path, text):
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(DenseVSError) as said:
        read_plan(tmp_path / "plan.toml")
    assert len(str(said.value)) < 1000


@pytest.mark.parametrize(
    ("name", "value"),
    [("fps", "1" * 400), ("chunks_size", "1" * 400), ("other", "1" * 5000), ("data_path", f'"{"a" * 300}"'),
     ("video_path", f'"{"a" * 300}"'), ("data_path", '"\\ud800"')],
)  # fmt: skip
def test_metadata_of_lerobot_without_end(tmp_path, name, value):
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    lerobot_v2(tmp_path / "v2", episodes=1)
    info = tmp_path / "v2" / "meta" / "info.json"
    info.write_text(info.read_text().rstrip().removesuffix("}") + f', "{name}": {value}}}')
    if name in ("fps", "chunks_size"):  # which have defaults
        assert open_recording(tmp_path / "v2").episodes == (0,)
        return
    with pytest.raises(DenseVSError) as said:
        open_recording(tmp_path / "v2")
    assert len(str(said.value)) < 1000


def test_episodes_are_looked_for_where_files_are(tmp_path, monkeypatch):
    """A claim of a million episodes took half a minute."""
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    from dense_vs.recording.lerobot_folder import LeRobotFolder

    lerobot_v2(tmp_path / "v2", episodes=2, total_episodes=10**20)
    (tmp_path / "v2" / "meta" / "episodes.jsonl").unlink(missing_ok=True)
    asked = []
    present = LeRobotFolder._present
    monkeypatch.setattr(LeRobotFolder, "_present", lambda self, n: asked.append(n) or present(self, n))
    assert LeRobotFolder(tmp_path / "v2").episodes == (0, 1)
    assert len(asked) < 10


def test_lines_of_lerobot_without_end(tmp_path):
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    lerobot_v2(tmp_path / "v2", episodes=1)
    with (tmp_path / "v2" / "meta" / "episodes.jsonl").open("a") as stream:
        stream.write('\n{"episode_index": ' + "1" * 5000 + "}\n")
    with pytest.raises(DenseVSError, match=r"episodes.jsonl, line \d+: it is no JSON"):
        open_recording(tmp_path / "v2")
