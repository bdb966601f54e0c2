"""Which reconstructions are tried, how often they are adjusted and which comes first, with errors that are told."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.reconstruction import initialization
from dense_vs.generative.reconstruction.initialization import _Bundles, candidates

T = 20


def found(name, posed=20, cameras=(True, True), rms=0.5):
    rng = np.random.default_rng(len(name))
    return SimpleNamespace(name=name, posed=np.arange(T) < posed, placed_cameras=np.array(cameras), rms=rms,
                           structure=rng.normal(size=(6, 3)))  # fmt: skip


class Adjusting:
    """Bundle adjustment that keeps what it was given, and whose errors are told one after the other."""

    def __init__(self, monkeypatch, completed=None):
        self.asked = []
        monkeypatch.setattr(initialization, "adjust_bundle", self.adjust)
        monkeypatch.setattr(initialization, "complete", completed or (lambda one, pixels, guess: one))

    def adjust(self, pixels, guess, one, max_iterations):
        self.asked.append(one.name)
        assert max_iterations == 60
        weights = np.zeros((T, 2, 6))
        weights[:5] = 0.3
        taken = (weights > 0).sum()
        return one, guess, SimpleNamespace(cost=one.rms**2 * 2 * taken), weights


def observations(cameras=2, features=6):
    pixels = np.random.default_rng(0).uniform(0, 400, (T, cameras, features, 2))
    pixels[:, -1, 0] = np.nan
    return Observations(joints=np.zeros((T, 2)), pixels=pixels, image_sizes=[(480, 640)] * cameras)


@pytest.fixture
def told(monkeypatch):
    """Reconstructions by stereo, and pairs by factorization, that are told; an error in their place is raised."""

    def set_to(stereo=(), pairs=()):
        adjusting, events = Adjusting(monkeypatch), []

        def reconstruct(pixels, guess, rng):
            events.append("stereo")
            for one in stereo:
                if isinstance(one, Exception):
                    raise one
                yield one

        left = list(pairs)

        def factorize(pixels, guess, camera, rng):
            events.append(camera)
            one = left.pop(0) if left else DenseVSError("no more")
            if isinstance(one, Exception):
                raise one
            return one

        monkeypatch.setattr(initialization, "reconstruct", reconstruct)
        monkeypatch.setattr(initialization, "factorize", factorize)
        return adjusting, events

    return set_to


def names(some):
    return [one.found.name for one in some]


HAND = np.ones(6, bool)


def test_an_error_is_that_of_a_coordinate_of_what_took_part(told):
    told([found("a", rms=0.3)])
    (one,) = candidates(observations(), HAND, None)
    assert one.rms == pytest.approx(0.3)
    told([found("a", rms=0.3)])
    bundles = _Bundles(np.zeros((T, 2, 6, 2)), np.zeros((2, 6)))
    assert bundles.adjusted(found("b", rms=0.7)).rms == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("errors", "posed", "asked", "best"),
    [
        ([0.79], [20], 1, 0),  # certain
        ([0.81, 0.8], [20, 20], 2, 0),
        ([4.0, 3.9], [10, 20], 2, 0),  # hardly better
        ([4.0, 3.0, 2.9], [10, 10, 10], 3, 1), ([4.0, 3.0], [10, 9], 2, 0), ([4.0, 3.0, 0.5], [10, 10, 11], 3, 2),
    ],
)  # fmt: skip
def test_a_reconstruction_is_adjusted_again_while_its_error_falls(monkeypatch, errors, posed, asked, best):
    """By a twentieth or more, without losing a sample's pose."""
    ones = [found(str(k), posed=p, rms=rms) for k, (p, rms) in enumerate(zip(posed, errors, strict=True))]
    following = {one.name: after for one, after in pairwise(ones)}
    adjusting = Adjusting(monkeypatch, lambda one, pixels, guess: following[one.name])
    result = _Bundles(np.zeros((T, 2, 6, 2)), np.zeros((2, 6))).adjusted(ones[0])
    assert adjusting.asked == [str(k) for k in range(asked)]
    assert result.found is ones[best]


def test_work_is_bounded(monkeypatch):
    falling = iter(0.9 ** np.arange(200))
    adjusting = Adjusting(monkeypatch, lambda one, pixels, guess: found("again", rms=1000 * next(falling)))
    bundles = _Bundles(np.zeros((T, 2, 6, 2)), np.zeros((2, 6)))
    bundles.adjusted(found("first", rms=5000.0))
    assert len(adjusting.asked) == 1 + initialization.REPEATED_BUNDLES
    spent = []
    while not bundles.spent:
        spent.append(bundles.half_spent)
        bundles._once(found("one"))
    total = initialization.MOST_BUNDLES
    assert len(adjusting.asked) == total
    # Half of the work is left for the other method.
    assert spent == [2 * (total - k) <= total for k in range(1 + initialization.REPEATED_BUNDLES, total)]


@pytest.mark.parametrize(
    ("stereo", "tried", "first"),
    [
        ([("a", 0.4), ("b", 0.2)], 1, ["a"]),  # the first is certain
        ([("a", 0.81), ("b", 0.2)], 2, ["b", "a"]),
        ([("a", 1.2), ("b", 1.4), ("c", 1.1)], 3, ["c", "a", "b"]),
    ],
)  # fmt: skip
def test_reconstructions_by_stereo_are_tried_until_one_is_certain(told, monkeypatch, stereo, tried, first):
    monkeypatch.setattr(initialization, "REPEATED_BUNDLES", 0)
    adjusting, events = told([found(name, rms=rms) for name, rms in stereo])
    assert names(candidates(observations(), HAND, None)) == first
    assert len(adjusting.asked) == tried
    assert events == ["stereo"]


@pytest.fixture
def limits(monkeypatch):
    for name, value in (("REPEATED_BUNDLES", 0), ("MOST_BUNDLES", 20)):
        monkeypatch.setattr(initialization, name, value)


@pytest.mark.parametrize("unsound", [{"rms": 1.51}, {"posed": 11}, {"cameras": (True, False)}])
def test_where_stereo_is_not_sound_a_camera_s_own_views_are_factorized(told, limits, unsound):
    """From the camera that sees most on; the first pair that holds a good one ends its tries."""
    adjusting, events = told(
        [found("stereo", **{"rms": 0.5, **unsound})],
        [(found("p1", rms=3.0), found("m1", rms=2.5)), (found("p2", rms=1.49), found("m2", rms=9.0)),
         (found("p3", rms=0.4), found("m3", rms=8.0))],
    )  # fmt: skip
    some = names(candidates(observations(), HAND, None))
    assert events == ["stereo", 0, 0, 1]
    assert set(adjusting.asked) == {"stereo", "p1", "m1", "p2", "m2", "p3", "m3"}
    assert some[0] == "p3"
    assert len(some) == 7


def test_a_camera_s_views_are_factorized_four_times_at_most(monkeypatch, told, limits):
    bad = [(found(f"p{k}", rms=3.0), found(f"m{k}", rms=3.0)) for k in range(8)]
    _, events = told([], bad)
    candidates(observations(), HAND, None)
    assert events == ["stereo", 0, 0, 0, 0, 1, 1, 1, 1]
    _, events = told([], [DenseVSError("flat"), *bad])
    candidates(observations(), HAND, None)
    assert events == ["stereo", 0, 1, 1, 1, 1]
    _, events = told([found("x")], bad)
    candidates(observations(cameras=1), HAND, None)
    assert events == [0, 0, 0, 0]  # one camera has no stereo
    _, events = told([], [(found(f"p{k}", rms=3.0), found(f"m{k}", rms=3.0)) for k in range(20)])
    monkeypatch.setattr(initialization, "MOST_BUNDLES", 3)
    candidates(observations(), HAND, None)
    assert events == ["stereo", 0, 0]  # a pair is adjusted to its end


def test_the_order_is_of_poses_and_cameras_in_fives_then_of_good_errors(told, limits):
    """A placed camera counts as much as poses of all samples."""
    pairs = [
        (found("few", posed=9, rms=0.1), found("one camera", posed=20, cameras=(True, False), rms=0.2)),
        (found("poor", posed=18, rms=2.2), found("well", posed=15, rms=2.9)),
        (found("best", posed=16, rms=1.45), found("next", posed=19, rms=2.4)),
    ]
    told([], pairs)
    some = names(candidates(observations(cameras=2), HAND, None))
    assert some == ["best", "poor", "next", "well", "few", "one camera"]


def test_why_there_is_none(told, limits):
    told([DenseVSError("too few matches")], [])
    with pytest.raises(DenseVSError, match="too few matches"):
        candidates(observations(), HAND, None)
    told([], [])
    with pytest.raises(DenseVSError, match="no more"):
        candidates(observations(), HAND, None)


def test_features_of_the_hand_alone_take_part(monkeypatch, told):
    told([found("a")])
    seen = []
    monkeypatch.setattr(
        initialization, "reconstruct", lambda pixels, guess, rng: seen.append(pixels) or iter([found("a")])
    )
    hand = np.arange(6) != 3
    candidates(observations(), hand, None)
    assert np.isnan(seen[0][:, :, 3]).all()
    np.testing.assert_array_equal(seen[0][:, :, hand], observations().pixels[:, :, hand])
