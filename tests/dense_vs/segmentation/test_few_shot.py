"""The few-shot segmenter on drawn images whose masks are exact, and what superpixels make of small objects."""

import numpy as np
import pytest
from drawn_objects import WIDTH, drawn

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import FewShotOptions, FewShotSegmenter
from dense_vs.segmentation.few_shot.pixel_channels import _texture, pixel_channels
from dense_vs.segmentation.few_shot.superpixels import find_superpixels


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


@pytest.mark.parametrize(
    "header", ["[" * 100_000, "9" * 5000, "[]", '{"format": "' + "x" * 100_000 + '", "version": 1}']
)
def test_a_header_that_is_none_is_refused(segmenter, tmp_path, header):
    segmenter.save(tmp_path / "object.npz")
    with np.load(tmp_path / "object.npz") as stored:
        arrays = dict(stored)
    np.savez(tmp_path / "object.npz", **{**arrays, "header": np.array(header)})
    with pytest.raises(DenseVSError, match="cannot read") as said:
        FewShotSegmenter.load(tmp_path / "object.npz")
    assert len(str(said.value)) < 1000


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
        ({"seed": 2**32}, "seed is 4294967296; expected a whole number"),
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


@pytest.mark.parametrize("wrong", [np.array(3), np.array(None), 3, None, "x"])
def test_examples_are_lists(wrong):
    image, mask = drawn(np.random.default_rng(4))
    for images, masks in ((wrong, [mask]), ([image], wrong)):
        with pytest.raises(DenseVSError, match=r"^images are a .* and masks a .*; expected lists$"):
            FewShotSegmenter().fit(images, masks)


@pytest.mark.parametrize("sigma", [0.8, 1.6])
def test_gradients_are_as_long_at_both_scales_where_an_edge_is_as_wide(sigma):
    """A ramp has the gradient of its slope, a parabola the Laplacian of its bend, by how wide the scale is."""
    x = np.arange(64, dtype=np.float32)
    ramp, bend = (np.tile(line.astype(np.float32), (48, 1)) for line in (0.3 * x, 0.02 * (x - 32) ** 2))
    which = {0.8: 0, 1.6: 2}[sigma]
    np.testing.assert_allclose(_texture(ramp)[which][10:-10, 12:-12], 0.3 * sigma, rtol=1e-4)
    np.testing.assert_allclose(_texture(bend)[which + 1][10:-10, 12:-12], 0.04 * sigma**2 / 4, rtol=1e-3)


def test_options_that_are_not_given_are_the_documented_ones_both_ways():
    found = FewShotOptions()
    assert found == FewShotSegmenter().options
    assert (found.size, found.samples, found.min_area, found.window) == (320, 1500, 12, 16)
    assert (found.min_score, found.memory, found.seed) == (0.5, 0.3, 0)
