"""The segmenter that reads ids: their pixels, and errors for ids that do not fit the image."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import Segmenter
from dense_vs.sims import IdSegmenter

IMAGE = np.zeros((16, 20, 3), np.uint8)
IDS = np.random.default_rng(0).integers(-1, 10, (16, 20)).astype(np.int32)


def test_pixels_of_the_wanted_ids():
    segmenter = IdSegmenter(lambda: IDS, [4, 9])
    assert isinstance(segmenter, Segmenter)
    np.testing.assert_array_equal(segmenter.segment(IMAGE), (IDS == 4) | (IDS == 9))


@pytest.mark.parametrize("ids", [IDS[:, :2], IDS.astype(float)])
def test_ids_that_do_not_fit_the_image(ids):
    with pytest.raises(DenseVSError, match=r"ids have shape .*expected integers of shape \(16, 20\)"):
        IdSegmenter(lambda: ids, [4]).segment(IMAGE)


def test_no_id():
    with pytest.raises(DenseVSError, match="wanted is empty"):
        IdSegmenter(lambda: IDS, [])
