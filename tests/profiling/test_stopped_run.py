"""A measurement that was stopped is gone on with where commit and arguments are the same."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from stopped_run import stopped_run


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"commit": "b"}, "has commit b; expected a"), ({"arguments": {"seeds": "1"}}, "has arguments {'seeds': '1'}")],
)
def test_a_run_of_another_commit_or_arguments_is_not_gone_on_with(tmp_path, changed, words):
    origin = {"commit": "a", "arguments": {"seeds": "2"}}
    file = tmp_path / "run.json"
    assert stopped_run(file, origin) == ([], {})
    begun = {"date": "before", "machine": {"cores": 2}}
    more = {"arguments": {"seeds": "2", "jobs": 8, "limit": 3.0, "resume": False}}
    file.write_text(json.dumps({**origin, **begun, **more, "rows": [{"arm": "planar"}]}))
    assert stopped_run(file, origin) == ([{"arm": "planar"}], begun)  # how many at a time is no matter
    file.write_text(json.dumps({**origin, **changed, "rows": []}))
    with pytest.raises(SystemExit, match=words):
        stopped_run(file, origin)
    with pytest.raises(SystemExit, match="expected both"):
        stopped_run(None, origin)
