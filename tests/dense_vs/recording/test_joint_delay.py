"""The delay of joint readings is found from the motion that they explain, and none is invented."""

import numpy as np
import pytest

from dense_vs import Babbling
from dense_vs.recording.joint_delay import TRIED_FRAMES, joint_delay

FRAME, COUNT, JOINTS = 1 / 30, 70, 4


@pytest.fixture(scope="module", params=[0, 1, 2])
def motion(request):
    """Joint positions at 300 readings a second, and noisy flow of 40 pixels between frames at 30 a second."""
    rng = np.random.default_rng(request.param)
    babbling = Babbling(JOINTS, seed=request.param)
    coarse = np.cumsum([babbling.step() for _ in range(COUNT + 10)], axis=0)
    times = np.arange(0, (COUNT + 9) * FRAME, 1 / 300)
    frames = np.arange(COUNT + 10) * FRAME
    positions = np.stack([np.interp(times, frames, joint) for joint in coarse.T], axis=1)
    image_times = frames[3 : COUNT - 3]
    at = np.stack([np.interp(image_times, frames, joint) for joint in coarse.T], axis=1)
    flow = np.diff(at, axis=0) @ rng.normal(0, 80, (JOINTS, 80))
    return flow + rng.normal(0, 0.2, flow.shape), image_times, times, positions


@pytest.mark.parametrize("delay", [-1.5, -0.75, 0.0, 0.5, 1.0, 2.25])
def test_finds_the_delay(motion, delay):
    flow, image_times, times, positions = motion
    assert joint_delay(flow, image_times, times + delay * FRAME, positions) == pytest.approx(
        delay * FRAME, abs=0.26 * FRAME
    )


def test_noise_has_no_delay(motion):
    _, image_times, times, positions = motion
    flow = np.random.default_rng(9).normal(size=(len(image_times) - 1, 200))
    assert joint_delay(flow, image_times, times, positions) == 0.0


def test_a_robot_that_stands_still_has_none(motion):
    flow, image_times, times, positions = motion
    assert joint_delay(flow, image_times, times, np.ones_like(positions)) == 0.0
    assert abs(TRIED_FRAMES).min() == 0
