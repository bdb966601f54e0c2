"""Small recordings in every format, written by the formats' own libraries and not by the code under test."""

import json
from fractions import Fraction

import numpy as np

SIZE = (96, 128)
FOXGLOVE = "foxglove_msgs/msg/CompressedVideo"
FFMPEG = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
VIDEO_TYPES = {
    FOXGLOVE: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    FFMPEG: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
}


def moving_images(count, pixels=2.0, size=SIZE, seed=0):
    """A textured square that moves to and fro by ``pixels`` a frame before a textured wall, RGB uint8."""
    import cv2

    random = np.random.default_rng(seed)
    height, width = size
    wall = cv2.GaussianBlur(random.uniform(0, 255, size), (0, 0), 2.0)
    wall = (60 + 130 * (wall - wall.min()) / np.ptp(wall)).astype(np.float32)
    patch = cv2.GaussianBlur(random.uniform(0, 255, size), (0, 0), 1.5)
    patch = (255 * (patch - patch.min()) / np.ptp(patch)).astype(np.float32)
    inside = np.zeros(size, np.float32)
    inside[height // 4 : 3 * height // 4, width // 8 : width // 2] = 1
    images = []
    for k in range(count):
        move = np.float32([[1, 0, 12 - abs((k * pixels) % 48 - 24)], [0, 1, 0]])
        place = cv2.warpAffine(inside, move, (width, height))
        moved = cv2.warpAffine(patch, move, (width, height))
        gray = np.clip(place * moved + (1 - place) * wall, 0, 255).astype(np.uint8)
        images.append(np.repeat(gray[..., None], 3, axis=2))
    return images


def encode(path, images, codec="libx264", fps=30, form=None, options=None):
    """A video by PyAV."""
    import av

    with av.open(str(path), "w", format=form) as container:
        stream = container.add_stream(codec, rate=Fraction(fps))
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = options or {}
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def joint_table(count, joints=2, fps=30.0):
    """Times (T,) [s] and positions (T, N)."""
    times = np.arange(count) / fps
    return times, np.stack([np.sin(times * (2 + n)) for n in range(joints)], axis=1)


def lerobot_v2(folder, episodes=2, frames=12, names=(("a", "b"),), version="v2.1", joints=2, **info):
    """A LeRobot v2 dataset by pyarrow and PyAV."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    features = {
        "observation.state": {"dtype": "float32", "shape": [joints], "names": names},
        "observation.images.front": {"dtype": "video", "shape": [*SIZE, 3], "names": ["height", "width", "channel"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    content = {
        "codebase_version": version,
        "fps": 30,
        "chunks_size": 1000,
        "total_episodes": episodes,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
        "features": features,
    } | info
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "videos/chunk-000/observation.images.front").mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(content))
    for episode in range(episodes):
        times, positions = joint_table(frames, joints)
        positions = positions + episode
        table = {"timestamp": times.astype(np.float32), "observation.state": positions.astype(np.float32).tolist()}
        pq.write_table(pa.table(table), folder / f"data/chunk-000/episode_{episode:06d}.parquet")
        video = folder / f"videos/chunk-000/observation.images.front/episode_{episode:06d}.mp4"
        encode(video, moving_images(frames, seed=episode))
    return folder


def lerobot_v3(folder, frames=(10, 14)):
    """A LeRobot v3.0 dataset: all episodes in one parquet file and one video."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    key = "observation.images.front"
    features = {
        "observation.state": {"dtype": "float32", "shape": [2], "names": {"motors": ["a", "b"]}},
        key: {"dtype": "video", "shape": [*SIZE, 3], "names": None},
    }
    for name in ("meta/episodes/chunk-000", "data/chunk-000", f"videos/{key}/chunk-000"):
        (folder / name).mkdir(parents=True)
    info = {"codebase_version": "v3.0", "fps": 30, "total_episodes": len(frames), "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    rows, states, times, numbers, images, start = [], [], [], [], [], 0
    for episode, count in enumerate(frames):
        t, q = joint_table(count)
        states += (q + episode).astype(np.float32).tolist()
        times += t.astype(np.float32).tolist()
        numbers += [episode] * count
        images += [np.full((*SIZE, 3), 40 + 100 * episode + 3 * k, np.uint8) for k in range(count)]
        files = {"data/chunk_index": 0, "data/file_index": 0}
        files |= {f"videos/{key}/chunk_index": 0, f"videos/{key}/file_index": 0}
        span = {f"videos/{key}/from_timestamp": start / 30, f"videos/{key}/to_timestamp": (start + count) / 30}
        rows.append({"episode_index": episode, "length": count, "tasks": ["x"], **files, **span})
        start += count
    table = {"observation.state": states, "timestamp": pa.array(times, pa.float32()), "episode_index": numbers}
    pq.write_table(pa.table(table), folder / "data/chunk-000/file-000.parquet")
    pq.write_table(pa.Table.from_pylist(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    encode(folder / f"videos/{key}/chunk-000/file-000.mp4", images, options={"g": "8", "crf": "5"})
    return folder


def ros_bag(path, kind="mcap", image="raw", frames=12, encoding="rgb8", stamped=True, start=1000.0):
    """A bag by rosbags: joints at 100 Hz, the names in another order in every second message; images at 30 Hz."""
    import cv2
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    types = store.types
    storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=storage)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    for name, definition in VIDEO_TYPES.items():
        store.register(get_types_from_msg(definition, name))

    def header(time):
        nanoseconds = round((time if stamped else 0.0) * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        extra = (0,) if ros1 else ()
        return types["std_msgs/msg/Header"](*extra, stamp, "")

    with writer:
        joint_type = "sensor_msgs/msg/JointState"
        kinds = {"raw": "sensor_msgs/msg/Image", "foxglove": FOXGLOVE, "ffmpeg": FFMPEG}
        image_type = kinds.get(image, "sensor_msgs/msg/CompressedImage")
        joints = writer.add_connection("/joint_states", joint_type, typestore=store)
        camera = writer.add_connection("/camera/image", image_type, typestore=store)
        messages = []
        for k in range(int(frames / 30 * 100) + 10):
            time = start - 0.05 + k / 100
            names, q, none = ["a", "b"], np.array([np.sin(time), np.cos(time)]), np.zeros(0)
            if k % 2:
                names, q = names[::-1], q[::-1].copy()
            messages.append((time, joints, types[joint_type](header(time), names, q, none, none)))
        packets = _packets(moving_images(frames)) if image in ("h264", "foxglove", "ffmpeg") else [None] * frames
        for k, (rgb, packet) in enumerate(zip(moving_images(frames), packets, strict=True)):
            time = start + k / 30
            if image == "raw":
                shown = rgb if encoding == "rgb8" else cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
                width = rgb.shape[1] * 3
                raw = np.pad(shown.reshape(rgb.shape[0], width), ((0, 0), (0, 4))).ravel()  # padded rows
                content = types[image_type](header(time), *rgb.shape[:2], encoding, 0, width + 4, raw)
            elif image == "foxglove":
                stamp = header(time).stamp
                content = types[image_type](stamp, "camera", np.frombuffer(packet, np.uint8), "h264")
            elif image == "ffmpeg":
                height, width = rgb.shape[:2]
                data = np.frombuffer(packet, np.uint8)
                content = types[image_type](header(time), width, height, "h264", k, 0, False, data)
            elif image == "h264":
                content = types[image_type](header(time), "h264", np.frombuffer(packet, np.uint8))
            else:
                data = cv2.imencode(f".{image}", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].ravel()
                content = types[image_type](header(time), image, data)
            messages.append((time, camera, content))
        for time, connection, message in sorted(messages, key=lambda m: m[0]):
            writer.write(connection, round(time * 1e9), serialize(message, connection.msgtype))
    return path


def _packets(images):
    """A packet of H.264 an image."""
    import av

    codec = av.CodecContext.create("libx264", "w")
    codec.height, codec.width = images[0].shape[:2]
    codec.pix_fmt, codec.time_base = "yuv420p", Fraction(1, 30)
    codec.options = {"tune": "zerolatency", "crf": "5"}
    packets = []
    for k, image in enumerate(images):
        frame = av.VideoFrame.from_ndarray(image, format="rgb24")
        frame.pts = k
        packets += [bytes(packet) for packet in codec.encode(frame)]
    return packets + [bytes(packet) for packet in codec.encode(None)]
