"""The stages of learning between one another: which starts are tried, weights by hand, mistakes that lose theirs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exact_arm import SIZES, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.learning import end_to_end, fitting
from dense_vs.generative.learning.fitting import FitOptions
from dense_vs.generative.least_squares.levenberg_marquardt import Solution
from dense_vs.generative.least_squares.pixel_problem import PixelState
from dense_vs.generative.report import FitReport


def candidate(name, posed=10, cameras=(True, True), seen=(True,) * 4):
    structure = np.where(np.array(seen)[:, None], 1.0, np.nan) * np.ones((len(seen), 3))
    found = SimpleNamespace(posed=np.arange(12) < posed, placed_cameras=np.array(cameras), structure=structure)
    return SimpleNamespace(found=found, weights=f"weights of {name}", intrinsics=f"lens of {name}", name=name)


@pytest.fixture
def chained(monkeypatch):
    """Chains whose errors are told, by candidate."""
    asked = []

    def set_to(**rms):
        def fit(joints, found, rng):
            asked.append(joints)
            name = found.name
            return [SimpleNamespace(rms=one, name=f"{name}{k}") for k, one in enumerate(rms[name])], f"stage {name}"

        monkeypatch.setattr(fitting, "fit_kinematics", fit)
        monkeypatch.setattr(fitting, "initial_parameters", lambda chain, found, home, lens: (chain.name, home, lens))
        return asked

    return set_to


def named(name, **options):
    one = candidate(name, **options)
    one.found.name = name
    return one


def test_starts_place_as_many_cameras_as_can_be_and_follow_the_rotations_best(chained):
    asked = chained(a=[0.5, 0.9], b=[0.1], c=[0.7])
    found = [named("a"), named("b", cameras=(True, False)), named("c", seen=(True, False, True, True))]
    starts, stage = fitting._assemble(found, np.full((12, 3), 2.0), np.full(3, 0.5), None)
    assert [start[0][0] for start in starts] == ["a0", "c0", "a1", "b0"]
    assert stage == "stage a"
    np.testing.assert_array_equal(asked[0], 1.5)
    (_, home, lens), weights, cameras, features = starts[1]
    assert (home.tolist(), lens, weights) == ([0.5] * 3, "lens of c", "weights of c")
    assert cameras.tolist() == [True, True]
    assert features.tolist() == [True, False, True, True]


@pytest.mark.parametrize(("posed", "enough"), [(2, False), (3, True)])
def test_three_posed_samples_are_enough(chained, posed, enough):
    chained(a=[0.5])
    if enough:
        assert len(fitting._assemble([named("a", posed=posed)], np.zeros((12, 3)), np.zeros(3), None)[0]) == 1
        return
    with pytest.raises(DenseVSError, match="known in fewer than 3 samples"):
        fitting._assemble([named("a", posed=posed)], np.zeros((12, 3)), np.zeros(3), None)


@pytest.fixture
def descended(monkeypatch):
    """End-to-end descents whose costs and errors are told; what they were asked is kept."""
    asked = []

    def set_to(costs, errors):
        def fit(problem, joints, starts):
            k = len(asked)
            asked.append((problem, starts[0]))
            state = SimpleNamespace(parameters=starts[0])
            return Solution(state, costs[k], 9.0, 5, True, 0.0), None

        monkeypatch.setattr(fitting, "fit_pixels", fit)
        monkeypatch.setattr(fitting, "coordinate_rms", lambda problem, cost: errors[len(asked) - 1])
        return asked

    return set_to


def of_hand(arm, starts, state="observed"):
    guess = arm.parameters.intrinsics
    observations = Observations(joints=arm.joints, pixels=arm.pixels, image_sizes=SIZES, feature_link=np.full(10, 3))
    return fitting._from_hand(observations, np.full(10, 3), arm.joints, starts, FitOptions(state=state), guess, 0.5)


def begun(arm, **changes):
    cameras, features = changes.get("cameras", [True, True]), changes.get("features", [True] * 10)
    weights = changes.get("weights", np.ones(arm.pixels.shape[:3]))
    return arm.parameters.copy(), weights, np.array(cameras), np.array(features)


@pytest.mark.parametrize(
    ("state", "errors", "tried"),
    [
        ("observed", [1.99], 1), ("observed", [2.0, 1.0], 2), ("noisy", [3.99], 1), ("noisy", [4.0, 1.0], 2),
        ("actions", [3.99], 1), ("observed", [9.0] * 12, 8),
    ],
)  # fmt: skip
def test_starts_are_tried_until_one_is_good(descended, state, errors, tried):
    """Below 2 px, or 4 where joints err; eight of them at most."""
    arm = exact_arm(samples=5)
    costs = [5.0, 3.0, 4.0, 3.5, 6.0, 2.5, 7.0, 8.0, 1.0, 1.0, 1.0, 1.0]
    asked = descended(costs, errors)
    starts = [begun(arm) for _ in range(12)]
    _, best = of_hand(arm, starts, state)
    assert len(asked) == tried
    assert best.cost == min(costs[:tried])


def test_what_was_not_placed_takes_no_part_and_is_unknown(descended):
    arm = exact_arm(samples=5)
    weights = np.full(arm.pixels.shape[:3], 0.25)
    weights[2, 0, 3] = 0.0
    asked = descended([5.0], [0.1])
    features = np.arange(10) != 6
    parameters, _ = of_hand(arm, [begun(arm, weights=weights, cameras=[True, False], features=features)])
    problem, _ = asked[0]
    expected = weights.copy()
    expected[2, 0, 3] = 1.0  # a candidate that left it out may have been wrong
    expected[:, 1], expected[:, :, 6] = 0.0, 0.0
    np.testing.assert_array_equal(problem.weights, expected)
    assert (problem.columns.features >= 0).tolist() == features.tolist()
    assert (problem.columns.cameras >= 0).tolist() == [False, False]  # the first is the world
    assert (problem.columns.intrinsics >= 0).tolist() == [True, False]
    assert (problem.columns.axes >= 0).all()
    assert np.isnan(parameters.features[6]).all()
    assert np.isfinite(parameters.features[features]).all()
    assert np.isnan(parameters.camera_translation[1]).all()
    assert np.isfinite(parameters.camera_translation[0]).all()


def test_a_descent_that_diverges_is_refused(descended):
    descended([np.inf, np.inf], [9.0, 9.0])
    arm = exact_arm(samples=5)
    with pytest.raises(DenseVSError, match="learning diverged"):
        of_hand(arm, [begun(arm), begun(arm)])


def test_weights_fall_with_errors_beyond_four_times_their_scale():
    """1 / (1 + (e / 4 s)^2), s the noise by the median error, of half a pixel at least."""
    arm = exact_arm(samples=5)
    for size in (0.01, 2.0):
        pixels = arm.pixels + size * np.random.default_rng(0).normal(size=arm.pixels.shape)
        pixels[3, 1, 4] += 30.0
        pixels[1, 0, 2] = np.nan
        observations = Observations(joints=arm.joints, pixels=pixels, image_sizes=SIZES)
        parameters = arm.parameters.copy()
        parameters.features[7] = np.nan
        parameters.features[8] = [0.0, 0.0, -30.0]  # behind both cameras
        problem = fitting._problem(observations, parameters.links, parameters, arm.joints, FitOptions(distortion=1),
                                   parameters.intrinsics, 0.5)  # fmt: skip
        errors = np.linalg.norm(project(arm.parameters, arm.joints) - pixels, axis=-1)
        errors[:, :, [7, 8]] = np.nan
        scale = max(np.nanmedian(errors) / 1.1774, 0.5)
        expected = np.nan_to_num(1 / (1 + (errors / (4 * scale)) ** 2))
        np.testing.assert_allclose(problem.weights, expected, rtol=1e-6)
        assert problem.columns.intrinsics_count == 5
        assert (problem.columns.features >= 0).tolist() == [True] * 7 + [False, True, True]
        assert parameters.features[7].tolist() == [0.0] * 3


def solved(arm, iterations=3):
    return Solution(PixelState(arm.parameters.copy(), arm.joints), 4.0, 9.0, iterations, True, 0.0)


def test_rejection_goes_on_until_the_same_detections_are_mistaken(monkeypatch):
    arm = exact_arm(samples=5)
    pixels = arm.pixels + 0.1 * np.random.default_rng(0).normal(size=arm.pixels.shape)
    pixels[2, 1, 3] += 20.0
    observations = Observations(joints=arm.joints, pixels=pixels, image_sizes=SIZES)
    problem = fitting._problem(observations, arm.parameters.links, arm.parameters.copy(), arm.joints, FitOptions(),
                               arm.parameters.intrinsics, 0.5)  # fmt: skip
    asked = []

    def minimize(problem, state, most):
        asked.append((problem.weights.copy(), most))
        return Solution(state, 3.0, 5.0, 7, True, 0.0)

    monkeypatch.setattr(fitting, "minimize", minimize)
    found = fitting._reject(problem, solved(arm), FitOptions())
    assert len(asked) == 1  # the second look finds the same
    assert asked[0][1] == 60
    assert np.argwhere(asked[0][0] == 0).tolist() == [[2, 1, 3]]
    assert found.iterations == 10
    calls = []
    flags = iter([[0], [1], [2], [3], [4], [5]])

    def changing(errors, sigma):
        wrong = np.zeros(errors.shape, bool)
        wrong[0, 0, next(flags)] = True
        calls.append(1)
        return wrong

    monkeypatch.setattr(fitting, "mistaken", changing)
    assert fitting._reject(problem, solved(arm, 0), FitOptions()).iterations == 28
    assert len(calls) == 4


def test_figures_are_of_what_was_used(monkeypatch):
    arm = exact_arm(samples=5)
    pixels = arm.pixels + 0.2 * np.random.default_rng(0).normal(size=arm.pixels.shape)
    pixels[2, 1, 3] += [20.0, 5.0]
    pixels[[0, 0], [0, 0], [4, 5]] = pixels[[0, 0], [0, 0], [5, 4]]
    observations = Observations(joints=arm.joints, pixels=pixels, image_sizes=SIZES)
    problem = fitting._problem(observations, arm.parameters.links, arm.parameters.copy(), arm.joints, FitOptions(),
                               arm.parameters.intrinsics, 0.5)  # fmt: skip
    weights = np.ones(pixels.shape[:3])
    weights[2, 1, 3] = weights[0, 0, 4] = weights[0, 0, 5] = 0.0
    problem.reweight(weights)
    told = []
    monkeypatch.setattr(fitting, "describe_unobservable", lambda *given: told.append(given[2:]) or ["nothing"])
    for state in ("observed", "actions"):
        report = FitReport(still_joints=[2])
        fitting._finish(report, observations, problem, solved(arm), FitOptions(state=state))
        errors = np.linalg.norm(arm.pixels - pixels, axis=-1)
        used = errors[weights > 0]
        assert report.rms_px == pytest.approx(np.sqrt(np.mean(used**2) / 2))
        assert report.mean_error_px == pytest.approx(used.mean())
        assert report.pixel_sigma == pytest.approx(np.median(used) / 1.1774)
        assert [(one.sample, one.camera, one.feature) for one in report.outliers] == [(0, 0, 4), (0, 0, 5), (2, 1, 3)]
        assert report.outliers[2].error_px == pytest.approx(errors[2, 1, 3])
        assert report.swapped == [(0, 0, 4, 5)]
        assert report.converged
        assert report.unobservable == ["nothing"]
    assert told == [(False, [2]), (True, [2])]


@pytest.mark.parametrize("state", ["noisy", "actions"])
def test_noise_is_fitted_before_and_after_mistakes_are_left_out(monkeypatch, state):
    arm = exact_arm(samples=5)
    observations = Observations(joints=arm.joints, actions=np.diff(arm.joints, axis=0), pixels=arm.pixels,
                                image_sizes=SIZES)  # fmt: skip
    events = []

    def fit(kind):
        def run(problem, state, given, pixel_sigma, sigma, *more):
            own = observations.joints if kind == "noisy" else observations.actions
            events.append((kind, state.joints[0, 0], given is own, pixel_sigma, sigma, more))
            return replace(solved(arm), state=replace(state, joints=state.joints + 1.0)), 0.01 * len(events)

        return run

    def reject(problem, best, options):
        events.append(("rejected", best.state.joints[0, 0]))
        return replace(best, state=replace(best.state, joints=best.state.joints + 10.0))

    monkeypatch.setattr(fitting, "fit_noisy_readings", fit("noisy"))
    monkeypatch.setattr(fitting, "fit_noisy_actions", fit("actions"))
    monkeypatch.setattr(fitting, "_reject", reject)
    options = FitOptions(state=state, state_sigma=0.3, proportional_noise=True)
    best, sigma, problem = fitting._with_noise(observations, arm.parameters.links, solved(arm), options,
                                               arm.parameters.intrinsics, 0.7, None)  # fmt: skip
    q, more = arm.joints[0, 0], () if state == "noisy" else (True,)
    assert [event[0] for event in events] == [state, "rejected", state]
    assert events[0][1:] == (q, True, 0.7, 0.3, more)
    assert events[1][1] == q + 1
    assert events[2][1:] == (q + 11, True, 0.7, 0.3, more)
    assert sigma == 0.03
    assert best.state.joints[0, 0] == q + 12
    assert problem.local == "joints"


# Stage 2, from poses.


def posed_arm(samples=12, noise=0.0):
    arm = exact_arm(samples=samples)
    p, rng = arm.parameters, np.random.default_rng(3)
    rotation, translation = [], []
    for q in arm.joints:
        turn, place = Rotation.identity(), np.zeros(3)
        for axis, point, angle in reversed(list(zip(p.axes, p.points, q - p.home, strict=True))):
            one = Rotation.from_rotvec(angle * axis)
            turn, place = one * turn, one.apply(place - point) + point
        rotation.append((Rotation.from_rotvec(noise * rng.normal(size=3)) * turn).as_matrix())
        translation.append(place)
    found = SimpleNamespace(rotation=np.array(rotation), translation=np.array(translation), structure=p.features,
                            posed=np.ones(samples, bool), camera_rotation=p.camera_rotation,
                            camera_translation=p.camera_translation)  # fmt: skip
    return arm, found


def test_a_chain_follows_exact_poses():
    arm, found = posed_arm()
    found.posed[4] = False
    found.rotation[4] = Rotation.from_rotvec([0.5, 0.5, 0.5]).as_matrix()
    q = arm.joints - arm.parameters.home
    fits, stage = end_to_end.fit_kinematics(q, found, np.random.default_rng(0), starts=9)
    np.testing.assert_allclose(fits[0].axes, arm.parameters.axes, atol=1e-5)
    across = np.cross(fits[0].points - arm.parameters.points, arm.parameters.axes)
    np.testing.assert_allclose(across, 0.0, atol=1e-4)
    assert fits[0].rms < 1e-5
    assert (stage.name, stage.iterations, stage.converged) == ("kinematics", 0, True)
    at_rest = [Rotation.from_matrix(R * 1.0 @ fits[0].home_rotation.T).magnitude() for R in found.rotation[found.posed]]
    assert stage.initial_loss == pytest.approx(np.sum(np.square(at_rest)))
    assert stage.loss == pytest.approx(0.0, abs=1e-8)
    p = end_to_end.initial_parameters(fits[0], found, arm.parameters.home, arm.parameters.intrinsics)
    np.testing.assert_allclose(p.features, arm.parameters.features, atol=1e-4)
    whole = replace(arm.parameters, axes=p.axes, points=p.points, features=p.features, links=p.links)
    np.testing.assert_allclose(project(whole, arm.joints)[:, :, :8], arm.pixels[:, :, :8], atol=0.05)
    assert p.links.tolist() == [3] * 10
    assert p.home is arm.parameters.home


@pytest.mark.parametrize(
    ("costs", "tried", "best"),
    [
        ([7.0, 5.0, 6.0], 3, 1), ([5.0, 7.0, 6.0], 3, 0), ([7.0, 6.0, 5.0], 3, 2), ([6.0, 6.0, 7.0], 3, 0),
        ([7.0, 3.9, 1.0], 2, 1), ([4.0, 4.5, 3.0], 3, 2), ([3.9], 1, 0), ([np.inf, 9.0], 2, 1),
    ],
)  # fmt: skip
def test_candidates_are_fitted_until_one_explains_the_pixels_and_the_best_is_kept(monkeypatch, costs, tried, best):
    """One of a cost below 4 leaves less than 2 px a coordinate, two of half a pixel being seen."""
    asked = []

    def fit(problem, state, iterations):
        asked.append((state.parameters, state.joints, iterations))
        return Solution(state, costs[len(asked) - 1], 99.0, 5, True, 0.0)

    monkeypatch.setattr(end_to_end, "minimize", fit)
    problem = SimpleNamespace(weights=np.array([0.25, 0.25]))
    names = ["first", "second", "third"][: len(costs)]
    found, which = end_to_end.fit_pixels(problem, "joints", names, 17)
    assert asked == [(name, "joints", 17) for name in names[:tried]]
    assert which == best
    assert (found.state.parameters, found.cost) == (names[best], costs[best])
