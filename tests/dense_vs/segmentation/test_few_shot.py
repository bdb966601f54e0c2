"""The few-shot segmenter on drawn images whose masks are exact, and what superpixels make of small objects."""

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import FewShotSegmenter
from dense_vs.segmentation.few_shot.pixel_channels import pixel_channels
from dense_vs.segmentation.few_shot.superpixels import find_superpixels

HEIGHT, WIDTH = 160, 200


def drawn(rng, size=None, colour=(200, 60, 40)):
    """An image of an ellipse among others of other colours on a mottled ground, and its mask."""
    ground = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 4)
    image = np.full((HEIGHT, WIDTH, 3), (120, 125, 110), np.float32) + 150 * ground[..., None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for other in ((60, 80, 170), (70, 150, 80)):
        cv2.ellipse(image, _place(rng), (int(rng.integers(8, 20)), 12), int(rng.integers(180)), 0, 360, other, -1)
    if size != 0:
        axes = (size, size) if size else (int(rng.integers(12, 26)), int(rng.integers(8, 16)))
        cv2.ellipse(mask, _place(rng), axes, int(rng.integers(180)), 0, 360, 1, -1)
        image[mask > 0] = colour
    image += 3 * rng.standard_normal(image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), mask.astype(bool)


def _place(rng):
    return int(rng.integers(40, WIDTH - 40)), int(rng.integers(40, HEIGHT - 40))


@pytest.fixture(scope="module")
def segmenter():
    rng = np.random.default_rng(0)
    pairs = [drawn(rng, size) for size in (None, None, None, 4, 3, None)]
    return FewShotSegmenter(samples=300, size=WIDTH).fit(*zip(*pairs, strict=True))


def test_finds_the_object_in_new_images(segmenter):
    rng = np.random.default_rng(1)
    for _ in range(4):
        segmenter.reset()
        image, mask = drawn(rng)
        found = segmenter.segment(image)
        assert (found & mask).sum() > 0.8 * (found | mask).sum()


def test_finds_an_object_smaller_than_a_cell_of_superpixels(segmenter):
    rng = np.random.default_rng(2)
    for _ in range(3):
        segmenter.reset()
        image, mask = drawn(rng, 3)
        found = segmenter.segment(image)
        assert (found & mask).sum() > 0.5 * (found | mask).sum()


def test_says_when_the_object_is_not_there(segmenter):
    segmenter.reset()
    assert not segmenter.segment(drawn(np.random.default_rng(3), 0)[0]).any()
    assert segmenter.score == 0.0


def test_file_keeps_what_was_learnt(segmenter, tmp_path):
    segmenter.save(tmp_path / "object.npz")
    again = FewShotSegmenter.load(tmp_path / "object.npz")
    image, _ = drawn(np.random.default_rng(4))
    segmenter.reset()
    np.testing.assert_array_equal(again.segment(image), segmenter.segment(image))


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
    [({"size": 8}, "size is 8"), ({"min_score": 1.5}, "min_score is 1.5"), ({"zoom": 2}, "unknown option 'zoom'")],
)
def test_options_out_of_range(options, message):
    with pytest.raises(DenseVSError, match=message):
        FewShotSegmenter(**options)


def test_nothing_learnt_and_nothing_to_learn():
    image, mask = drawn(np.random.default_rng(5))
    with pytest.raises(DenseVSError, match="has not learnt"):
        FewShotSegmenter().segment(image)
    with pytest.raises(DenseVSError, match="expected both"):
        FewShotSegmenter().fit([image], [np.zeros_like(mask)])
    with pytest.raises(DenseVSError, match="1 images and 2 masks"):
        FewShotSegmenter().fit([image], [mask, mask])
