"""Features that went out of sight, found again on a textured plane that is turned and moved by known amounts."""

import cv2
import numpy as np
import pytest
from counted_features import GRAY, YOUNG, Features, bare, directions_of

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo import body_tracker
from dense_vs.point_servo import regained as regaining_module
from dense_vs.point_servo.body_features import BodyFeatures, FeatureState
from dense_vs.point_servo.feature_looks import FeatureLooks
from dense_vs.point_servo.regained import regained

CENTER, FOCAL = np.array([79.5, 59.5]), 150.0
PLACES = np.array([[60.0, 50.0], [85, 45], [95, 65], [70, 72], [80, 58], [100, 50]])
FIRST = np.array([0.3])  # rad
NUMBERS = np.arange(len(PLACES))


def texture(seed=0):
    noise = np.random.default_rng(seed).uniform(0, 255, (120, 160)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(blurred, np.empty_like(blurred), 0, 255, cv2.NORM_MINMAX)


def seen(turned, shift=(0.0, 0.0)):
    """The plane turned about the camera's axis by so many rad and then shifted [px], uint8, and where places are."""
    c, s = np.cos(turned), np.sin(turned)
    matrix = np.array([[c, -s], [s, c]])
    whole = np.column_stack([matrix, CENTER - matrix @ CENTER + shift])
    image = cv2.warpAffine(texture(), whole, (160, 120), flags=cv2.INTER_CUBIC)
    return np.clip(image, 0, 255).astype(np.uint8), (PLACES - CENTER) @ matrix.T + CENTER + shift


def known_body(axis=(0.0, 0.0, 1.0)):
    """Features on a plane 2 units away that one joint turns, and how they looked at first."""
    chain = Chain(np.array([axis]), np.array([[0.0, 0.0, 2.0]]), FIRST.copy(), np.array([-1]))
    features = BodyFeatures(chain, FOCAL, CENTER, np.array([True]))
    features.added(len(PLACES))
    features.links[:], features.states[:] = 0, FeatureState.KNOWN
    features.points = features.rays(PLACES) * 2.0
    looks = FeatureLooks()
    looks.take(NUMBERS, seen(0.0)[0], PLACES)
    return features, looks


def sought(image, q, offset=(0.0, 0.0), numbers=NUMBERS, **body):
    return regained(*known_body(**body), numbers, FIRST, image, np.asarray(q, float), np.asarray(offset, float))


@pytest.mark.parametrize("turned", [-2.5, -1.2, 0.0, 1.2, 3.1])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.0, -2.4)])
def test_they_are_found_however_far_the_link_has_turned(turned, shift):
    image, true = seen(turned, shift)
    numbers, places = sought(image, FIRST + turned)
    assert len(numbers) >= 5
    np.testing.assert_allclose(places, true[numbers], atol=0.2)


def test_a_larger_shift_needs_to_be_known():
    image, true = seen(1.2, (7.0, 6.0))
    assert not len(sought(image, FIRST + 1.2)[0])
    numbers, places = sought(image, FIRST + 1.2, (6.0, 6.5))
    np.testing.assert_allclose(places, true[numbers], atol=0.2)
    assert len(numbers) >= 5


def test_nothing_is_found_in_another_image_or_in_another_posture():
    other = np.clip(texture(seed=1), 0, 255).astype(np.uint8)
    numbers, places = sought(other, FIRST)
    assert numbers.shape == (0,)
    assert places.shape == (0, 2)
    assert not len(sought(seen(0.0)[0], FIRST + 0.8)[0])


def test_one_that_does_not_agree_is_left_out():
    image, true = seen(0.0)
    features, looks = known_body()
    features.points[2] += [0.04, 0.0, 0.0]  # 3 px beside: its look is found where it is, off from where it should be
    numbers, places = regained(features, looks, NUMBERS, FIRST, image, FIRST, np.zeros(2))
    assert 2 not in numbers
    np.testing.assert_allclose(places, true[numbers], atol=0.2)
    assert len(numbers) == 5


@pytest.mark.parametrize(("left", "found"), [(4, 4), (3, 0)])
def test_four_have_to_agree(left, found):
    image, _ = seen(0.5)
    assert len(sought(image, FIRST + 0.5, numbers=NUMBERS[:left])[0]) == found


@pytest.mark.parametrize(("others", "found"), [(5, 5), (7, 0)])
def test_half_have_to_agree(others, found):
    """Five are where they should be; each other is seen some px from there, to another side."""
    image, _ = seen(0.0)
    features, looks = known_body()
    places = PLACES[0] + [[3.0 * (k % 4), 3.0 * (k // 4)] for k in range(others)]
    more = features.added(others)
    looks.take(more, image, places)
    features.links[more], features.states[more] = 0, FeatureState.KNOWN
    angles = 2 * np.pi * np.arange(others) / others
    features.points[more] = features.rays(places + 2.4 * np.column_stack([np.cos(angles), np.sin(angles)])) * 2.0
    numbers, _ = regained(features, looks, np.append(NUMBERS[:5], more), FIRST, image, FIRST, np.zeros(2))
    assert numbers.tolist() == list(range(found))


@pytest.mark.parametrize("turned", [1.2, 3.0])
def test_those_that_are_seen_aslant_or_from_behind_are_not_sought(turned):
    """Turned about a vertical line, a plane is seen narrower, and mirrored from behind."""
    image, _ = seen(0.0)
    assert not len(sought(image, FIRST + turned, axis=(0.0, 1.0, 0.0))[0])


def test_those_outside_the_image_are_not_sought():
    image, true = seen(0.0, (-56.0, 0.0))
    numbers, places = sought(image, FIRST, (-56.0, 0.0))
    assert numbers.tolist() == [1, 2, 3, 4, 5]  # the first would be at 4 px
    np.testing.assert_allclose(places, true[1:], atol=0.2)


def regaining(monkeypatch, numbers, places):
    """A tracker with features 1 to 5, of which 4 and 5 are in sight, and what it asked for."""
    asked = []
    links = [1, 1, 1, 2, 1, 1]
    tracker = bare(Features(np.zeros((6, 2)), np.zeros((6, 2)), links=links), [4, 5], [[10, 10], [20, 20]])
    tracker.features.states[2] = YOUNG
    tracker._first, tracker._sure, tracker._offset = np.arange(5), np.array([5]), np.array([0.5, 1.0])
    tracker.on_link.defined_at = np.array([0.1])

    def regained(features, looks, gone, *rest):
        asked.append((gone.tolist(), *rest))
        return np.array(numbers, int), np.array(places, float).reshape(-1, 2)

    monkeypatch.setattr(body_tracker, "regained", regained)
    return tracker, asked


def test_features_of_its_own_image_that_are_gone_are_sought_and_taken(monkeypatch):
    tracker, asked = regaining(monkeypatch, [1], [[30, 31]])
    monkeypatch.setattr(body_tracker, "direction_weights", lambda gray, places: places[:, :, None] * np.eye(2))
    before = directions_of(tracker)
    directions = tracker._regain(GRAY, np.array([0.7]), before)
    ((gone, defined_at, gray, q, offset),) = asked
    assert gone == [1]  # not the point, nor one in sight, of another link or not known
    assert gray is GRAY
    np.testing.assert_array_equal([*defined_at, *q, *offset], [0.1, 0.7, 0.5, 1.0])
    np.testing.assert_array_equal(tracker._live, [4, 5, 1])
    np.testing.assert_array_equal(tracker._places, [[10, 10], [20, 20], [30, 31]])
    np.testing.assert_array_equal(tracker._sure, [1, 5])
    np.testing.assert_array_equal(directions, [*before, np.diag([30, 31])])


def test_where_none_is_seen_again_nothing_changes(monkeypatch):
    tracker, _ = regaining(monkeypatch, [], [])
    before = directions_of(tracker)
    np.testing.assert_array_equal(tracker._regain(GRAY, np.array([0.7]), before), before)
    np.testing.assert_array_equal(tracker._places, [[10, 10], [20, 20]])
    np.testing.assert_array_equal(tracker._live, [4, 5])
    np.testing.assert_array_equal(tracker._sure, [5])


@pytest.mark.parametrize("held", [False, True])
def test_they_are_sought_while_none_is_in_sight(monkeypatch, held):
    at = np.array([[40.0, 30.0], [40, 30], [50, 30], [40, 40]])
    tracker = bare(Features(at, np.zeros_like(at)), [1, 2, 3], at[1:], held=held)
    monkeypatch.setattr(body_tracker, "carried", lambda before, gray, places, expected: (places, places[:, 0] > 0))
    sought = []
    tracker._regain = lambda gray, q, directions: sought.append(q) or directions
    tracker.update(GRAY, np.zeros(1))
    assert len(sought) == (0 if held else 1)


class Told:
    """Looks that are seen so far from where they are sought, all for sure but for some, and what was asked of them."""

    def __init__(self, off=(), unsure=()):
        self.off, self.unsure, self.asked = np.array(off, float), unsure, []

    def sought(self, numbers, gray, places, maps, most_off):
        self.asked.append((numbers.tolist(), places, maps, most_off))
        off = self.off[numbers] if len(self.off) else np.zeros_like(places)
        return places + off, ~np.isin(numbers, self.unsure)


@pytest.fixture
def equally(monkeypatch):
    """Places count alike in all directions."""
    monkeypatch.setattr(
        regaining_module, "direction_weights", lambda gray, places: np.tile(np.eye(2), (len(places), 1, 1))
    )


@pytest.mark.parametrize(("turned", "asked"), [(0.9, True), (1.2, False), (2.9, False)])
def test_looks_are_sought_where_half_of_their_width_is_seen_from_the_front(equally, turned, asked):
    """Turned about a vertical line they are seen by its cosine narrower, and mirrored from behind."""
    features, _ = known_body(axis=(0.0, 1.0, 0.0))
    looks = Told()
    regained(features, looks, NUMBERS, FIRST, seen(0.0)[0], FIRST + turned, np.zeros(2))
    ((numbers, *_),) = looks.asked
    assert (len(numbers) > 0) == asked


@pytest.mark.parametrize(("nearer", "asked"), [(0.9, True), (1.1, False)])
def test_looks_are_sought_up_to_twice_their_size(equally, nearer, asked):
    """A slide brings the plane nearer by so much of its 2 units."""
    features, _ = known_body()
    still = np.zeros((1, 3))
    features.chain = Chain(still, still, np.zeros(1), np.array([-1]), np.array([[0.0, 0.0, -1.0]]))
    looks = Told()
    regained(features, looks, NUMBERS, np.zeros(1), seen(0.0)[0], np.array([nearer]), np.zeros(2))
    ((numbers, places, maps, most_off),) = looks.asked
    assert numbers == (NUMBERS.tolist() if asked else [])
    assert most_off == 5.0
    if asked:
        size = 2.0 / (2.0 - nearer)
        np.testing.assert_allclose(places, CENTER + size * (PLACES - CENTER))
        np.testing.assert_allclose(maps, np.tile(size * np.eye(2), (6, 1, 1)), atol=1e-9)


def test_those_that_agree_are_about_the_middle_of_their_own(equally):
    """The median of all is 0.6 px off, which two more are within 1 px of; that of those is 0 px, which they are not."""
    features, _ = known_body()
    numbers = np.append(NUMBERS, features.added(3))
    features.links[:], features.states[:] = 0, FeatureState.KNOWN
    features.points = features.rays(np.vstack([PLACES, PLACES[:3] + 2.0])) * 2.0
    looks = Told([[x, 0.0] for x in (0, 0, 0, 0, 0.6, 1.2, 1.2, 3, 3)])
    found, places = regained(features, looks, numbers, FIRST, seen(0.0)[0], FIRST, np.zeros(2))
    assert found.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(places[4] - PLACES[4], [0.6, 0.0], atol=1e-9)
    looks.unsure = [3]
    assert not len(regained(features, looks, numbers[:4], FIRST, seen(0.0)[0], FIRST, np.zeros(2))[0])


@pytest.mark.parametrize(("sought", "found"), [(14, 5), (17, 0)])
def test_of_those_that_are_sought_a_third_or_so_has_to_be_seen(equally, sought, found):
    """Five agree, and all others are not sure: some looks are alike anywhere, so few of many are not the features."""
    features, _ = known_body()
    others = sought - len(NUMBERS)
    numbers = np.append(NUMBERS, features.added(others))
    features.links[:], features.states[:] = 0, FeatureState.KNOWN
    features.points = features.rays(np.vstack([PLACES, np.tile(CENTER, (others, 1))])) * 2.0
    looks = Told(unsure=numbers[5:])
    outside = features.added(30)  # of the image, as where they should be seen: they have no say
    features.links[outside], features.states[outside] = 0, FeatureState.KNOWN
    features.points[outside] = features.rays(np.tile([-20.0, 50.0], (30, 1))) * 2.0
    numbers = np.append(numbers, outside)
    seen_again, _ = regained(features, looks, numbers, FIRST, seen(0.0)[0], FIRST, np.zeros(2))
    assert seen_again.tolist() == list(range(found))
