"""What a model keeps of itself, and what it takes over, when a part of it is relearned."""

import numpy as np
import pytest
from exact_arm import SIZES, exact_arm

from dense_vs.generative import GenerativeModel, Observations
from dense_vs.generative import model as model_module
from dense_vs.generative.report import FitReport


@pytest.mark.parametrize(
    ("sizes", "kept"), [([(48, 64)], True), ([(48, 64), (72, 80)], False), ([(48, 64), (72, 80), (90, 99)], False)]
)
def test_sizes_of_images_are_those_of_as_many_cameras_at_least(monkeypatch, sizes, kept):
    arm = exact_arm()
    model = GenerativeModel(
        arm.parameters.copy(), arm.joints, FitReport(pixel_sigma=0.4, still_joints=[1]), image_sizes=SIZES
    )
    changed, report, asked = arm.parameters.copy(), FitReport(), []

    def relearn(parameters, obs, what, sigma, postures, seed):
        asked.append((what, sigma, seed))
        np.testing.assert_array_equal(postures, arm.joints)
        return changed, report

    monkeypatch.setattr(model_module, "relearn", relearn)
    pixels = np.tile(arm.pixels[:, :1], (1, len(sizes), 1, 1))
    obs = Observations(joints=arm.joints + 1.0, pixels=pixels, image_sizes=sizes, feature_link=arm.parameters.links)
    assert model.relearn(obs, "base", seed=5) is report
    assert asked == [("base", 0.4, 5)]
    assert model.parameters is changed
    assert model.image_sizes == (SIZES if kept else sizes)
    assert model.report.still_joints == [1]
    np.testing.assert_array_equal(model.postures, arm.joints)
    monkeypatch.setattr(model_module, "relearn", lambda *_: (changed, report))
    model.relearn(obs, "kinematics")
    np.testing.assert_array_equal(model.postures, obs.joints)
    assert model.report.still_joints == []
    model.report.pixel_sigma = 0.0  # not known
    monkeypatch.setattr(model_module, "relearn", relearn)
    monkeypatch.setattr(model, "postures", arm.joints)
    model.relearn(obs, "base")
    assert asked[-1] == ("base", 0.5, 0)
