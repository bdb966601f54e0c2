"""Checked single values: what passes comes back converted, what does not is named with what was expected."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.checks import check_choice, check_flag, check_number, check_whole


@pytest.mark.parametrize("value", [1, 1.0, np.float32(1), np.int64(1), np.uint8(1)])
def test_numbers_come_back_as_floats(value):
    got = check_number("gain", value, above=0, most=1)
    assert type(got) is float
    assert got == 1.0


@pytest.mark.parametrize(
    "value", [True, np.True_, "1", None, [1.0], np.array([1.0]), 1j, np.nan, np.inf, -np.inf, 10**400, b"1"]
)
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(DenseVSError, match=r"^gain is .*; expected a finite number$"):
        check_number("gain", value)


@pytest.mark.parametrize(
    ("value", "bounds", "expected"),
    [
        (0, {"above": 0}, "a finite number above 0$"),
        (-1e-9, {"least": 0}, "a finite number of at least 0$"),
        (1, {"above": 0, "below": 1}, "a finite number above 0 and below 1$"),
        (1.5, {"least": 0.5, "most": 1}, "a finite number of at least 0.5 and at most 1$"),
        (2, {"most": 1}, "a finite number at most 1$"),
    ],
)
def test_bounds_are_kept_and_said(value, bounds, expected):
    with pytest.raises(DenseVSError, match=expected):
        check_number("gain", value, **bounds)


def test_closed_bounds_are_within():
    assert check_number("gain", 0.0, least=0) == 0
    assert check_number("gain", 1, most=1) == 1
    assert check_whole("count", 3, least=3, most=3) == 3


@pytest.mark.parametrize("value", [True, 1.0, "1", None, np.float64(1), 0, 8, np.array(2)])
def test_whole_numbers(value):
    assert type(check_whole("count", np.int32(7), least=1, most=7)) is int
    with pytest.raises(DenseVSError, match=r"^count is .*; expected a whole number of at least 1 and at most 7$"):
        check_whole("count", value, least=1, most=7)


def test_choices_and_flags():
    assert check_choice("form", "full", ("full", "shared")) == "full"
    for wrong in ("none", None, 1):
        with pytest.raises(DenseVSError, match="expected one of full, shared"):
            check_choice("form", wrong, ("full", "shared"))
    assert check_flag("warm", np.True_) is True
    for wrong in (1, 0, "no", None):
        with pytest.raises(DenseVSError, match="expected True or False"):
            check_flag("warm", wrong)
