"""Every format gives the same images, times and joints that its own library wrote."""

import json
import shutil

import numpy as np
import pytest
from small_recordings import SIZE, joint_table, lerobot_v2, lerobot_v3, moving_images, ros_bag

from dense_vs import DenseVSError
from dense_vs.recording import open_recording

pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
pytest.importorskip("rosbags.rosbag2", reason="ROS bags need rosbags")

ENCODED = 4.0  # mean difference of gray levels after H.264 or JPEG


def differences(frames, images):
    return [np.abs(f.image.astype(float) - image).mean() for f, image in zip(frames, images, strict=True)]


@pytest.mark.parametrize("version", ["v2.0", "v2.1"])
def test_lerobot_v2(tmp_path, version):
    recording = open_recording(lerobot_v2(tmp_path, version=version), episode=1)
    assert recording.format == f"LeRobot {version}"
    assert recording.cameras == ("observation.images.front",)
    assert recording.joint_names == ("a", "b")
    assert recording.episodes == (0, 1)
    frames = list(recording)
    times, positions = joint_table(12)
    np.testing.assert_allclose([f.time for f in frames], times, atol=1e-4)
    np.testing.assert_allclose([f.joints for f in frames], positions + 1, atol=1e-3)
    assert frames[0].image.shape == (*SIZE, 3)
    assert max(differences(frames, moving_images(12, seed=1))) < ENCODED


def test_lerobot_v3_episodes_share_files(tmp_path):
    recording = open_recording(lerobot_v3(tmp_path))
    assert recording.joint_names == ("a", "b")
    for episode, count in enumerate((10, 14)):
        frames = list(recording.episode(episode))
        times, positions = joint_table(count)
        np.testing.assert_allclose([f.time for f in frames], times, atol=1e-3)
        np.testing.assert_allclose([f.joints for f in frames], positions + episode, atol=2e-3)
        shown = [f.image.mean() for f in frames]
        np.testing.assert_allclose(shown, 40 + 100 * episode + 3 * np.arange(count), atol=2.5)


def test_lerobot_images_in_parquet(tmp_path):
    import cv2
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = lerobot_v2(tmp_path, episodes=1)
    info = json.loads((folder / "meta/info.json").read_text())
    info["features"]["observation.images.front"]["dtype"] = "image"
    (folder / "meta/info.json").write_text(json.dumps(info))
    shutil.rmtree(folder / "videos")
    images, (times, positions) = moving_images(12), joint_table(12)
    stored = [{"bytes": cv2.imencode(".png", image)[1].tobytes(), "path": None} for image in images]
    table = {"timestamp": times, "observation.state": positions.tolist(), "observation.images.front": stored}
    pq.write_table(pa.table(table), folder / "data/chunk-000/episode_000000.parquet")
    frames = list(open_recording(folder))
    assert max(differences(frames, images)) == 0
    np.testing.assert_allclose([f.joints for f in frames], positions)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a", "b"], ("a", "b")),
        ([["a", "b"]], ("a", "b")),
        ({"motors": ["a", "b"]}, ("a", "b")),
        ({"arm": ["a"], "hand": ["b"]}, ("a", "b")),
        (None, ("state_0", "state_1")),
        (["a", "a"], ("state_0", "state_1")),
        (["a"], ("state_0", "state_1")),
    ],
)
def test_lerobot_names_nest_and_differ(tmp_path, names, expected):
    assert open_recording(lerobot_v2(tmp_path, episodes=1, frames=3, names=names)).joint_names == expected


def test_partial_downloads_offer_what_is_there(tmp_path):
    folder = lerobot_v2(tmp_path, episodes=3, total_episodes=100)
    (folder / "videos/chunk-000/observation.images.front/episode_000001.mp4").unlink()
    recording = open_recording(folder)
    assert recording.episodes == (0, 2)
    with pytest.raises(DenseVSError, match=r"episode 1 is not in .*; it has 0, 2"):
        recording.episode(1)


@pytest.mark.parametrize(
    ("kind", "image", "encoding"),
    [
        ("mcap", "raw", "rgb8"),
        ("mcap", "png", ""),
        ("mcap", "h264", ""),
        ("mcap", "foxglove", ""),
        ("sqlite3", "ffmpeg", ""),
        ("sqlite3", "raw", "bgr8"),
        ("sqlite3", "jpeg", ""),
        ("ros1", "raw", "bgr8"),
        ("ros1", "jpeg", ""),
    ],
)
def test_ros_bags(tmp_path, kind, image, encoding):
    path = ros_bag(tmp_path / ("bag.bag" if kind == "ros1" else "bag"), kind, image, encoding=encoding)
    recording = open_recording(path)
    assert recording.cameras == ("/camera/image",)
    assert recording.joint_names == ("a", "b")
    frames = list(recording)
    times = 1000.0 + np.arange(12) / 30
    np.testing.assert_allclose([f.time for f in frames], times - times[0], atol=1e-6)
    # The table of 100 Hz is linear between its ticks to (0.01 s)^2 / 8.
    np.testing.assert_allclose([f.joints for f in frames], np.stack([np.sin(times), np.cos(times)], axis=1), atol=2e-5)
    limit = 1e-9 if image in ("raw", "png") else ENCODED
    assert max(differences(frames, moving_images(12))) <= limit


def test_a_single_mcap_file_and_headers_without_stamps(tmp_path):
    ros_bag(tmp_path / "bag", stamped=False)
    frames = list(open_recording(tmp_path / "bag" / "bag.mcap"))
    np.testing.assert_allclose([f.time for f in frames], np.arange(12) / 30, atol=1e-6)


@pytest.mark.parametrize("how", ["column", "nanoseconds", "count"])
def test_image_folders(tmp_path, how):
    import cv2

    images, (times, positions) = moving_images(12), joint_table(12)
    folder = tmp_path / "images"
    folder.mkdir()
    start = 1_600_000_000 if how == "nanoseconds" else 0
    names = [
        f"{round((start + t) * 1e9)}.png" if how == "nanoseconds" else f"image_{k}.png" for k, t in enumerate(times)
    ]
    for name, image in zip(names, images, strict=True):
        cv2.imwrite(str(folder / name), image)
    with open(folder / "log.csv", "w") as log:
        log.write("time,image,a,b\n" if how == "column" else "time,a,b\n")
        for name, t, q in zip(names, times, positions, strict=True):
            log.write(f"{start + t:.9f},{name + ',' if how == 'column' else ''}{q[0]},{q[1]}\n")
    recording = open_recording(folder)
    frames = list(recording)
    assert recording.joint_names == ("a", "b")
    np.testing.assert_allclose([f.time for f in frames], start + times, atol=1e-6)
    np.testing.assert_allclose([f.joints for f in frames], positions, atol=1e-6)
    assert max(differences(frames, images)) == 0  # image_10 comes after image_9


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_images_of_a_folder_are_turned_upright(tmp_path, orientation):
    """A camera that was held upside down or sideways says so in the file; J belongs to the image as it is seen."""
    from PIL import Image

    upright = np.repeat(np.arange(24 * 16, dtype=np.uint8).reshape(24, 16, 1) // 2, 3, axis=2)
    turns = {1: 0, 3: 2, 6: 1, 8: 3}[orientation]  # quarters, counterclockwise, from what is seen to what is stored
    stored = Image.fromarray(np.ascontiguousarray(np.rot90(upright, turns)))
    exif = Image.Exif()
    exif[0x0112] = orientation
    for number in range(3):
        stored.save(tmp_path / f"{number}.png", exif=exif)
    (tmp_path / "log.csv").write_text("time,a\n0,0\n0.1,1\n0.2,0\n")
    recording = open_recording(tmp_path)
    for frame in recording:
        np.testing.assert_array_equal(frame.image, upright)


def test_digits_that_are_no_numbers_are_letters_of_a_name(tmp_path):
    """²1.png: a power of two is a digit to Python, and no number to it."""
    import cv2

    images = moving_images(5)
    for name, image in zip(("a2", "a10", "²1", "²2", "²10"), images, strict=True):
        (tmp_path / f"{name}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    (tmp_path / "log.csv").write_text("time,a\n" + "".join(f"{k},{k}\n" for k in range(5)))
    assert max(differences(list(open_recording(tmp_path)), images)) == 0


def test_image_folder_without_times_is_refused(tmp_path):
    import cv2

    for k, image in enumerate(moving_images(5)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    (tmp_path / "log.csv").write_text("time,a\n0,0\n1,1\n2,2\n")
    with pytest.raises(DenseVSError, match=r"times of the 5 images .* are not known: expected a column 'image'"):
        open_recording(tmp_path)


def test_a_folder_with_video_and_log(recording):
    found = open_recording(recording)
    assert found.format == "video and joint log"
    assert len(list(found)) == 40
    assert open_recording(recording / "video.mp4").joint_names == found.joint_names  # joints.csv beside it


def test_patterns_choose_joints(tmp_path):
    folder = lerobot_v2(tmp_path, episodes=1, frames=3, joints=3, names=["right_a", "left_a", "right_b"])
    assert open_recording(folder, joint_names=["right*"]).joint_names == ("right_a", "right_b")
    assert open_recording(folder, joint_names=["*_a", "right*"]).joint_names == ("right_a", "left_a", "right_b")
    with pytest.raises(
        DenseVSError, match="joint 'hand\\*' is not in the log; expected one of right_a, left_a, right_b"
    ):
        open_recording(folder, joint_names=["hand*"])


def test_choices_that_are_not_there(tmp_path):
    folder = lerobot_v2(tmp_path / "data", episodes=1, frames=3)
    with pytest.raises(DenseVSError, match=r"camera 'wrist' is not in .*; it has observation.images.front"):
        open_recording(folder, camera="wrist")
    with pytest.raises(DenseVSError, match="episode 7 is not in"):
        open_recording(folder, episode=7)
    with pytest.raises(DenseVSError, match="does not exist; expected a video file"):
        open_recording(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DenseVSError, match="holds no recording; expected a video file"):
        open_recording(tmp_path / "empty")
    (tmp_path / "log.csv").write_text("time,a\n0,0\n1,1\n")
    with pytest.raises(DenseVSError, match="holds its own joints; expected no joint log beside it"):
        open_recording(folder, tmp_path / "log.csv")
