"""What is no recording, episode, log or robot is named, whichever call gets it; and errors have an end."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.recording import (
    ClockOffset,
    Episode,
    JointLog,
    MotionSamples,
    Recorder,
    Recording,
    Replay,
    find_clock_offset,
    open_recording,
    survey_episode,
)

LOG = JointLog(("a", "b"), np.arange(3.0), np.zeros((3, 2)))
OTHERS: list[Any] = ["x", None, 3, object(), [1.0], SimpleNamespace(log="x", images=None)]


def source(cameras=("front",), episodes=(0,), joints=("a", "b")):
    """A format whose names alone matter."""
    return SimpleNamespace(
        path="here", name="a test", cameras=cameras, joint_names=joints, episodes=episodes,
        log=lambda _: LOG, images=lambda *_: [],
    )  # fmt: skip


@pytest.mark.parametrize("wrong", OTHERS)
def test_what_is_none_of_these_is_refused(tmp_path, wrong):
    for call, message in (
        (lambda: Recording(wrong), "source is a .* without"),
        (lambda: Replay(wrong), "recording is a .*; expected a Recording or an Episode"),
        (lambda: survey_episode(wrong), "episode is a .*; expected an Episode"),
        (lambda: find_clock_offset(wrong, LOG), "samples are a .*; expected MotionSamples"),
        (lambda: find_clock_offset(MotionSamples(), wrong), "log is a .*; expected a JointLog"),
        (lambda: ClockOffset(0.0, 1.0, 0.0).applied(wrong), "log is a .*; expected a JointLog"),
        (lambda: Recorder(wrong, wrong, tmp_path / "run"), "robot is a .* without"),
    ):
        with pytest.raises(DenseVSError, match=message):
            call()
    assert not list(tmp_path.iterdir())


def test_a_seed_is_looked_at_before_it_is_used():
    """NumPy takes a list apart without end where it holds itself, and the process dies of it."""
    endless: list[Any] = []
    endless.append(endless)
    for wrong in (endless, "x", -1, 1.5, None, True):
        with pytest.raises(DenseVSError, match="seed is"):
            find_clock_offset(MotionSamples(), LOG, seed=wrong)


@pytest.mark.parametrize("wrong", ["x", None, np.nan, np.inf, 1j, [1.0], True, 10**400])
def test_an_offset_is_a_finite_number(wrong):
    episode = Episode(0, "front", LOG, source())
    with pytest.raises(DenseVSError, match=r"time_offset is .*; expected a finite number"):
        episode.shifted(wrong)
    with pytest.raises(DenseVSError, match="seconds is"):
        episode.shifted(ClockOffset(wrong, 1.0, 0.0))


@pytest.mark.parametrize("wrong", [3, "ab", [3], np.array([[1.0]]), {"a": 1}, [], [None], b"ab"])
def test_joints_are_chosen_by_names(wrong, tmp_path):
    if wrong == {"a": 1}:  # its names are one
        assert Recording(source(), joint_names=wrong).joint_names == ("a",)
        return
    with pytest.raises(DenseVSError, match=r"joint names is .*; expected a sequence of names|joints are none"):
        Recording(source(), joint_names=wrong)


def test_cameras_and_episodes_are_chosen_by_name_and_number():
    for wrong in (3, ["front"], np.array(["front", "b"]), "back" * 1000):
        with pytest.raises(DenseVSError, match=r"camera .* is not in here; it has front"):
            Recording(source(), camera=wrong)
    for wrong in ("0", 0.5, True, np.arange(2), 10**5000):
        with pytest.raises(DenseVSError, match=r"episode .* is not in here; it has 0"):
            Recording(source(), episode=wrong)
    assert Recording(source(), episode=np.int64(0)).episode().log is not None
    for one in (source(cameras=()), source(episodes=())):
        with pytest.raises(DenseVSError, match="has no camera or no episode"):
            Recording(one)


def test_errors_have_an_end():
    many = source(("c" * 100_000,), tuple(range(0, 200_000, 2)), ("j" * 100_000,))
    for given in ({"camera": "x"}, {"camera": "x" * 100_000}, {"episode": 1}, {"joint_names": ["x" * 100_000]}):
        with pytest.raises(DenseVSError, match="is not in") as said:
            Recording(many, **given)
        assert len(str(said.value)) < 2000


def test_a_camera_is_asked_for_when_it_is_read(tmp_path):
    robot = SimpleNamespace(
        joint_names=("a",), joint_limits=None, joints=lambda: (np.zeros(1), 0.0), command=lambda _: None
    )
    with pytest.raises(DenseVSError, match="camera is a str without read"), Recorder("x", robot, tmp_path / "a") as one:
        one.read()
    ragged = SimpleNamespace(read=lambda: ([[1], [1, 2]], 0.0))
    with pytest.raises(DenseVSError, match="image"), Recorder(ragged, robot, tmp_path / "b") as one:
        one.read()


def test_a_recording_is_opened_with_names(tmp_path):
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    from small_recordings import lerobot_v2

    lerobot_v2(tmp_path / "v2", episodes=1)
    with pytest.raises(DenseVSError, match="joint names is 3; expected a sequence of names"):
        open_recording(tmp_path / "v2", joint_names=3)
