"""The judge of the fuzzed cases: an unknown keyword is the caller's, or a fault of the product's own line."""

import importlib.util

from outcome import Tally, run_case


def of_product(tmp_path, text):
    """A function of a module that lies in one of the product's folders."""
    path = tmp_path / "dense_vs" / "made.py"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("made", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.called


def test_an_unknown_keyword_may_be_a_type_error(tmp_path):
    tally = Tally()
    plain = of_product(tmp_path, "def called(number=1):\n    return number\n")
    passed_on = of_product(tmp_path, "def called(**options):\n    return dict(a=1) and sorted([2, 1], **options)\n")
    run_case(tally, "plain", lambda: plain(numbr=2))
    run_case(tally, "passed on", lambda: passed_on(numbr=2))
    assert tally.counts == {"unknown keyword": 2}


def test_a_keyword_that_the_product_gives_and_another_does_not_take_is_a_fault(tmp_path):
    tally = Tally()
    called = of_product(tmp_path, "def called(value):\n    return sorted(value, initial=0)\n")
    run_case(tally, "sorted", lambda: called([2, 1]))
    run_case(tally, "two", lambda: called(1, 2))  # arguments, but no keyword
    assert [fault.split(":")[:2] for fault in tally.faults] == [["exception", " sorted"], ["exception", " two"]]
