"""Features of a body whose places follow from the joints by plain sums, and a tracker made of its parts alone."""

from collections import deque
from types import SimpleNamespace

import numpy as np

from dense_vs.body_model.image_directions import direction_weights
from dense_vs.point_servo.body_features import FeatureState
from dense_vs.point_servo.body_tracker import LATELY, BodyTracker

KNOWN, YOUNG, DROPPED = FeatureState.KNOWN, FeatureState.YOUNG, FeatureState.DROPPED
GRAY = np.zeros((60, 80), np.uint8)
CHAIN = np.array([[0.9, 0.2], [0.2, 0.5]])  # px^2, of the place that the chain has the point at


class Features:
    """Feature k is seen at ``at[k] + rate[k] q[0]``; index 0 is the point."""

    def __init__(self, at, rate, states=None, links=None):
        self.at, self.rate = np.array(at, float), np.array(rate, float)
        self.states = np.full(len(self.at), KNOWN) if states is None else np.array(states)
        self.links = np.ones(len(self.at), int) if links is None else np.array(links)
        self.learned = np.array([True, True, False])
        self.keyframes, self.assigned, self.refined = [], [], []

    def __len__(self):
        return len(self.at)

    def project(self, numbers, q):
        return self.at[numbers] + self.rate[numbers] * q[0]

    def seen_on(self, link, numbers):
        return (self.states[numbers] == KNOWN) & (self.links[numbers] == link)

    def assign(self, numbers):
        self.assigned.append(list(numbers))

    def refine(self, preferred, kept):
        self.refined.append((list(preferred), list(kept)))

    def keep(self, keyframe):
        self.keyframes.append(keyframe)

    def added(self, count):
        first = len(self.at)
        self.at, self.rate = np.vstack([self.at, np.zeros((count, 2))]), np.vstack([self.rate, np.zeros((count, 2))])
        self.states = np.append(self.states, np.full(count, YOUNG))
        self.links = np.append(self.links, np.full(count, -1))
        return np.arange(first, first + count)


class Looks:
    """Looks by which nothing is off, but for the features that are said to be."""

    def __init__(self, off=None, unsure=(), unlike=()):
        self.off, self.unsure, self.unlike, self.asked, self.calls = off or {}, unsure, unlike, [], []

    def held(self, numbers, gray, places):
        self.asked.append(list(numbers))
        off = np.array([self.off.get(number, (0.0, 0.0)) for number in numbers.tolist()]).reshape(-1, 2)
        return places + off, ~np.isin(numbers, self.unsure), ~np.isin(numbers, self.unlike)

    def take(self, numbers, gray, places):
        self.calls.append(("take", list(numbers), places.tolist()))

    def unturned(self, numbers):
        self.calls.append(("unturned", list(numbers)))

    def renumber(self, renumbered):
        self.calls.append(("renumber", list(renumbered)))


def link_of(**given):
    """What the chain says of the point: it is on link 1, and nothing more."""
    nothing = {"depth": None, "slip": 0.0, "astray": lambda q: np.zeros(2), "begin": lambda *begun: None}
    nothing["covariance"] = lambda q: CHAIN.copy()
    return SimpleNamespace(**{"link": 1, **nothing, **given})


def bare(features, live=(), places=(), **given):
    """A tracker with some of its parts, without the images that it is made from."""
    tracker = object.__new__(BodyTracker)
    tracker.__dict__.update(
        features=features, _live=np.array(live, int), _places=np.array(places, float).reshape(-1, 2),
        on_link=link_of(), _offset=np.zeros(2), _covariance=1.44 * np.eye(2), seen=0, unseen=0,
        point=np.array([7.0, 7.0]), _positions=np.zeros(1), _kept_at=np.zeros(1), _own=1.0, _sighting=None,
        _gray=GRAY, _lost_after=5, _doubt=1.0, uncertainty=0.0, lately=deque([0.0], LATELY),
        _looks=Looks(), _due=[], _sure=np.zeros(0, int), _first=np.zeros(0, int), _images=0, held=False,
    )  # fmt: skip
    tracker.__dict__.update(given)
    return tracker


def directions_of(tracker):
    """What errors of the places of a tracker's features in sight are multiplied by in :data:`GRAY`."""
    return direction_weights(GRAY, tracker._places)
