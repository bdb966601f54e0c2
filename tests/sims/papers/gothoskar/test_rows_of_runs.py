"""What becomes of runs in the tables: counts, medians and shares of runs made by hand."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.generative import GenerativeModel
from dense_vs.sims.papers.gothoskar import (
    camera_shift,
    kfold,
    noisy_control,
    noisy_states,
    servo,
    speed,
    stages,
)
from dense_vs.sims.papers.gothoskar.servo_runs import LEAST_SEEN, _errors, _inferred

SEEDS = [3, 4]


def values(rows):
    return {row.name: row.ours for row in rows}


def test_servo_rows():
    table = np.array([[90.0, 0.9, 0.4], [80.0, 5.0, 0.8], [70.0, 7.0, 3.0], [60.0, 0.99, 1.0]])
    rows = servo._rows("independent", {"model": table}, Namespace(sigma=0.01, seeds=SEEDS))
    found = values(rows)
    assert found["independent noise 0.01: model: moves to below 1 px, median"] == 1.5  # 1, 2, never, 1
    assert found["independent noise 0.01: model: share ever below 1 px"] == 0.75
    assert found["independent noise 0.01: model: final error, median"] == pytest.approx(0.9)
    (row, *_) = servo._rows("exact", {"IBVS": table}, Namespace(sigma=0.01, seeds=SEEDS))
    assert row.name.startswith("exact: IBVS:")


def test_rows_of_noisy_control():
    done = [
        noisy_control._Servo(np.array([[50.0, 4.0], [50.0, 0.5]]), 2.0, 0.7, 3.0, 0.6),
        noisy_control._Servo(np.array([[50.0, 6.0]]), 4.0, 0.9, 5.0, 0.8),
    ]
    rows = noisy_control._rows("joint", "independent", 0.01, done, (3, 4))
    found, start = values(rows), "joint, independent noise 0.01:"
    assert found[f"{start} error after the last move, median"] == 4.0
    assert found[f"{start} share ever below 1 px"] == pytest.approx(1 / 3)
    assert found[f"{start} error of the model, mean"] == pytest.approx(0.8)
    assert found[f"{start} error of the model, worst"] == 0.9
    assert found[f"{start} error of the model that takes actions for exact, worst"] == 5.0
    assert found[f"{start} error of the model, bound (Cramer-Rao), mean"] == pytest.approx(0.7)
    assert found[f"{start} what one move's noise leaves, median"] == 3.0
    papers = {row.name: row.paper for row in rows}
    assert papers[f"{start} error after the last move, median"] == noisy_control.PAPER_FINAL_PX.get(("joint", 0.01))
    other = noisy_control._rows("cartesian", "proportional", 0.01, done, (3, 4))
    assert len(other) == 3
    assert other[0].paper is None


def test_rows_of_noisy_control_are_of_the_last_move():
    """Three moves: near at once, near in between, near in the end, near at the start and not counted as moved."""
    errors = np.array([[50.0, 0.9, 2.0, 3.0], [50.0, 8.0, 0.9, 5.0], [50.0, 8.0, 4.0, 0.9], [0.9, 8.0, 4.0, 7.0]])
    found = values(noisy_control._rows("cartesian", "proportional", 0.02, [noisy_control._Servo(errors, 2.0)], (3,)))
    start = "cartesian, proportional noise 0.02:"
    assert found == {
        f"{start} error after the last move, median": 4.0,
        f"{start} share ever below 1 px": 1.0,
        f"{start} moves to below 1 px, median": 1.5,
    }


@pytest.mark.parametrize(
    ("controller", "law", "sigma", "paper"),
    [
        ("cartesian", "independent", 0.02, 5.0),
        ("cartesian", "proportional", 0.02, None),
        ("cartesian", "independent", 0.01, None),
        ("joint", "independent", 0.02, None),
    ],
)
def test_the_paper_tells_one_error_of_one_law(controller, law, sigma, paper):
    done = [noisy_control._Servo(np.array([[50.0, 4.0]]), 2.0)]
    rows = noisy_control._rows(controller, law, sigma, done, (3, 4))
    assert rows[0].paper == paper
    assert all(row.paper is None for row in rows[1:])
    assert all(row.seeds == (3, 4) for row in rows)
    assert not any("error of the model" in row.name for row in rows)  # what is not known has no row


def test_error_of_tasks_counts_what_is_behind_a_camera_as_far_off():
    exact = np.array([[[[10.0, 20.0], [np.nan, np.nan]]], [[[10.0, 20.0], [30.0, 40.0]]]])
    shown = np.array([[[[13.0, 24.0], [0.0, 0.0]]], [[[10.0, 20.0], [np.nan, np.nan]]]])
    arm = SimpleNamespace(projections=lambda poses: shown)
    np.testing.assert_allclose(_errors(arm, None, SimpleNamespace(exact=exact)), [5.0, 5000.0])


def test_offset_of_joints_is_taken_out_and_nothing_else():
    true = np.array([[0.1, 0.2], [0.3, 0.4]])
    model = SimpleNamespace(postures=true - [0.05, -0.02], pixels=lambda joints: np.repeat(joints[:, None, None], 1, 1))
    learned_from = SimpleNamespace(truth=SimpleNamespace(joints=true))
    held_out = np.array([[1.0, 2.0]])
    pixels = (held_out - [0.05, -0.02])[:, None, None] + [3.0, 4.0]
    test = SimpleNamespace(truth=SimpleNamespace(joints=held_out, pixels=pixels))
    assert noisy_control._aligned_error(model, learned_from, test) == pytest.approx(5.0)


def test_folds_are_learned_from_what_is_not_in_them(monkeypatch, tmp_path):
    class Samples(np.ndarray):
        observations = property(lambda self: self)

    scored = []
    trial = SimpleNamespace(
        seed=0,
        evidence=lambda count: np.arange(count).view(Samples),
        rng=lambda _: np.random.default_rng(0),
    )

    def held_out_error(train, fold):
        assert not np.intersect1d(train, fold).size
        np.testing.assert_array_equal(np.union1d(train, fold), np.arange(20))
        scored.append(len(fold))
        return float(len(scored))

    monkeypatch.setattr(kfold, "trials", lambda _: [trial])
    monkeypatch.setattr(kfold, "held_out_error", held_out_error)
    monkeypatch.setattr(kfold, "draw_bars", lambda *_, **__: None)
    monkeypatch.setattr(GenerativeModel, "fit", lambda samples, seed: samples)
    found = values(kfold.run(Namespace(samples=20, folds=[2, 4], seeds=SEEDS, out=tmp_path)))
    assert scored == [10, 10, 5, 5, 5, 5]
    assert found["k = 2: mean"] == 1.5
    assert found["k = 4: worst"] == 6.0


def test_losses_of_the_stage_that_learns_everything_are_means_over_detections():
    report = SimpleNamespace(
        stages=[SimpleNamespace(name=n, initial_loss=a, loss=b) for n, a, b in (("x", 9, 9), ("end to end", 80, 4))]
    )
    assert stages._end_to_end(report, SimpleNamespace(seen=np.ones((2, 2, 2), bool))) == (10.0, 0.5)


@pytest.mark.parametrize(("controller", "truth"), [("joint", 7.0), ("cartesian", 9.0)])
def test_noisy_readings_are_scored_on_exact_postures(monkeypatch, controller, truth):
    """Learned from what was read with noise, tested on the truth of the same controller."""
    told = {}

    def evidence(samples, joint_noise=0.0, pose_noise=None):
        told.update(samples=samples, joint_noise=joint_noise, pose_noise=pose_noise)
        return SimpleNamespace(observations="read")

    def fit(observations, state, controller, seed):
        assert (observations, state, seed) == ("read", "noisy", 5)
        return SimpleNamespace(pixels=lambda exact: np.full((1, 1, 1, 2), exact))

    monkeypatch.setattr(GenerativeModel, "fit", fit)
    held_out = SimpleNamespace(
        truth=SimpleNamespace(joints=7.0, poses=9.0), observations=SimpleNamespace(pixels=np.zeros((1, 1, 1, 2)))
    )
    trial = SimpleNamespace(seed=5, evidence=evidence)
    error = noisy_states._error(trial, controller, "noisy", 0.02, 50, held_out)
    assert error == pytest.approx(truth * np.sqrt(2))
    assert (told["joint_noise"], told["pose_noise"]) == ((0.02, None) if controller == "joint" else (0.0, 0.02))


def test_alarms_and_wrongly_named_cameras_are_counted(monkeypatch, tmp_path):
    """Two false alarms of the first before the shift, one of the second, which takes everything to have moved.

    The shifted camera is named at the third and at the fifth sample after it, another one at two samples.
    """
    from dense_vs.sims.marked_arm import evidence

    said, shifted = [], 1
    named = [(0,) if s in (4, 9) else () for s in range(camera_shift.BUFFER)]
    named += [(), (0,), (shifted,), (0, shifted), *[(shifted,)] * 6]
    named += [()] * (camera_shift.BUFFER + 4) + [(shifted,)] * 6

    def add(*_):
        said.append(1)
        return SimpleNamespace(
            moved_cameras=named[len(said) - 1], everything_moved=len(said) == 70, gradient_norm=float(len(said))
        )

    camera = SimpleNamespace(shifted=lambda *_: camera)

    arm = SimpleNamespace(cameras=(camera, camera))
    monkeypatch.setattr("dataclasses.replace", lambda arm, **_: arm)
    monkeypatch.setattr(evidence, "draw_joints", lambda arm, count, *_: np.zeros((count, 6)))

    def observed(arm, joints, *_):
        return SimpleNamespace(observations=SimpleNamespace(joints=joints, pixels=joints))

    monkeypatch.setattr(evidence, "observe", observed)
    rng = SimpleNamespace(integers=lambda _: shifted)
    trial = SimpleNamespace(
        seed=0,
        postures="normal",
        observed_arm=lambda: arm,
        rng=lambda _: rng,
        evidence=lambda count: SimpleNamespace(observations=None),
    )
    monkeypatch.setattr(camera_shift, "trials", lambda _: [trial, trial])
    monkeypatch.setattr(camera_shift, "draw_lines", lambda *_, **__: None)
    model = SimpleNamespace(online=lambda capacity: SimpleNamespace(add=add))
    monkeypatch.setattr(GenerativeModel, "fit", lambda observations, seed: model)
    arguments = Namespace(cameras=2, meters=0.02, radians=0.02, seeds=[0], arm=["ur5"], out=tmp_path)
    found = values(camera_shift.run(arguments))
    assert found["alarms in 100 samples before any shift"] == 3
    assert found["other cameras named in 20 samples after it"] == 2
    assert found["samples until the shifted camera is named, median"] == 4
    assert found["samples until the shifted camera is named, worst"] == 5
    assert found["50/0: gradient norm"] == 80.0  # 50 and, with the first run's 60 samples, 110
    assert found["40/10: gradient norm"] == 90.0


def test_a_query_of_a_hundred_is_timed_by_the_piece(monkeypatch, tmp_path):
    monkeypatch.setattr(speed, "_queries", lambda seed: dict.fromkeys(speed.PAPER, seed))
    monkeypatch.setattr(speed, "_median_ms", lambda query, repeats: 100.0 * query + (repeats == 5))
    monkeypatch.setattr(speed, "draw_bars", lambda *_, **__: None)
    found = values(speed.run(Namespace(repeats=7, seeds=[1, 2, 9], out=tmp_path)))
    assert found["Forward Kinematics"] == 200.0
    assert found["Infer Joints from Image, each of 100"] == 2.0
    assert found["Learning from 50 samples"] == 201.0  # five times are enough of it


def test_the_median_of_repeats_counts_and_the_first_call_does_not(monkeypatch):
    """A clock that each query moves on by what it takes [s]."""
    clock, calls = [0.0], []
    takes = [9.0, 0.25, 0.5, 4.0]

    def query():
        clock[0] += takes[len(calls)]
        calls.append(clock[0])

    monkeypatch.setattr(speed, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    assert speed._median_ms(query, 3) == 500.0
    assert len(calls) == 4


def test_medians_and_worst_of_stages(monkeypatch, tmp_path):
    trials = [SimpleNamespace(seed=k, evidence=lambda _: SimpleNamespace(observations=Namespace(joints=0, pixels=0)))
              for k in (1, 2, 9)]  # fmt: skip
    monkeypatch.setattr(stages, "trials", lambda _: trials)
    monkeypatch.setattr(stages, "draw_bars", lambda *_, **__: None)
    monkeypatch.setattr(stages, "_end_to_end", lambda report, _: (100.0 * report, float(report)))
    monkeypatch.setattr(
        stages, "_from_random", lambda trial, _, reconstructed: trial.seed * (3.0 if reconstructed else 2)
    )
    monkeypatch.setattr(stages, "pixel_error", lambda *_: 0.5)
    monkeypatch.setattr(GenerativeModel, "fit", lambda _, seed: SimpleNamespace(report=seed, pixels=lambda _: None))
    rows = stages.run(Namespace(samples=50, published=False, seeds=SEEDS, out=tmp_path))
    found, papers = values(rows), {row.name: row.paper for row in rows}
    of, worst = "mean squared distance, median", "mean squared distance, worst"
    for order, factor in (
        ("before end-to-end", 100.0),
        ("after end-to-end", 1.0),
        ("all at once", 2.0),
        ("cameras and structure, all", 3.0),
    ):
        assert (found[f"{order}: {of}"], found[f"{order}: {worst}"]) == (2 * factor, 9 * factor)
        assert papers[f"{order}: {worst}"] is None
    assert papers[f"after end-to-end: {of}"] == 0.47
    assert found["after end-to-end: mean distance, worst"] == 0.5


def test_joints_are_inferred_near_where_all_of_them_are_known_and_enough_is_seen():
    asked = []

    class Model:
        parameters = SimpleNamespace(features=np.append(np.zeros((LEAST_SEEN, 3)), [[np.nan, 0, 0]], axis=0))

        def infer_joints(self, images, near=None):
            asked.append((images[:, 0, 0, 0].tolist(), None if near is None else near.tolist()))
            return np.full((len(images), 2), 9.0)

    images = np.ones((4, 1, LEAST_SEEN + 1, 2)) * np.arange(4.0)[:, None, None, None]
    images[3, 0, 1] = np.nan  # one too few, as the last feature is not known
    near = np.array([[0.1, 0.2], [0.3, np.nan], [np.nan, np.nan], [0.5, 0.6]])
    joints = _inferred(Model(), images, near)
    assert asked == [([0.0], [[0.1, 0.2]]), ([1.0, 2.0], None)]
    np.testing.assert_array_equal(joints, [[9, 9], [9, 9], [9, 9], [0.5, 0.6]])
