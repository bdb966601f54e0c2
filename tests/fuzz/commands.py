"""Every command with spoiled arguments, in one process: an exit code and a line, never a traceback."""

import contextlib
import io
import os
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from outcome import Tally, run_case
from target import mask, rgb

WORDS = ("", "x", "-1", "0", "9" * 5000, "\u00b2", "nan", "inf", "-inf", "1e12", "1e400", "nan,nan", "1,2,3",
         "a" * 5000, "\u2603", "..", "9" * 30, "0:0", "--", "-h", "pipe", "/dev/zero")  # fmt: skip
REACH = "reach --robot planar --targets 1 --babble 0.1 --max-frames 2 --height 96 --width 128 --no-video --threads 1"
RECORD = "record --robot planar --seconds 0.1 --height 32 --width 48 --truth-every 2 --threads 1"
CODES = (0, 2)


def run(tally: Tally, seed: int, count: int, progress: Path) -> None:
    """Run ``count`` commands, a good one with one or two words spoiled each."""
    from dense_vs.cli.main import main

    # Some commands take words such as ".." for folders: they are to be inside the temporary one.
    with TemporaryDirectory() as name, contextlib.chdir(name):
        Path("below").mkdir()
        os.chdir("below")
        os.mkfifo("pipe")  # nobody writes to it
        commands = good_commands(Path(name))
        for case in range(count):
            random = np.random.default_rng([seed, case])
            words = list(commands[int(random.integers(len(commands)))])
            for _ in range(1 + int(random.random() < 0.3)):
                words[int(random.integers(1, len(words)))] = WORDS[int(random.integers(len(WORDS)))]
            shown = f"commands {seed} {case} {' '.join(word[:30] for word in words)}"
            progress.write_text(shown, errors="replace")

            def call(words: list[str] = words) -> None:
                said = io.StringIO()
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                    try:
                        code = main(words)
                    except SystemExit as end:  # argparse's own
                        code = end.code
                if code not in CODES:
                    raise AssertionError(f"exit code {code}")
                if "Traceback" in said.getvalue():
                    raise AssertionError(said.getvalue()[-200:])

            run_case(tally, shown, call)


def good_commands(folder: Path) -> list[list[str]]:
    """A command line of every command: a good one, or, where that takes long, one of which a word is wrong already."""
    from arm_recordings import record
    from small_recordings import encode, joint_table, moving_images

    from dense_vs.segmentation import FewShotSegmenter

    encode(folder / "video.mp4", moving_images(6, size=(48, 64)))
    times, positions = joint_table(12)
    rows = "".join(f"{t},{q[0]},{q[1]}\n" for t, q in zip(times, positions, strict=True))
    (folder / "joints.csv").write_text(f"time,a,b\n{rows}")
    FewShotSegmenter(size=32, samples=20).fit([rgb()], [mask()]).save(folder / "object.npz")
    (folder / "i.png").write_bytes(cv2.imencode(".png", rgb())[1].tobytes())
    (folder / "i_mask.png").write_bytes(cv2.imencode(".png", mask().astype(np.uint8))[1].tobytes())
    (folder / "approach.csv").write_text(
        "mask_area_px,camera_z_m\n" + "".join(f"{9000 - 900 * k},{k}\n" for k in range(9))
    )
    back, halves = np.linspace(0, 0.5, 10), np.linspace(18, 7, 10).astype(int)
    seen = np.array([np.pad(np.ones((2 * h, 2 * h), bool), ((24 - h, 24 - h), (32 - h, 32 - h))) for h in halves])
    np.savez(
        folder / "normal.npz", sequence=np.array(["drawn"]), start=np.array([0, 10]), height_width=np.array([48, 64]),
        mask_bits=np.packbits(seen.reshape(10, -1), axis=1), camera_back=back.astype(np.float32),
        depth=(0.3 + back).astype(np.float32),
    )  # fmt: skip
    (folder / "sweep.toml").write_text('[[experiment]]\ncommand = "none"\nseeds = "0:2"\n')
    arm = record("ur5", 0).observations()[:12]
    np.savez(
        folder / "arm.npz", **{name: getattr(arm, name) for name in ("joints", "pixels", "intrinsics", "image_sizes")}
    )
    out = str(folder / "out")
    recording = [str(folder / "video.mp4"), str(folder / "joints.csv")]
    return [
        ["info", *recording, "--episode", "0", "--camera", "video", "--joints", "a,b"],
        ["estimate", *recording, "--out", out, "--time-offset", "0", "--scale", "1", "--every", "5", "--no-video",
         "--threads", "1", "--smoothing", "0.05", "--episodes", "0:1"],
        ["segment", str(folder / "i.png"), "--model", str(folder / "object.npz"), "--out", out],
        ["segment-train", str(folder), "--out", str(folder / "new.npz"), "--seed", "0", "--folds", "0"],
        ["learn-model", str(folder / "arm.npz"), "--out", str(folder / "model.npz"), "--seed", "0", "--held-out",
         "2", "--distortion", "1"],
        ["depth-eval", str(folder), "--methods", "vos-de", "--sets", "normal"],
        [*REACH.split(), "--out", out, "--point", "tip", "--seed", "0", "--gain", "0.2",
         "--tolerance", "2"],
        [*RECORD.split(), "--out", out, "--log-rate", "100", "--jitter", "0.002", "--time-offset", "0"],
        ["depth-train", "--sequences", "0", "--out", out, "--seed", "0", "--jobs", "1"],
        ["body", *recording, "--out", str(folder / "body.npz"), "--kind", "posture", "--held-out", "0", "--scale", "1",
         "--time-offset", "0", "--focal-length", "60"],
        ["sweep", str(folder / "sweep.toml"), "--out", out, "--jobs", "1", "--threads", "1"],
        ["batch", "--robot", "none", "--worlds", "1", "--out", out, "--seed", "0", "--height", "32"],
        ["live", "--robot", "none", "--port", "0", "--seed", "0"],
        ["reproduce", "vosvs", "depth-log", "--log", str(folder / "approach.csv"), "--seed", "0", "--out", out],
        ["reproduce", "vosvs", "trial", "--objects", "none", "--seed", "0", "--jobs", "1", "--mask-seconds", "0.1",
         "--json", str(folder / "figures.json"), "--out", out],
        ["reproduce", "dije", "labels", "--seconds", "nan", "--seed", "0", "--out", out],
        ["reproduce", "gothoskar", "grasp", "--tries", "0", "--independent", "0.01", "--seed", "0", "--out", out],
        ["arms", "none", "--out", out],
    ]  # fmt: skip
