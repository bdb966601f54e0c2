"""The mutation run on a project of one module: what tests tell apart is killed, the rest survives."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pytest_cov")
pytest.importorskip("xdist")

sys.path.append(str(Path(__file__).parents[2] / "tools"))

from mutation import sample
from mutation.operators import mutants
from mutation.result import at_continuous_border, interval
from mutation.sample import MODULES, draw, groups_of

TOOLS = Path(__file__).parents[2] / "tools"
PROGRAM = TOOLS / "mutation" / "run.py"
SCORE = """
LIMIT = 2.0


def share(errors):
    return sum(one < LIMIT for one in errors) / len(errors)


def slow_share(errors):
    return sum(one < 3.0 for one in errors) / len(errors)


def unseen(errors):
    return max(errors) + 1
"""
TESTS = """
import pytest

from tiny.score import share, slow_share


def test_share():
    assert share([1.0, 3.0, 1.0, 1.0, 5.0]) == 0.6


@pytest.mark.slow
def test_slow_share():
    assert slow_share([1.0, 3.0, 2.0, 2.0, 30.0]) == 0.6


def test_that_fails_of_itself():
    assert share([]) == 0
"""
SETTINGS = """
[tool.pytest.ini_options]
pythonpath = ["."]
markers = ["slow: takes long"]
[tool.coverage.run]
branch = true
source = ["tiny"]
"""


@pytest.fixture
def project(tmp_path):
    for folder in ("tiny", "tests"):
        (tmp_path / folder).mkdir()
    (tmp_path / "tiny" / "__init__.py").touch()
    (tmp_path / "tiny" / "score.py").write_text(SCORE)
    (tmp_path / "tests" / "test_score.py").write_text(TESTS)
    (tmp_path / "pyproject.toml").write_text(SETTINGS)
    return tmp_path


def command(project, *options):
    return [
        *(sys.executable, PROGRAM, "--root", project, "--modules", "tiny/*.py"),
        *("--minutes", "2", "--sample", "50", "--json", project / "result.json", *options),
    ]


def test_what_tests_tell_apart_is_killed(project):
    done = subprocess.run(command(project, "--jobs", "2"), check=False, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((project / "result.json").read_text())
    survivors = {(one["function"], one["before"], one["after"]): one for one in result["survivors"]}
    # No error of test_share is 2, so the border may belong to either side; 3 is the border of the slow test.
    assert set(survivors) == {
        ("share", "one < LIMIT", "one <= LIMIT"),
        ("unseen", "max(errors)", "min(errors)"),
        ("unseen", "max(errors) + 1", "max(errors) - 1"),
    }
    assert survivors["share", "one < LIMIT", "one <= LIMIT"]["reason"].startswith("the border of a continuous value")
    assert survivors["unseen", "max(errors)", "min(errors)"]["reason"] == "no test reaches this line"
    # A constant, two comparisons, a quotient; the same of the slow function; two that nothing reaches.
    assert result["shares"]["all"] == {
        "of": 10, "mutations": 10, "killed": 7, "timeouts": 0, "share_killed": 0.7, "between": [0.3968, 0.8922],
        "survived_but_the_same": 1, "share_killed_of_others": 0.7778,
    }  # fmt: skip
    assert result["shares"]["chosen"] == result["shares"]["all"]
    assert result["controls"] == {"run": 1, "failed": []}
    assert result["tests_failed_without_mutation"] == ["tests/test_score.py::test_that_fails_of_itself"]
    assert result["errors"] == []
    assert not list((project / "out" / "mutation").glob("trial-*"))
    # Going on finds everything done; with a new test, what has survived is tried once more.
    again = subprocess.run(
        command(project, "--jobs", "2", "--resume"), check=True, capture_output=True, text=True, timeout=300
    )
    assert "passed" not in again.stdout  # neither the tests nor a mutation ran
    resumed = json.loads((project / "result.json").read_text())
    for name in ("shares", "survivors", "controls"):
        assert resumed[name] == result[name]
    more = TESTS.replace("share, slow_share", "share, slow_share, unseen")
    (project / "tests" / "test_score.py").write_text(more + "\n\ndef test_unseen():\n    assert unseen([1, 2]) == 3\n")
    subprocess.run(command(project, "--jobs", "2", "--again"), check=True, capture_output=True, timeout=300)
    (left,) = json.loads((project / "result.json").read_text())["survivors"]
    assert left["after"] == "one <= LIMIT"
    other = subprocess.run(
        command(project, "--seed", "1", "--resume"), check=False, capture_output=True, text=True, timeout=300
    )
    assert other.returncode != 0
    assert "the run to go on with differs" in other.stderr


@pytest.mark.slow
def test_without_slow_tests_their_lines_are_reached_by_none(project):
    subprocess.run(command(project, "--quick"), check=True, capture_output=True, timeout=300)
    result = json.loads((project / "result.json").read_text())
    reasons = {one["reason"] for one in result["survivors"] if one["function"] == "slow_share"}
    assert reasons == {"no test reaches this line"}
    assert result["shares"]["all"]["killed"] == 3


@pytest.mark.slow
def test_a_run_that_is_stopped_leaves_what_it_has(project):
    (project / "tiny" / "hanging.py").write_text("def once(value):\n    return value + 1\n")
    (project / "tests" / "test_hanging.py").write_text(
        "import time\n\nfrom tiny.hanging import once\n\n\n"
        "def test_once():\n    if once(1) != 2:\n        time.sleep(600)\n"
    )
    run = subprocess.Popen(command(project, "--jobs", "2"), stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        end = time.monotonic() + 120
        done = 0
        while time.monotonic() < end and done < 10:  # all but the one that hangs
            time.sleep(0.1)
            if (project / "result.json").is_file():
                done = json.loads((project / "result.json").read_text())["shares"].get("all", {"mutations": 0})[
                    "mutations"
                ]
        run.send_signal(signal.SIGTERM)
        assert run.wait(timeout=30) != 0
        result = json.loads((project / "result.json").read_text())
        assert result["shares"]["all"]["mutations"] == 10
        assert result["drawn"] == 11
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ("source", "after"),
    [
        ("x = a < b", ["a >= b", "a <= b"]),
        ("x = a == 3", ["a != 3", "a == 4"]),
        ("def f():\n    return a >= b", ["a < b", "a > b", "True", "False"]),
        ("def f():\n    return a and b", ["a or b", "True", "False"]),
        ("x = a - b", ["a + b"]),
        ("x = not a", ["a"]),
        ("LEAST = 3", ["4"]),
        ("x: float = 0.5", ["5.0"]),
        ("f(x=True)", ["False"]),
        ("x = max(a)", ["min(a)"]),
        ("x = y.argmin()", ["y.argmax()"]),
        ("x = a if b else c", ["c if b else a"]),
        ("x = 'the one' if b else f'another {c}'", []),
        ("x = 'one' if b else 'two'", ["'two' if b else 'one'"]),
        ("x = np.abs(a)", ["a"]),
        ("raise Error(f'{a - b}')", []),
        ("def plot_it():\n    x = a - b", []),
        ("def label_quality():\n    x = a - b", ["a + b"]),
        ("print(a - b)", []),
        ("x = a > 1e-6", ["a <= 1e-06"]),
        ("x = max(a, 1e-9 * b)", ["min(a, 1e-09 * b)", "1e-09 / b"]),
        ("x = np.zeros((0, 3))", []),
        ("x = np.zeros(0, int)", []),
        ("x = np.zeros((n, 3))", ["np.ones((n, 3))"]),
        ("f(zip(a, b, strict=True))", []),
    ],
)
def test_wrong_steps(source, after):
    assert [one.after for one in mutants(source)] == after


@pytest.mark.parametrize(
    ("killed", "total", "low", "high"), [(85, 100, 0.7672, 0.9069), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0)]
)
def test_where_the_share_of_all_lies(killed, total, low, high):
    """Published values of Wilson's interval."""
    assert interval(killed, total) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ("before", "after", "same"),
    [
        ("a < b", "a <= b", True),
        ("np.abs(x) > 0.5", "np.abs(x) >= 0.5", True),
        ("a < b", "a >= b", False),  # turned round
        ("a < b", "a > b", False),
        ("a < 3", "a <= 3", False),  # a count may well be met
        ("index >= 0", "index > 0", False),
        ("len(a) >= least", "len(a) > least", False),
        ("seen.sum() > least", "seen.sum() >= least", False),
        ("a + b", "a - b", False),
        ("True", "False", False),
    ],
)
def test_borders_that_no_run_meets(before, after, same):
    assert at_continuous_border(before, after) == same


def test_reasons_are_of_mutations_that_there_are():
    """A reason for what no longer stands in the code would hide nothing, but mislead."""
    known = json.loads((TOOLS / "mutation" / "reasons.json").read_text())
    for name, reason in known.items():
        place, _, change = name.partition(": ")
        file, _, function = place.partition(" ")
        found = mutants((TOOLS.parent / file).read_text())
        assert change in {f"{one.before} -> {one.after}" for one in found if one.function == function}, name
        assert len(reason) > 20


def test_a_sample_takes_every_mutation_alike_and_the_groups_in_turn(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "long.py").write_text("\n".join(f"x{k} = a - b" for k in range(90)))
    (tmp_path / "a" / "short.py").write_text("\n".join(f"x{k} = a + b" for k in range(10)))
    (tmp_path / "tests" / "a").mkdir(parents=True)
    groups = groups_of(tmp_path, {"first": ("a/short.py",), "all": ("a/*.py",)}, "*")
    assert groups == {"first": ["a/short.py"], "all": ["a/long.py"]}
    assert sample.tests_of(tmp_path, groups) == [tmp_path / "tests" / "a"]
    drawn, counts = draw(tmp_path, groups, 8, seed=3)
    assert counts == {"first": 10, "all": 90}
    assert [group for group, *_ in drawn] == ["first", "all"] * 8
    assert len({(file, one.place) for _, file, one in drawn}) == 16
    assert drawn == draw(tmp_path, groups, 8, seed=3)[0]
    assert drawn != draw(tmp_path, groups, 8, seed=4)[0]
    both, _ = draw(tmp_path, {"both": ["a/long.py", "a/short.py"]}, 50, seed=0)
    assert 1 <= sum(file == "a/short.py" for _, file, _ in both) <= 9  # a tenth of the mutations is there
    assert len(draw(tmp_path, groups, 50, seed=3)[0]) == 60


def test_every_pattern_names_modules():
    root = TOOLS.parent
    for patterns in MODULES.values():
        for pattern in patterns:
            assert list(root.glob(pattern)), pattern
