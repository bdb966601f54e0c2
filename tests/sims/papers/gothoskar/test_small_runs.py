"""Experiments on the generative model, run small: what their figures must be, whatever the seed."""

import json

import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.sims.papers.gothoskar import drift, speed
from dense_vs.sims.papers.gothoskar.arm_trials import Trial

PERFECT_PX = 0.627  # mean distance that the pixels' noise alone makes


@pytest.fixture
def reproduce(tmp_path):
    """The values of an experiment run from the command line, by row."""

    def run(name, *options):
        file = tmp_path / "rows.json"
        assert main(["reproduce", "gothoskar", name, "--out", str(tmp_path), "--json", str(file), *options]) == 0
        return {row["name"]: row["ours"] for row in json.loads(file.read_text())["rows"]}

    return run


def test_folds_are_scored_on_what_was_left_out(reproduce):
    values = reproduce("kfold", "--arm", "ur5", "--samples", "40", "--folds", "2", "--seed", "2")
    assert PERFECT_PX < values["k = 2: mean"] < 1.0
    assert values["k = 2: worst"] >= values["k = 2: mean"]


@pytest.mark.slow
def test_learning_end_to_end_lowers_the_error_to_the_noise(reproduce):
    values = reproduce("stages", "--arm", "ur5", "--samples", "30", "--seed", "2")
    before = values["before end-to-end: mean squared distance, median"]
    after = values["after end-to-end: mean squared distance, median"]
    assert after < 0.6 < before  # noise of half a pixel makes 0.5 px^2


@pytest.mark.slow
def test_the_model_servoes_in_fewer_moves_than_a_careful_gain(reproduce):
    options = ["--arm", "ur5", "--samples", "30", "--targets", "5", "--moves", "4", "--gains", "0.2", "--seed", "2"]
    values = reproduce("servo", *options)
    assert values["exact: model: moves to below 1 px, median"] <= 2
    assert values["exact: model: final error, median"] < 1.0
    assert values["exact: model: share ever below 1 px"] == 1.0
    # Four moves of a fifth each leave 0.8^4 of a hundred pixels.
    assert values["exact: IBVS, gain 0.2: share ever below 1 px"] == 0.0
    assert values["exact: IBVS, gain 0.2: moves to below 1 px, median"] is None  # JSON's infinity


def test_two_cameras_reproject_better_than_one(reproduce):
    values = reproduce("single-camera", "--arm", "ur5", "--samples", "30", "--learn-from", "30", "--seed", "2")
    both, one = (values[f"ur5: {name}: reprojection: median"] for name in ("both cameras", "one camera"))
    assert both < one
    assert values["learned from one camera, 30 samples: mean"] > PERFECT_PX


@pytest.mark.slow
def test_every_query_takes_time(reproduce):
    values = reproduce("speed", "--repeats", "1")
    assert len(values) == 11 + 3  # the paper's table, and ours
    assert all(0 < value < np.inf for value in values.values())
    assert values["Learning from 50 samples"] > values["Forward End-to-End"]
    assert values["Infer Joints from Pose"] > values["Forward Kinematics"]


def test_queries_that_are_timed_answer_what_they_are_named_for():
    queries = speed._queries(2)
    np.testing.assert_allclose(queries["Forward Camera/Feature"](), queries["Forward End-to-End"]()[0], atol=1e-9)
    assert queries["Loss (Pixel)"]() < 4 * 24 * 0.5  # px^2 of 12 features in 2 cameras at half a pixel of noise
    assert queries["Loss (Cartesian Pose)"]() < 0.15  # one image turns the hand by some hundredths of a radian
    joints, left = queries["Infer Joints from Pose"]()
    solved = joints[left.argmin()]
    assert left.min() < 1e-8
    np.testing.assert_allclose(solved, queries["Infer Joints from Image"](), atol=0.05)
    # 6 axes and points of 2 each, 12 features of 3, a camera's pose of 6 and the lenses of both, of 4.
    assert queries["Gradient End-to-End"]().shared_gradient.shape == (6 * 4 + 12 * 3 + 6 + 2 * 4,)
    value, gradient = queries["Gradient Kinematics"]()
    assert 0 < value < 50 * 0.15
    assert gradient.shape == (6 + 6 * 4,)
    of_cameras = queries["Gradient Camera/Feature"]()
    assert of_cameras.local_gradient.shape == (50, 6)
    assert of_cameras.shared_gradient.shape == (12 * 3 + 6 + 2 * 4,)


@pytest.mark.slow
def test_a_followed_drift_ends_nearer_than_a_kept_model(reproduce):
    values = reproduce("drift", "--arm", "ur5", "--samples", "40", "--slip", "0.005", "--warm", "0.01", "--seed", "2")
    for start in ("structure drifts by 0.005 m:", "camera:1 drifts by 0.01 of its lens:"):
        kept, followed = (values[f"{start} error at the end, {name}, mean"] for name in ("kept", "followed"))
        assert PERFECT_PX < values[f"{start} error before, mean"] < 0.8
        assert PERFECT_PX < followed < 0.6 * kept
        assert followed <= values[f"{start} worst error on the way, followed"]
        assert 1 <= values[f"{start} steps in 40 observations"] <= 40
        assert values[f"{start} of 1 drifts, taken for a moved camera"] == 0


def test_a_drift_is_as_large_as_asked():
    arm, way = Trial("ur5", 2, 2, "normal").observed_arm(), np.array([3.0, 0.0, -4.0, 1.0])
    slipped = drift.drifted_arm(arm, "structure", 0.005, way)
    np.testing.assert_allclose(slipped.features - arm.features, np.tile([0.003, 0.0, -0.004], (12, 1)))
    warm = drift.drifted_arm(arm, "camera:1", 0.01, np.array([3.0, 1.0, -4.0, 1.0]))
    np.testing.assert_allclose(warm.cameras[1].intrinsics / arm.cameras[1].intrinsics, [1.01, 1.01, 0.99, 1.01])
    assert warm.cameras[0] is arm.cameras[0]
