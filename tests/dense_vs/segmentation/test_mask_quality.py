"""Verdicts on masks whose faults are known."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import MaskVerdict, assess_mask


def square(*sides):
    mask = np.zeros((60, 80), bool)
    for top, left, size in sides:
        mask[top : top + size, left : left + size] = True
    return mask


@pytest.mark.parametrize(
    ("mask", "verdict"),
    [
        (square((20, 30, 10)), MaskVerdict.GOOD),
        (square((0, 30, 10)), MaskVerdict.CUT),
        (square((10, 10, 10), (40, 50, 9)), MaskVerdict.SPLIT),
        (square((10, 10, 3)), MaskVerdict.EMPTY),
        (np.ones((60, 80), bool), MaskVerdict.FLOODED),
    ],
)
def test_verdicts(mask, verdict):
    assert assess_mask(mask).verdict is verdict


def test_jump_from_the_mask_before():
    assert assess_mask(square((5, 5, 5)), square((30, 40, 20))).verdict is MaskVerdict.JUMPED


@pytest.mark.parametrize(("gap", "verdict"), [(2, MaskVerdict.CUT), (6, MaskVerdict.GOOD)])
def test_mask_beside_what_hides_the_scene_is_cut(gap, verdict):
    hidden = np.zeros((60, 80), bool)
    hidden[:, 40 + gap :] = True
    quality = assess_mask(square((20, 30, 10)), hidden=hidden)
    assert quality.verdict is verdict
    assert quality.servoable


def test_shapes_that_differ():
    with pytest.raises(DenseVSError, match="hidden has shape"):
        assess_mask(square((20, 30, 10)), hidden=np.zeros((5, 5), bool))
