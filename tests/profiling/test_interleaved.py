"""Timing in turns, on a clock that only the alternatives move."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from profiling import interleaved as module
from profiling.interleaved import interleaved, median_ratio


@pytest.fixture
def clock(monkeypatch):
    """The time, in a list of one."""
    now = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_a_round_runs_each_once_and_nobody_has_a_place_or_one_before_it_for_good(clock):
    ran = []
    alternatives = {name: lambda _, name=name: ran.append(name) for name in "abcd"}
    interleaved(alternatives, 200, warmup=0)
    rounds = [ran[k : k + 4] for k in range(0, len(ran), 4)]
    assert all(sorted(one) == [*"abcd"] for one in rounds)
    places = Counter((name, place) for one in rounds for place, name in enumerate(one))
    before = Counter(pairwise(ran))
    assert min(places[name, place] for name in "abcd" for place in range(4)) > 30
    assert min(before[one, other] for one in "abcd" for other in "abcd" if one != other) > 30


def test_the_time_of_each_is_kept_by_its_round_and_warmup_is_not(clock):
    numbers = []

    def grows(number):
        numbers.append(number)
        clock[0] += number

    def steady(_):
        clock[0] += 0.5

    seconds = interleaved({"grows": grows, "steady": steady}, 3, warmup=2)
    assert numbers == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(seconds["grows"], [2, 3, 4])
    np.testing.assert_allclose(seconds["steady"], 0.5)
    assert median_ratio(seconds["grows"], seconds["steady"]) == 6.0


def test_of_several_calls_the_first_does_not_count(clock):
    taken = iter([9.0, 1.0, 2.0, 6.0] * 3)
    numbers = []

    def one(number):
        numbers.append(number)
        clock[0] += next(taken)

    seconds = interleaved({"one": one}, 2, warmup=1, calls=4)
    assert numbers == [*range(12)]
    np.testing.assert_allclose(seconds["one"], 2.0)
