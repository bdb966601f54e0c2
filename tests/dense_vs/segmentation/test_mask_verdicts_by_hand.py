"""Masks on either side of every limit of a verdict, and all their figures counted pixel by pixel."""

import numpy as np
import pytest
from scipy.ndimage import label

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import MaskVerdict, assess_mask


def boxes(*sides, shape=(20, 30)):
    mask = np.zeros(shape, bool)
    for top, left, height, width in sides:
        mask[top : top + height, left : left + width] = True
    return mask


def counted(mask, previous=None):
    """Figures of a mask, each by its definition."""
    ys, xs = np.nonzero(mask)
    height, width = mask.shape
    edge = np.ones(mask.shape, bool)
    edge[1:-1, 1:-1] = False
    parts = np.bincount(label(mask, np.ones((3, 3)))[0][mask])[1:]
    sides = (xs.min() == 0) + 2 * (xs.max() == width - 1) + 4 * (ys.min() == 0) + 8 * (ys.max() == height - 1)
    overlap = np.nan if previous is None else (mask & previous).sum() / (mask | previous).sum()
    return {
        "area": mask.sum(), "centroid": (xs.mean(), ys.mean()), "fraction": mask.mean(), "parts": len(parts),
        "largest_share": parts.max() / mask.sum(), "border_share": mask[edge].sum() / edge.sum(), "overlap": overlap,
        "box": (xs.min(), ys.min(), np.ptp(xs) + 1, np.ptp(ys) + 1), "border": sides,
    }  # fmt: skip


@pytest.mark.parametrize(
    "mask",
    [
        boxes((3, 4, 5, 6)),
        boxes((0, 4, 5, 6)),
        boxes((15, 4, 5, 6)),
        boxes((3, 0, 5, 6)),
        boxes((3, 24, 5, 6), (10, 3, 2, 2), (12, 5, 2, 2)),
        boxes((0, 0, 20, 30)),
        boxes((0, 0, 20, 3), (0, 5, 1, 25)),
    ],
)
@pytest.mark.parametrize("previous", [None, boxes((2, 3, 8, 8)), boxes((17, 13, 3, 3))])
def test_figures_are_counted(mask, previous):
    found = assess_mask(mask, previous)
    for name, value in counted(mask, previous).items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-12, err_msg=name)


def test_a_mask_of_nothing():
    nothing = assess_mask(boxes(), boxes((3, 4, 5, 6)))
    assert nothing.verdict is MaskVerdict.EMPTY
    assert (nothing.area, nothing.fraction, nothing.parts, nothing.largest_share) == (0, 0.0, 0, 0.0)
    assert (nothing.border_share, nothing.overlap, nothing.box, nothing.border) == (0.0, 0.0, (0, 0, 0, 0), 0)
    assert np.isnan(nothing.centroid).all()
    assert not nothing.servoable
    assert not nothing.measurable
    assert np.isnan(assess_mask(boxes(), boxes()).overlap)
    assert assess_mask(boxes(), min_area=0).verdict is MaskVerdict.EMPTY  # of no pixel there is no place
    small = assess_mask(boxes((0, 4, 3, 5)))
    assert (small.area, small.largest_share, small.border_share, small.border) == (15, 0.0, 0.0, 4)


BEFORE = boxes((0, 0, 4, 4))


@pytest.mark.parametrize(
    ("mask", "changes", "verdict"),
    [
        (boxes((3, 4, 3, 5)), {}, MaskVerdict.EMPTY),  # 15 pixels
        (boxes((3, 4, 4, 4)), {}, MaskVerdict.GOOD),  # 16
        (boxes((3, 4, 1, 1)), {"min_area": 1}, MaskVerdict.GOOD),
        (boxes((3, 4, 1, 1)), {"min_area": 0}, MaskVerdict.GOOD),
        (boxes((0, 0, 18, 30)), {}, MaskVerdict.CUT),  # 0.9 of the image
        (boxes((0, 0, 18, 30), (18, 0, 1, 1)), {}, MaskVerdict.FLOODED),
        (boxes((5, 5, 8, 8)), {"max_fraction": 0.1}, MaskVerdict.FLOODED),
        (boxes((1, 1, 6, 5), (10, 10, 2, 5)), {}, MaskVerdict.GOOD),  # 30 of 40 pixels in the largest part
        (boxes((1, 1, 6, 5), (10, 10, 1, 11)), {}, MaskVerdict.SPLIT),
        (boxes((1, 1, 6, 5), (10, 10, 1, 11)), {"min_largest_share": 0.7}, MaskVerdict.GOOD),
        (boxes((6, 6, 8, 8)), {"previous": BEFORE}, MaskVerdict.GOOD),  # four times as large
        (boxes((6, 6, 8, 8), (14, 6, 1, 1)), {"previous": BEFORE}, MaskVerdict.JUMPED),
        (boxes((6, 6, 8, 8), (14, 6, 1, 1)), {"previous": BEFORE, "max_area_ratio": 4.1}, MaskVerdict.GOOD),
        (boxes((3, 3, 8, 9)), {"previous": BEFORE}, MaskVerdict.GOOD),  # they overlap
        (boxes((6, 6, 8, 8), (14, 6, 1, 1)), {"previous": boxes((0, 0, 3, 5))}, MaskVerdict.GOOD),  # nothing was there
        (boxes((6, 6, 4, 4)), {"previous": boxes((11, 0, 8, 9))}, MaskVerdict.JUMPED),
        (boxes((3, 4, 4, 4)), {"hidden": boxes((3, 10, 4, 4))}, MaskVerdict.CUT),  # three pixels away
        (boxes((3, 4, 4, 4)), {"hidden": boxes((3, 11, 4, 4))}, MaskVerdict.GOOD),
        (boxes((3, 4, 4, 4)), {"hidden": boxes()}, MaskVerdict.GOOD),
    ],
)
def test_either_side_of_a_limit(mask, changes, verdict):
    found = assess_mask(mask, **changes)
    assert found.verdict is verdict
    assert found.servoable == (verdict in (MaskVerdict.GOOD, MaskVerdict.CUT, MaskVerdict.SPLIT))
    assert found.measurable == (verdict is MaskVerdict.GOOD)


@pytest.mark.parametrize("name", ["min_area", "max_fraction", "min_largest_share", "max_area_ratio"])
def test_limits_below_nothing(name):
    assess_mask(boxes((3, 4, 4, 4)), **{name: 0})
    with pytest.raises(DenseVSError, match=name):
        assess_mask(boxes((3, 4, 4, 4)), **{name: -0.1})
