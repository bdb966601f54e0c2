"""Features on a body's links, seen in keyframes, and the body's chain, which they refine while the robot moves.

The chain comes from a fit to the babbling (:mod:`dense_vs.body_model`), whose postures are few. As the robot moves on,
every keyframe adds places of features; chain, focal length and features are adjusted to all of them together, so that
what is learned far away holds back where it began. A new feature goes to the link whose motion explains its places.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from dense_vs.body_model.adjustment import adjusted
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.spread import spread
from dense_vs.body_model.track_problem import BodyState, TrackProblem

NOISE = 0.5  # px, of a feature's place
BELIEVED = 0.35  # mean robust error, 0 to 1, up to which a link explains a feature's places
LEAST_SEEN = 5  # keyframes from which a feature's link is decided, and it takes part in the adjustment
LEAST_TRAVEL = 3.0  # px
STILL_TRAVEL, STILL_SEEN = 1.0, 4  # px and keyframes: what moves less is the background
MOST_KEYFRAMES = 110
MOST_ADJUSTED = 160  # features in an adjustment
KEYFRAMES_ADJUSTED = 80
LATEST = 8  # keyframes that are always adjusted
ITERATIONS = 1
NEAREST = 1e-3  # depth of what is before the camera, in the chain's unit of length
BEHIND = -1e6  # px, place of what is behind the camera
FOCAL_DEVIATION = 0.02  # of its logarithm, from one adjustment to the next
BEND_DEVIATION = 0.01  # of the lens's bend about none; a webcam has 0.035, which features across half the image tell
BELIEVED_BEFORE = 2.0  # times the information that the fit has of the chain, whose lines are doubted enough by then


class FeatureState(IntEnum):
    """What is known of a feature."""

    YOUNG = 0
    """Its link is not decided."""
    KNOWN = 1
    """It has a link and a place there."""
    DROPPED = 2
    """No link explains it."""


@dataclass(frozen=True)
class Keyframe:
    """A posture and what was seen in it.

    Attributes:
        positions: ``(N,)`` [rad].
        features: indices ``(K,)``.
        places: ``(K, 2)`` [px].
        image: gray uint8 ``(H, W)``.
        directions: ``(K, 2, 2)``, what errors of the places are multiplied by; by the image unless given.
    """

    positions: np.ndarray
    features: np.ndarray
    places: np.ndarray
    image: np.ndarray
    directions: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self):
        if not self.directions.size:
            object.__setattr__(self, "directions", direction_weights(self.image, self.places))

    def with_place(self, feature: int, place: np.ndarray | None, weight: float = 1.0) -> "Keyframe":
        """The keyframe with another place ``(2,)`` of one feature, whose errors count so much; without it for None."""
        others = self.features != feature
        features, places, directions = self.features[others], self.places[others], self.directions[others]
        if place is not None:
            features, places = np.append(features, feature), np.vstack([places, place])
            directions = np.concatenate([directions, weight * direction_weights(self.image, place[None])])
        return Keyframe(self.positions, features, places, self.image, directions)

    def with_more(self, features: np.ndarray, places: np.ndarray) -> "Keyframe":
        """The keyframe with other features ``(K,)`` as well, that its image shows at places ``(K, 2)`` [px]."""
        directions = np.concatenate([self.directions, direction_weights(self.image, places)])
        features, places = np.append(self.features, features), np.vstack([self.places, places])
        return Keyframe(self.positions, features, places, self.image, directions)


class BodyFeatures:
    """Features and chain.

    Args:
        chain: lines of the N joints.
        focal: focal length [px].
        center: principal point ``(2,)`` [px].
        learned: bool ``(N,)``, joints whose lines are known.
        information: ``(4 N + 1, 4 N + 1)`` about the chain and the focal length as given, see
            :attr:`.Precision.information`; none unless given.
        bend: of the lens, see :class:`.Lens`.

    Attributes:
        lens: of the camera; its bend is adjusted with the chain.
        links: ``(M,)`` of every feature.
        points: ``(M, 3)`` in the home posture, in the chain's unit of length.
        states: ``(M,)`` of :class:`FeatureState`.
        keyframes: oldest first.
        lasting: features whose keyframes are kept for longest.
    """

    def __init__(
        self,
        chain: Chain,
        focal: float,
        center: np.ndarray,
        learned: np.ndarray,
        information: np.ndarray | None = None,
        bend: float = 0.0,
    ):
        self.chain, self.focal = chain, focal
        self._information = None if information is None else BELIEVED_BEFORE * information
        self._moved: np.ndarray | float = 0.0  # since, see BodyState.moved
        self.center, self.learned = np.asarray(center, dtype=np.float64), np.asarray(learned, dtype=bool)
        self.lens = Lens.of_center(self.center, bend)
        self.links = np.zeros(0, int)
        self.points = np.zeros((0, 3))
        self.states = np.zeros(0, int)
        self.keyframes: list[Keyframe] = []
        self.lasting = np.zeros(0, int)

    def __len__(self) -> int:
        return len(self.links)

    def added(self, count: int) -> np.ndarray:
        """Indices ``(count,)`` of new, young features."""
        first = len(self)
        self.links = np.append(self.links, np.full(count, -1))
        self.points = np.vstack([self.points, np.zeros((count, 3))])
        self.states = np.append(self.states, np.full(count, FeatureState.YOUNG))
        return np.arange(first, first + count)

    def keep(self, keyframe: Keyframe) -> None:
        """Take a keyframe; of too many, some of the oldest go."""
        self.keyframes.append(keyframe)
        if len(self.keyframes) > MOST_KEYFRAMES:
            old = self.keyframes[1 : MOST_KEYFRAMES // 2]
            spare = [one for one in old if not np.isin(self.lasting, one.features).any()] or old
            gone = {id(one) for one in spare[::6]}
            self.keyframes = [one for one in self.keyframes if id(one) not in gone]

    def forget_unseen(self, others: np.ndarray) -> np.ndarray:
        """Forget features that no keyframe holds, but for ``others``; the new index ``(M,)`` of each, -1 for none."""
        held = np.unique(np.concatenate([*(one.features for one in self.keyframes), others, self.lasting]).astype(int))
        renumbered = np.full(len(self), -1)
        renumbered[held] = np.arange(len(held))
        self.links, self.points, self.states = self.links[held], self.points[held], self.states[held]
        self.keyframes = [replace(one, features=renumbered[one.features]) for one in self.keyframes]
        self.lasting = renumbered[self.lasting]
        return renumbered

    def seen_on(self, link: int, features: np.ndarray) -> np.ndarray:
        """Which of some features are known to be on a link, bool."""
        return (self.states[features] == FeatureState.KNOWN) & (self.links[features] == link)

    def positions(self, features: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Where features are in a posture ``(N,)`` [rad], ``(K, 3)`` in the camera frame."""
        rotation, translation = self.chain.link_poses(np.asarray(q, dtype=np.float64)[None])
        links = self.links[features]
        return np.einsum("kij,kj->ki", rotation[0, links], self.points[features]) + translation[0, links]

    def project(self, features: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Where features are seen in a posture ``(N,)`` [rad], ``(K, 2)`` [px]; far outside behind the camera."""
        return self.pixels(self.positions(features, q))

    def pixels(self, positions: np.ndarray) -> np.ndarray:
        """Places ``(K, 2)`` [px] of positions ``(K, 3)`` in the camera frame; far outside behind the camera."""
        depths = positions[:, 2:]
        front = depths > NEAREST
        if front.all():
            return self.lens.seen(positions[:, :2] * (self.focal / depths))
        away = positions[:, :2] * (self.focal / np.where(front, depths, 1.0))
        return np.where(front, self.lens.seen(away), BEHIND)

    def rays(self, places: np.ndarray) -> np.ndarray:
        """Directions ``(K, 3)`` in the camera frame, of depth 1, in which places ``(K, 2)`` [px] are seen."""
        away = (self.lens.straight(places) - self.center) / self.focal
        return np.column_stack([away, np.ones(len(away))])

    def jacobian(self, feature: int, q: np.ndarray) -> np.ndarray:
        """J ``(2, N)`` [px/rad] of a feature's place in a posture ``(N,)`` [rad], by the chain; 0 behind the camera."""
        one, posture = np.array([feature]), np.asarray(q, dtype=np.float64)
        position = self.positions(one, posture)
        velocity = self.chain.velocities(posture, position, self.links[one])[0] * self.learned[:, None]
        x, y, depth = position[0]
        if depth <= NEAREST:
            return np.zeros((2, len(self.learned)))
        straight = self.focal / depth * (velocity[:, :2] - np.array([x, y]) / depth * velocity[:, 2:]).T
        return self.lens.slopes(self.focal * position[0, :2] / depth + self.center) @ straight

    def tracks(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Postures ``(T, N)`` of the keyframes, places ``(T, K, 2)`` of some features, NaN where not seen, and what
        their errors are multiplied by ``(T, K, 2, 2)``.
        """
        column = np.full(len(self), -1)
        column[features] = np.arange(len(features))
        places = np.full((len(self.keyframes), len(features), 2), np.nan)
        directions = np.zeros((*places.shape, 2))
        row = np.repeat(np.arange(len(self.keyframes)), [len(one.features) for one in self.keyframes])
        at = column[np.concatenate([one.features for one in self.keyframes])]
        asked = at >= 0
        row, at = row[asked], at[asked]
        places[row, at] = np.concatenate([one.places for one in self.keyframes])[asked]
        directions[row, at] = np.concatenate([one.directions for one in self.keyframes])[asked]
        return np.array([one.positions for one in self.keyframes]), places, directions

    def assign(self, features: np.ndarray) -> None:
        """Give young features that were seen often enough to the link that explains them; drop what none explains."""
        if not len(features):
            return
        postures, places, directions = self.tracks(features)
        seen = np.isfinite(places[..., 0])
        counts = seen.sum(axis=0)
        low = np.where(seen[..., None], places, np.inf).min(axis=0)
        high = np.where(seen[..., None], places, -np.inf).max(axis=0)
        travel = np.where(counts > 0, (high - low).max(axis=1), 0.0)
        still = (counts >= STILL_SEEN) & (travel < STILL_TRAVEL)
        self.states[features[still]] = FeatureState.DROPPED
        ready = (counts >= LEAST_SEEN) & (travel > LEAST_TRAVEL)
        if ready.any():
            self._decide(features[ready], postures, places[:, ready], directions[:, ready])

    def _decide(self, features: np.ndarray, postures: np.ndarray, places: np.ndarray, directions: np.ndarray) -> None:
        count = len(features)
        last = len(places) - 1 - np.isfinite(places[::-1, :, 0]).argmax(axis=0)
        rotation, translation = (poses[last] for poses in self.chain.link_poses(postures))
        rays, straight = self.rays(places[last, range(count)]), self.lens.straight(places)
        candidates = np.flatnonzero(self.learned)
        starts = []
        for link in candidates:
            here = rays * self._usual_depths(int(link), rotation[:, link], translation[:, link])[:, None]
            starts.append(np.einsum("kji,kj->ki", rotation[:, link], here - translation[:, link]))
        # All of them on every link at once.
        times = len(candidates)
        tried = place_points(
            self.chain, self.focal, (float(self.center[0]), float(self.center[1])), postures,
            np.tile(straight, (1, times, 1)), np.repeat(candidates, count), np.concatenate(starts), NOISE,
            np.tile(directions, (1, times, 1, 1)),
        )  # fmt: skip
        costs = tried.cost.reshape(times, count)
        best = costs.argmin(axis=0)
        explained = costs.min(axis=0) < BELIEVED
        self.links[features] = candidates[best]
        self.points[features] = tried.points.reshape(times, count, 3)[best, range(count)]
        self.states[features] = np.where(explained, FeatureState.KNOWN, FeatureState.DROPPED)

    def _usual_depths(self, link: int, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
        """Median depth of the link's known features at each of some poses ``(K, 3, 3)``, ``(K, 3)``."""
        on = (self.states == FeatureState.KNOWN) & (self.links == link)
        if not on.any():
            known = self.points[self.states == FeatureState.KNOWN]
            return np.full(len(rotation), float(np.median(known[:, 2])) if len(known) else 1.0)
        depths = self.points[on] @ rotation[:, 2].T + translation[:, 2]
        return np.maximum(np.median(depths, axis=0), 0.1)

    def refine(self, preferred: np.ndarray, kept: np.ndarray) -> None:
        """Adjust chain, focal length, lens and features to the keyframes.

        Args:
            preferred: features that take part first.
            kept: those that are placed anew on the chain even where they take no part.
        """
        counts = np.bincount(np.concatenate([one.features for one in self.keyframes]), minlength=len(self))
        used = np.flatnonzero((self.states == FeatureState.KNOWN) & (counts >= LEAST_SEEN))
        if len(used) < 2 * LEAST_SEEN:
            return
        rank = counts[used] + MOST_KEYFRAMES * np.isin(used, preferred)
        used = np.sort(used[np.argsort(-rank, kind="stable")[:MOST_ADJUSTED]])
        postures, places, directions = self.tracks(used)
        count = len(postures)
        rows = np.unique(np.append(spread(count, KEYFRAMES_ADJUSTED), np.arange(max(0, count - LATEST), count)))
        center = float(self.center[0]), float(self.center[1])
        problem = TrackProblem(
            postures[rows], places[rows], self.links[used], center, np.ones((len(rows), len(used))),
            (self.focal, FOCAL_DEVIATION), NOISE, BEND_DEVIATION, directions[rows], self._information,
        )  # fmt: skip
        start = BodyState(self.chain, self.points[used], self.focal, self.lens.bend, self._moved)
        state = adjusted(problem, start, 1, ITERATIONS)
        self.chain, self.focal, self.lens = state.chain, state.focal, replace(self.lens, bend=state.bend)
        self._moved = state.moved
        self.points[used] = state.points
        self._follow(np.setdiff1d(kept, used))

    def _follow(self, features: np.ndarray) -> None:
        """Place features anew that took no part in an adjustment: the unit of length drifts with the chain."""
        features = features[self.states[features] == FeatureState.KNOWN]
        if not len(features):
            return
        postures, places, directions = self.tracks(features)
        camera = self.focal, (float(self.center[0]), float(self.center[1]))
        links, start = self.links[features], self.points[features]
        self.points[features] = place_points(
            self.chain, *camera, postures, self.lens.straight(places), links, start, NOISE, directions
        ).points
