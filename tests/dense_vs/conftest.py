"""What the tests of the algorithms share: a plane with known image motion, and recordings of it."""

import csv

import numpy as np
import pytest
from planar_scene import PlanarScene

from dense_vs.robot.babbling import Babbling

RECORDING_FPS = 25.0
RECORDING_FRAMES = 40


@pytest.fixture(scope="session")
def scene():
    return PlanarScene()


@pytest.fixture(scope="session")
def postures():
    """Joint positions (T, 4) [rad] of a babbling that moves the plane by a few px a frame."""
    babbling = Babbling(4, amplitude=0.12, seed=3)
    return np.cumsum([babbling.step() for _ in range(80)], axis=0)


@pytest.fixture(scope="session")
def exact_frames(scene, postures):
    """Flow and joint step of every frame after the first, exact."""
    steps = np.diff(postures, axis=0).astype(np.float32)
    return [(scene.flow(a, b), dq) for a, b, dq in zip(postures[:-1], postures[1:], steps, strict=True)]


@pytest.fixture(scope="session")
def recording(scene, postures, tmp_path_factory):
    """A folder with video.mp4, joints.csv at 100 Hz and truth.npz of the last frames."""
    pytest.importorskip("av", reason="writing video needs PyAV")
    from dense_vs.recording.truth_file import TruthFile
    from dense_vs.recording.video import VideoWriter

    folder = tmp_path_factory.mktemp("recording")
    times = np.arange(RECORDING_FRAMES) / RECORDING_FPS
    with VideoWriter(folder / "video.mp4", RECORDING_FPS, quality=8) as video:
        for q in postures[:RECORDING_FRAMES]:
            video.write(np.repeat(scene.image(q)[..., None], 3, axis=2))
    ticks = np.arange(-0.05, times[-1] + 0.05, 0.01)
    with open(folder / "joints.csv", "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *scene.joint_names])
        for tick in ticks:
            writer.writerow([tick, *(np.interp(tick, times, q) for q in postures[:RECORDING_FRAMES].T)])
    shown = np.arange(RECORDING_FRAMES - 3, RECORDING_FRAMES)
    TruthFile(
        scene.joint_names,
        times[shown],
        np.array([scene.jacobian(postures[k]) for k in shown], dtype=np.float32),
        np.ones((len(shown), scene.height, scene.width), dtype=bool),
    ).write(folder / "truth.npz")
    return folder
