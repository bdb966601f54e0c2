"""The OpenCV driver on a stand-in with the interface of cv2.VideoCapture."""

import threading
import time

import cv2
import numpy as np
import pytest

from dense_vs import Camera
from dense_vs.drivers.opencv_camera import OpenCVCamera
from dense_vs.errors import DenseVSError


class FakeCapture:
    """A camera of 50 images a second; blue on the left, as OpenCV's BGR has it."""

    opened = 0

    def __init__(self, source=0):
        type(self).opened += 1
        self.working, self.size, self.there, self.settings = True, (8, 12), source != 9, {}
        type(self).last = self

    def isOpened(self):
        return self.there

    def set(self, name, value):
        self.settings[name] = value

    def read(self):
        time.sleep(0.02)
        image = np.zeros((*self.size, 3), np.uint8)
        image[:, :4, 0] = 200
        return self.working, image if self.working else None

    def release(self):
        self.working = False


def read_on(camera):
    for _ in range(5):
        camera.read()


@pytest.fixture
def camera():
    FakeCapture.opened = 0
    camera = OpenCVCamera(0, width=12, fps=50, delay=0.5, timeout=0.2, open_capture=FakeCapture)
    yield camera
    camera.close()


def test_images_are_rgb_new_and_stamped(camera):
    assert isinstance(camera, Camera)
    (first, t1), (_, t2), (_, t3) = camera.read(), camera.read(), camera.read()
    assert first[0, 0].tolist() == [0, 0, 200]
    assert t1 < t2 < t3
    assert time.monotonic() - 0.5 - 1.0 < t3 < time.monotonic() - 0.5
    assert FakeCapture.last.settings == {cv2.CAP_PROP_FRAME_WIDTH: 12, cv2.CAP_PROP_FPS: 50}


def test_a_slow_loop_gets_the_newest_image(camera):
    camera.read()
    time.sleep(0.3)
    before = time.monotonic()
    assert camera.read()[1] > before - 0.5 - 0.1


def test_a_camera_that_stalls_is_said_and_opened_anew(camera):
    camera.read()
    FakeCapture.last.working = False
    with pytest.raises(DenseVSError, match="no image"):
        read_on(camera)
    end = time.monotonic() + 10
    while FakeCapture.opened < 2 and time.monotonic() < end:
        time.sleep(0.01)
    assert FakeCapture.opened == 2
    image = None
    while image is None and time.monotonic() < end:
        try:
            image, _ = camera.read()
        except DenseVSError:
            continue
    assert image is not None


def test_another_size_is_refused_until_it_is_the_old_one_again(camera):
    camera.read()
    FakeCapture.last.size = (16, 24)
    with pytest.raises(DenseVSError, match="24 x 16 px now; expected 12 x 8"):
        read_on(camera)
    FakeCapture.last.size = (8, 12)
    sizes = []
    for _ in range(4):
        try:
            sizes.append(camera.read()[0].shape)
        except DenseVSError:
            continue
    assert sizes[-1] == (8, 12, 3)


def test_a_camera_that_is_not_there_is_refused():
    threads = threading.active_count()
    with pytest.raises(DenseVSError, match="cannot open camera 9"):
        OpenCVCamera(9, open_capture=FakeCapture)
    assert threading.active_count() == threads
