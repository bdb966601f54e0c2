"""Which object is in the hand where several segmenters take the same thing for theirs."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.grasp.hand_claims import HandClaim, settle_claims


def square(left, size, score=float("nan")):
    mask = np.zeros((40, 80), bool)
    mask[10 : 10 + size, left : left + size] = True
    return HandClaim(mask, score)


def test_the_surer_one_is_believed():
    assert settle_claims([square(10, 20, 0.8), square(11, 20, 0.7)]) == [400.0, 0.0]
    assert settle_claims([square(10, 20, 0.6), square(11, 20, 0.7)]) == [0.0, 400.0]
    assert settle_claims([square(10, 20, 0.7), square(11, 20, 0.7)]) == [400.0, 0.0]  # what was asked for


def test_claims_of_different_things_stand():
    assert settle_claims([square(10, 20, 0.6), square(40, 10, 0.9), square(52, 10, 0.1)]) == [400.0, 100.0, 100.0]


@pytest.mark.parametrize(("shift", "areas"), [(9, [400.0, 0.0]), (10, [400.0, 400.0]), (11, [400.0, 400.0])])
def test_overlap_from_which_on_two_masks_are_of_one_thing(shift, areas):
    assert settle_claims([square(10, 20, 0.9), square(10 + shift, 20, 0.5)]) == areas


def test_a_part_of_what_is_believed_is_no_thing_of_its_own():
    assert settle_claims([square(10, 6, 0.5), square(8, 20, 0.9)]) == [0.0, 400.0]


def test_without_scores_the_first_wins():
    assert settle_claims([square(10, 20), square(11, 20), square(10, 20)]) == [400.0, 0.0, 0.0]
    assert settle_claims([square(10, 20), square(11, 20, 0.9)]) == [400.0, 0.0]
    assert settle_claims([square(10, 20, 0.1), square(11, 20)]) == [400.0, 0.0]


def test_an_empty_claim_stands_in_nobody_s_way():
    assert settle_claims([square(0, 0, 0.9), square(11, 20, 0.2)]) == [0.0, 400.0]
    assert settle_claims([square(0, 0)]) == [0.0]


def test_bad_input():
    with pytest.raises(DenseVSError, match="at least one mask"):
        settle_claims([])
    with pytest.raises(DenseVSError, match="all of one shape"):
        settle_claims([square(0, 3), HandClaim(np.zeros((3, 3), bool))])
