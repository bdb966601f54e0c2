"""Which runs an experiment is made of, and that its progress comes to its end; every run is one made by hand."""

from argparse import Namespace
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.gothoskar import few_samples, noisy_control, noisy_states, servo

SEEDS = [3, 4]


@pytest.fixture
def course(monkeypatch):
    """Runs an experiment over two trials; gives its rows by name and the curves that it draws."""

    def run(module, **arguments):
        counted, drawn = {"done": 0}, {}

        @contextmanager
        def progress(name, total, unit):
            counted["total"] = total
            yield SimpleNamespace(update=lambda: counted.update(done=counted["done"] + 1))

        monkeypatch.setattr(module, "progress", progress)
        monkeypatch.setattr(module, "trials", lambda _: [Number(1), Number(2)])
        monkeypatch.setattr(module, "draw_lines", lambda path, series, **_: drawn.update({path.name: series}))
        rows = module.run(Namespace(seeds=SEEDS, arm=["ur5"], **arguments))
        assert counted["done"] == counted["total"]
        assert all(row.seeds == (3, 4) for row in rows)
        return {row.name: row for row in rows}, drawn

    return run


class Number(int):
    """A trial that is its number; evidence is what was asked for."""

    def evidence(self, samples, purpose=0, **options):
        return SimpleNamespace(asked=(samples, purpose), first=lambda count: (int(self), samples, count, options))


def test_few_samples_are_the_first_of_the_most(course, monkeypatch, tmp_path):
    seen = []

    def add_errors(errors, trial, evidence, held_out, kinematics):
        assert (held_out.asked, kinematics) == ((100, 1), "dh")
        seen.append(evidence)
        _, _, count, told = evidence
        error = 10.0 / count + (0.2 if told["tolerances_known"] else 0.9) + 0.2 * trial
        errors.training.append(0.5)
        errors.validation.append(error)
        errors.perfect.append(np.array([0.6, 0.8]))

    monkeypatch.setattr(few_samples, "add_errors", add_errors)
    monkeypatch.setattr(few_samples, "draw_points", lambda *_, **__: None)
    options = {"samples": [20, 50], "kinematics": "dh", "out": tmp_path}
    rows, _ = course(few_samples, tolerances="both", **options)
    known = [(trial, 50, count, {"tolerances_known": True}) for trial in (1, 2) for count in (20, 50)]
    assert [one for one in seen if one[3]["tolerances_known"]] == known
    assert len(seen) == 8
    name = "validation error, 50 samples, lens tolerances given"  # 0.6 and 0.8
    assert rows[f"{name}: mean"].ours == pytest.approx(0.7)
    assert (rows[f"{name}: mean"].paper, rows[f"{name}: standard deviation"].paper) == (0.6235, 0.0143)
    assert rows[f"{name}: share below 1 px"].ours == 1.0
    assert rows[f"{name}: bound (Cramer-Rao), mean"].ours == pytest.approx(0.7)
    name = "validation error, 20 samples, lens tolerances not given"  # 1.6 and 1.8
    assert rows[f"{name}: worst"].ours == pytest.approx(1.8)
    assert rows[f"{name}: mean"].paper is None
    assert (rows[f"{name}: share below 1 px"].ours, rows[f"{name}: share below 2 px"].ours) == (0.0, 1.0)
    rows, _ = course(few_samples, tolerances="unknown", **options)
    assert len(seen) == 8 + 4
    assert all("lens tolerances not given" in name for name in rows)


def test_every_controller_law_and_noise_is_servoed(course, monkeypatch, tmp_path):
    asked = []

    def run(trial, controller, law, sigma, arguments):
        asked.append((int(trial), controller, law, sigma))
        errors = np.array([[50.0, 8.0, trial + 100 * sigma], [50.0, 8.0, trial + 100 * sigma + 4]])
        return noisy_control._Servo(errors, float(trial), float(trial), float(trial), float(trial))

    monkeypatch.setattr(noisy_control, "_servo", run)
    both = {"controller": ["cartesian", "joint"], "sigma": [0.0, 0.02]}
    rows, drawn = course(noisy_control, samples=50, targets=2, moves=2, out=tmp_path, **both)
    laws = ("independent", "proportional")
    assert asked == [
        (trial, controller, law, sigma)
        for controller in both["controller"]
        for law in laws
        for sigma in both["sigma"]
        for trial in (1, 2)
    ]
    end = "error after the last move, median"  # of 3, 7, 4 and 8 with noise, of 1, 5, 2 and 6 without
    assert rows[f"joint, proportional noise 0.02: {end}"].ours == 5.5
    assert rows[f"cartesian, independent noise 0: {end}"].ours == 3.5
    assert sorted(drawn) == sorted(f"{controller}_{law}.png" for controller in both["controller"] for law in laws)
    moves, medians = drawn["joint_independent.png"]["noise 0.02"]
    assert list(moves) == [0, 1, 2]
    assert medians.tolist() == [[50.0, 8.0, 5.5]]


def test_every_law_is_servoed(course, monkeypatch, tmp_path):
    def curves(trial, law, arguments, bar):
        for _ in range(1 + len(arguments.gains)):
            bar.update()
        errors = np.array([[50.0, 0.5 * trial + servo.LAWS.index(law)]])
        return [("model", errors), *((f"IBVS, gain {gain:g}", errors + 10) for gain in arguments.gains)]

    monkeypatch.setattr(servo, "_curves", curves)
    rows, drawn = course(servo, samples=50, targets=1, moves=1, gains=[0.1, 1.0], sigma=0.02, out=tmp_path)
    assert rows["exact: model: final error, median"].ours == 0.75
    assert rows["exact: IBVS, gain 1: final error, median"].ours == 10.75
    assert rows["exact: model: share ever below 1 px"].ours == 0.5
    laws = [law for law in servo.LAWS if law != "exact"]
    assert rows[f"{laws[0]} noise 0.02: model: final error, median"].ours == 0.75 + servo.LAWS.index(laws[0])
    assert len(rows) == len(servo.LAWS) * 3 * 3
    assert drawn["servo_exact.png"]["model"][1].tolist() == [[50.0, 0.75]]


@pytest.mark.parametrize("controllers", [["joint"], ["cartesian"], ["joint", "cartesian"]])
def test_every_reading_is_learned_from(course, monkeypatch, tmp_path, controllers):
    asked, bounds = [], []

    def error(trial, controller, state, sigma, samples, held_out):
        assert (samples, held_out.asked) == (50, (100, 1))
        asked.append((controller, int(trial), sigma, state))
        return trial + 100 * sigma + (state == "observed")

    def bound(runs, arguments, rows):
        bounds.append([int(one) for one in runs])
        return np.zeros((2, 2))

    monkeypatch.setattr(noisy_states, "_error", error)
    monkeypatch.setattr(noisy_states, "_bounds", bound)
    rows, drawn = course(noisy_states, controller=controllers, sigma=[0.01, 0.04], samples=50, out=tmp_path)
    assert sorted(asked) == sorted(
        (controller, trial, sigma, state)
        for controller in controllers
        for trial in (1, 2)
        for sigma in (0.01, 0.04)
        for state in ("observed", "noisy")
    )
    assert bounds == [[1, 2]] * ("joint" in controllers)
    assert len(rows) == len(controllers) * 2 * 2 * 3
    for controller in controllers:
        unit = {"joint": "rad", "cartesian": "m and rad"}[controller]
        name = f"test error, 0.01 {unit}, noise not modeled"
        assert (rows[f"{name}: mean"].ours, rows[f"{name}: worst"].ours) == (3.5, 4.0)
        printed = (rows[f"{name}: mean"].paper, rows[f"{name}: standard deviation"].paper)
        assert printed == ((1.715, 0.086) if controller == "joint" else (None, None))
        assert rows[f"test error, 0.04 {unit}, noise modeled: mean"].paper is None
        assert rows[f"test error, 0.04 {unit}, noise modeled: mean"].ours == 5.5
        curves = drawn[f"noisy_{controller}_readings.png"]
        assert ("perfect fit" in curves) == (controller == "joint")
