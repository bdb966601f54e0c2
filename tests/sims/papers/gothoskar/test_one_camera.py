"""What one camera alone tells, beside both: the same images, the pixels that were used, joints as angles."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.generative import GenerativeModel
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


class Seen(SimpleNamespace):
    """Observations that can be cut."""

    def __getitem__(self, part):
        return Seen(pixels=self.pixels[part], image_sizes=[1, 2], intrinsics=np.zeros((2, 4)), joints=None)


@pytest.fixture
def ran(monkeypatch, tmp_path):
    """Rows and bars of two models whose errors are given, one set a model; models of one camera see that one alone."""

    def run(errors, perfect, **options):
        fitted, drawn, inferred, bounds = [], {}, iter(errors), iter(perfect)
        held_out = SimpleNamespace(observations=SimpleNamespace(joints=None, pixels=np.zeros((4, 2, 1, 2))))

        def evidence(count, purpose=0):
            if purpose:
                return held_out
            seen = Seen(pixels=np.zeros((count, 2, 1, 2)), image_sizes=[1, 2], intrinsics=np.zeros((2, 4)), joints=None)
            return SimpleNamespace(observations=seen)

        def fit(observations, seed):
            samples, cameras = observations.pixels.shape[:2]
            fitted.append((seed, samples, cameras))
            return SimpleNamespace(pixels=lambda _: np.full((4, cameras, 1, 2), 3.0 / np.sqrt(2)))

        trials = [SimpleNamespace(arm="ur5", seed=k, evidence=evidence) for k in (1, 2)]
        monkeypatch.setattr(single_camera, "trials", lambda _: trials)
        monkeypatch.setattr(single_camera, "draw_bars", lambda path, names, bars, **_: drawn.update(bars))
        monkeypatch.setattr(single_camera, "_inferred", lambda *_: dict.fromkeys(single_camera.PAPER, next(inferred)))
        monkeypatch.setattr(single_camera, "_perfect", lambda *_: next(bounds))
        monkeypatch.setattr(single_camera, "replace", lambda few, pixels, **_: SimpleNamespace(pixels=pixels))
        monkeypatch.setattr(GenerativeModel, "fit", fit)
        rows = single_camera.run(Namespace(arm=["ur5"], seeds=[3, 4], out=tmp_path, **options))
        return {row.name: row for row in rows}, drawn, fitted

    return run


ERRORS = [np.array([1.0, 2.0, 9.0]), np.array([4.0])]


def test_means_and_medians_are_over_all_images_of_all_seeds(ran):
    rows, drawn, _ = ran(ERRORS, [{}, {}], samples=50, learn_from=[20, 50])
    for name, (mean, _) in single_camera.PAPER.items():
        assert (rows[f"ur5: {name}: mean"].ours, rows[f"ur5: {name}: median"].ours) == (4.0, 3.0)
        assert rows[f"ur5: {name}: mean"].paper == mean
        assert rows[f"ur5: {name}: mean"].unit == ("rad" if "joints" in name else "px")
    assert rows["learned from one camera, 50 samples: mean"].ours == pytest.approx(3.0)
    assert rows["learned from one camera, 50 samples: mean"].paper == 1.231
    assert rows["learned from one camera, 20 samples: mean"].paper is None
    assert drawn["paper"] == [0.0536, 0.0519, 1.1441, 1.6608]
    assert drawn["ur5, mean"] == [4.0] * 4
    assert np.isnan(drawn["ur5, perfect, mean"]).all()


def test_perfect_inference_stands_beside_ours_where_it_is_known(ran):
    name = "one camera: reprojection"
    bounds = [{f"{name}, perfect": np.array([0.25, 0.5, 3.0])}, {f"{name}, perfect": np.array([0.25])}]
    rows, drawn, _ = ran(ERRORS, bounds, samples=50, learn_from=[50])
    assert (rows[f"ur5: {name}, perfect: mean"].ours, rows[f"ur5: {name}, perfect: median"].ours) == (1.0, 0.375)
    assert rows[f"ur5: {name}, perfect: mean"].paper is None
    np.testing.assert_array_equal(drawn["ur5, perfect, mean"], [np.nan, np.nan, np.nan, 1.0])


@pytest.mark.parametrize(("samples", "learn_from"), [(50, [20, 70]), (50, [20]), (10, [70])])
def test_every_model_learns_from_as_many_samples_as_told(ran, samples, learn_from):
    _, _, fitted = ran(ERRORS, [{}, {}], samples=samples, learn_from=learn_from)
    assert fitted == [one for seed in (1, 2) for one in [(seed, samples, 2), *((seed, few, 1) for few in learn_from)]]
