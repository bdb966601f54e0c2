"""The few-shot segmenter on drawn images whose masks are exact, and what superpixels make of small objects."""

from dataclasses import asdict

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import FewShotSegmenter
from dense_vs.segmentation.few_shot import segmenter as module
from dense_vs.segmentation.few_shot.candidate_regions import see
from dense_vs.segmentation.few_shot.pixel_channels import pixel_channels
from dense_vs.segmentation.few_shot.segmenter import FewShotOptions
from dense_vs.segmentation.few_shot.superpixels import find_superpixels

HEIGHT, WIDTH = 160, 200


def drawn(rng, size=None, color=(200, 60, 40)):
    """An image of an ellipse among others of other colors on a mottled ground, and its mask."""
    ground = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 4)
    image = np.full((HEIGHT, WIDTH, 3), (120, 125, 110), np.float32) + 150 * ground[..., None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for other in ((60, 80, 170), (70, 150, 80)):
        cv2.ellipse(image, _place(rng), (int(rng.integers(8, 20)), 12), int(rng.integers(180)), 0, 360, other, -1)
    if size != 0:
        axes = (size, size) if size else (int(rng.integers(12, 26)), int(rng.integers(8, 16)))
        cv2.ellipse(mask, _place(rng), axes, int(rng.integers(180)), 0, 360, 1, -1)
        image[mask > 0] = color
    image += 3 * rng.standard_normal(image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), mask.astype(bool)


def _place(rng):
    return int(rng.integers(40, WIDTH - 40)), int(rng.integers(40, HEIGHT - 40))


@pytest.fixture(scope="module")
def segmenter():
    rng = np.random.default_rng(0)
    pairs = [drawn(rng, size) for size in (None, None, None, 4, 3, None)]
    return FewShotSegmenter(samples=300, size=WIDTH).fit(*zip(*pairs, strict=True))


@pytest.mark.slow
def test_finds_the_object_in_new_images(segmenter):
    rng = np.random.default_rng(1)
    for _ in range(4):
        segmenter.reset()
        image, mask = drawn(rng)
        found = segmenter.segment(image)
        assert (found & mask).sum() > 0.8 * (found | mask).sum()


@pytest.mark.slow
def test_finds_an_object_smaller_than_a_cell_of_superpixels(segmenter):
    rng = np.random.default_rng(2)
    for _ in range(3):
        segmenter.reset()
        image, mask = drawn(rng, 3)
        found = segmenter.segment(image)
        assert (found & mask).sum() > 0.5 * (found | mask).sum()


@pytest.mark.slow
def test_says_when_the_object_is_not_there(segmenter):
    segmenter.reset()
    assert not segmenter.segment(drawn(np.random.default_rng(3), 0)[0]).any()
    assert segmenter.score == 0.0


@pytest.mark.slow
def test_file_keeps_what_was_learned(segmenter, tmp_path):
    segmenter.save(tmp_path / "object.npz")
    again = FewShotSegmenter.load(tmp_path / "object.npz")
    image, _ = drawn(np.random.default_rng(4))
    segmenter.reset()
    np.testing.assert_array_equal(again.segment(image), segmenter.segment(image))


def shown_at(x, y, rng):
    """An image of the ellipse with its middle at (x, y), and its mask."""
    image, _ = drawn(rng, 0)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(mask, (x, y), (18, 11), 30, 0, 360, 1, -1)
    image[mask > 0] = (200, 60, 40)
    return image, mask.astype(bool)


@pytest.fixture
def tracker(segmenter, tmp_path, monkeypatch):
    """The segmenter with a window, and the sizes of the images that it has looked at."""
    segmenter.save(tmp_path / "object.npz")
    tracker = FewShotSegmenter.load(tmp_path / "object.npz")
    tracker.options = FewShotOptions(**(asdict(tracker.options) | {"window": 16}))
    sizes = []

    def look(image, image_area=None):
        sizes.append(image.shape[:2])
        return see(image, image_area)

    monkeypatch.setattr(module, "see", look)
    return tracker, sizes


def overlap(found, mask):
    return (found & mask).sum() / (found | mask).sum()


@pytest.mark.slow
def test_an_object_that_moves_little_is_looked_for_where_it_was(tracker):
    tracker, sizes = tracker
    rng = np.random.default_rng(6)
    for number in range(6):
        image, mask = shown_at(60 + 8 * number, 80, rng)
        assert overlap(tracker.segment(image), mask) > 0.8
    assert sizes[0] == (HEIGHT, WIDTH)
    assert len(sizes) == 6
    assert max(height * width for height, width in sizes[1:]) < 0.35 * HEIGHT * WIDTH


@pytest.mark.slow
def test_an_object_that_leaves_its_window_is_looked_for_everywhere(tracker):
    tracker, sizes = tracker
    rng = np.random.default_rng(7)
    for x, y in ((50, 50), (150, 110), (150 - 24, 110), (190, 150), (8, 8)):  # away, to the edge, into the corners
        image, mask = shown_at(x, y, rng)
        assert overlap(tracker.segment(image), mask) > 0.7
    assert sizes.count((HEIGHT, WIDTH)) >= 4
    assert not tracker.segment(drawn(rng, 0)[0]).any()
    assert tracker.score == 0.0


def test_a_window_stays_in_the_image_and_on_the_grid():
    for first, last, length in ((0, 3, 120), (100, 119, 120), (50, 60, 240), (0, 119, 60), (119, 119, 16)):
        taken = np.zeros(120, dtype=bool)
        taken[first : last + 1] = True
        window = module._grown(taken, length, 10)
        assert window.start % 8 == 0
        assert 0 <= window.start <= max(first * length // 120 - 10, 0)
        assert min((last + 1) * length // 120 + 9, length) <= window.stop <= length
        assert window.stop - window.start >= 16


def test_small_blob_is_a_superpixel_wherever_it_lies():
    for shift in range(8):  # over a cell of the grid of seeds
        image = np.full((96, 96, 3), 110, np.uint8)
        image[40 + shift : 45 + shift, 50:55] = (150, 60, 200)
        pixels = find_superpixels(pixel_channels(image), 8)
        inside = np.zeros((96, 96))
        inside[40 + shift : 45 + shift, 50:55] = 1
        assert (pixels.sums(inside)[:, 0] / pixels.area).max() > 0.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": 8}, "size is 8"),
        ({"min_score": 1.5}, "min_score is 1.5"),
        ({"seed": -1}, "seed is -1"),
        ({"window": -1}, "window is -1"),
    ],
)
def test_options_out_of_range(options, message):
    with pytest.raises(DenseVSError, match=message):
        FewShotSegmenter(**options)


def test_nothing_learned_and_nothing_to_learn():
    image, mask = drawn(np.random.default_rng(5))
    with pytest.raises(DenseVSError, match="has not learned"):
        FewShotSegmenter().segment(image)
    with pytest.raises(DenseVSError, match="expected both"):
        FewShotSegmenter().fit([image], [np.zeros_like(mask)])
    with pytest.raises(DenseVSError, match="1 images and 2 masks"):
        FewShotSegmenter().fit([image], [mask, mask])
