"""Reading ahead keeps order and errors, and its thread ends with the iteration."""

import threading

import pytest

from dense_vs.recording.prefetch import prefetch


def readers():
    return [thread for thread in threading.enumerate() if thread.name == "prefetch"]


def test_order_and_end():
    assert list(prefetch(range(100), depth=3)) == list(range(100))
    assert not readers()


def test_an_error_comes_after_what_was_read():
    def items():
        yield 1
        yield 2
        raise ValueError("damaged")

    ahead = prefetch(items())
    assert [next(ahead), next(ahead)] == [1, 2]
    with pytest.raises(ValueError, match="damaged"):
        next(ahead)
    assert not readers()


def test_no_more_than_the_depth_is_read_ahead():
    read = []

    def items():
        for k in range(1000):
            read.append(k)
            yield k

    ahead = prefetch(items(), depth=4)
    assert next(ahead) == 0
    ahead.close()  # left early
    assert len(read) <= 8
    assert not readers()
