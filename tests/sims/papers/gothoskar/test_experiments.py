import argparse
import json

import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.papers import EXPERIMENTS
from dense_vs.sims.papers.gothoskar import relearning
from dense_vs.sims.papers.gothoskar.protocol import pixel_error, spread_rows
from dense_vs.sims.papers.gothoskar.servoing import joint_tasks, moves_needed, servo_model


def reproduce(folder, name, *options):
    """The rows of an experiment run from the command line, by name."""
    file = folder / "rows.json"
    arguments = ["reproduce", "generative", name, "--out", str(folder), "--json", str(file), *options]
    assert main(arguments) == 0
    return {row["name"]: row for row in json.loads(file.read_text())["rows"]}


def test_few_samples(tmp_path):
    rows = reproduce(tmp_path, "few-samples", "--arm", "ur5", "--samples", "20", "50", "--seed", "1")
    assert rows["validation error, 50 samples: mean"]["paper"] == 0.6235
    assert rows["validation error, 50 samples: worst"]["ours"] < 0.75
    assert rows["validation error, 20 samples: worst"]["ours"] < 1.0
    assert rows["validation error, 20 samples: worst"]["seeds"] == [1]
    assert 0.6 < rows["validation error, 20 samples: bound (Cramer-Rao), mean"]["ours"] < 1.0
    assert rows["validation error, 50 samples: share below 1 px of perfect fits"]["ours"] == 1.0
    assert (tmp_path / "few_samples.png").stat().st_size > 10_000


def test_noisy_states_and_actions_stand_beside_their_bounds(tmp_path):
    common = ["--arm", "ur5", "--sigma", "0.01", "--seed", "1"]
    rows = reproduce(tmp_path, "noisy-states", *common)
    name = "test error, 0.01 rad, noise modelled"
    assert rows[f"{name}: mean"]["ours"] < 1.4 * rows[f"{name}: bound (Cramer-Rao), mean"]["ours"]
    assert rows["what readings 0.01 rad off are in pixels, mean"]["ours"] > 2.0
    assert rows["test error, 0.01 m and rad, noise modelled: mean"]["ours"] < 1.6
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
    few, many = relearning.relearnt_errors(learned, "moved camera", seen, held_out, [3, 10])
    assert few < 2.0
    assert many < 0.8
    assert relearning.relearnt_errors(learned, "kinematics", seen, held_out, [2]) == [np.inf]


def test_error_counts_only_what_was_seen_and_punishes_what_the_model_lacks():
    observed = np.array([[[3.0, 4.0], [np.nan, np.nan]]])
    assert pixel_error(np.zeros((1, 2, 2)), observed) == 5.0
    assert pixel_error(np.full((1, 2, 2), np.nan), observed) == np.inf


def test_rows_of_a_spread():
    rows = spread_rows("k", (1.0, 0.5), [1.0, 3.0], "px", [0, 1])
    assert [row.ours for row in rows] == [2.0, 1.0, 3.0]
    assert [row.paper for row in rows] == [1.0, 0.5, None]


def test_every_experiment_has_help_and_arguments():
    from importlib import import_module

    for home in EXPERIMENTS["generative"].values():
        module = import_module(home)
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        assert module.HELP
        assert module.__doc__


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("relearning", ["--cameras", "3"], "--cameras is 3"),
        ("camera-shift", ["--cameras", "1"], "--cameras is 1"),
        ("speed", ["--repeats", "0"], "--repeats is 0"),
        ("few-samples", ["--seed", "-1"], "--seed is [-1]"),
        ("grasp", ["--tries", "0"], "--tries and --samples"),
    ],
)
def test_bad_options_are_answered(tmp_path, capsys, name, options, message):
    assert main(["reproduce", "generative", name, "--out", str(tmp_path), *options]) == 2
    assert message in capsys.readouterr().err
