"""Checked single values: what passes comes back converted, what does not is named with what was expected."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.checks import (
    check_choice,
    check_flag,
    check_flags,
    check_function,
    check_kind,
    check_methods,
    check_names,
    check_number,
    check_options,
    check_pair,
    check_whole,
)


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


def test_arrays_without_a_dimension_are_no_sequences():
    assert check_pair("size", np.array([3, 4]), least=1, most=9) == (3, 4)
    assert check_names("names", np.array(["a", "b"])) == ("a", "b")
    with pytest.raises(DenseVSError, match=r"^size is array\(3\); expected two whole numbers"):
        check_pair("size", np.array(3), least=1, most=9)
    with pytest.raises(DenseVSError, match=r"^names is array\(3\); expected a sequence of names"):
        check_names("names", np.array(3))


@pytest.mark.parametrize(
    "value", ["no", True, [True], [True, False, 1], [1, 0, 1], [[True] * 3], [[True], [True, False]], None]
)
def test_several_flags(value):
    np.testing.assert_array_equal(check_flags("held", (True, False, np.True_), 3), [True, False, True])
    with pytest.raises(DenseVSError, match=r"^held is .*; expected True or False for each of 3$"):
        check_flags("held", value, 3)


def test_hidden_flags_are_none():
    with pytest.raises(DenseVSError, match="held is"):
        check_flags("held", np.ma.masked_array([True, False], mask=[False, True]), 2)


def test_kinds_methods_and_functions():
    assert check_kind("count", 3, int) == 3
    assert check_options("count", None, int) == 0
    check_methods("log", [], "append", "pop")
    check_function("on_look", None)
    check_function("on_look", len)
    with pytest.raises(DenseVSError, match=r"^count is '3'; expected a int$"):
        check_options("count", "3", int)
    with pytest.raises(DenseVSError, match=r"^log is a tuple without append, pop; expected methods append, index, pop"):
        check_methods("log", (), "append", "index", "pop")
    rude = type("Rude", (), {"read": property(lambda self: 1 // 0)})()
    with pytest.raises(DenseVSError, match=r"^camera is a Rude without read; expected methods read$"):
        check_methods("camera", rude, "read")
    with pytest.raises(DenseVSError, match=r"^on_look is 3; expected a function, or None$"):
        check_function("on_look", 3)
