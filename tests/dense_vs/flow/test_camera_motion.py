"""The motion of a swaying camera against motions that are known exactly."""

import numpy as np
import pytest
from scipy.ndimage import affine_transform

from dense_vs.flow.camera_motion import CameraMotion, fit_camera_motion

HEIGHT, WIDTH = 96, 128
CORNERS = np.array([[0.0, 0.0], [WIDTH - 1, 0.0], [0.0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]])


def similarity(turn, growth, shift):
    """About the image's middle."""
    middle = 0.5 * np.array([WIDTH - 1, HEIGHT - 1])
    linear = (1 + growth) * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return CameraMotion(np.column_stack([linear, middle - linear @ middle + shift]), 1.0, 0.0)


def exact_flow(motion):
    """Flow of an image in which everything stands still: x minus where the camera's motion has brought x from."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    now = np.stack([x, y], axis=2)
    return now - (now - motion.matrix[:, 2]) @ np.linalg.inv(motion.matrix[:, :2]).T


@pytest.mark.parametrize(
    ("turn", "growth", "shift"), [(0, 0, (0.2, -0.1)), (0.004, 0, (0, 0)), (-0.003, 0.002, (0.5, 0.3))]
)
def test_fit_finds_the_camera_below_others_motion(turn, growth, shift):
    rng = np.random.default_rng(1)
    true = similarity(turn, growth, np.array(shift))
    rows, columns = (part.ravel() for part in np.mgrid[4:HEIGHT:8, 4:WIDTH:8])
    places = np.column_stack([columns, rows])
    flow = exact_flow(true)[rows, columns] + 0.05 * rng.standard_normal((len(places), 2))
    robot = (columns > 60) & (rows > 20)  # 40 % of the places
    flow[robot] += [3.0, -2.0]
    flow[rng.choice(len(flow), 5)] = np.nan
    found = fit_camera_motion(places, flow)
    assert found is not None
    assert np.linalg.norm(found.moved(CORNERS) - true.moved(CORNERS), axis=1).max() < 0.1
    assert found.inliers == pytest.approx(1 - robot.mean(), abs=0.05)
    assert 0.03 < found.error < 0.15


def test_too_few_places_are_no_motion():
    assert fit_camera_motion(np.zeros((19, 2)), np.zeros((19, 2))) is None
    assert fit_camera_motion(np.zeros((40, 2)), np.full((40, 2), np.nan)) is None


def test_what_stands_still_has_no_flow_left():
    motion = similarity(0.01, -0.004, np.array([1.0, -0.7]))
    left = motion.taken_out(exact_flow(motion).astype(np.float32))
    assert np.abs(left).max() < 1e-4


def test_motion_of_its_own_is_left():
    """A point that goes from p to p + m before the camera moves it too: m is left, turned as the image is."""
    motion, own = similarity(0.01, 0.0, np.array([1.0, -0.7])), np.array([4.0, 2.0])
    now = motion.moved(np.array([50.0, 40.0]) + own)
    at = np.rint(now).astype(int)
    flow = np.full((HEIGHT, WIDTH, 2), np.nan, np.float32)
    flow[at[1], at[0]] = at - np.array([50.0, 40.0]) - (now - at)  # the same displacement from a whole pixel
    before = at - flow[at[1], at[0]]
    np.testing.assert_allclose(motion.taken_out(flow)[at[1], at[0]], at - motion.moved(before), atol=1e-4)


def test_carried_image_is_that_of_scipy():
    rng = np.random.default_rng(2)
    image = rng.standard_normal((HEIGHT, WIDTH, 2, 3)).astype(np.float32)
    motion = similarity(0.02, 0.01, np.array([1.5, -2.25]))
    carried = motion.carried(image)
    assert carried.shape == image.shape
    # SciPy takes rows first and asks where each pixel comes from.
    inverse = np.linalg.inv(np.vstack([motion.matrix, [0, 0, 1]]))[[1, 0]][:, [1, 0, 2]]
    for c in np.ndindex(2, 3):
        expected = affine_transform(image[..., *c], inverse[:, :2], inverse[:, 2], order=1, mode="nearest")
        off = np.abs(carried[..., *c] - expected)[4:-4, 4:-4]
        assert off.max() < 0.15  # OpenCV takes steps of 1/32 px
        assert off.mean() < 0.02


def test_one_motion_after_another():
    first, second = similarity(0.02, 0.01, np.array([1.5, -2.25])), similarity(-0.01, 0.0, np.array([0.0, 3.0]))
    np.testing.assert_allclose(second.after(first).moved(CORNERS), second.moved(first.moved(CORNERS)))
    assert CameraMotion.none().largest(HEIGHT, WIDTH) == 0
    assert similarity(0, 0, np.array([3.0, 4.0])).largest(HEIGHT, WIDTH) == pytest.approx(5)
