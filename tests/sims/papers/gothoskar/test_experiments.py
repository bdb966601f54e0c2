import argparse
import json

import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.generative import GenerativeModel
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.papers import PAPERS
from dense_vs.sims.papers.gothoskar import few_samples, relearning
from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial
from dense_vs.sims.papers.gothoskar.grasp import LIFTED, is_grasped
from dense_vs.sims.papers.gothoskar.insertion import is_inserted
from dense_vs.sims.papers.gothoskar.scores import pixel_error, share_rows, spread_rows
from dense_vs.sims.papers.gothoskar.servo_runs import joint_tasks, moves_needed, servo_model


def reproduce(folder, name, *options):
    """The rows of an experiment run from the command line, by name."""
    file = folder / "rows.json"
    arguments = ["reproduce", "gothoskar", name, "--out", str(folder), "--json", str(file), *options]
    assert main(arguments) == 0
    return {row["name"]: row for row in json.loads(file.read_text())["rows"]}


@pytest.mark.slow
def test_few_samples(tmp_path):
    rows = reproduce(tmp_path, "few-samples", "--arm", "ur5", "--samples", "20", "50", "--seed", "1")
    given = "validation error, {} samples, lens tolerances given"
    assert rows[f"{given.format(50)}: mean"]["paper"] == 0.6235
    assert rows[f"{given.format(50)}: worst"]["ours"] < 0.75
    assert rows[f"{given.format(20)}: worst"]["ours"] < 1.0
    assert rows[f"{given.format(20)}: worst"]["seeds"] == [1]
    assert 0.6 < rows[f"{given.format(20)}: bound (Cramer-Rao), mean"]["ours"] < 1.0
    assert rows[f"{given.format(50)}: share below 1 px of perfect fits"]["ours"] == 1.0
    not_given = "validation error, 20 samples, lens tolerances not given: bound (Cramer-Rao), mean"
    assert rows[not_given]["ours"] > rows[f"{given.format(20)}: bound (Cramer-Rao), mean"]["ours"]
    assert (tmp_path / "few_samples.png").stat().st_size > 10_000


def test_few_samples_are_scored_on_postures_that_were_not_learned_from():
    trial = Trial("ur5", 1, 2, "normal")
    seen, held_out = trial.evidence(12), trial.evidence(TEST_SAMPLES, 1)
    errors = few_samples.Errors([], [], [])
    few_samples.add_errors(errors, trial, seen, held_out, "poe")
    model = GenerativeModel.fit(seen.observations, seed=1)
    test = held_out.observations
    exact = np.linalg.norm(model.pixels(test.joints) - test.pixels, axis=-1)
    assert errors.validation == [pytest.approx(np.nanmean(exact), rel=1e-6)]
    assert errors.training[0] < 0.62 < errors.validation[0]  # what was learned from has less than the pixels' noise
    assert not np.isin(test.joints, seen.observations.joints).any()


@pytest.mark.slow
def test_noisy_states_and_actions_stand_beside_their_bounds(tmp_path):
    common = ["--arm", "ur5", "--sigma", "0.01", "--seed", "1"]
    rows = reproduce(tmp_path, "noisy-states", *common)
    name = "test error, 0.01 rad, noise modeled"
    assert rows[f"{name}: mean"]["ours"] < 1.4 * rows[f"{name}: bound (Cramer-Rao), mean"]["ours"]
    assert rows["what readings 0.01 rad off are in pixels, mean"]["ours"] > 2.0
    assert rows["test error, 0.01 m and rad, noise modeled: mean"]["ours"] < 1.6
    rows = reproduce(tmp_path, "noisy-control", "--controller", "joint", "--targets", "5", "--moves", "2", *common)
    name = "joint, independent noise 0.01: error of the model"
    bound = rows[f"{name}, bound (Cramer-Rao), mean"]["ours"]
    assert rows[f"{name}, mean"]["ours"] < 1.5 * bound
    assert rows[f"{name} that takes actions for exact, mean"]["ours"] > 2 * bound


def test_camera_shift_is_named_and_no_other_camera_is(tmp_path):
    rows = reproduce(tmp_path, "camera-shift", "--arm", "baxter", "--seed", "4")
    assert rows["samples until the shifted camera is named, worst"]["ours"] <= 2
    norms = [row["ours"] for name, row in rows.items() if name.endswith("gradient norm")]
    assert np.all(np.diff(norms) > 0)
    assert norms[10] > 5 * norms[0]


def test_the_model_reaches_targets_in_a_move_or_two(learned, trial):
    arm, rng = trial.observed_arm(), trial.rng(9)
    tasks = joint_tasks(arm, 20, rng, "normal")
    errors = servo_model(learned, arm, tasks, 3, rng, NoisyController(0.0, "independent", rng), lambda joints: joints)
    assert np.median(errors[:, 0]) > 20
    assert np.median(moves_needed(errors)) <= 2
    assert np.mean(np.isfinite(moves_needed(errors))) >= 0.95


def test_relearning_a_moved_camera_from_three_samples(learned, trial):
    intrinsics = learned.parameters.intrinsics[:, :4]
    seen, held_out = (e.observations for e in relearning.new_setup(trial, "moved camera", intrinsics, 10))
    assert seen.seen[:, 1].sum(axis=1).min() >= 4
    few, many = relearning.relearned_errors(learned, "moved camera", seen, held_out, [3, 10])
    assert few < 2.0
    assert many < 0.8
    assert relearning.relearned_errors(learned, "kinematics", seen, held_out, [2]) == [np.inf]


def test_error_counts_only_what_was_seen_and_punishes_what_the_model_lacks():
    observed = np.array([[[3.0, 4.0], [np.nan, np.nan]]])
    assert pixel_error(np.zeros((1, 2, 2)), observed) == 5.0
    assert pixel_error(np.full((1, 2, 2), np.nan), observed) == np.inf


def test_moves_until_an_error_is_below_a_pixel():
    errors = np.array([[0.9, 5.0, 5.0], [5.0, 1.0, 0.99], [1.0, 1.0, 1.0], [5.0, 0.5, 0.1]])
    np.testing.assert_array_equal(moves_needed(errors), [0, 2, np.inf, 1])
    np.testing.assert_array_equal(moves_needed(errors, reached=0.2), [np.inf, np.inf, np.inf, 2])


@pytest.mark.parametrize(("depth", "counts"), [(0.0, False), (0.0349, False), (0.035, True), (0.04, True)])
def test_a_peg_counts_when_35_mm_are_in_the_hole(depth, counts):
    assert is_inserted(depth) is counts


@pytest.mark.parametrize(
    ("raised", "in_hand", "counts"),
    [
        ([0.0, 0.0, 0.1], [0.01, 0.0, 0.0], True),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], False),  # still on the table
        ([0.0, 0.0, LIFTED], [0.0, 0.0, 0.0], False),
        ([0.1, 0.1, 0.0], [0.0, 0.0, 0.0], False),  # pushed aside
        ([0.0, 0.0, 0.1], [0.0, LIFTED, 0.0], False),  # thrown
        ([0.0, 0.0, -0.1], [0.0, 0.0, 0.0], False),
    ],
)
def test_a_block_counts_when_it_hangs_in_the_gripper(raised, in_hand, counts):
    assert is_grasped(np.array(raised), np.array(in_hand)) is counts


def test_share_below_a_limit():
    values, perfect = np.array([0.5, 1.0, 2.0, np.inf]), [np.array([0.1, 0.2]), np.array([3.0, 0.9])]
    assert [row.ours for row in share_rows("k", 1.0, values, perfect, [0])] == [0.25, 0.75]


def test_rows_of_a_spread():
    rows = spread_rows("k", (1.0, 0.5), [1.0, 3.0], "px", [0, 1])
    assert [row.ours for row in rows] == [2.0, 1.0, 3.0]
    assert [row.paper for row in rows] == [1.0, 0.5, None]


def test_every_experiment_has_help_and_arguments():
    from importlib import import_module

    for experiment in PAPERS["gothoskar"].experiments.values():
        module = import_module(experiment.home)
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        assert experiment.help
        assert module.__doc__


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("relearning", ["--cameras", "3"], "--cameras is 3"),
        ("camera-shift", ["--cameras", "1"], "--cameras is 1"),
        ("speed", ["--repeats", "0"], "--repeats is 0"),
        ("few-samples", ["--seed", "-1"], "--seed is -1"),
        ("grasp", ["--tries", "0"], "--tries is 0"),
    ],
)
def test_bad_options_are_answered(tmp_path, capsys, name, options, message):
    assert main(["reproduce", "gothoskar", name, "--out", str(tmp_path), *options]) == 2
    assert message in capsys.readouterr().err
