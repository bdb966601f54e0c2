"""What the humanoid's labels and tracked points are compared with: masks and points marked by hand."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import g1_episodes
import real_robot
from real_robot import SIZE, Labels

Y, X = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)


def labels_of(masks, images):
    labels = Labels.__new__(Labels)
    labels.masks, labels.images, labels._nearest = masks, images, {}
    labels.done = SimpleNamespace()
    return labels


def take(labels, time, image, own):
    labels.done.labels = lambda: own
    labels.take(SimpleNamespace(time=time, image=np.full((*SIZE, 3), image, np.float32)))


def test_a_marked_row_is_compared_with_the_frame_that_shows_its_image():
    mask = X < 100
    labels = labels_of({30: mask, 60: X < 50}, {row: np.full((*SIZE, 3), float(row)) for row in (30, 60)})
    take(labels, 0.87, 30.0, X < 10)  # too early by more than 0.12 s
    take(labels, 0.95, 33.0, X < 20)
    take(labels, 1.00, 31.0, X < 50)
    take(labels, 1.05, 27.0, X < 30)  # darker by more
    take(labels, 1.13, 30.0, X < 40)  # too late
    assert labels.quality() == [pytest.approx((0.5, 0.5))]
    take(labels, 2.0, 60.0, X < 100)
    assert labels.quality() == [pytest.approx((0.5, 0.5)), pytest.approx((0.5, 1.0))]


def test_the_frame_whose_image_differs_least_on_the_whole_is_compared():
    """One that is 3 gray levels off everywhere, and one with a single pixel 90 off, which is the same image."""
    labels = labels_of({30: X < 100}, {30: np.full((*SIZE, 3), 30.0)})
    take(labels, 0.98, 33.0, X < 20)
    spotted = np.full((*SIZE, 3), 30.0, np.float32)
    spotted[0, 0] = 120.0
    labels.done.labels = lambda: X < 50
    labels.take(SimpleNamespace(time=1.0, image=spotted))
    assert labels.quality() == [pytest.approx((0.5, 0.5))]


def test_marked_rows_are_kept_as_the_estimator_sees_them(monkeypatch):
    monkeypatch.setattr(real_robot, "marked_masks", lambda number: {1: number > X})
    images = [(np.full((480, 640, 3), value, np.uint8), 0.0) for value in (10, 20, 30)]
    labels = Labels(SimpleNamespace(number=7, images=lambda: images), None)
    assert list(labels.images) == [1]
    assert labels.images[1].shape == (*SIZE, 3)
    assert (labels.images[1] == 20).all()
    np.testing.assert_array_equal(labels.masks[1], X < 7)


def test_masks_are_the_polygons_at_half_size(tmp_path, monkeypatch):
    file = tmp_path / "marks.json"
    square = [[100, 40], [299, 40], [299, 139], [100, 139]]  # px at 640x480
    marks = {"masks": [{"episode": 5, "frame": 12, "polygon": square}, {"episode": 6, "frame": 1, "polygon": square}]}
    file.write_text(json.dumps({**marks, "points": [{"episode": 5}]}))
    monkeypatch.setattr(g1_episodes, "MARKS", file)
    ((row, mask),) = g1_episodes.marked_masks(5).items()
    assert row == 12
    np.testing.assert_array_equal(mask, (X >= 50) & (X < 150) & (Y >= 20) & (Y < 70))
    assert g1_episodes.marked_masks(9) == {}
    assert g1_episodes.marked_points() == [{"episode": 5}]


def test_a_pixel_of_a_mask_is_at_least_half_inside_the_polygon(tmp_path, monkeypatch):
    """An odd column on the left, an odd row above: two of four pixels are inside there, one of four in the corner."""
    square = [[101, 41], [299, 41], [299, 139], [101, 139]]  # px at 640x480
    file = tmp_path / "marks.json"
    file.write_text(json.dumps({"masks": [{"episode": 5, "frame": 12, "polygon": square}]}))
    monkeypatch.setattr(g1_episodes, "MARKS", file)
    expected = (X >= 50) & (X < 150) & (Y >= 20) & (Y < 70)
    expected[20, 50] = False
    np.testing.assert_array_equal(g1_episodes.marked_masks(5)[12], expected)


def test_the_tracked_point_is_compared_row_by_row_with_the_marks(monkeypatch):
    """Texture that moves by 3 px an image, every third image repeated; one mark is wrong by (3, 4) px."""
    texture = np.random.default_rng(1).uniform(0, 255, (120, 175)).astype(np.float32)
    wide = cv2.resize(texture, (700, 480), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    shifts = [0, 0, 3, 6, 6, 9, 12, 12, 15]
    images = [np.ascontiguousarray(np.repeat(wide[:, 30 - s : 670 - s, None], 3, axis=2)) for s in shifts]
    stream = [(image, row / 30) for row, image in enumerate(images)]
    monkeypatch.setattr(
        real_robot,
        "open_recording",
        lambda data, episode: SimpleNamespace(episode=lambda: SimpleNamespace(images=lambda: stream)),
    )
    rows = [2, 3, 4, 6, 7]
    places = [[320.0 + shifts[row] - shifts[2], 240.0] for row in rows]
    places[3] = [places[3][0] + 3, 244.0]
    errors, lost = real_robot.tracking_errors({"episode": 1, "frames": rows, "positions": places})
    np.testing.assert_allclose(errors, [0, 0, 5, 0], atol=0.4)
    assert not lost.any()
