"""The six episodes of a real humanoid: AV1, images that come twice, a camera that is late."""

import numpy as np
import pytest
from shared_data import SHARED_DATA

from dense_vs.recording import MotionSamples, RepetitionFilter, find_clock_offset, open_recording

FOLDER = SHARED_DATA / "g1_reach"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"{FOLDER} is not there")
EPISODE = 43


@pytest.fixture(scope="module")
def read():
    """An episode, which of its images were kept, their motion, and how many repeat."""
    pytest.importorskip("pyarrow", reason="LeRobot folders need pyarrow")
    import cv2

    episode = open_recording(FOLDER, episode=EPISODE, joint_names=["kRight[SEW]*"]).episode()
    repetition, motion, kept = RepetitionFilter(), MotionSamples(), []
    for image, time in episode.images():
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        kept.append(repetition.keep(gray))
        if kept[-1]:
            motion.add(gray, time)
    return episode, np.array(kept), motion, repetition.repeated


def test_what_is_there():
    recording = open_recording(FOLDER)
    assert recording.format == "LeRobot v2.1"
    assert recording.episodes == (5, 10, 20, 28, 37, 43)
    assert recording.cameras == ("observation.images.cam_high",)
    assert len(recording.joint_names) == 26
    assert open_recording(FOLDER, joint_names=["kRight*"]).joint_names[0] == "kRightShoulderPitch"


def test_images_come_twice(read):
    _, kept, _, repeated = read
    assert len(kept) == 394
    # 15 images a second in a file of 30; few steps are one image or three, where the phase slips.
    assert 0.45 < kept.mean() < 0.55
    assert np.mean(np.diff(np.flatnonzero(kept)) == 2) > 0.8
    assert 0.4 < repeated / 394 < 0.5


@pytest.mark.parametrize("shift", [-0.2, -0.1, 0.1, 0.2])
def test_a_shifted_log_shifts_the_answer(read, shift):
    episode, _, motion, _ = read
    plain = find_clock_offset(motion, episode.log)
    shifted = find_clock_offset(motion, episode.log.shifted(shift))
    assert plain.confidence > 0.7
    assert 0.03 < plain.seconds < 0.15
    assert shifted.seconds + shift == pytest.approx(plain.seconds, abs=0.015)
