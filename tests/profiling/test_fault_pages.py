"""The table of faults in its page, and the cases that are run for it, with results made by hand."""

import json
import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import faults

ROW = {"arm": "planar", "seed": 1, "before": 0.1, "at_end": 0.5, "after": 0.1, "named": [], "reach": "reached"}
ROW |= {"fault": faults.NAMES[0], "reach_px": 1.0, "worst": 2.0, "unflagged": 0, "after_px": [1.0, 2.0, 0.5]}


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page with an old table, and a result of two robots."""
    rows = [ROW, {**ROW, "arm": "arm", "seed": 0}]
    (tmp_path / "faults.json").write_text(
        json.dumps({"date": "2026-01-02T03:04", "commit": "0123456789", "rows": rows})
    )
    page = tmp_path / "faults.md"
    page.write_text(f"# Faults\n\n{faults.BEGIN}\nold\n{faults.END}\n\nMore.\n")
    monkeypatch.setattr(faults, "RESULT", tmp_path / "faults.json")
    monkeypatch.setattr(faults, "PAGE", page)
    return page


def test_the_table_stands_between_its_markers(page):
    assert faults.write_page(check=False) == 0
    lines = page.read_text().splitlines()
    assert lines[:4] == ["# Faults", "", faults.BEGIN, ""]
    assert lines[4] == "Robots arm, planar; seeds 0, 1; 2026-01-02, commit 0123456."
    assert lines[6].startswith("| fault | J before |")
    assert lines[7] == "|" + "---|" * 10
    assert lines[8].startswith(f"| {faults.NAMES[0]} | 0.10 | 0.50 | 0.10 | 1.00 | 4 of 6 | 2 of 2 |")
    assert lines[9:] == ["", faults.END, "", "More."]


def test_a_check_changes_nothing_and_fails_where_the_table_differs(page, capsys):
    old = page.read_text()
    assert faults.write_page(check=True) == 1
    assert page.read_text() == old
    assert "faults.md is not what faults.json says" in capsys.readouterr().err
    faults.write_page(check=False)
    new = page.read_text()
    assert faults.write_page(check=True) == 0
    assert faults.write_page(check=False) == 0  # once more changes nothing
    assert page.read_text() == new
    assert capsys.readouterr().err == ""


def test_the_page_is_written_from_the_command(monkeypatch):
    asked = []
    monkeypatch.setattr(faults, "write_page", lambda check: asked.append(check) or 7)
    for options in (["--page"], ["--page", "--check"]):
        monkeypatch.setattr(sys, "argv", ["faults.py", *options])
        assert faults.main() == 7
    assert asked == [False, True]


@pytest.fixture
def measured(monkeypatch):
    """Rows of cases that are measured in this process."""

    def measure(arm, seed, fault):
        return faults.Row(arm, seed, fault, 0.1, 0.5, 0.1, [], "reached", 1.0, 2.0, 0, [1.0])

    monkeypatch.setattr(faults, "measure", measure)


@pytest.mark.usefixtures("measured")
def test_every_fault_meets_every_seed_and_robot_in_order(monkeypatch, tmp_path, capsys):
    two = list(faults.NAMES[:2])
    file = tmp_path / "faults.json"
    monkeypatch.setattr(
        sys,
        "argv",
        ["faults.py", "--seeds", "5", "4", "--faults", *two[::-1], "--arms", "planar", "arm", "--json", str(file)],
    )
    assert faults.main() == 0
    content = json.loads(file.read_text())
    cases = [(row["seed"], row["arm"], row["fault"]) for row in content["rows"]]
    assert cases == [(seed, arm, fault) for seed in (4, 5) for arm in ("arm", "planar") for fault in two]
    assert "reaches after it" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["faults.py", "--seeds", "5", "--faults", two[0], "--arms", "arm"])
    assert faults.main() == 0  # and no file where none was asked for


@pytest.mark.usefixtures("measured")
def test_one_robot_at_a_time_needs_no_other_process(monkeypatch):
    made = []

    class Pool:
        def __init__(self, count, context):
            made.append(count)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def submit(self, work, *case):
            return SimpleNamespace(result=lambda: work(*case))

    monkeypatch.setattr(faults, "ProcessPoolExecutor", Pool)
    monkeypatch.setattr(faults, "as_completed", reversed)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")  # put back afterwards
    monkeypatch.setenv("DENSE_VS_THREADS", "3")
    for jobs, pools in ((1, []), (2, [2]), (5, [2, 5])):
        options = Namespace(arms=["arm"], seeds=[0, 1], faults=["black"], jobs=jobs)
        assert {(row.seed, row.fault) for row in faults._rows(options)} == {(0, "black"), (1, "black")}
        assert made == pools


@pytest.mark.parametrize("fault", faults.NAMES)
def test_a_restart_is_met_by_itself_and_every_fault_has_its_number(monkeypatch, fault):
    def trial(arm, seed):
        assert (arm, seed) == ("arm", 3)
        return SimpleNamespace(
            meet=lambda fault, number: ("meet", fault, number), meet_restart=lambda number: ("restart", number)
        )

    monkeypatch.setattr(faults, "FaultTrial", trial)
    number = faults.NAMES.index(fault)
    expected = ("restart", number) if fault == "killed and restarted" else ("meet", fault, number)
    assert faults.measure("arm", 3, fault) == expected
    assert faults.NAMES[-2:] == ("killed and restarted", "nothing, to compare with")  # what is added later comes last
    assert len(set(faults.NAMES)) == len(faults.NAMES)


@pytest.fixture
def begun(monkeypatch):
    """What runs are made with."""
    made = []

    class Run:
        def __init__(self, world, **options):
            made.append(options)
            self.learned = 0
            estimator = SimpleNamespace(options=SimpleNamespace(height=24, width=32))
            self.loop = SimpleNamespace(pipeline="pipeline", estimator=estimator)

        def learn(self):
            self.learned += 1

    world = SimpleNamespace(joint_names=("a", "b"), joints=lambda: (np.array([0.5, 0.25]), 9.0))
    monkeypatch.setattr(faults, "SimWorld", lambda arm, seed, device: made.append((arm, seed, device)) or world)
    monkeypatch.setattr(faults, "FaultInjector", lambda world, seed: f"injector {seed}")
    monkeypatch.setattr(faults, "ReachingExperiment", Run)
    return made


def test_a_trial_begins_by_learning(begun):
    one = faults.FaultTrial("planar", 3)
    assert one.run.learned == 1
    (world, options) = begun
    assert world == ("planar", 3, "cpu")
    assert options.pop("on_frame") == one._after_frame
    assert options == {"traced": False, "point": "tip", "seed": 3, "injector": "injector 3"}
    assert (one.named, one.frames, one.due, one.places) == (set(), [], None, {})


def test_errors_are_means_over_three_seconds_before_and_three_seconds_after(begun):
    one, babbled = faults.FaultTrial("arm", 3), []
    errors = iter(range(15))
    one.run.loop.babble = babbled.append
    one.run.jacobian_error = lambda: SimpleNamespace(median=next(errors) / 100)
    assert one._error(faults.AFTER) == pytest.approx(0.07)
    assert babbled == [pytest.approx(0.2)] * 15
    assert (faults.BEFORE, faults.LATER, faults.AFTER) == (3.0, 1.5, 3.0)


@pytest.mark.parametrize(("body", "used"), [("kept body", "kept body"), (None, True)])
def test_a_restart_goes_on_with_what_was_kept(begun, monkeypatch, body, used):
    """At the posture where the robot is, and with nothing else of the first run."""
    told = []
    kept = SimpleNamespace(bring_to=lambda q: told.append(("bring", q.tolist())), estimator="kept estimator", body=body)

    class Checkpoint:
        def __init__(self, path, joints):
            told.append(joints)

        def keep(self, loop, time):
            told.append((loop.pipeline, time))

        def end(self):
            told.append("end")

        def resume(self, size, device):
            told.append((size, device))
            return kept

    monkeypatch.setattr(faults, "Checkpoint", Checkpoint)
    one = faults.FaultTrial("arm", 3)
    first = one.run
    one.restart()
    assert told == [("a", "b"), ("pipeline", 0.0), "end", ((24, 32), "cpu"), ("bring", [0.5, 0.25])]
    assert one.run is not first
    assert one.run.learned == 0
    options = begun[-1]
    assert options.pop("on_frame") == one._after_frame
    expected = {"traced": False, "point": "tip", "seed": 3, "injector": "injector 3", "estimator": "kept estimator"}
    assert options == {**expected, "body_model": used}
