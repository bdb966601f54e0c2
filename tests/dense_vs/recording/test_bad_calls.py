"""What is no image, reading, stamp, rate or path is refused by recordings, and leaves them as they were."""

from typing import Any

import numpy as np
import pytest
from small_recordings import encode, moving_images

from dense_vs import DenseVSError
from dense_vs.recording import (
    JointBuffer,
    MotionSamples,
    Recorder,
    RepetitionFilter,
    TruthFile,
    VideoReader,
    VideoWriter,
    open_recording,
    open_writer,
)

RGB = np.zeros((32, 48, 3), np.uint8)
GRAY = np.random.default_rng(0).integers(0, 255, (48, 64)).astype(np.uint8)
NO_STAMPS: list[Any] = ["1", "x", 1j, True, None, np.nan, np.inf, 10**400, [1.0], np.datetime64("2020-01-01")]
NO_GRAYS: list[Any] = ["x", np.array(["x"]), np.array([["x"]]), GRAY.astype(float), GRAY[:0], GRAY[0], [1.0], None]
NO_READINGS: list[Any] = ["x", ["1", "2"], [1j, 2j], [1.0], [np.nan, 1.0], [[1.0], [1.0, 2.0]], None]
FORMS = ("video", "lerobot", "mcap")


@pytest.mark.parametrize("wrong", ["x", 0, -1, 1.5, True, None, 2**63, 10**400])
def test_a_buffer_has_a_number_of_joints_and_readings(wrong):
    for given in ({"joints": wrong}, {"joints": 2, "capacity": wrong}):
        with pytest.raises(DenseVSError, match=r"(joints|capacity) is .*; expected a whole number"):
            JointBuffer(**given)


def test_a_buffer_takes_numbers_alone():
    buffer = JointBuffer(2)
    buffer.add(np.zeros(2), 1.0)
    buffer.add(np.ones(2), 2.0)
    for wrong in NO_STAMPS:
        with pytest.raises(DenseVSError, match="joint time stamp is"):
            buffer.add(np.zeros(2), wrong)
        with pytest.raises(DenseVSError, match="time is"):
            buffer.at(wrong)
        for given in ({"factor": wrong, "since": 1.0}, {"factor": 2.0, "since": wrong}):
            with pytest.raises(DenseVSError, match=r"(factor|since) is"):
                buffer.stretch(0, **given)
    joints: list[Any] = [2, -1, 0.0, "a", None]
    for joint in joints:
        with pytest.raises(DenseVSError, match=r"joint is .*; expected a whole number of at least 0 and at most 1"):
            buffer.stretch(joint, 2.0, 1.0)
    np.testing.assert_array_equal(buffer.readings()[1], [[0, 0], [1, 1]])


def test_motion_is_of_gray_images_of_one_camera():
    samples = MotionSamples()
    samples.add(GRAY, 0.0)
    for wrong in NO_GRAYS:
        with pytest.raises(DenseVSError, match=r"image .*; expected uint8 of shape \(H, W\)"):
            samples.add(wrong, 0.1)
    for wrong in NO_STAMPS:
        with pytest.raises(DenseVSError, match="image time stamp is"):
            samples.add(GRAY, wrong)
    with pytest.raises(DenseVSError, match="other proportions than the last"):
        samples.add(GRAY[:, :40], 0.1)
    assert samples.pairs == []
    samples.add(GRAY, 0.1)
    assert samples.pairs == [(0.0, 0.1)]


def test_repetitions_are_of_gray_images():
    one = RepetitionFilter()
    assert one.keep(GRAY)
    for wrong in NO_GRAYS:
        with pytest.raises(DenseVSError, match=r"image .*; expected uint8 of shape \(H, W\)"):
            one.keep(wrong)
    assert not one.keep(GRAY)


def test_a_part_of_a_video_has_times(tmp_path):
    path = encode(tmp_path / "video.mp4", moving_images(8, size=(48, 64)))
    for name in ("begin", "end"):
        for wrong in ["1", "x", 1j, True, np.nan, np.inf, 1e300, 10**400, [1.0]]:
            with pytest.raises(DenseVSError, match=f"{name} is"):
                VideoReader(path, **{name: wrong})
    paths: list[Any] = ["a" * 5000, None, 5, "\0"]
    for wrong in paths:
        with pytest.raises(DenseVSError, match=r"path .*(expected a file's path|too long)"):
            VideoReader(wrong)


def test_a_video_is_written_to_a_file_at_a_rate(tmp_path):
    paths: list[Any] = [None, 5, "a" * 5000, "\0", "", "/"]
    for wrong in paths:
        with pytest.raises(DenseVSError, match=r"(path|cannot write) .*(expected|too long)"):
            VideoWriter(wrong)
    qualities: list[Any] = [-1, 52, 1.5, "x", None, 10**400]
    for wrong in qualities:
        with pytest.raises(DenseVSError, match=r"quality is .*; expected a whole number"):
            VideoWriter(tmp_path / "video.mp4", quality=wrong)
    assert list(tmp_path.iterdir()) == []
    with VideoWriter(tmp_path / "video.mp4", 0.001) as video:
        for wrong in ([1.0], None, "x", RGB[:1], RGB[..., 0], RGB.astype(float)):
            with pytest.raises(DenseVSError, match=r"frame .*; expected uint8 of shape \(H, W, 3\), at least 2 x 2"):
                video.write(wrong)
        video.write(RGB)


@pytest.mark.parametrize("form", FORMS)
def test_a_recording_takes_images_and_numbers_alone(form, tmp_path):
    writer = open_writer(form, tmp_path / "run", ("a", "b"))
    for wrong in NO_STAMPS:
        with pytest.raises(DenseVSError, match="image time stamp is"):
            writer.add_image(RGB, wrong)
        with pytest.raises(DenseVSError, match="joint time stamp is"):
            writer.add_joints(np.zeros(2), wrong)
    for wrong in NO_READINGS:
        with pytest.raises(DenseVSError, match=r"joint positions .*expected finite numbers"):
            writer.add_joints(wrong, 0.0)
    for wrong in ("x", None, [1.0], RGB[..., 0], RGB.astype(float)):
        with pytest.raises(DenseVSError, match=r"expected uint8 of shape \(H, W, 3\)"):
            writer.add_image(wrong, 0.0)
    with pytest.raises(DenseVSError, match=r"got 0 |has 0 "):
        writer.close()


def test_a_bag_takes_the_times_that_a_message_has(tmp_path):
    writer = open_writer("mcap", tmp_path / "run", ("a",))
    for wrong in (2.0**31, 1e300, -1001.0, -(2**64)):
        with pytest.raises(DenseVSError, match="joint time stamp is"):
            writer.add_joints(np.zeros(1), wrong)
    writer.add_joints(np.zeros(1), 2.0**31 - 1)
    writer.abort()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"form": np.array(["a", "b"])}, "format is .*; expected one of video, lerobot, mcap"),
        ({"form": None}, "format is None"),
        ({"path": None}, "path is a NoneType"),
        ({"path": "a" * 5000}, "too long"),
        ({"joint_names": "ab"}, "joint names is 'ab'"),
        ({"joint_names": None}, "joint names is None"),
        ({"fps": "x"}, "fps is 'x'"),
        ({"fps": 1e30}, "fps is"),
        ({"fps": 10**400}, "fps is"),
        ({"quality": "x"}, "quality is 'x'"),
    ],
)
def test_a_writer_is_opened_for_what_can_be_written(given, words, tmp_path):
    for form in ("video", "lerobot"):
        with pytest.raises(DenseVSError, match=words):
            open_writer(**{"form": form, "path": tmp_path / "run", "joint_names": ("a",)} | given)


def test_a_reading_that_is_not_finite_is_passed_on_and_not_recorded(tmp_path):
    class Arm:
        joint_names, joint_limits = ("a",), None
        readings = iter([([0.0], 0.0), ([np.nan], 0.1), ([0.3], np.nan), ([0.2], 0.2)])

        def joints(self):
            return next(self.readings)

        def read(self):
            return RGB, 0.0

        def command(self, delta):
            pass

    arm = Arm()
    with Recorder(arm, arm, tmp_path / "run", form="video") as recorder:
        recorder.read()
        passed = [recorder.joints() for _ in range(4)]
    assert np.isnan(passed[1][0][0])
    assert np.isnan(passed[2][1])
    log = open_recording(tmp_path / "run" / "video.mp4", tmp_path / "run" / "joints.csv").episode().log
    np.testing.assert_allclose(log.times, [0.0, 0.2])
    np.testing.assert_allclose(log.positions, [[0.0], [0.2]])


def test_truth_is_asked_for_at_a_time_and_a_scale(tmp_path):
    truth = TruthFile(("a",), np.arange(2.0), np.ones((2, 4, 6, 2, 1), np.float32), np.ones((2, 4, 6), bool))
    scales: list[Any] = [-1, 0, 1e-300, 1e7, np.nan, np.inf, "1", 1j, None, True, 10**400]
    for scale in scales:
        with pytest.raises(DenseVSError, match="scale"):
            truth.at(1.0, scale)
    for time in NO_STAMPS:
        with pytest.raises(DenseVSError, match="time is"):
            truth.at(time)
    truth.write(tmp_path / "truth.npz")
    names: list[Any] = [5, None, "a", [1], []]
    for wrong in names:
        with pytest.raises(DenseVSError, match="joint names is"):
            TruthFile.read(tmp_path / "truth.npz", wrong)
