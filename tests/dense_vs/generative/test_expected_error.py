"""What a fit expects of itself on other postures, against its true error there."""

import numpy as np
import pytest
from arm_recordings import record

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.generative.learning.expected_error import inverse_root, shared_information
from dense_vs.generative.least_squares.pixel_problem import NormalEquations


def true_error(case, model):
    """Mean distance [px] to exact pixels at postures that the model has not seen."""
    exact = case.arm.see(case.unseen_joints, hide=False)
    seen = np.isfinite(case.unseen_pixels[..., 0])
    return float(np.linalg.norm(model.pixels(case.unseen_joints) - exact, axis=-1)[seen].mean())


def test_it_is_about_the_true_error():
    expected, true = [], []
    for seed in range(4):
        case = record("ur5", seed, 20)
        model = GenerativeModel.fit(case.observations())
        expected.append(model.report.expected_error_px)
        true.append(true_error(case, model))
    assert np.mean(expected) == pytest.approx(np.mean(true), rel=0.5)


def test_a_model_that_explains_its_samples_and_nothing_else_says_so(ur5):
    model = GenerativeModel.fit(ur5.observations())
    assert model.report.expected_error_px < 0.3
    report = model.relearn(ur5.observations()[:5], "kinematics")  # as many equations as unknowns
    assert report.mean_error_px < 1.0
    assert report.expected_error_px > 5.0


def test_noisy_joints_raise_it_and_actions_have_none(ur5):
    noisy = ur5.joints + np.random.default_rng(0).normal(0, 0.01, ur5.joints.shape)
    report = GenerativeModel.fit(ur5.observations(joints=noisy), state="noisy").report
    assert 0.3 < report.expected_error_px < 2.0
    observed = ur5.observations(joints=None, actions=np.diff(noisy, axis=0))
    assert GenerativeModel.fit(observed, state="actions").report.expected_error_px is None


def test_information_of_the_shared_unknowns_is_what_the_others_leave():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(40, 3 + 2 * 2))
    root[:20, 5:], root[20:, 3:5] = 0.0, 0.0  # two samples of two unknowns, 20 equations each
    whole = root.T @ root
    local = np.stack([whole[3:5, 3:5], whole[5:7, 5:7]])
    coupling = np.stack([whole[3:5, :3], whole[5:7, :3]])
    shared = shared_information(NormalEquations(0.0, whole[:3, :3], np.zeros(3), coupling, local, np.zeros((2, 2))))
    expected = np.linalg.inv(whole)[:3, :3]
    np.testing.assert_allclose(np.linalg.inv(shared), expected, rtol=1e-9)
    half = inverse_root(shared)
    np.testing.assert_allclose(half @ half.T, expected, rtol=1e-9)


@pytest.mark.parametrize("joints", ["degrees", "random", "of other samples"])
def test_joints_that_do_not_belong_to_the_images_are_told(ur5, joints):
    wrong = {
        "degrees": np.rad2deg(ur5.joints),
        "random": np.random.default_rng(0).uniform(-2, 2, ur5.joints.shape),
        "of other samples": np.roll(ur5.joints, 7, axis=0),
    }[joints]
    model = GenerativeModel.fit(ur5.observations(joints=wrong))
    report = model.report
    assert not report.converged
    assert report.misfit > 10
    true = np.linalg.norm(model.pixels(wrong[:20]) - ur5.pixels[:20], axis=-1)
    assert report.expected_error_px > 0.5 * np.nanmean(true)
    with pytest.raises(DenseVSError, match="the model misses its own samples by"):
        model.command(ur5.pixels[0], ur5.pixels[1])


def test_a_model_that_fits_has_no_misfit(ur5, model):
    assert model.report.converged
    assert 0.7 < model.report.misfit < 1.3
    model.command(ur5.pixels[0], ur5.pixels[1])


def test_an_image_that_no_posture_explains_moves_nothing(ur5, model):
    rng = np.random.default_rng(1)
    noise = np.where(np.isfinite(ur5.pixels[0]), rng.uniform(0, 600, ur5.pixels[0].shape), np.nan)
    assert model.misfit_px(ur5.pixels[:5], model.infer_joints(ur5.pixels[:5])).max() < 1.5
    assert model.misfit_px(noise, model.infer_joints(noise)) > 30
    blurred = ur5.pixels[0] + rng.normal(0, 10, ur5.pixels[0].shape)
    assert 5 < model.misfit_px(blurred, model.infer_joints(blurred)) < 20
    for now, target, name in ((noise, ur5.pixels[1], "current"), (ur5.pixels[1], noise, "target"),
                              (blurred, ur5.pixels[1], "current")):  # fmt: skip
        with pytest.raises(DenseVSError, match=f"no posture explains the {name} image: the nearest is"):
            model.command(now, target)
