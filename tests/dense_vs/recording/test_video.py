"""Video files: what was written comes back, with its times; a file is whole or absent; bad files are named."""

import os
from typing import Any

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.recording.video import VideoReader, VideoWriter

pytest.importorskip("av", reason="writing video needs PyAV")

# Mean absolute difference of grey levels after H.264 at a quality meant for optical flow.
PIXEL_TOLERANCE = 3.0


def grey_rgb(image):
    return np.repeat(image[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def frames(scene):
    return [grey_rgb(scene.image(np.array([0.03, 0.01, 0.02, 0]) * k)) for k in range(12)]


def write(path, frames, fps=30.0, **options):
    with VideoWriter(path, fps, **options) as video:
        for frame in frames:
            video.write(frame)
    return path


@pytest.mark.parametrize("fps", [30.0, 25.0, 12.5, 29.97])
def test_round_trip(tmp_path, frames, fps):
    reader = VideoReader(write(tmp_path / "video.mp4", frames, fps, quality=12))
    assert (reader.height, reader.width, reader.frame_count) == (96, 128, len(frames))
    assert reader.fps == pytest.approx(fps, rel=1e-3)
    images, times = zip(*reader, strict=True)
    np.testing.assert_allclose(times, np.arange(len(frames)) / fps, atol=1e-3)
    assert len(images) == len(frames)
    for image, frame in zip(images, frames, strict=True):
        assert (image.shape, image.dtype) == ((96, 128, 3), np.uint8)
        assert np.abs(image.astype(float) - frame).mean() < PIXEL_TOLERANCE
    assert os.listdir(tmp_path) == ["video.mp4"]


def test_colours_keep_their_order(tmp_path):
    frame = np.zeros((64, 64, 3), np.uint8)
    frame[..., 0], frame[..., 2] = 220, 30  # red
    image, _ = next(iter(VideoReader(write(tmp_path / "red.mp4", [frame] * 3))))
    np.testing.assert_allclose(image.mean(axis=(0, 1)), [220, 0, 30], atol=12)


def test_odd_sides_are_cut_by_a_pixel(tmp_path, frames):
    reader = VideoReader(write(tmp_path / "odd.mp4", [frame[:95, :127] for frame in frames], quality=12))
    assert (reader.height, reader.width) == (94, 126)
    image, _ = next(iter(reader))
    assert np.abs(image.astype(float) - frames[0][:94, :126]).mean() < PIXEL_TOLERANCE


def test_frames_come_once(tmp_path, frames):
    reader = VideoReader(write(tmp_path / "video.mp4", frames))
    assert len(list(reader)) == len(frames)
    assert list(reader) == []


def test_refused_frames_leave_no_file(tmp_path, frames):
    for bad, message in (
        (frames[0][:48], "frame of 128 x 48 pixels in a video of 128 x 96"),
        (frames[0].astype(float), "dtype float64; expected uint8"),
        (frames[0][..., 0], r"frame has shape \(96, 128\).*expected uint8 of shape \(H, W, 3\)"),
    ):
        with pytest.raises(DenseVSError, match=message):
            write(tmp_path / "video.mp4", [frames[0], bad])
        assert os.listdir(tmp_path) == []


def test_interrupted_writing_keeps_the_old_file(tmp_path, frames):
    path = write(tmp_path / "video.mp4", frames)
    before = path.read_bytes()

    def interrupted():
        with VideoWriter(path) as video:
            video.write(frames[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["video.mp4"]


def test_refuses_to_write(tmp_path, frames):
    with pytest.raises(DenseVSError, match=r"cannot write .*video.mp4: No such file or directory"):
        VideoWriter(tmp_path / "missing" / "video.mp4")
    rates: list[Any] = [0, -1.0, float("nan"), float("inf"), "fast"]
    for fps in rates:
        with pytest.raises(DenseVSError, match=r"fps is .*expected"):
            VideoWriter(tmp_path / "video.mp4", fps)
    with pytest.raises(DenseVSError, match="no frame"):
        write(tmp_path / "video.mp4", [])
    assert os.listdir(tmp_path) == []
    (tmp_path / "video.mp4").mkdir()
    with pytest.raises(DenseVSError, match=r"cannot write .*video.mp4: Is a directory"):
        write(tmp_path / "video.mp4", frames)
    assert os.listdir(tmp_path) == ["video.mp4"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cannot be opened; expected a file that OpenCV reads"),
        (b"time,a\n0,1\n", "cannot be opened"),
        (bytes(5000), "cannot be opened"),
    ],
    ids=["empty", "text", "zeros"],
)
def test_refuses_files(tmp_path, content, message):
    path = tmp_path / "video.mp4"
    path.write_bytes(content)
    with pytest.raises(DenseVSError, match=message):
        VideoReader(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_refuses_a_truncated_file(tmp_path, frames, share):
    content = write(tmp_path / "whole.mp4", frames).read_bytes()
    path = tmp_path / "short.mp4"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DenseVSError, match=r"short\.mp4 (cannot be opened|has no frame)"):
        VideoReader(path)


def test_refuses_a_missing_file_and_a_folder(tmp_path):
    for path in (tmp_path / "missing.mp4", tmp_path):
        with pytest.raises(DenseVSError, match="does not exist"):
            VideoReader(path)
