"""Setups that drift or were changed, and random starts, on models and arms made by hand."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm
from dense_vs.sims.papers.gothoskar import drift, relearning, stages
from dense_vs.sims.papers.gothoskar.arm_trials import Trial

SEEDS = [3, 4]


def test_rows_of_a_drift():
    errors = np.zeros((2, 2, 11))
    errors[:, 0, -1], errors[:, 1, -1] = [5.0, 7.0], [1.0, 2.0]
    errors[:, 1, 0], errors[1, 1, 5] = [0.5, 0.7], 3.0
    rows = drift._rows("structure", 0.005, errors, (8, 2, 1), Namespace(seeds=SEEDS, samples=40))
    found, start = {row.name: row.ours for row in rows}, "structure drifts by 0.005 m:"
    assert found == {
        f"{start} error before, mean": pytest.approx(0.6),
        f"{start} error at the end, kept, mean": 6.0,
        f"{start} error at the end, followed, mean": 1.5,
        f"{start} error at the end, followed, worst": 2.0,
        f"{start} worst error on the way, followed": 3.0,
        f"{start} steps in 80 observations": 8.0,
        f"{start} of 2 drifts, taken for a moved camera": 1.0,
        "structure: steps in 80 observations without a drift": 2.0,
    }
    lens = drift._rows("camera:1", 0.01, errors, (8, 2, 1), Namespace(seeds=SEEDS, samples=40))
    assert lens[0].name.startswith("camera:1 drifts by 0.01 of its lens:")


def test_drifts_are_run_with_and_without_a_change(monkeypatch, tmp_path):
    asked, drawn = [], []

    def follow(trial, model, what, size, samples, rng):
        asked.append((trial, what, size, samples))
        drawn.append(rng.normal())
        return np.full((2, 11), 10.0 * trial + size), 3 if size else 1, size > 0 and trial == 2

    monkeypatch.setattr(drift, "trials", lambda _: [Number(1), Number(2)])
    monkeypatch.setattr(drift, "follow", follow)
    monkeypatch.setattr(drift, "draw_lines", lambda *_, **__: None)
    monkeypatch.setattr(GenerativeModel, "fit", lambda observations, seed: "model")
    options = {"cameras": 2, "samples": 40, "slip": 0.005, "warm": 0.01, "seeds": SEEDS, "out": tmp_path}
    found = {row.name: row.ours for row in drift.run(Namespace(**options))}
    assert asked[:4] == [(1, "structure", 0.0, 40), (1, "structure", 0.005, 40), (2, "structure", 0.0, 40),
                         (2, "structure", 0.005, 40)]  # fmt: skip
    assert asked[4:] == [(trial, "camera:1", 2 * size, samples) for trial, _, size, samples in asked[:4]]
    # Each drift is of its own numbers, the one without a change of the same.
    first, second = (np.random.default_rng(purpose).normal(size=2).tolist() for purpose in (80, 81))
    assert drawn == [*first, *first, *second, *second]
    assert found["structure drifts by 0.005 m: error before, mean"] == pytest.approx(15.005)
    assert found["structure drifts by 0.005 m: steps in 80 observations"] == 6
    assert found["structure: steps in 80 observations without a drift"] == 2
    assert found["camera:1 drifts by 0.01 of its lens: of 2 drifts, taken for a moved camera"] == 1
    for border in ({"slip": 0.1, "warm": 0.2, "samples": 10}, {"slip": 0.0, "warm": 0.0}):
        assert len(drift.run(Namespace(**{**options, **border}))) == 16
    for wrong in ({"cameras": 1}, {"samples": 9}, {"slip": -0.1}, {"slip": 0.2}, {"warm": 0.3}):
        with pytest.raises(DenseVSError, match=next(iter(wrong))):
            drift.run(Namespace(**{**options, **wrong}))


class Number(int):
    """A trial that is its number."""

    seed = 0

    def evidence(self, samples):
        assert samples == 50
        return SimpleNamespace(observations=None)

    def rng(self, purpose):
        return np.random.default_rng(purpose)


@pytest.mark.parametrize(("ignored_from", "steps", "gave_up"), [(99, 20, False), (5, 5, True)])
def test_a_drift_is_followed_after_every_observation(monkeypatch, ignored_from, steps, gave_up):
    """Every second call follows; errors are the size of the drift, and a tenth of it followed."""
    from dense_vs.sims.marked_arm import evidence

    class Online:
        def __init__(self, capacity):
            assert capacity == 20
            self.added = 0

        @property
        def ignored(self):
            return self.added > 2 * ignored_from

        def add(self, joints, pixels):
            self.added += 1

        def follow(self, what):
            assert what == "structure"
            if self.added % 2:
                model.again.parameters = object()

    class Again:
        def __init__(self, *_, **__):
            model.again = self
            self.parameters = object()

        def online(self, capacity):
            return Online(capacity)

    model = SimpleNamespace(
        parameters=SimpleNamespace(copy=lambda: None), postures=None, report=None, image_sizes=None, again=None
    )
    monkeypatch.setattr("dense_vs.generative.GenerativeModel", Again)
    monkeypatch.setattr(drift, "replace", lambda report: report)
    monkeypatch.setattr(drift, "drifted_arm", lambda arm, what, size, way: size)
    monkeypatch.setattr(evidence, "draw_joints", lambda arm, count, rng, postures: count)

    def observed(arm, joints, rng):
        return SimpleNamespace(observations=SimpleNamespace(joints=[joints], pixels=[None], size=arm))

    monkeypatch.setattr(evidence, "observe", observed)
    monkeypatch.setattr(drift, "held_out_error", lambda one, seen: seen.size * (1.0 if one is model else 0.1))
    trial = SimpleNamespace(observed_arm=lambda: None, postures="normal")
    errors, taken, lost = drift.follow(trial, model, "structure", 4.0, 40, np.random.default_rng(0))
    np.testing.assert_allclose(errors, [np.linspace(0, 4, 11), np.linspace(0, 0.4, 11)])
    assert (taken, lost) == (steps, gave_up)


@pytest.fixture(scope="module")
def trial():
    return Trial("ur5", 2, 2, "normal")


def test_changes_of_a_setup_change_one_part(trial):
    before = trial.observed_arm()
    moved = relearning._changed(trial, "moved camera", np.random.default_rng(0))
    assert moved.cameras[0].T_camera_world.tolist() == before.cameras[0].T_camera_world.tolist()
    assert not np.allclose(moved.cameras[1].T_camera_world, before.cameras[1].T_camera_world)
    knock = moved.cameras[1].T_camera_world @ np.linalg.inv(before.cameras[1].T_camera_world)
    assert np.linalg.norm(knock[:3, 3]) == pytest.approx(0.1)
    assert np.arccos((np.trace(knock[:3, :3]) - 1) / 2) == pytest.approx(0.15)
    added = relearning._changed(trial, "added camera", np.random.default_rng(0))
    assert len(added.cameras) == 3
    elsewhere = make_observed_arm("ur5", seed=1002, cameras=1).cameras[0]  # drawn from a seed that no trial has
    assert added.cameras[2].T_camera_world.tolist() == elsewhere.T_camera_world.tolist()
    np.testing.assert_array_equal(added.features, before.features)
    other = relearning._changed(trial, "structure", np.random.default_rng(0))
    assert other.features.tolist() == make_observed_arm("ur5", seed=2, feature_seed=1002).features.tolist()
    assert not np.allclose(other.features, before.features)
    assert len(other.cameras) == 2
    angles, shifts = [], []
    for seed in range(60):
        based = relearning._changed(trial, "base", np.random.default_rng(seed))
        moves = [
            np.linalg.inv(b.T_camera_world) @ a.T_camera_world
            for a, b in zip(based.cameras, before.cameras, strict=True)
        ]
        np.testing.assert_allclose(moves[0], moves[1], atol=1e-9)
        angles.append(np.arccos((np.trace(moves[0][:3, :3]) - 1) / 2))
        shifts.append(moves[0][:3, 3])
    assert np.sqrt(np.mean(np.square(angles)) / 3) == pytest.approx(0.03, rel=0.25)
    assert np.std(shifts) == pytest.approx(0.03, rel=0.25)
    kept = relearning._changed(trial, "kinematics", np.random.default_rng(0))
    np.testing.assert_array_equal(kept.features, before.features)


def test_lenses_that_were_known_stay_and_that_of_an_added_camera_is_guessed(monkeypatch, trial):
    """The guess of a maker for any camera: its own lens, and 0.5 more in every number."""
    from dense_vs.sims.marked_arm import evidence

    asked, known = [], np.arange(8.0).reshape(2, 4) + 600

    def guess(arm, rng):
        asked.append(len(arm.cameras))
        return np.array([camera.intrinsics for camera in arm.cameras]) + 0.5

    monkeypatch.setattr(evidence, "guessed_intrinsics", guess)
    for part, cameras in (("moved camera", 2), ("structure", 2), ("added camera", 3)):
        seen, held_out = relearning.new_setup(trial, part, known, 3)
        for one, samples in ((seen, 3), (held_out, 100)):
            assert one.observations.pixels.shape[:2] == (samples, cameras)
            np.testing.assert_array_equal(one.observations.intrinsics[:2, :4], known)
        assert asked == ([3] if part == "added camera" else [])
    third = seen.truth.arm.cameras[2].intrinsics + 0.5
    np.testing.assert_array_equal(seen.observations.intrinsics[2, :4], third)
    np.testing.assert_array_equal(held_out.observations.intrinsics[2, :4], third)


def test_rows_of_relearning(monkeypatch, tmp_path):
    monkeypatch.setattr(relearning, "PARTS", {"moved camera": "camera:1", "base": "base"})
    monkeypatch.setattr(relearning, "draw_lines", lambda *_, **__: None)
    monkeypatch.setattr(GenerativeModel, "fit", lambda observations, seed: "model")
    bounds = []

    def bound(seen, held_out, rng, camera):
        bounds.append((seen, camera))
        return SimpleNamespace(noisy=np.array([0.5, 4.0]))

    monkeypatch.setattr("dense_vs.sims.marked_arm.cramer_rao.cramer_rao", bound)
    evidence = SimpleNamespace(first=lambda samples: samples, observations=SimpleNamespace(intrinsics=np.zeros((2, 9))))

    def one(number):
        return SimpleNamespace(seed=number, evidence=lambda samples: evidence, rng=lambda _: None)

    monkeypatch.setattr(relearning, "trials", lambda _: [one(0), one(1)])
    monkeypatch.setattr(relearning, "new_setup", lambda trial, part, intrinsics, samples: (evidence, evidence))
    found = iter([[np.inf, 1.0], [5.0, 3.0], [np.inf, 3.0], [np.inf, 1.0]])
    monkeypatch.setattr(relearning, "relearned_errors", lambda *_: next(found))
    options = {"samples": 50, "relearn_from": [3, 10], "seeds": SEEDS, "out": tmp_path}
    rows = {row.name: row.ours for row in relearning.run(Namespace(cameras=2, **options))}
    assert rows["moved camera, 3 samples: share refused"] == 1.0
    assert "moved camera, 3 samples: mean" not in rows
    assert rows["moved camera, 10 samples: mean"] == 2.0
    assert rows["moved camera, 10 samples: share below 2 px"] == 0.5
    assert rows["moved camera, 10 samples: bound (Cramer-Rao), mean"] == 2.25
    assert rows["base, 3 samples: share refused"] == 0.5
    assert rows["base, 3 samples: mean"] == 5.0  # of the other
    assert rows["base, 10 samples: worst"] == 3.0
    assert "base, 10 samples: share refused" not in rows
    assert not any(name.startswith("base") and "bound" in name for name in rows)
    assert bounds == [(3, 1), (10, 1)] * 2
    with pytest.raises(DenseVSError, match="--cameras is 3"):
        relearning.run(Namespace(cameras=3, **options))


def test_random_starts_have_the_hand_before_every_camera(monkeypatch, trial):
    """Nothing is known: points about 2 before the first camera; other cameras turned by 0.6 rad about and ahead."""
    from dense_vs.generative.learning import end_to_end

    given = {}

    def initial(kinematics, found, mean, intrinsics):
        given.update(kinematics=kinematics, mean=mean, intrinsics=intrinsics)
        return SimpleNamespace(
            features=np.zeros((5, 3)), intrinsics=np.zeros((3, 9)),
            camera_rotation=np.tile(np.eye(3), (3, 1, 1)), camera_translation=np.zeros((3, 3)),
        )  # fmt: skip

    monkeypatch.setattr(end_to_end, "initial_parameters", initial)
    found = SimpleNamespace(translation=np.array([[1.0, 1.0, 4.0], [np.nan] * 3, [3.0, 1.0, 6.0]]))
    joints, rng = np.array([[0.0, 1.0], [1.0, 3.0]]), np.random.default_rng(0)
    ahead, points, angles = [], [], []
    for _ in range(60):
        start = stages._random_start(found, joints, "guess", rng, False)
        np.testing.assert_allclose(np.linalg.norm(given["kinematics"].axes, axis=1), 1.0)
        points.append(given["kinematics"].points)
        np.testing.assert_array_equal(start.camera_rotation[0], np.eye(3))
        for camera in (1, 2):
            R, t = start.camera_rotation[camera], start.camera_translation[camera]
            ahead.append(R @ [0.0, 0.0, 2.0] + t)
            angles.append(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))
        points.append(start.features[:2])
    np.testing.assert_allclose(np.mean(ahead, axis=0), [0, 0, 2], atol=0.05)
    assert np.std(ahead, axis=0).max() == pytest.approx(0.1, rel=0.3)
    assert np.mean(angles) == pytest.approx(0.95, rel=0.15)
    np.testing.assert_allclose(np.mean(points, axis=(0, 1)), [0, 0, 2], atol=0.1)
    assert np.std(points[::2], axis=(0, 1)).max() == pytest.approx(0.3, rel=0.25)
    assert np.std(points[1::2], axis=(0, 1)).max() == pytest.approx(0.05, rel=0.25)
    np.testing.assert_array_equal(given["mean"], [0.5, 2.0])
    known = stages._random_start(found, joints, "guess", rng, True)
    np.testing.assert_array_equal(known.features, 0.0)
    np.testing.assert_array_equal(known.camera_translation, 0.0)
    np.testing.assert_allclose(given["kinematics"].home_translation, [2.0, 1.0, 5.0])


@pytest.mark.parametrize(("reconstructed", "cameras"), [(True, "learned"), (False, "guess")])
def test_random_kinematics_begin_with_the_cameras_that_are_known(monkeypatch, reconstructed, cameras):
    from dense_vs.generative.learning import end_to_end
    from dense_vs.generative.least_squares import pixel_problem
    from dense_vs.generative.reconstruction import bundle_adjustment, initialization, stereo

    costs, asked = iter([np.inf, 8.0]), []
    found = SimpleNamespace(placed_cameras=[True])
    monkeypatch.setattr(initialization, "guessed_intrinsics", lambda _: "guess")
    monkeypatch.setattr(stereo, "reconstruct", lambda *_: iter(["first"]))
    monkeypatch.setattr(bundle_adjustment, "adjust_bundle", lambda *_: (found, "learned", None, None))
    monkeypatch.setattr(pixel_problem, "PixelProblem", lambda *_: "problem")
    monkeypatch.setattr(end_to_end, "all_shared", lambda _: None)
    monkeypatch.setattr(end_to_end, "fit_pixels", lambda *_: [SimpleNamespace(cost=next(costs))])
    monkeypatch.setattr(stages, "_random_start", lambda _, joints, known, rng, flag: asked.append((known, flag)))
    seen = np.ones(4, bool)
    observations = SimpleNamespace(joints=np.zeros((2, 3)), pixels=np.zeros((1, 2, 4, 2)), seen=seen)
    trial = SimpleNamespace(rng=np.random.default_rng)
    assert stages._from_random(trial, observations, reconstructed=reconstructed) == 2.0  # the first start was none
    assert asked == [(cameras, reconstructed)] * 2
