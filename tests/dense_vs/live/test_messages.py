"""What a page may send: numbers that no float holds, and what is no message."""

import pytest

from dense_vs import DenseVSError
from dense_vs.live.actions import number, pair, parse, whole


@pytest.mark.parametrize("digits", ["1" + "0" * 400, "-1" + "0" * 400, "1e999", "NaN"])
def test_numbers_that_no_float_holds(digits):
    message = parse(f'{{"at": [{digits}, 1], "speed": {digits}, "point": {digits}}}')
    for read, name in ((pair, "at"), (number, "speed"), (whole, "point")):
        with pytest.raises(DenseVSError, match=f"{name} is .*; expected"):
            read(message, name)


def test_good_numbers():
    message = parse('{"at": [1, 2.5], "speed": 2, "point": -4503599627370496}')
    assert pair(message, "at") == (1.0, 2.5)
    assert number(message, "speed") == 2.0
    assert whole(message, "point") == -(1 << 52)


@pytest.mark.parametrize("text", [b'{"do": "stop"}', None, 3, "[]", "{", "x" * 5000])
def test_no_messages(text):
    with pytest.raises(DenseVSError, match=r"a message (is|has)"):
        parse(text)
