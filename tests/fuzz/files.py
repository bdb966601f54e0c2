"""Every reader of files on damaged files: bytes flipped, cut, doubled; arrays of another shape, type or size.

Some are no files at all: a pipe that nobody writes to, a device that never ends.
"""

import io
import json
import os
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from outcome import Tally, run_case
from small_networks import red_network
from target import H, W, mask, rgb


def run(tally: Tally, seed: int, count: int, progress: Path) -> None:
    """Damage and read ``count`` files."""
    with TemporaryDirectory() as name:
        readers = made(Path(name))
        for case in range(count):
            random = np.random.default_rng([seed, case])
            good, read = readers[int(random.integers(len(readers)))]
            bad = good.with_name(f"bad{good.suffix}")
            how = damage(good, bad, random)
            shown = f"files {seed} {case} {good.stem}: {how}"
            progress.write_text(shown)
            run_case(tally, shown, lambda read=read, bad=bad: read(bad), may_be_nan=True)


def made(folder: Path) -> list[tuple[Path, Callable[[Path], Any]]]:
    """Good files of every kind, and what reads them."""
    from calls import estimator
    from calls_models import model
    from small_recordings import encode, joint_table, moving_images

    from dense_vs import DenseJacobian, JointLog
    from dense_vs.cli.learn_model import read_recording
    from dense_vs.depth.learned_depth import WEIGHTS, LearnedDepth
    from dense_vs.depth.odms import read_sequences
    from dense_vs.generative import GenerativeModel
    from dense_vs.recording import TruthFile, open_recording
    from dense_vs.segmentation import FewShotSegmenter, OnnxSegmenter, read_image, read_mask

    estimator().save(folder / "jacobian.npz")
    learned, recording = model()
    learned.save(folder / "model.npz")
    np.savez(folder / "features.npz", pixels=recording.pixels[:6], joints=recording.joints[:6],
             image_sizes=np.array([[480, 640]] * 2), intrinsics=recording.intrinsics)  # fmt: skip
    TruthFile(("a", "b"), np.arange(2.0), np.ones((2, H, W, 2, 2), np.float32), np.stack([mask()] * 2)).write(
        folder / "truth.npz"
    )
    FewShotSegmenter(size=32, samples=20).fit([rgb()], [mask()]).save(folder / "object.npz")
    LearnedDepth.load(WEIGHTS).save(folder / "weights.npz")
    bits = np.packbits(np.stack([mask()] * 12).reshape(12, -1), axis=1)
    np.savez(folder / "odms.npz", sequence=np.array(["s"]), start=np.array([0, 12]), height_width=np.array([H, W]),
             mask_bits=bits, camera_back=np.linspace(0, 0.3, 12), depth=np.linspace(0.5, 0.8, 12))  # fmt: skip
    (folder / "log.csv").write_text("time,a,b\n" + "".join(f"{k / 10},{k},{-k}\n" for k in range(8)))
    for name, image in (("image.png", rgb()), ("image.jpg", rgb()), ("mask.png", mask().astype(np.uint8) * 255)):
        (folder / name).write_bytes(cv2.imencode(Path(name).suffix, image)[1].tobytes())
    red_network(folder / "network.onnx")
    encode(folder / "video.mp4", moving_images(8, size=(48, 64)))
    times, positions = joint_table(12)
    rows = "".join(f"{t},{q[0]},{q[1]}\n" for t, q in zip(times, positions, strict=True))
    (folder / "joints.csv").write_text(f"time,a,b\n{rows}")

    def video(path: Path) -> int:
        return sum(1 for _ in open_recording(path, folder / "joints.csv").episode().images())

    return [
        (folder / "jacobian.npz", lambda path: DenseJacobian.load(path, device="cpu", threads=1).to_numpy()),
        (folder / "model.npz", lambda path: GenerativeModel.load(path).pixels(recording.joints[:2])),
        (folder / "features.npz", read_recording),
        (folder / "truth.npz", lambda path: TruthFile.read(path, ["b"]).at(1.0)),
        (folder / "object.npz", lambda path: FewShotSegmenter.load(path).segment(rgb())),
        (folder / "weights.npz", lambda path: LearnedDepth.load(path).factor),
        (folder / "odms.npz", lambda path: list(read_sequences(path))),
        (folder / "log.csv", lambda path: JointLog.read_csv(path).positions),
        (folder / "image.png", read_image),
        (folder / "image.jpg", read_image),
        (folder / "mask.png", read_mask),
        (folder / "network.onnx", lambda path: OnnxSegmenter(path).segment(rgb())),
        (folder / "video.mp4", video),
        *of_rooms(folder),
    ]


def of_rooms(folder: Path) -> list[tuple[Path, Callable[[Path], Any]]]:
    """Files of the live page, sweeps, the body model and checkpoints."""
    from calls import estimator
    from calls_rooms import body, checkpoint, memory
    from small_recordings import lerobot_v2

    from dense_vs.body_model import load_body
    from dense_vs.live.state_file import load_state
    from dense_vs.point_servo.checkpoint import Checkpoint
    from dense_vs.recording import open_recording
    from dense_vs.sweep.figures import SUMMARY_FILE, figures_of
    from dense_vs.sweep.plan import read_plan
    from dense_vs.sweep.run_task import OUT_FOLDER, result_folder

    body().save(folder / "body.npz")
    memory().save(folder / "memory.npz")
    (folder / "kept.npz").write_bytes(checkpoint().path.read_bytes())
    plan = '[[experiment]]\ncommand = "reach"\nseeds = "0:3"\n[experiment.options]\nrobot = ["arm", "planar"]\n'
    (folder / "plan.toml").write_text(f"{plan}targets = 3\nno-video = true\n")
    task = read_plan(folder / "plan.toml")[0]
    summary = {"seed": 1, "fps": 30.5, "robot": "arm", "targets": [{"reached": True, "true_error_px": 0.5}]}
    (folder / "summary.json").write_text(json.dumps(summary))
    lerobot_v2(folder / "lerobot", episodes=1)
    (folder / "info.json").write_bytes((folder / "lerobot" / "meta" / "info.json").read_bytes())

    def figures(path: Path) -> Any:
        place = result_folder(folder, task) / OUT_FOLDER
        place.mkdir(parents=True, exist_ok=True)
        path.replace(place / SUMMARY_FILE)
        return figures_of(folder, task)

    def episodes(path: Path) -> Any:
        path.replace(folder / "lerobot" / "meta" / "info.json")
        return open_recording(folder / "lerobot").episodes

    def resumed(path: Path) -> Any:
        kept = Checkpoint(path, checkpoint().joint_names).resume((H, W), device="cpu", threads=1)
        kept.bring_to(np.full(3, 0.01))
        return kept.estimator.to_numpy(), None if kept.body is None else kept.body.jacobian(np.zeros(3))

    return [
        (folder / "kept.npz", resumed),
        (folder / "jacobian.npz", lambda path: load_state(path, estimator()).to_numpy()),
        (folder / "body.npz", lambda path: load_body(path).jacobian(np.zeros(2))),
        (folder / "memory.npz", lambda path: load_body(path).jacobian(np.zeros(2))),
        (folder / "plan.toml", lambda path: [task.command_line("out", "rows") for task in read_plan(path)]),
        (folder / "summary.json", figures),
        (folder / "info.json", episodes),
    ]


def damage(good: Path, bad: Path, random: np.random.Generator) -> str:
    """Write a damaged copy; how it was damaged."""
    content = bytearray(good.read_bytes())
    bad.unlink(missing_ok=True)
    if good.suffix == ".npz" and random.random() < 0.7:
        return _damage_array(good, bad, random)
    choice = int(random.integers(8))
    if choice == 6:
        if random.random() < 0.5:
            os.mkfifo(bad)
            return "a pipe"
        bad.symlink_to("/dev/zero")
        return "a device"
    if choice == 7 and good.suffix in (".json", ".toml", ".csv"):
        places = [found.span() for found in re.finditer(rb"[0-9]+", content)]
        first, end = places[int(random.integers(len(places)))]
        digits = b"9" * int(random.choice([20, 400, 5000]))
        bad.write_bytes(content[:first] + digits + content[end:])
        return f"{len(digits)} digits at {first}"
    if choice == 0:
        bad.write_bytes(content[: int(random.integers(len(content)))])
        return "cut"
    if choice == 1:
        for place in random.integers(len(content), size=int(random.integers(1, 20))):
            content[place] ^= 1 << int(random.integers(8))
        bad.write_bytes(content)
        return "bits flipped"
    if choice == 2:
        place, length = int(random.integers(len(content))), int(random.integers(1, 64))
        content[place : place + length] = random.bytes(length)
        bad.write_bytes(content)
        return f"{length} bytes at {place} overwritten"
    if choice == 3:
        content[: int(random.integers(1, 200))] = random.bytes(int(random.integers(1, 200)))
        bad.write_bytes(content)
        return "another beginning"
    if choice == 4:
        bad.write_bytes(b"")
        return "empty"
    place = int(random.integers(len(content)))
    bad.write_bytes(content[:place] + content[place // 2 :])
    return "a part twice"


def _damage_array(good: Path, bad: Path, random: np.random.Generator) -> str:
    """Another shape, type, value or header of one array, or one missing."""
    with np.load(good) as stored:
        arrays = {name: stored[name] for name in stored.files}
    name = sorted(arrays)[int(random.integers(len(arrays)))]
    array = arrays[name]
    kinds = ["missing", "more axes", "empty", "type", "text", "nan", "huge", "negative", "header", "shorter", "scalar",
             "nested", "digits"]  # fmt: skip
    kind = kinds[int(random.integers(len(kinds)))]
    if kind == "missing":
        del arrays[name]
    elif kind == "more axes":
        arrays[name] = array[None]
    elif kind == "empty":
        arrays[name] = np.zeros((0, *array.shape[1:]), array.dtype)
    elif kind == "type":
        other = [np.int64, np.float16, np.complex128, np.uint8, bool][int(random.integers(5))]
        arrays[name] = np.zeros(array.shape, other)
    elif kind in ("nested", "digits"):
        arrays[name] = np.array({"nested": "[" * 100_000, "digits": "9" * 5000}[kind])
    elif kind == "text":
        arrays[name] = np.full(array.shape, "x")
    elif kind in ("nan", "huge", "negative"):
        value = {"nan": np.nan, "huge": 3e38, "negative": -7.0}[kind]
        changed = np.array(array, copy=True)
        if changed.dtype.kind == "f" and changed.size:
            changed.reshape(-1)[int(random.integers(changed.size))] = value
        elif changed.dtype.kind in "iu" and changed.size:
            changed.reshape(-1)[int(random.integers(changed.size))] = np.iinfo(changed.dtype).max
        arrays[name] = changed
    elif kind == "shorter":
        arrays[name] = array[:-1] if array.ndim else array[None]
    elif kind == "scalar":
        arrays[name] = np.array(3.5)
    np.savez(bad, **arrays)
    if kind == "header":
        _claim_more(bad, f"{name}.npy")
    return f"{name} {kind}"


def _claim_more(path: Path, entry: str) -> None:
    """Let an array's header claim 1e12 elements."""
    with zipfile.ZipFile(path) as archive:
        contents = {one: archive.read(one) for one in archive.namelist()}
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)})
    contents[entry] = stream.getvalue() + b"\0" * 64
    with zipfile.ZipFile(path, "w") as archive:
        for one, content in contents.items():
            archive.writestr(one, content)
