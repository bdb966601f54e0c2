import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.generative.inference.joint_inference import predict
from dense_vs.generative.report import FitReport
from dense_vs.sims.marked_arm.cramer_rao import cramer_rao, perfect_inference, true_parameters
from dense_vs.sims.marked_arm.evidence import act_cartesian
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.papers.gothoskar.protocol import Trial, held_out_error


@pytest.mark.parametrize("arm", ["ur5", "baxter"])
def test_true_parameters_make_the_true_pixels(arm):
    truth = Trial(arm, 2, 2, "normal").evidence(20).truth
    assert truth.joints is not None
    generated = predict(true_parameters(truth.arm, truth.joints[0]), truth.joints)
    seen = np.isfinite(truth.pixels[..., 0])
    np.testing.assert_allclose(generated[seen], truth.pixels[seen], atol=1e-8)


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


def test_inference_with_the_true_model_is_perfect():
    trial = Trial("ur5", 3, 2, "normal")
    test = trial.evidence(60, 1)
    truth = test.truth
    assert truth.joints is not None
    joints, pixels = perfect_inference(test, np.array([True, True]))
    model = GenerativeModel(true_parameters(truth.arm, truth.joints.mean(axis=0)), truth.joints, FitReport())
    found = model.infer_joints(test.observations.pixels, near=truth.joints)
    off = np.linalg.norm(found - truth.joints, axis=1)
    # Linearised or not makes some percent where an image tells a joint to a tenth of a radian.
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
    with pytest.raises(DenseVSError, match="Cartesian"):
        cramer_rao(moved, moved, rng)
