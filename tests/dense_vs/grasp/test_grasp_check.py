"""(23) and what is said where an area is missing."""

import pytest

from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspOutcome, check_grasp


@pytest.mark.parametrize(
    ("grasp", "raised", "opening", "outcome"),
    [
        (1000, 900, None, GraspOutcome.HELD),
        (1000, 400, None, GraspOutcome.MISSED),
        (1000, 400, 0.05, GraspOutcome.HELD),  # more than is left of an object left behind: the fingers are asked
        (1000, 400, 0.0, GraspOutcome.MISSED),
        (1000, 300, 0.05, GraspOutcome.MISSED),
        (1000, 900, 0.0, GraspOutcome.MISSED),  # closed fingers hold nothing
        (1000, 0, None, GraspOutcome.LOST),
        (1000, 0, 0.0, GraspOutcome.LOST),
        (1000, 0, 0.05, GraspOutcome.HELD),
        (0, 900, None, GraspOutcome.UNKNOWN),
        (0, 900, 0.0, GraspOutcome.MISSED),
        (0, 0, 0.05, GraspOutcome.HELD),
    ],
)
def test_outcome(grasp, raised, opening, outcome):
    assert check_grasp(grasp, raised, opening=opening, behind=0.28).outcome is outcome


@pytest.mark.parametrize(
    ("areas", "opening", "others", "outcome"),
    [
        ((1000, 900), 0.05, (899,), GraspOutcome.HELD),
        ((1000, 900), 0.05, (900,), GraspOutcome.HELD),
        ((1000, 900), 0.05, (20, 901), GraspOutcome.WRONG),
        ((1000, 900), None, (901,), GraspOutcome.WRONG),
        ((1000, 900), 0.0, (901,), GraspOutcome.MISSED),  # closed fingers hold nothing
        ((0, 0), 0.05, (15,), GraspOutcome.HELD),  # too little to be seen: the fingers decide
        ((0, 0), 0.05, (16,), GraspOutcome.WRONG),
        ((1000, 0), 0.0, (), GraspOutcome.MISSED),
        ((1000, 0), None, (), GraspOutcome.MISSED),
        ((1000, 400), 0.05, (), GraspOutcome.HELD),
    ],
)
def test_check_away_from_what_was_left_behind(areas, opening, others, outcome):
    assert check_grasp(*areas, opening=opening, behind=0.0, others=others).outcome is outcome


@pytest.mark.parametrize(("others", "outcome"), [((), GraspOutcome.LOST), ((0,), GraspOutcome.LOST),
                                                 ((1,), GraspOutcome.WRONG)])  # fmt: skip
def test_what_is_not_among_others_has_no_area(others, outcome):
    """Where a pixel counts as seen, one of another object is more than none of the object."""
    assert check_grasp(1000, 0, behind=0.28, min_area=0, others=others).outcome is outcome


def test_bad_input():
    for others in ((3, -1), 5, (float("nan"),), "ab", None):
        with pytest.raises(DenseVSError, match="others"):
            check_grasp(5, 5, others=others)
    with pytest.raises(DenseVSError, match="area_grasp"):
        check_grasp(-1, 5)
    with pytest.raises(DenseVSError, match="opening is nan"):
        check_grasp(5, 5, opening=float("nan"))
