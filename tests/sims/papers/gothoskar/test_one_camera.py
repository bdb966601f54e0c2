"""What one camera alone tells, beside both: the same images, the pixels that were used, joints as angles."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.gothoskar import single_camera


class Model:
    """Infers a joint that is off by 0.3 rad, or by a turn and 0.4 where the second camera is not seen."""

    def __init__(self):
        self.seen = []

    def infer_joints(self, pixels):
        self.seen.append(pixels)
        alone = np.isnan(pixels[:, 1:]).all()
        return np.full((len(pixels), 2), 0.4 + 2 * np.pi if alone else 0.3)

    def pixels(self, joints):
        found = np.zeros((len(joints), 2, 5, 2))
        found[:, 0, :, 0], found[:, 1, :, 0] = joints[:, :1] % (2 * np.pi), 9.0
        return found


def held_out():
    pixels = np.zeros((4, 2, 5, 2))
    pixels[2, 0, :2] = np.nan  # three features are left to the first camera
    pixels[3, 0, :1] = np.nan
    return SimpleNamespace(observations=SimpleNamespace(pixels=pixels), truth=SimpleNamespace(joints=np.zeros((4, 2))))


def test_errors_of_both_and_of_one_are_of_the_same_images():
    model = Model()
    errors = single_camera._inferred(model, held_out())
    assert [len(one) for one in errors.values()] == [3] * len(errors)
    assert [len(one) for one in model.seen] == [3, 3]
    assert np.isnan(model.seen[1][:, 1]).all()
    assert np.isfinite(model.seen[0][:, 1]).all()
    np.testing.assert_allclose(errors["both cameras: joints"], 0.3 * np.sqrt(2))
    np.testing.assert_allclose(errors["one camera: joints"], 0.4 * np.sqrt(2))  # a whole turn is none
    np.testing.assert_allclose(errors["both cameras: reprojection"][0], (0.3 + 9.0) / 2)
    np.testing.assert_allclose(errors["one camera: reprojection"][0], (0.4 + 9.0) / 2)  # in both, though one was used
    np.testing.assert_allclose(errors["one camera: reprojection in it"], 0.4)


@pytest.mark.parametrize(("arm", "joints"), [("ur5", True), ("baxter", False)])
def test_perfect_inference_is_asked_with_both_and_with_the_first(monkeypatch, arm, joints):
    asked = []

    def perfect(evidence, cameras):
        asked.append(cameras.tolist())
        return np.arange(4.0), np.arange(4.0) + 10

    monkeypatch.setattr("dense_vs.sims.marked_arm.cramer_rao.perfect_inference", perfect)
    errors = single_camera._perfect(SimpleNamespace(cameras=3, arm=arm), held_out())
    assert asked == [[True, True, True], [True, False, False]]
    np.testing.assert_array_equal(errors["one camera: reprojection, perfect"], [10.0, 11.0, 13.0])
    assert ("both cameras: joints, perfect" in errors) == joints  # seven joints are not unique
