"""Every command with spoiled arguments, in one process: an exit code and a line, never a traceback."""

import contextlib
import io
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from outcome import Tally, run_case
from target import mask, rgb

WORDS = ("", "x", "-1", "0", "nan", "inf", "-inf", "1e12", "1e400", "nan,nan", "1,2,3", "a" * 5000, "\u2603", "..",
         "9" * 30, "0:0", "--", "-h")  # fmt: skip
REACH = "reach --robot planar --targets 1 --babble 0.1 --max-frames 2 --height 32 --width 48 --no-video --threads 1"
RECORD = "record --robot planar --seconds 0.1 --height 32 --width 48 --truth-every 2 --threads 1"
CODES = (0, 2)


def run(tally: Tally, seed: int, count: int, progress: Path) -> None:
    """Run ``count`` commands, a good one with one or two words spoiled each."""
    from dense_vs.cli.main import main

    with TemporaryDirectory() as name:
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
    """A good command line of every command."""
    from small_recordings import encode, joint_table, moving_images

    from dense_vs.segmentation import FewShotSegmenter

    encode(folder / "video.mp4", moving_images(6, size=(48, 64)))
    times, positions = joint_table(12)
    rows = "".join(f"{t},{q[0]},{q[1]}\n" for t, q in zip(times, positions, strict=True))
    (folder / "joints.csv").write_text(f"time,a,b\n{rows}")
    FewShotSegmenter(size=32, samples=20).fit([rgb()], [mask()]).save(folder / "object.npz")
    (folder / "i.png").write_bytes(cv2.imencode(".png", rgb())[1].tobytes())
    (folder / "i_mask.png").write_bytes(cv2.imencode(".png", mask().astype(np.uint8))[1].tobytes())
    out = str(folder / "out")
    recording = [str(folder / "video.mp4"), str(folder / "joints.csv")]
    return [
        ["info", *recording, "--episode", "0", "--camera", "camera", "--joints", "a,b"],
        ["estimate", *recording, "--out", out, "--time-offset", "0", "--scale", "1", "--every", "5", "--no-video",
         "--threads", "1", "--smoothing", "0.05", "--episodes", "0:1"],
        ["segment", str(folder / "i.png"), "--model", str(folder / "object.npz"), "--out", out],
        ["segment-train", str(folder), "--out", str(folder / "new.npz"), "--seed", "0", "--folds", "0"],
        ["learn-model", str(folder / "none.npz"), "--out", out, "--seed", "0", "--holdout", "2", "--distortion", "1"],
        ["depth-eval", str(folder), "--methods", "vos-de", "--sets", "robot"],
        [*REACH.split(), "--out", out, "--point", "tip", "--seed", "0", "--gain", "0.2"],
        [*RECORD.split(), "--out", out, "--log-rate", "100", "--jitter", "0.002", "--time-offset", "0"],
        ["depth-train", "--sequences", "0", "--out", out, "--seed", "0", "--processes", "1"],
        ["reproduce", "dije", "labels", "--seconds", "nan", "--seed", "0", "--out", out],
        ["arms", "none", "--out", out],
    ]  # fmt: skip
