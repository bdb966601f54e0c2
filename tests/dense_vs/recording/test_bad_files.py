"""A damaged recording gives one clear line, takes no memory for what it claims and runs nothing of what it holds."""

import json
import re
import struct
import tracemalloc

import numpy as np
import pytest
from small_recordings import encode, lerobot_v2, lerobot_v3, moving_images, ros_bag

from dense_vs import DenseVSError
from dense_vs.recording import VideoReader, VideoWriter, open_recording

pytest.importorskip("av", reason="video needs PyAV")
pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
pytest.importorskip("rosbags.rosbag2", reason="ROS bags need rosbags")

MEMORY = 200 << 20  # bytes that no small damaged file may take


def read_all(path):
    """Frames of every episode, or the line that says why there are none."""
    try:
        recording = open_recording(path)
        return sum(len(list(recording.episode(number))) for number in recording.episodes)
    except DenseVSError as error:
        return str(error)


def assert_refused(path, message):
    tracemalloc.start()
    said = read_all(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert isinstance(said, str), f"read {said} frames"
    assert re.search(message, said), said
    assert peak < MEMORY


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    folder = tmp_path_factory.mktemp("originals")
    lerobot_v2(folder / "v2", episodes=1)
    lerobot_v3(folder / "v3")
    ros_bag(folder / "bag")
    ros_bag(folder / "sqlite", "sqlite3", "jpeg")
    ros_bag(folder / "one.bag", "ros1", "jpeg")
    return folder


def copy(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        target.mkdir(exist_ok=True)
        for file in source.iterdir():
            copy(file, target / file.name)
    else:
        target.write_bytes(source.read_bytes())
    return target


FILES = [
    ("v2", "meta/info.json"),
    ("v2", "data/chunk-000/episode_000000.parquet"),
    ("v2", "videos/chunk-000/observation.images.front/episode_000000.mp4"),
    ("v3", "meta/episodes/chunk-000/file-000.parquet"),
    ("v3", "data/chunk-000/file-000.parquet"),
    ("v3", "videos/observation.images.front/chunk-000/file-000.mp4"),
    ("bag", "bag.mcap"),
    ("bag", "metadata.yaml"),
    ("sqlite", "sqlite.db3"),
    ("sqlite", "metadata.yaml"),
    ("one.bag", ""),
]


@pytest.mark.parametrize(("name", "file"), FILES)
def test_a_damaged_file_says_one_line(tmp_path, originals, name, file):
    """Cut short, emptied, and with bytes changed at random: read in part, or refused, never another exception."""
    random = np.random.default_rng(7)
    target = copy(originals / name, tmp_path / name)
    victim = target / file if file else target
    content = victim.read_bytes()
    refused = 0
    changed = [b"", content[:7], content[: len(content) // 2], content[:-5], bytes(len(content))]
    for _ in range(12):
        noisy = bytearray(content)
        for place in random.integers(0, len(noisy), 8):
            noisy[place] = random.integers(0, 256)
        changed.append(bytes(noisy))
    for damaged in changed:
        victim.write_bytes(damaged)
        said = read_all(target)
        assert isinstance(said, (int, str))
        refused += isinstance(said, str)
        if isinstance(said, str):
            assert "\n" not in said.strip()
    assert refused >= 4


def info_with(originals, tmp_path, **changes):
    folder = copy(originals / "v2", tmp_path / "v2")
    info = json.loads((folder / "meta/info.json").read_text())
    for name, value in changes.items():
        info[name] = value
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"codebase_version": "v1.6"}, r"LeRobot folder of version 'v1.6'; expected v2.0, v2.1, v3.0"),
        ({"features": []}, "has no feature 'observation.state'|no table of features"),
        ({"features": {"observation.state": 3}}, "no table of features"),
        ({"features": {"observation.state": {"dtype": "float32", "shape": [2]}}}, "has no camera"),
        ({"features": {"observation.state": {"dtype": "float32", "shape": [10**12]}}}, "expected 1 to 4096"),
        ({"data_path": "../../{episode_index}.parquet"}, "expected a file inside the folder"),
        ({"data_path": "/etc/{episode_index}"}, "expected a file inside the folder"),
        ({"data_path": "{episode_index.__class__}"}, "bad file name"),
        ({"data_path": "{episode_index:0999999999d}"}, "bad file name"),
        ({"data_path": "{"}, "bad file name"),
        ({"total_episodes": 0}, "no episode whose files are all there"),
    ],
)
def test_what_info_json_may_not_say(originals, tmp_path, changes, message):
    assert_refused(info_with(originals, tmp_path, **changes), message)


def test_parquet_with_other_columns(originals, tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = copy(originals / "v2", tmp_path / "v2")
    file = folder / "data/chunk-000/episode_000000.parquet"
    cases = [
        ({"timestamp": [0.0, 0.1]}, "has no column 'observation.state'"),
        ({"timestamp": [0.0, 0.1], "observation.state": [[1.0, 2.0], [1.0]]}, "rows of different lengths"),
        ({"timestamp": [0.0, 0.1], "observation.state": [[1.0], [2.0]]}, "has 1 numbers a row"),
        ({"timestamp": [0.0, 0.1], "observation.state": [[1.0, None], [1.0, 2.0]]}, "expected numbers, none missing"),
        ({"timestamp": [0.0, 0.1], "observation.state": [["x", "y"], ["x", "y"]]}, "expected numbers, none missing"),
        ({"timestamp": [0.1, 0.0], "observation.state": [[1.0, 2.0], [1.0, 2.0]]}, "times do not increase"),
        ({"timestamp": [0.0, None], "observation.state": [[1.0, 2.0], [1.0, 2.0]]}, "1 missing values"),
        ({"timestamp": [0.0], "observation.state": [[1.0, 2.0]]}, "has 1 rows; expected at least 2"),
        ({"timestamp": [0.0, 0.1], "observation.state": [[1.0, float("inf")], [1.0, 2.0]]}, "not finite"),
    ]
    for table, message in cases:
        pq.write_table(pa.table(table), file)
        assert_refused(folder, message)


def test_a_bag_of_other_things(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    message = store.types["std_msgs/msg/String"]("hello")
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        writer.write(topic, 10**12, store.serialize_cdr(message, "std_msgs/msg/String"))
    assert_refused(tmp_path / "bag", r"no topic of type sensor_msgs/msg/JointState; it has /chatter")


def test_a_bag_with_an_unknown_encoding(tmp_path):
    assert_refused(ros_bag(tmp_path / "bag", encoding="16UC9"), "has encoding '16UC9'; expected one of rgb8")


def test_definitions_in_a_bag_are_not_used(tmp_path):
    """The library would turn them into code; only types of our own are decoded."""
    ros_bag(tmp_path / "bag")
    content = (tmp_path / "bag" / "bag.mcap").read_bytes()
    assert b"float64[] position" in content
    other = content.replace(b"float64[] position", b"float64[] posit!on")
    (tmp_path / "bag" / "bag.mcap").write_bytes(other)
    said = read_all(tmp_path / "bag")
    assert said == 12 or "cannot be read as a ROS bag" in str(said)


def test_an_image_that_claims_to_be_huge(tmp_path):
    import zlib

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(bytes(1000)))
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + pixels + chunk(b"IEND", b"")
    for k in range(2):
        (tmp_path / f"{k}.png").write_bytes(png)
    (tmp_path / "log.csv").write_text("time,a\n0,0\n1,1\n")
    assert_refused(tmp_path, "60000 x 60000 pixels; expected|cannot be read as an image")


@pytest.mark.parametrize("container", ["h264", "mpegts", "mp4", "matroska"])
def test_a_video_that_changes_its_size(tmp_path, container):
    """A player would scale what follows to the first size without a word."""
    import av

    large = encode(tmp_path / "a.h264", moving_images(8, size=(96, 128)), form="h264").read_bytes()
    small = encode(tmp_path / "b.h264", moving_images(8, size=(64, 64)), form="h264").read_bytes()
    path = tmp_path / "both"
    (tmp_path / "both.h264").write_bytes(large + small)
    with av.open(str(tmp_path / "both.h264")) as source, av.open(str(path), "w", format=container) as target:
        stream = source.streams.video[0]
        copy = target.add_stream_from_template(stream)
        for number, packet in enumerate(packet for packet in source.demux(stream) if packet.size):
            packet.stream = copy
            packet.pts = packet.dts = number * round(1 / (30 * packet.time_base))
            target.mux(packet)
    with pytest.raises(DenseVSError, match="changes its frame size from 128 x 96 to 64 x 64"):
        list(VideoReader(path))


def test_a_frame_of_another_size_is_not_written(tmp_path):
    with pytest.raises(DenseVSError, match="frame of 129 x 96 pixels in a video of 128 x 96"):
        write_two(tmp_path / "v.mp4", (96, 128), (96, 129))  # once cut to even sides they would be alike
    assert not (tmp_path / "v.mp4").exists()


def write_two(path, *sizes):
    with VideoWriter(path) as video:
        for size in sizes:
            video.write(np.zeros((*size, 3), np.uint8))


def test_memory_does_not_grow_with_length(tmp_path):
    """Peak while a recording is read, and one five times as long."""

    def peak(count):
        folder = lerobot_v2(tmp_path / str(count), episodes=1, frames=count)
        tracemalloc.start()
        for _ in open_recording(folder):
            pass
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(10)  # what is imported once
    assert peak(200) < peak(40) + 1_500_000  # an image has 36,864 bytes: 160 more would be 5.9 MB
