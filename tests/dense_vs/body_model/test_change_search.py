"""The steps of the search for a change: which patches count, the least squares, and its slopes by differences."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_arm import TexturedArm, postures

from dense_vs.body_model import ChangeKind
from dense_vs.body_model.drawn_patches import SeenPatches
from dense_vs.body_model.find_change import (
    REACHES,
    TRIED,
    _Guess,
    _median,
    _off,
    _Search,
    _Sightings,
    _simplest,
    _stepped,
    _weights,
)

ARM = TexturedArm()
MODEL = ARM.model()
TURN, SHIFT = np.array([0.03, -0.05, 0.04]), np.array([0.02, 0.01, -0.04])
OFFSETS = np.array([0.06, -0.04, 0.05])


def search():
    return _Search(MODEL, [], np.zeros((0, 3)))


def nothing(**known):
    return replace(search()._nothing(), **known)


def sightings(
    offsets=(0, 0, 0), turn=(0, 0, 0), shift=(0, 0, 0), count=60, links=(0, 1, 2), weights=None, directions=None
):
    """Points of some links at four postures, seen where the changed body has them."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(np.flatnonzero(np.isin(MODEL.surface.links, links)), count)
    home, links = MODEL.surface.points[chosen].astype(float), MODEL.surface.links[chosen]
    readings = postures(4)[np.arange(count) % 4]
    places = np.array(
        [
            ARM.pixels(point[None], link[None], q - offsets, turn, shift)[0]
            for point, link, q in zip(home, links, readings, strict=True)
        ]
    )
    weights = np.ones(count) if weights is None else weights
    directions = np.tile(np.eye(2), (count, 1, 1)) if directions is None else directions
    return _Sightings(home, links, readings, places, weights, directions, 0.0)


def test_patches_count_by_how_much_they_look_alike():
    patches = SeenPatches(np.zeros((5, 2), int), np.zeros((5, 2)), np.array([0.3, 0.5, 0.7, 0.9, 1.0]))
    np.testing.assert_allclose(_weights(patches), [0, 0, 0.5, 1, 1])


def test_what_patches_are_off_is_of_those_that_are_seen():
    pixels, places = np.array([[10, 20], [30, 40], [50, 60]]), np.array([[13.0, 24.0], [0.0, 0.0], [50.0, 59.0]])
    off = _off(SeenPatches(pixels, places, np.array([0.8, 0.5, 0.6])))
    np.testing.assert_allclose(off, [5.0, 1.0])
    assert _median([off, np.array([7.0])]) == 5.0
    assert _median([np.zeros(0)]) == 0.0


@pytest.mark.parametrize("width", [40, 320, 3200])
def test_patches_are_sought_as_far_as_the_image_is_wide(width):
    of_size = _Search(SimpleNamespace(size=(width * 3 // 4, width)), [], np.zeros((0, 3)))
    assert of_size._reaches == [max(2, round(reach * width / 320)) for reach in (24, 8, 3)]
    assert REACHES == (24, 8, 3)


@pytest.mark.parametrize(("camera", "joints"), [(True, ()), (False, (1,)), (False, (0, 1, 2)), (True, (0, 2))])
def test_errors_are_those_of_the_changed_body_and_slopes_their_differences(camera, joints):
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(60, 2, 2))
    seen = sightings(directions=directions)
    guess = nothing(camera=camera, joints=joints, offsets=OFFSETS, shift=SHIFT)
    guess = replace(guess, rotation=Rotation.from_rotvec(TURN).as_matrix())
    depth = 0.9
    errors, slopes = search()._linearized(guess, seen, depth)
    there = sightings(OFFSETS, TURN, SHIFT).places
    np.testing.assert_allclose(errors, np.einsum("kij,kj->ki", directions, seen.places - there), atol=1e-8)
    count = 6 * camera + len(joints)
    assert slopes.shape == (60, 2, count)
    for c in range(count):
        less, more = (
            search()._linearized(_stepped(guess, by * np.eye(count)[c], depth), seen, depth)[0] for by in (-1e-6, 1e-6)
        )
        np.testing.assert_allclose(slopes[:, :, c], (less - more) / 2e-6, rtol=1e-5, atol=1e-4)


def test_a_step_is_of_the_camera_first_and_then_of_the_joints():
    step = np.array([0.1, 0.2, -0.3, 0.01, 0.02, 0.03, 0.5, -0.6])
    after = _stepped(nothing(camera=True, joints=(0, 2), offsets=OFFSETS, shift=SHIFT), step, depth=2.0)
    np.testing.assert_allclose(after.rotation, Rotation.from_rotvec(step[:3]).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(after.shift, SHIFT + 2 * step[3:6])
    np.testing.assert_allclose(after.offsets, OFFSETS + np.array([0.5, 0, -0.6]))
    only = _stepped(nothing(joints=(1,)), np.array([0.5]), depth=2.0)
    np.testing.assert_allclose(only.offsets, [0, 0.5, 0])
    np.testing.assert_array_equal(only.rotation, np.eye(3))


@pytest.mark.parametrize(("joint", "offset"), [(0, 0.12), (1, -0.15), (2, 0.2)])
def test_the_offset_of_a_joint_is_found_among_gross_errors(joint, offset):
    rng = np.random.default_rng(3)
    seen = sightings(offset * np.eye(3)[joint], count=90)
    wrong = np.arange(90) % 3 == 0
    angles = rng.uniform(0, 2 * np.pi, 90)
    away = rng.uniform(30, 60, 90)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    seen = replace(seen, places=seen.places + wrong[:, None] * away)
    found = search()._fitted(nothing(kind=ChangeKind.JOINT, joints=(joint,)), seen, 0)
    np.testing.assert_allclose(found.offsets, offset * np.eye(3)[joint], atol=2e-3)
    assert found.cost == pytest.approx(1 / 3, abs=0.02)  # a gross error counts as one, a right place as none


def test_what_a_guess_leaves_is_counted_by_weight_up_to_three_pixels():
    seen = sightings(count=4, links=[0], weights=np.array([1.0, 2.0, 0.0, 1.0]))
    last = nothing(joints=(2,))  # which does not move the first link
    off = np.array([[1.5, 0.0], [0.0, -0.3], [99.0, 0.0], [0.0, 30.0]])
    left = search()._fitted(last, replace(seen, places=seen.places + off), 0)
    assert left.cost == pytest.approx((1.0 * 0.25 + 2.0 * 0.01 + 1.0 * 1.0) / 4)
    nowhere = search()._fitted(last, replace(seen, weights=np.zeros(4)), 0)
    assert nowhere.cost == 0.0


def test_places_that_do_not_count_do_not_pull():
    seen = sightings(OFFSETS * [0, 1, 0], count=60)
    other = sightings(-OFFSETS * [0, 1, 0], count=60)
    counted = np.arange(60) % 2 == 0
    places = np.where(counted[:, None], seen.places, other.places)
    mixed = replace(seen, places=places, weights=counted.astype(float))
    found = search()._fitted(nothing(joints=(1,)), mixed, 0)
    np.testing.assert_allclose(found.offsets, OFFSETS * [0, 1, 0], atol=2e-3)


@pytest.mark.parametrize(
    ("learned", "kinds"),
    [
        ((True, False, False), ["JOINT", "CAMERA"]),
        ((True, False, True), ["JOINT", "JOINT", "CAMERA", "JOINTS"]),
        ((True, True, True), ["JOINT", "JOINT", "JOINT", "CAMERA", "JOINTS"]),
    ],
)
def test_what_may_have_changed(learned, kinds, monkeypatch):
    one = search()
    monkeypatch.setattr(one, "_model", ARM.model())
    one._model.learned = np.array(learned)
    opened = one._open(one._nothing(), sightings(0.1 * np.eye(3)[2]))
    assert [guess.kind.name for guess in opened] == kinds
    assert len(kinds) <= TRIED + 2
    singles = [guess.joints for guess in opened if guess.kind is ChangeKind.JOINT]
    assert sorted(singles) == [(n,) for n in np.flatnonzero(learned)]
    if len(singles) > 1:
        assert singles[0] == (2,)  # the one that explains most is the first
    assert all(guess.camera == (guess.kind is ChangeKind.CAMERA) for guess in opened)


@pytest.mark.parametrize(("before", "chosen"), [(0.5, 0), (0.4999, 1)])
def test_a_gain_of_a_fiftieth_is_none(before, chosen):
    assert _simplest([ChangeKind.NOTHING, ChangeKind.JOINT], [before, 0.52]) == chosen


def test_a_guess_is_said_in_the_units_of_the_joints():
    slides = TexturedArm(slides=True).model()
    guess = _Guess(ChangeKind.JOINT, (2,), False, np.array([0, 0, 0.03]), np.eye(3), np.zeros(3))
    assert guess.change(slides).units == ("rad", "rad", "m")


@pytest.mark.parametrize(("counts", "fitted"), [((20, 20), 2), ((19, 20), 0), ((20, 19), 1)])
def test_a_guess_is_looked_for_nearer_and_nearer_as_long_as_twenty_patches_are_seen(monkeypatch, counts, fitted):
    one, told, asked = search(), iter(counts), []
    monkeypatch.setattr(one, "_reaches", [24, 8, 3])

    def seen(guess, reach):
        asked.append((guess.cost, reach))
        return SimpleNamespace(links=np.zeros(next(told), int))

    monkeypatch.setattr(one, "_sightings", seen)
    monkeypatch.setattr(one, "_fitted", lambda guess, seen, turn: replace(guess, cost=float(turn)))
    found = one._searched(nothing(cost=0.5))
    assert found.cost == (0.5, 1.0, 2.0)[fitted]
    assert asked == [(0.5, 8), (1.0, 3)][: min(fitted + 1, 2)]
