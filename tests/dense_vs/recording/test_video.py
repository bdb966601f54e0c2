"""Video files: what was written comes back, with its times; a file is whole or absent; bad files are named."""

import os
import struct
from typing import Any

import numpy as np
import pytest
from small_recordings import encode

from dense_vs import DenseVSError
from dense_vs.recording import VideoReader, VideoWriter

pytest.importorskip("av", reason="writing video needs PyAV")

# Mean absolute difference of gray levels after H.264 at a quality meant for optical flow.
PIXEL_TOLERANCE = 3.0


def gray_rgb(image):
    return np.repeat(image[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def frames(scene):
    return [gray_rgb(scene.image(np.array([0.03, 0.01, 0.02, 0]) * k)) for k in range(12)]


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


def test_colors_keep_their_order(tmp_path):
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
    rates: list[Any] = [0, -1.0, float("nan"), float("inf"), "fast", 1e30, 1e-300, 10**400]
    for fps in rates:
        with pytest.raises(DenseVSError, match=r"fps is .*expected"):
            VideoWriter(tmp_path / "video.mp4", fps)
    with pytest.raises(DenseVSError, match="no frame"):
        write(tmp_path / "video.mp4", [])
    assert os.listdir(tmp_path) == []
    (tmp_path / "video.mp4").mkdir()
    with pytest.raises(DenseVSError, match=r"cannot write .*video.mp4: it is a folder"):
        write(tmp_path / "video.mp4", frames)
    assert os.listdir(tmp_path) == ["video.mp4"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cannot be opened: .*; expected a video file"),
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


@pytest.fixture
def schedule():
    """Of this process, put back: as root, libsvtav1 gives whoever encodes with it real-time priority, for good.

    A browser that a later test in the same process starts inherits it, and waits spinning for what never gets a core.
    """
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    os.sched_setscheduler(0, *before)


@pytest.mark.usefixtures("schedule")
@pytest.mark.parametrize(
    ("codec", "suffix", "options"),
    [
        ("libx264", "mp4", {"crf": "12"}),
        ("libx265", "mp4", {"crf": "12", "x265-params": "log-level=none"}),
        ("libvpx-vp9", "webm", {"crf": "15", "cpu-used": "8"}),
        ("libsvtav1", "mp4", {"crf": "15", "preset": "10"}),
    ],
)
def test_codecs(tmp_path, frames, codec, suffix, options):
    import av

    if codec not in av.codecs_available:
        pytest.skip(f"PyAV is built without {codec}")
    path = encode(tmp_path / f"video.{suffix}", frames, codec, options=options)
    images, times = zip(*VideoReader(path), strict=True)
    np.testing.assert_allclose(times, np.arange(len(frames)) / 30, atol=2e-3)
    for image, frame in zip(images, frames, strict=True):
        assert np.abs(image.astype(float) - frame).mean() < PIXEL_TOLERANCE


@pytest.mark.parametrize("clockwise", [0, 90, 180, 270])
def test_rotated_videos_come_upright(tmp_path, frames, clockwise):
    """A phone held upright stores its images lying and says so in the track's matrix."""
    content = bytearray(encode(tmp_path / "lying.mp4", frames).read_bytes())
    one, cos, sin = 0x10000, round(np.cos(np.deg2rad(clockwise))), round(np.sin(np.deg2rad(clockwise)))
    plain = struct.pack(">9i", one, 0, 0, 0, one, 0, 0, 0, 0x40000000)
    turned = struct.pack(">9i", cos * one, sin * one, 0, -sin * one, cos * one, 0, 0, 0, 0x40000000)
    place = content.index(plain, content.index(b"tkhd"))
    content[place : place + 36] = turned
    path = tmp_path / "turned.mp4"
    path.write_bytes(bytes(content))
    reader = VideoReader(path)
    upright = np.rot90(frames[0], -clockwise // 90)
    assert (reader.height, reader.width) == upright.shape[:2]
    image, _ = next(iter(reader))
    assert np.abs(image.astype(float) - upright).mean() < PIXEL_TOLERANCE


def test_odd_sizes_are_read_whole(tmp_path, frames):
    import av

    if "libvpx-vp9" not in av.codecs_available:
        pytest.skip("PyAV is built without libvpx-vp9")
    odd = [frame[:95, :127] for frame in frames]
    reader = VideoReader(encode(tmp_path / "odd.webm", odd, "libvpx-vp9", options={"crf": "15", "cpu-used": "8"}))
    assert (reader.height, reader.width) == (95, 127)
    image, _ = next(iter(reader))
    assert np.abs(image.astype(float) - odd[0]).mean() < PIXEL_TOLERANCE


def test_a_part_of_a_video(tmp_path, frames):
    path = encode(tmp_path / "video.mp4", frames, options={"g": "4", "crf": "8"})
    images, times = zip(*VideoReader(path, begin=5 / 30, end=9 / 30), strict=True)
    np.testing.assert_allclose(times, np.arange(4) / 30, atol=1e-3)
    for image, frame in zip(images, frames[5:9], strict=True):
        assert np.abs(image.astype(float) - frame).mean() < PIXEL_TOLERANCE
