"""The six episodes of a real humanoid: AV1, images that come twice, a camera that is late."""

import numpy as np
import pytest
from shared_data import SHARED_DATA

from dense_vs.recording import MotionSamples, find_clock_offset, open_recording
from dense_vs.recording.distinct_images import DistinctImages

FOLDER = SHARED_DATA / "g1_reach"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"{FOLDER} is not there")
EPISODE = 43


@pytest.fixture(scope="module")
def read():
    """An episode, the times of its distinct images, their motion, and what was counted."""
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    episode = open_recording(FOLDER, episode=EPISODE, joint_names=["kRight[SEW]*"]).episode()
    motion, times = MotionSamples(), []
    distinct = DistinctImages(episode.images(), 30.0)
    for found in distinct:
        times.append(found.time)
        motion.add(found.gray, found.time)
    return episode, np.array(times), motion, distinct


def test_what_is_there():
    recording = open_recording(FOLDER)
    assert recording.format == "LeRobot v2.1"
    assert recording.episodes == (5, 10, 20, 28, 37, 43)
    assert recording.cameras == ("observation.images.cam_high",)
    assert len(recording.joint_names) == 26
    assert open_recording(FOLDER, joint_names=["kRight*"]).joint_names[0] == "kRightShoulderPitch"


def test_images_come_twice(read):
    _, times, _, distinct = read
    assert distinct.images == 394
    # 15 images a second in a file of 30; the slips of one image and three are evened out.
    assert 0.45 < len(times) / 394 < 0.55
    steps = np.diff(times)
    assert np.median(steps) == pytest.approx(1 / 15, abs=0.002)
    assert np.mean(np.abs(steps - 1 / 15) < 0.02) > 0.85
    assert 0.4 < distinct.repeated / 394 < 0.5
    assert not distinct.gaps


@pytest.mark.parametrize("shift", [-0.2, -0.1, 0.1, 0.2])
def test_a_shifted_log_shifts_the_answer(read, shift):
    episode, _, motion, _ = read
    plain = find_clock_offset(motion, episode.log)
    shifted = find_clock_offset(motion, episode.log.shifted(shift))
    assert plain.confidence > 0.6
    assert 0.03 < plain.seconds < 0.15
    assert shifted.seconds + shift == pytest.approx(plain.seconds, abs=0.015)
