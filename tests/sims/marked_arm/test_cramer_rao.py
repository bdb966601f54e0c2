from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.generative.prediction import predict
from dense_vs.generative.report import FitReport
from dense_vs.sims.marked_arm import cramer_rao as module
from dense_vs.sims.marked_arm.cramer_rao import cramer_rao, perfect_inference, true_parameters
from dense_vs.sims.marked_arm.evidence import act_cartesian
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.papers.gothoskar.arm_trials import Trial
from dense_vs.sims.papers.gothoskar.scores import held_out_error


@pytest.mark.parametrize("arm", ["ur5", "baxter"])
def test_true_parameters_make_the_true_pixels(arm):
    truth = Trial(arm, 2, 2, "normal").evidence(20).truth
    assert truth.joints is not None
    parameters = true_parameters(truth.arm, truth.joints[0])
    generated = predict(parameters, truth.joints)
    seen = np.isfinite(truth.pixels[..., 0])
    np.testing.assert_allclose(generated[seen], truth.pixels[seen], atol=1e-8)
    # Of each line the point that is nearest to the hand, so that no number is large beside others.
    away = parameters.points - parameters.features.mean(axis=0)
    np.testing.assert_allclose(np.sum(away * parameters.axes, axis=1), 0.0, atol=1e-9)


@pytest.mark.slow
def test_fits_reach_the_bound_and_do_not_undercut_it():
    errors, bounds = [], []
    for seed in range(6):
        trial = Trial("ur5", seed, 2, "normal")
        few, test = trial.evidence(15), trial.evidence(100, 1)
        bounds.append(cramer_rao(few, test, trial.rng(4)).noisy.mean())
        errors.append(held_out_error(GenerativeModel.fit(few.observations), test.observations))
    # Six fits scatter by about 3 % about the mean of what they may reach.
    assert np.mean(errors) == pytest.approx(np.mean(bounds), rel=0.1)


def test_more_samples_and_known_lenses_lower_it_and_noisy_joints_raise_it():
    trial = Trial("baxter", 1, 2, "uniform")
    test = trial.evidence(50, 1)

    def bound(samples, **options):
        return cramer_rao(samples, test, trial.rng(4), **options).exact.mean()

    few, many = (trial.evidence(samples, 0, tolerances_known=False) for samples in (10, 50))
    assert bound(many) < 0.5 * bound(few)
    assert bound(trial.evidence(10)) < 0.95 * bound(few)
    assert bound(many, state="noisy", sigma=0.01) > 2 * bound(many)
    assert bound(few, camera=1) < bound(few)
    assert bound(many, state="actions", sigma=0.01) > bound(many)


@pytest.mark.parametrize("state", ["noisy", "actions"])
def test_the_offset_that_actions_leave_open_is_taken_out(monkeypatch, state):
    """The first sample is learned 0.01 rad off in every joint, the second 0.03 rad, and nothing else is off."""
    trial = Trial("ur5", 2, 2, "normal")
    two, test = trial.evidence(2), trial.evidence(3, 1)
    learned = np.repeat([0.01, 0.03], 6) / 0.5  # half a pixel of noise is taken for one

    def root(information):
        return np.concatenate([np.zeros(len(information) - 12), learned])[:, None]

    asked = []

    def predicted(parameters, joints):
        asked.append(joints - test.truth.joints)
        return test.truth.pixels + np.array([3.0, 4.0])

    monkeypatch.setattr(module, "inverse_root", root)
    monkeypatch.setattr(module, "predict", predicted)
    ones = SimpleNamespace(normal=lambda *_, size=None: np.zeros(()) if size is None else np.ones(size))
    bound = cramer_rao(two, test, ones, state=state, sigma=0.01, draws=2)
    np.testing.assert_allclose(asked, np.full((2, 3, 6), 0.02 if state == "actions" else 0.0), atol=1e-12)
    assert bound.exact.tolist() == bound.noisy.tolist() == [5.0, 5.0]


@pytest.mark.parametrize(("state", "prior"), [("noisy", "JointReadings"), ("actions", "JointActions")])
def test_a_reading_weighs_by_its_variance_beside_that_of_a_pixel(monkeypatch, state, prior):
    """Half a pixel is as likely as 0.01 rad: their squares are as 2500 to one."""
    trial, given = Trial("ur5", 2, 2, "normal"), []
    few, test = trial.evidence(6), trial.evidence(3, 1)
    kind = getattr(module, prior)
    monkeypatch.setattr(module, prior, lambda *told: given.append(told) or kind(*told))
    cramer_rao(few, test, trial.rng(4), state=state, sigma=0.01, draws=1)
    ((values, weight),) = given
    assert weight == pytest.approx(2500.0)
    joints = few.truth.joints
    np.testing.assert_array_equal(values, joints if state == "noisy" else joints[1:] - joints[:-1])


@pytest.mark.parametrize("camera", [0, 1])
def test_only_the_camera_that_is_asked_for_is_open(monkeypatch, camera):
    trial = Trial("ur5", 2, 2, "normal")
    few, test = trial.evidence(6), trial.evidence(3, 1)
    asked = []
    monkeypatch.setattr(module, "predict", lambda p, joints: asked.append(p) or predict(p, joints))
    cramer_rao(few, test, trial.rng(4), camera=camera, draws=1)
    true = true_parameters(few.truth.arm, few.truth.joints.mean(axis=0))
    moved = np.abs(asked[0].camera_translation - true.camera_translation).max(axis=1) > 0
    assert moved.tolist() == [camera == 0, camera == 1]
    np.testing.assert_array_equal(asked[0].features, true.features)


def test_inference_with_the_true_model_is_perfect():
    trial = Trial("ur5", 3, 2, "normal")
    test = trial.evidence(60, 1)
    truth = test.truth
    assert truth.joints is not None
    joints, pixels = perfect_inference(test, np.array([True, True]))
    model = GenerativeModel(true_parameters(truth.arm, truth.joints.mean(axis=0)), truth.joints, FitReport())
    found = model.infer_joints(test.observations.pixels, near=truth.joints)
    off = np.linalg.norm(found - truth.joints, axis=1)
    # Linearized or not makes some percent where an image tells a joint to a tenth of a radian.
    assert np.median(off) == pytest.approx(np.median(joints), rel=0.1)
    distance = np.linalg.norm(model.pixels(found) - test.observations.pixels, axis=-1)
    assert np.nanmean(distance) == pytest.approx(np.mean(pixels), rel=0.05)
    assert np.median(perfect_inference(test, np.array([True, False]))[0]) > 2 * np.median(joints)


def test_what_has_no_bound_is_answered(trial):
    rng = np.random.default_rng(0)
    samples = trial.evidence(10)
    with pytest.raises(DenseVSError, match=r"sigma 0\.0 rad"):
        cramer_rao(samples, samples, rng, state="noisy")
    moved = act_cartesian(trial.observed_arm(), 5, NoisyController(0.0, "independent", rng), rng)
    for learned_from, test in ((moved, moved), (samples, moved), (moved, samples)):
        with pytest.raises(DenseVSError, match="Cartesian"):
            cramer_rao(learned_from, test, rng)
