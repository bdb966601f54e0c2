"""Calls that threads share out: each is made once, errors come back, and who helps may need help."""

import threading
import time

import pytest

from dense_vs.kernels.cpu_threads import share_out


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [0, 1, 2, 50])
def test_every_call_is_made_once_before_it_returns(threads, count):
    made = []
    for _ in range(20):
        made.clear()
        share_out([lambda k=k: made.append(k) for k in range(count)], threads)
        assert sorted(made) == list(range(count))


def test_other_threads_take_what_this_one_has_no_time_for():
    who, met = [], threading.Barrier(3, timeout=20)

    def call():
        met.wait()  # only three at once get past it
        who.append(threading.get_ident())

    share_out([call] * 3, 3)
    assert len(set(who)) == 3
    assert threading.get_ident() in who


@pytest.mark.parametrize("here", [True, False])
def test_an_error_in_any_thread_comes_back(here):
    mine, both = threading.get_ident(), threading.Barrier(2, timeout=20)

    def call():
        both.wait()
        if (threading.get_ident() == mine) == here:
            raise ValueError("a call that fails")

    with pytest.raises(ValueError, match="a call that fails"):
        share_out([call, call], 2)
    made = []
    share_out([lambda: made.append(1)] * 4, 2)
    assert len(made) == 4


def test_a_call_may_share_out_calls_of_its_own():
    made = []

    def outer():
        share_out([lambda: made.append(1)] * 5, 3)

    share_out([outer] * 6, 3)
    assert len(made) == 30


def test_what_was_begun_elsewhere_is_waited_for():
    done, both = [], threading.Barrier(2, timeout=20)
    mine = threading.get_ident()

    def call():
        both.wait()
        if threading.get_ident() != mine:
            time.sleep(0.05)
        done.append(threading.get_ident())

    share_out([call, call], 2)
    assert len(set(done)) == 2


def test_several_threads_may_share_out_at_once():
    made, errors = [[] for _ in range(4)], []

    def many(mine):
        try:
            for _ in range(50):
                share_out([lambda: mine.append(1)] * 6, 3)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=many, args=(one,)) for one in made]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=30)
    assert not errors
    assert [len(one) for one in made] == [300] * 4
