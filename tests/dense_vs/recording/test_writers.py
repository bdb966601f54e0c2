"""What was recorded comes back, by our reader, by the formats' own libraries, and as a robot that is replayed."""

import json

import numpy as np
import pytest
from small_recordings import SIZE, moving_images

from dense_vs import Camera, DenseVSError, Robot, ServoLoop
from dense_vs.recording import Recorder, Replay, open_recording, open_writer

pytest.importorskip("av", reason="video needs PyAV")
pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
pytest.importorskip("rosbags.rosbag2", reason="ROS bags need rosbags")

FRAMES = 12
ENCODED = 4.0


class Filmed:
    """A camera and a robot: joints at 300 Hz a little after each image."""

    joint_names = ("a", "b")
    joint_limits = None

    def __init__(self, start=0.0):
        self.images, self.start, self.k, self.commands = moving_images(FRAMES), start, -1, 0

    def read(self):
        self.k += 1
        return self.images[self.k], self.start + self.k / 30

    def joints(self):
        time = self.start + self.k / 30 + 0.003
        return self.positions(time), time

    def positions(self, time):
        return np.array([0.5 * time, 1.0 - time]) - np.array([0.5, -1.0]) * self.start

    def command(self, delta):
        self.commands += 1


def record(path, form, start=0.0):
    robot = Filmed(start)
    with Recorder(robot, robot, path, form=form) as recorder:
        assert isinstance(recorder, Camera)
        assert isinstance(recorder, Robot)
        for _ in range(FRAMES):
            recorder.read()
            recorder.joints()
            recorder.command(np.zeros(2))
    assert robot.commands == FRAMES
    return robot


@pytest.mark.parametrize("form", ["video", "lerobot", "mcap"])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_round_trip(tmp_path, form, start):
    robot = record(tmp_path / "run", form, start)
    recording = open_recording(tmp_path / "run")
    assert recording.joint_names == ("a", "b")
    frames = list(recording)
    # The first image lies before the first reading: a format with stamps of its own leaves it out.
    first = 0 if form == "lerobot" else 1
    assert len(frames) == FRAMES - first
    times = np.arange(first, FRAMES) / 30
    np.testing.assert_allclose([f.time for f in frames], times, atol=1e-3)
    expected = [robot.positions(start + t) for t in times]
    if form == "lerobot":
        expected[0] = robot.positions(start + 0.003)
    np.testing.assert_allclose([f.joints for f in frames], expected, atol=1e-4 if start == 0 else 1e-3)
    for frame, image in zip(frames, robot.images[first:], strict=True):
        assert np.abs(frame.image.astype(float) - image).mean() < ENCODED


def test_mcap_is_read_by_rosbags(tmp_path):
    from rosbags.highlevel import AnyReader

    robot = record(tmp_path / "run", "mcap", start=1.7e9)
    with AnyReader([tmp_path / "run"]) as reader:
        messages = {c.topic: [] for c in reader.connections}
        for connection, stamp, data in reader.messages():
            messages[connection.topic].append((stamp, reader.deserialize(data, connection.msgtype)))
    assert sorted(messages) == ["/camera/image/compressed", "/joint_states"]
    assert [len(found) for found in messages.values()] == [FRAMES, FRAMES]
    for stamp, message in messages["/joint_states"]:
        time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        assert time == pytest.approx(stamp * 1e-9, abs=1e-6)
        np.testing.assert_allclose(message.position, robot.positions(time), atol=1e-6)
        assert message.name == ["a", "b"]


def test_lerobot_files_are_what_the_format_says(tmp_path):
    import pyarrow.parquet as pq

    writer = open_writer("lerobot", tmp_path / "data", ("a", "b"))
    for episode, count in enumerate((6, 9)):
        for k, image in enumerate(moving_images(count)):
            writer.add_image(image, 100.0 * episode + k / 30)
            writer.add_joints(np.array([k, -k], float), 100.0 * episode + k / 30)
        writer.end_episode()
    writer.close()
    info = json.loads((tmp_path / "data/meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == ("v3.0", 2, 15)
    assert info["features"]["observation.images.camera"]["shape"] == [*SIZE, 3]
    rows = pq.read_table(tmp_path / "data/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(r["episode_index"], r["length"], r["dataset_from_index"], r["dataset_to_index"]) for r in rows] == [
        (0, 6, 0, 6),
        (1, 9, 6, 15),
    ]
    data = pq.read_table(tmp_path / "data/data/chunk-000/file-001.parquet").to_pydict()
    assert data["index"] == list(range(6, 15))
    assert data["observation.state"][3] == [3, -3]
    assert data["action"][3] == [4, -4]
    np.testing.assert_allclose(data["timestamp"], np.arange(9) / 30, atol=1e-6)
    assert [len(list(open_recording(tmp_path / "data").episode(e))) for e in (0, 1)] == [6, 9]


def test_lerobot_reads_what_we_write(tmp_path):
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="needs the lerobot package")
    robot = record(tmp_path / "run", "lerobot")
    dataset = lerobot.LeRobotDataset("local/run", root=tmp_path / "run")
    assert len(dataset) == FRAMES
    np.testing.assert_allclose(dataset[5]["observation.state"], robot.positions(5 / 30), atol=1e-4)


def test_a_loop_is_recorded_and_replayed(tmp_path):
    robot = Filmed()
    with Recorder(robot, robot, tmp_path / "run", form="mcap") as recorder:
        loop = ServoLoop(recorder, recorder, device="cpu", threads=1)
        for _ in range(FRAMES - 1):
            loop.step(np.zeros(2))
    replay = Replay(open_recording(tmp_path / "run"))
    assert isinstance(replay, Camera)
    assert isinstance(replay, Robot)
    again = ServoLoop(replay, replay, device="cpu", threads=1)
    for _ in range(FRAMES - 2):
        again.step(np.zeros(2))
    assert replay.commands == FRAMES - 2
    assert again.frame.time == pytest.approx(loop.frame.time, abs=1e-6)
    with pytest.raises(DenseVSError, match="the recording is over"):
        again.step(np.zeros(2))


def test_refused(tmp_path):
    robot = Filmed()
    with pytest.raises(DenseVSError, match="format is 'avi'; expected one of video, lerobot, mcap"):
        Recorder(robot, robot, tmp_path / "run", form="avi")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    for form in ("lerobot", "mcap"):
        with pytest.raises(DenseVSError, match="is there already; expected a new or empty folder"):
            Recorder(robot, robot, tmp_path / "full", form=form)
    with pytest.raises(DenseVSError, match="whole number"):
        Recorder(robot, robot, tmp_path / "run", form="lerobot", fps=29.5)
    assert (tmp_path / "full" / "file").read_text() == "mine"


@pytest.mark.parametrize("form", ["video", "lerobot", "mcap"])
def test_a_run_that_failed_or_gave_nothing_leaves_no_recording(tmp_path, form):
    def failing():
        robot = Filmed()
        with Recorder(robot, robot, tmp_path / "failed", form=form) as recorder:
            recorder.read()
            raise RuntimeError("the robot fell")

    with pytest.raises(RuntimeError, match="fell"):
        failing()
    with (
        pytest.raises(DenseVSError, match="expected at least"),
        Recorder(Filmed(), Filmed(), tmp_path / "n", form=form),
    ):
        pass
    for folder in ("failed", "n"):
        with pytest.raises(DenseVSError):
            open_recording(tmp_path / folder)
