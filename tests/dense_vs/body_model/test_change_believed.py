"""Which change is believed by told agreements, where patches lie on the body, and the least squares step by step."""

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_arm import CENTER, FOCAL, TexturedArm, postures

from dense_vs.body_model import ChangeKind
from dense_vs.body_model.find_change import _Search, _Sightings, _simplest, _stepped

MODULE = import_module("dense_vs.body_model.find_change")
ARM = TexturedArm()
MODEL = ARM.model()
N, J, C, S = ChangeKind.NOTHING, ChangeKind.JOINT, ChangeKind.CAMERA, ChangeKind.JOINTS
TURN, SHIFT = np.array([0.03, -0.05, 0.04]), np.array([0.02, 0.01, -0.04])
OFFSETS = np.array([0.06, -0.04, 0.05])


def search(images=(), joints=None):
    return _Search(MODEL, list(images), np.zeros((0, 3)) if joints is None else joints)


def believed(monkeypatch, agreements, kinds=(J, J, C, S), patches=20):
    """The change found where these guesses, and nothing before them, agree so much."""
    one = search()
    guesses = [replace(one._nothing(), kind=kind, offsets=np.full(3, 0.1 * k)) for k, kind in enumerate(kinds, start=1)]
    monkeypatch.setattr(one, "_agreement", lambda guess: (agreements[round(10 * guess.offsets[0])], patches))
    monkeypatch.setattr(one, "_sightings", lambda guess, reach: SimpleNamespace(off=7.0))
    monkeypatch.setattr(one, "_open", lambda nothing, first: guesses)
    monkeypatch.setattr(one, "_searched", lambda guess: guess)
    return one.found()


def numbers(change):
    return change.kind, round(10 * change.offsets[0]), change.agreement


def test_twenty_patches_are_enough_to_say_something(monkeypatch):
    change = believed(monkeypatch, [0.6, 0.9, 0.8, 0.8, 0.8])
    assert numbers(change) == (J, 1, 0.9)
    assert (change.agreement_before, change.off, change.patches) == (0.6, 7.0, 20)
    change = believed(monkeypatch, [0.6, 0.9, 0.8, 0.8, 0.8], patches=19)
    assert numbers(change) == (ChangeKind.UNKNOWN, 0, 0.6)
    assert (change.agreement_before, change.off, change.patches) == (0.6, 0.0, 0)


@pytest.mark.parametrize(("best", "kind"), [(0.7, J), (np.nextafter(0.7, 0), ChangeKind.UNKNOWN)])
def test_below_an_agreement_of_seven_tenths_no_change_is_believed(monkeypatch, best, kind):
    change = believed(monkeypatch, [0.3, 0.5, best, 0.4, best + 0.01])
    assert change.kind is kind
    assert change.agreement == (best if kind is J else best + 0.01)
    assert change.agreement_before == 0.3
    assert not change.rivals


@pytest.mark.parametrize(
    ("kinds", "agreements", "rivals"),
    [
        ((J, J, C, S), (0.4, 0.9, 0.9 - 0.005, 0.9, 0.9), [2, 3]),
        ((J, J, C, S), (0.4, 0.9, np.nextafter(0.9 - 0.005, 0), 0.5, 0.9), []),
        ((J, C), (0.4, 0.6, 0.9), []),
        ((C, J, J), (0.4, 0.9, 0.8, 0.7), []),
        ((J, S), (0.4, 0.6, 0.9), []),  # zeros of all joints have no rivals
        ((J, C), (0.9, 0.901, 0.901), []),  # nor has nothing
    ],
)
def test_rivals_are_other_changes_of_one_joint_or_the_camera_after_which_images_look_alike(
    monkeypatch, kinds, agreements, rivals
):
    change = believed(monkeypatch, agreements, kinds)
    assert [numbers(one) for one in change.rivals] == [(kinds[k - 1], k, agreements[k]) for k in rivals]
    assert all((one.agreement_before, one.off, one.patches) == (0.4, 7.0, 20) for one in change.rivals)


@pytest.mark.parametrize(
    ("kinds", "agreements", "chosen"),
    [
        ([N, J, S], [0.4, 0.9, 0.9 + 0.02], 1),
        ([N, J, S], [0.4, 0.9, np.nextafter(0.9 + 0.02, 1)], 2),
        ([N, J, C], [0.4, 0.9 - 0.02, 0.9], 1),
        ([N, J, C], [0.4, np.nextafter(0.9 - 0.02, 0), 0.9], 2),
    ],
)
def test_at_the_border_the_simpler_change_is_believed(kinds, agreements, chosen):
    assert _simplest(kinds, agreements) == chosen


def test_the_agreement_is_the_mean_over_the_patches_of_all_images(monkeypatch):
    told = iter([np.array([0.9, 0.5]), np.array([0.4]), np.zeros(0), np.zeros(0)])
    monkeypatch.setattr(MODULE, "correlations", lambda body, q, image: next(told))
    one = search(["a", "b"], np.zeros((2, 3)))
    assert one._agreement(one._nothing()) == (pytest.approx(0.6), 3)
    assert one._agreement(one._nothing()) == (0.0, 0)


def test_of_many_joints_four_that_explain_most_are_looked_at_again(monkeypatch):
    one = search()
    costs = np.array([0.5, 0.2, 0.9, 0.1, 0.4, 0.3])
    nothing = replace(one._nothing(), offsets=np.zeros(6))
    monkeypatch.setattr(one, "_model", SimpleNamespace(learned=np.ones(6, bool)))
    monkeypatch.setattr(
        one, "_fitted", lambda guess, seen, turn: replace(guess, cost=costs[guess.joints[0]] if guess.joints else 0.7)
    )
    opened = one._open(nothing, some_sightings())
    assert [guess.joints for guess in opened] == [(3,), (1,), (5,), (4,), (), tuple(range(6))]
    assert [guess.camera for guess in opened] == [False] * 4 + [True, False]


def test_a_guess_says_nothing_that_is_not_known_yet():
    change = search()._nothing().change(MODEL)
    assert (change.agreement, change.agreement_before, change.off, change.patches, change.rivals) == (0, 0, 0, 0, ())
    assert search()._nothing().cost == 0.0


def test_patches_lie_on_the_surface_in_the_home_posture():
    """Of a guess that has moved camera and joints, drawn and seen there."""
    readings = postures(2)
    images = [ARM.image(q - OFFSETS, TURN, SHIFT).astype(np.float32) for q in readings]
    one = search(images, readings)
    rotation = Rotation.from_rotvec(TURN).as_matrix()
    guess = replace(one._nothing(), camera=True, joints=(0, 1, 2), offsets=OFFSETS, rotation=rotation, shift=SHIFT)
    seen = one._sightings(guess, 3)
    assert len(seen.links) > 40
    assert np.array_equal(np.unique(seen.joints, axis=0), np.unique(readings, axis=0))
    for link in range(3):
        own = MODEL.surface.points[MODEL.surface.links == link]
        home = seen.home[seen.links == link]
        assert len(home)
        apart = np.linalg.norm(home[:, None] - own, axis=2).min(axis=1)
        assert np.quantile(apart, 0.8) < 0.6 / FOCAL  # half a pixel, but at edges that are filled
    there = np.array(
        [
            ARM.pixels(point[None], [link], q - OFFSETS, TURN, SHIFT)[0]
            for point, link, q in zip(seen.home, seen.links, seen.joints, strict=True)
        ]
    )
    assert np.median(np.linalg.norm(there - seen.places, axis=1)) < 0.3
    assert seen.off < 0.3


def some_sightings(count=24):
    rng = np.random.default_rng(4)
    chosen = rng.choice(len(MODEL.surface.points), count)
    home, links = MODEL.surface.points[chosen].astype(float), MODEL.surface.links[chosen]
    readings = postures(4)[np.arange(count) % 4]
    readings[:, 0] = 0.1  # in one joint all are alike
    places = np.array([ARM.pixels(p[None], [k], q - OFFSETS)[0] for p, k, q in zip(home, links, readings, strict=True)])
    places += rng.normal(0, 2.0, places.shape)
    places[::6] += 25.0
    return _Sightings(home, links, readings, places, rng.uniform(0.1, 1, count), np.tile(np.eye(2), (count, 1, 1)), 0.0)


@pytest.mark.parametrize(
    ("camera", "joints", "turn"), [(True, (), 0), (False, (1,), 2), (False, (0, 1, 2), 1), (True, (2,), 0)]
)
def test_a_guess_is_fitted_by_twelve_damped_steps_that_believe_less_and_less(camera, joints, turn):
    one, seen = search(), some_sightings()
    guess = replace(one._nothing(), camera=camera, joints=joints)
    found = one._fitted(guess, seen, turn)
    depth = np.median(seen.home[:, 2])
    usual = [0.5] * 6 * camera + [1.0] * len(joints)
    scale = [15, 5, 2][turn]  # 24, 8 and 3 px of an image 320 wide
    for _ in range(12):
        errors, slopes = one._linearized(guess, seen, depth)
        square = (errors**2).sum(axis=1)
        left, right = np.diag([1 / size**2 for size in usual]), np.zeros(len(usual))
        for weight, error, slope, off in zip(seen.weights, errors, slopes, square, strict=True):
            trust = weight / (1 + off / scale**2) ** 2
            left, right = left + trust * slope.T @ slope, right + trust * slope.T @ error
        guess = _stepped(guess, np.linalg.solve(left, right), depth)
        scale = max(1.5, 0.7 * scale)
    np.testing.assert_allclose(found.offsets, guess.offsets, atol=1e-9)
    np.testing.assert_allclose(found.rotation, guess.rotation, atol=1e-9)
    np.testing.assert_allclose(found.shift, guess.shift, atol=1e-9)
    cost = (seen.weights * np.minimum(square / 9.0, 1)).sum() / seen.weights.sum()
    assert found.cost == pytest.approx(cost, rel=1e-6)


def test_errors_are_those_of_each_reading_and_of_what_is_before_the_camera():
    seen = some_sightings()
    errors, _ = search()._linearized(replace(search()._nothing(), joints=(1,), offsets=OFFSETS), seen, 1.0)
    there = [
        ARM.pixels(p[None], [k], q - OFFSETS)[0] for p, k, q in zip(seen.home, seen.links, seen.joints, strict=True)
    ]
    np.testing.assert_allclose(errors, seen.places - np.array(there), atol=1e-8)
    behind = replace(seen, home=np.tile([0.1, -0.2, -1.0], (24, 1)), links=np.zeros(24, int), joints=np.zeros((24, 3)))
    errors, _ = search()._linearized(replace(search()._nothing(), joints=(1,)), behind, 4.0)
    expected = FOCAL * np.array([0.1, -0.2]) / 4e-6 + np.array(CENTER)
    np.testing.assert_allclose(errors, seen.places - expected)
