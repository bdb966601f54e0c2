"""Writers of recordings take names that come back, end once, and keep what is complete whatever is called then."""

import shutil

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.recording import TruthFile, VideoReader, VideoWriter, open_recording, open_writer
from dense_vs.recording.lerobot_writer import LeRobotWriter
from dense_vs.recording.ros_bag_writer import RosBagWriter
from dense_vs.recording.writers import VideoAndLogWriter

pytest.importorskip("av", reason="video needs PyAV")
pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
pytest.importorskip("rosbags.rosbag2", reason="ROS bags need rosbags")

RGB = np.random.default_rng(0).integers(0, 255, (32, 48, 3)).astype(np.uint8)
FORMS = ("video", "lerobot", "mcap")
MADE = {
    "video": lambda folder, names: VideoAndLogWriter(folder, names, fps=30.0, quality=12),
    "lerobot": LeRobotWriter,
    "mcap": RosBagWriter,
}


def filled(form, folder, names=("a", "b"), frames=3):
    writer = open_writer(form, folder, names)
    for k in range(frames):
        writer.add_image(np.roll(RGB, k, axis=1), k / 30)
        writer.add_joints(np.arange(len(names)) + k / 10, k / 30)
    return writer


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("names", [("a", "a"), ("a", ""), ("\ud800",), ("a" * 300,), ("a\0",), ("a", 3)], ids=ascii)
def test_names_that_would_not_come_back_are_refused_at_once(tmp_path, form, names):
    for make in (lambda folder: open_writer(form, folder, names), lambda folder: MADE[form](folder, names)):
        with pytest.raises(DenseVSError, match="joint name") as said:
            make(tmp_path / "run")
        assert len(str(said.value)) < 1000
        assert not (tmp_path / "run").exists() or not list((tmp_path / "run").iterdir())


@pytest.mark.parametrize("names", [("time", "image"), (" a",)])
def test_a_joint_log_has_columns_of_its_own(tmp_path, names):
    with pytest.raises(DenseVSError, match="does not come back from a joint log"):
        open_writer("video", tmp_path / "run", names)
    assert not list((tmp_path / "run").iterdir())


@pytest.mark.parametrize("form", FORMS)
def test_names_come_back(tmp_path, form):
    names = ("time", "a b", "c,d", 'e"f', "\u2603", *([] if form == "video" else ["image"]))
    filled(form, tmp_path / "run", names).close()
    recording = open_recording(tmp_path / "run")
    assert recording.joint_names == names
    np.testing.assert_allclose(next(iter(recording)).joints, np.arange(len(names)), atol=1e-6)


@pytest.mark.parametrize("form", ["lerobot", "mcap"])
def test_words_that_no_file_can_hold(tmp_path, form):
    for name in ("camera", "task", "robot") if form == "lerobot" else ("camera",):
        for text in ("\ud800", 3, None, ""):
            with pytest.raises(DenseVSError, match=f"{name} is .*; expected text"):
                MADE[form](tmp_path / "run", ("a",), **{name: text})


@pytest.mark.parametrize("form", FORMS)
def test_a_recording_ends_once(tmp_path, form):
    writer = filled(form, tmp_path / "run")
    writer.close()
    for end in (writer.close, writer.abort, writer.close):
        end()
        for add in (lambda: writer.add_image(RGB, 1.0), lambda: writer.add_joints([1.0, 2.0], 1.0)):
            with pytest.raises(DenseVSError, match="is complete; expected nothing more"):
                add()
    assert len(list(open_recording(tmp_path / "run"))) == 3


@pytest.mark.parametrize("form", FORMS)
def test_a_recording_that_was_given_up_stays_so(tmp_path, form):
    writer = filled(form, tmp_path / "run")
    writer.abort()
    writer.close()
    writer.abort()
    with pytest.raises(DenseVSError, match="expected nothing more"):
        writer.add_image(RGB, 1.0)
    with pytest.raises(DenseVSError):
        open_recording(tmp_path / "run")


@pytest.mark.parametrize("form", FORMS)
def test_a_folder_that_went_before_the_end(tmp_path, form):
    for end in ("close", "abort"):
        writer = filled(form, tmp_path / end)
        shutil.rmtree(tmp_path / end)
        if end == "abort":
            writer.abort()
        else:
            with pytest.raises(DenseVSError, match="cannot write"):
                writer.close()
        writer.close()
        writer.abort()


@pytest.mark.parametrize("form", FORMS)
def test_what_lacks_joints_leaves_nothing_half_written(tmp_path, form):
    writer = open_writer(form, tmp_path / "run", ("a",))
    writer.add_image(RGB, 0.0)
    with pytest.raises(DenseVSError, match="expected at least"):
        writer.close()
    writer.close()
    files = [file for file in (tmp_path / "run").rglob("*") if file.is_file()] if (tmp_path / "run").exists() else []
    assert files == []


def test_a_video_ends_once(tmp_path):
    video = VideoWriter(tmp_path / "video.mp4")
    with video:
        video.write(RGB)
    video.__exit__(None)
    video.__exit__(ValueError)
    with pytest.raises(DenseVSError, match=r"video\.mp4 is complete; expected nothing more"):
        video.write(RGB)
    assert len(list(VideoReader(tmp_path / "video.mp4"))) == 1


GOOD = {
    "joint_names": ("a", "b"),
    "times": np.arange(2.0),
    "jacobians": np.ones((2, 4, 6, 2, 2), np.float32),
    "robot_masks": np.ones((2, 4, 6), bool),
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("joint_names", ("a", "a")),
        ("joint_names", ("a",)),
        ("joint_names", 3),
        ("times", np.array([0.0, np.nan])),
        ("times", np.arange(3.0)),
        ("times", np.array(["0", "1"])),
        ("jacobians", "x"),
        ("jacobians", np.full((2, 4, 6, 2, 2), np.inf, np.float32)),
        ("robot_masks", object()),
        ("robot_masks", [[1], [1, 2]]),
        ("robot_masks", np.ones((2, 4, 6))),
    ],
)
def test_truth_that_could_not_be_read_is_not_written(tmp_path, name, value):
    path = tmp_path / "truth.npz"
    TruthFile(**GOOD).write(path)
    before = path.read_bytes()
    with pytest.raises(
        DenseVSError, match=r"(joint names?|times|jacobians|robot_masks) .*(expected|finite|there twice)"
    ):
        TruthFile(**GOOD | {name: value}).write(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    np.testing.assert_array_equal(TruthFile.read(path, ["b"]).jacobians, GOOD["jacobians"][..., 1:])
