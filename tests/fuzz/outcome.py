"""What came of a case: a typed error or a right result, else a fault with a name."""

import dataclasses
import enum
import re
import signal
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError

SECONDS = 20  # of a case, then it hangs
ROOMS = ("dense_vs", "sims", "kernels")  # the product's


class Hang(BaseException):
    """A case did not end; no handler of exceptions takes it for its own."""


@dataclass
class Tally:
    """Counts of what came of all cases, and the faults."""

    counts: Counter = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def fault(self, kind: str, words: str) -> None:
        """Note a fault."""
        self.counts[kind] += 1
        self.faults.append(f"{kind}: {words}")


def run_case(
    tally: Tally,
    name: str,
    call: Callable[[], Any],
    *,
    nonsense: bool = False,
    may_be_nan: bool = False,
    state: Callable[[], Any] | None = None,
) -> None:
    """Run a call and judge it.

    Args:
        tally: takes the outcome.
        name: what it is, for the report.
        call: the case.
        nonsense: whether one of its arguments is no number where one is expected.
        may_be_nan: whether the result may hold values that are not finite.
        state: of the object; unchanged after a typed error.
    """
    before = None if state is None else state()
    signal.signal(signal.SIGALRM, _hang)
    signal.alarm(SECONDS)
    try:
        result = call()
    except DenseVSError as error:
        signal.alarm(0)
        tally.counts["typed error"] += 1
        if not str(error):
            tally.fault("no message", name)
        if before is not None and state is not None and not _same(before, state()):
            tally.fault("state changed", f"{name}: {_line(error)}")
        return
    except Hang:
        tally.fault("hang", name)
        return
    except Exception as error:
        signal.alarm(0)
        if _unknown_keyword(error):
            tally.counts["unknown keyword"] += 1
            return
        tally.fault("exception", f"{name}: {_line(error)}")
        return
    finally:
        signal.alarm(0)
    if nonsense:
        tally.fault("accepted nonsense", name)
    elif not may_be_nan and not finite(result):
        tally.fault("not finite", name)
    else:
        tally.counts["result"] += 1


def finite(value: Any, depth: int = 3) -> bool:
    """Whether all numbers in a result are finite."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return bool(np.isfinite(value).all())
    if isinstance(value, (float, np.floating)):
        return bool(np.isfinite(value))
    if depth and isinstance(value, (list, tuple)):
        return all(finite(one, depth - 1) for one in value)
    if depth and dataclasses.is_dataclass(value) and not isinstance(value, (type, enum.Enum)):
        return all(finite(getattr(value, one.name, None), depth - 1) for one in dataclasses.fields(value))
    return True


def _same(before: Any, after: Any) -> bool:
    if isinstance(before, dict):
        return before.keys() == after.keys() and all(_same(before[key], after[key]) for key in before)
    if isinstance(before, (list, tuple)):
        return len(before) == len(after) and all(_same(a, b) for a, b in zip(before, after, strict=True))
    if isinstance(before, np.ndarray):
        return np.array_equal(before, after, equal_nan=before.dtype.kind == "f")
    return bool(before == after)


def _unknown_keyword(error: Exception) -> bool:
    """Whether the caller gave a keyword that there is none of, not a line of the product that called another."""
    keyword = re.search(r"'(\w+)'", str(error))
    if not isinstance(error, TypeError) or keyword is None or "keyword argument" not in str(error):
        return False
    last = traceback.extract_tb(error.__traceback__)[-1]
    return not any(f"/{room}/" in last.filename for room in ROOMS) or f"{keyword[1]}=" not in (last.line or "")


def _hang(*_: Any) -> None:
    raise Hang


def _line(error: BaseException) -> str:
    """The error and the product's line that it came from."""
    places = traceback.extract_tb(error.__traceback__)
    own = [one for one in places if any(f"/{room}/" in one.filename for room in ROOMS)]
    last = own[-1] if own else places[-1]
    where = "/".join(last.filename.split("/")[-3:])
    return f"{type(error).__name__}: {str(error)[:150]} at {where}:{last.lineno}"
