"""A point of the body followed by how its whole link moves, where its own look says too little (beyond DIJE).

On plain links a patch slides along outlines and shading, turns out of sight, or is covered. But links are rigid and the
joint readings are exact: with the chain that a body model has, the link's features say where the point is, and while
the robot moves on they refine the chain. Features that turn out of sight are replaced by new ones, each on the link
whose motion explains it. The point is known by its pixel when it was defined and a depth (:mod:`.point_on_link`).
"""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from dense_vs.arrays import middle
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.feature_flow import carried, keep_apart, new_features
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.point_servo.body_features import NOISE, BodyFeatures, FeatureState, Keyframe
from dense_vs.point_servo.feature_looks import FeatureLooks
from dense_vs.point_servo.feature_numbers import are_among
from dense_vs.point_servo.link_gate import off_their_link
from dense_vs.point_servo.look_back import Trace, followed_back
from dense_vs.point_servo.more_features import APART, LEAST_SEEN, more_features
from dense_vs.point_servo.place_posterior import BASIC, UNTIED, off_by_features, place_uncertainty, with_look
from dense_vs.point_servo.plainness import plainness
from dense_vs.point_servo.point_look import LIKE, PointLook
from dense_vs.point_servo.point_on_link import ANYWHERE, POINT, PointOnLink
from dense_vs.point_servo.regained import regained
from dense_vs.point_servo.surface_place import SurfacePlace

FIRST_FEATURES = 180  # in the image in which the point is defined
MOST_FEATURES = 600  # from which those that no keyframe holds are forgotten
AROUND = 3  # known features around a young one, which it is taken along with
HELD, OTHERS_HELD = 3, 5  # images, in one of which a feature of the point's link, or another's, is held to its look
KEYFRAME_MOTION = 15.0  # px that a feature moves by between keyframes
AWAY = 1e4  # px of motion that says nothing: one of the places is behind the camera
ALIKE = 0.87  # correlation from which the point's own look tells its place, where features of its image do as well
ASIDE = 1.0  # px, standard deviation of the expected place, the depth aside, while looking back
ROUNDS = 3  # of looking back for the point itself, each with the depth that the former gave
AGAIN = 4  # keyframes in which it is sought again whenever there is a new one, as the chain is known better by then
BELIEVED = 0.72  # correlation from which a place of the point's own look tells its depth
LEAST_OPEN = 0.05  # of the logarithm of the depth, left open in a search: places that repeat a guess tell nothing
MOST_UNCERTAIN = 0.8  # of the tolerance: standard deviation by which a place is certain, the middle of LATELY images
LATELY = 9  # images: what is seen of a look comes and goes, and a place is no better known for one lucky image
DOUBT = 1.5  # times the depth's standard deviation: places of features around share their errors
VOTES = 7  # features around, which say what link the point is on where its own places do not


class BodyTracker:
    """Follows one point of a body.

    Args:
        chain, focal, center, learned, information, bend: of the body, as :class:`BodyFeatures`.
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], oldest first, up to the present one.
        point: ``(2,)`` [px], its place in the last image.
        body: bool ``(H, W)``, pixels of the body in the last image.
        link: that the point is on; found from its track and its neighbors' unless given.
        trace: of the body model, by which features are looked for in the history.
        surface: of the body model at the point, in the chain's unit; None where it has none.
        same: bool ``(H, W)``, pixels of the last image that move as the point does; others do not count in its look.
        window: side of the patch that is the point's own look [px], odd.
        lost_after: images without enough features in sight after which the point counts as lost.
        doubt: times what is not known of its place, above 1 for a body that is known badly.

    Attributes:
        features: of the body; index 0 is the point.
        point: ``(2,)`` [px], where the point is now.
        seen: features of its link that were in sight in the last image.
        held: whether enough of them are from the image in which the point was defined, and look as they did there.
        unseen: images since at least :data:`LEAST_SEEN` were.
        uncertainty, lately: standard deviation of the point's place [px], now and in the last :data:`LATELY` images.
        on_link: the point by what the chain says.
    """

    def __init__(
        self,
        chain: Chain,
        focal: float,
        center: np.ndarray,
        learned: np.ndarray,
        history: Sequence[tuple[np.ndarray, np.ndarray]],
        point: np.ndarray,
        body: np.ndarray,
        *,
        information: np.ndarray | None = None,
        bend: float = 0.0,
        link: int | None = None,
        trace: Trace | None = None,
        surface: SurfacePlace | None = None,
        same: np.ndarray | None = None,
        window: int = 25,
        lost_after: int = 15,
        doubt: float = 1.0,
    ):
        self.features = BodyFeatures(chain, focal, center, learned, information, bend)
        self.features.lasting = np.array([POINT])
        self._lost_after, self._doubt = lost_after, doubt
        self._gray, positions = history[-1]
        self._first_gray = self._gray
        self._positions = self._kept_at = np.array(positions, dtype=np.float64)
        self.point = np.array(point, dtype=np.float64)
        plain = plainness(self._gray, self.point)
        self.on_link = PointOnLink(self.features, self.point, self._positions, surface, plain)
        self._offset, self._covariance = np.zeros(2), UNTIED**2 * np.eye(2)
        self.seen, self.unseen, self.held = 0, 0, False
        self._own, self._next, self._images = 1.0, 0, 0
        self._due: list[Callable[[], None]] = []
        self._sighting: np.ndarray | None = None
        self._looks, self._sure = FeatureLooks(), np.zeros(0, int)
        self._look = PointLook(self._gray, self.point, same, window)
        self._look_back(history, body, link, trace)
        self.on_link.place(self._first)
        for _ in range(ROUNDS):
            self._find_in(range(len(self.features.keyframes) - 1))
            self.on_link.place(self._first)
        self._refine()
        self.uncertainty = self._uncertainty()
        self.lately = deque([self.uncertainty], LATELY)

    @property
    def known(self) -> bool:
        """Whether the body has a link that the point is on."""
        return bool(self.features.states[POINT] == FeatureState.KNOWN)

    @property
    def points(self) -> np.ndarray:
        """Where the point is, ``(1, 2)`` [px], as :attr:`PointTracker.points`."""
        return self.point[None].copy()

    @property
    def correlation(self) -> np.ndarray:
        """Float32 ``(1,)``, of the point's own look with its first one; -1 where it is not found."""
        return np.array([self._own], np.float32)

    @property
    def lost(self) -> np.ndarray:
        """Bool ``(1,)``: whether its link has not been seen for ``lost_after`` images. It is still sought."""
        return np.array([self.unseen >= self._lost_after])

    def certain(self, tolerance: float = 1.0) -> bool:
        """Whether it is known to twice a tolerance of at least 1 px where the point is, and seen no worse now."""
        most = MOST_UNCERTAIN * max(tolerance, 1.0)
        return self.unseen == 0 and max(self.usual_uncertainty, 0.5 * self.uncertainty) <= most

    @property
    def usual_uncertainty(self) -> float:
        """Standard deviation of the point's place [px], the median of the last images."""
        return float(middle(np.array(self.lately)))

    def update(self, gray: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Find the point in the present image; its place ``(2,)`` [px].

        Args:
            gray: uint8 ``(H, W)``.
            positions: joint positions ``(N,)`` [rad].
        """
        features, link, q = self.features, self.on_link.link, np.asarray(positions, dtype=np.float64)
        expected = features.project(self._live, q)
        places, believed = carried(self._gray, gray, self._places, self._expected(expected))
        self._images += 1
        often = np.where(features.links[self._live] == link, HELD, OTHERS_HELD)
        self._hold(gray, places, believed, believed & ((self._live + self._images) % often == 0))
        known = features.states[self._live] == FeatureState.KNOWN
        directions = direction_weights(gray, places)
        believed &= ~off_their_link(places - expected, directions, features.links[self._live], believed & known)
        self._live, self._places, directions = self._live[believed], places[believed], directions[believed]
        if not self.held:
            directions = self._regain(gray, q, directions)
        self._locate(q, gray, directions)
        if self._due:
            self._due.pop(0)()
        elif self._moved(np.append(self._on_link(link), POINT), q) > KEYFRAME_MOTION:
            self._keep(gray, q, directions)
        return self.point

    def find_again(self, gray: np.ndarray, positions: np.ndarray) -> bool:
        """Look for the features of the image in which the point was defined; whether enough of them are seen.

        Args:
            gray: uint8 ``(H, W)``, from near the posture that the point was defined in.
            positions: joint positions ``(N,)`` [rad].
        """
        features, q = self.features, np.asarray(positions, dtype=np.float64)
        known = (features.states[self._first] == FeatureState.KNOWN) & (self._first != POINT)
        numbers, begun = self._first[known], self._begun[known]
        step = features.project(numbers, q) - features.project(numbers, self.on_link.defined_at)
        places, believed = carried(self._first_gray, gray, begun, begun + step)
        self._looks.unturned(numbers)
        self._live = numbers
        self._hold(gray, places, believed, believed.copy())
        self._live, self._places = numbers[believed], places[believed]
        self._locate(q, gray, direction_weights(gray, self._places))
        return self.unseen == 0

    def _locate(self, q: np.ndarray, gray: np.ndarray, directions: np.ndarray) -> None:
        """Take an image as the present one: where the point is in it, and how well that is known."""
        self._correct(q, self.on_link.link, gray, directions)
        self._gray, self._positions = gray, q
        self.uncertainty = self._uncertainty()
        self.lately.append(self.uncertainty)

    def _hold(self, gray: np.ndarray, places: np.ndarray, believed: np.ndarray, due: np.ndarray) -> None:
        """Hold features in sight that are ``due``, bool ``(K,)``, to their first looks.

        Changes ``places`` ``(K, 2)`` [px] and ``believed``, bool ``(K,)``, whether they are seen there.
        """
        numbers = self._live[due]
        places[due], sure, alike = self._looks.held(numbers, gray, places[due])
        believed[due] &= alike
        self._sure = np.union1d(self._sure[~are_among(self._sure, numbers, len(self.features))], numbers[sure])

    def _regain(self, gray: np.ndarray, q: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Take features of the point's own image that are seen again; what errors of places are multiplied by."""
        gone = np.setdiff1d(self._first[self.features.seen_on(self.on_link.link, self._first)], [*self._live, POINT])
        if not len(gone):
            return directions
        numbers, places = regained(self.features, self._looks, gone, self.on_link.defined_at, gray, q, self._offset)
        self._live, self._places = np.append(self._live, numbers), np.vstack([self._places, places])
        self._sure = np.union1d(self._sure, numbers)
        return np.concatenate([directions, direction_weights(gray, places)])

    def _on_link(self, link: int) -> np.ndarray:
        """Features in sight that are on a link, the point aside."""
        return self._live[self.features.seen_on(link, self._live) & (self._live != POINT)]

    def _own_image(self, features: np.ndarray) -> np.ndarray:
        """Those of some features that were defined in the point's own image and look as they did there.

        What the chain is off between then and now, it is off for them as for the point. Others were placed by the chain
        as it was when they came into sight: they agree with it however far it is off.
        """
        sure = features[are_among(features, self._sure, len(self.features))]
        return sure[np.isin(sure, self._first)]

    def _moved(self, features: np.ndarray, q: np.ndarray) -> float:
        """How far some features moved since the last keyframe at most [px]."""
        before, now = self.features.project(features, self._kept_at), self.features.project(features, q)
        moved = np.linalg.norm(now - before, axis=1)
        return float(moved[moved < AWAY].max(initial=0.0))  # nor nan: one behind the camera has not moved

    def _expected(self, there: np.ndarray) -> np.ndarray:
        """Where features in sight, which the chain has ``there``, should be by now [px]; young ones as those around."""
        step = there - self.features.project(self._live, self._positions)
        known = self.features.states[self._live] == FeatureState.KNOWN
        step[~known | (np.abs(step).max(axis=1, initial=0) > AWAY)] = 0.0
        if known.any() and not known.all():
            across, down = (self._places[known, k] - self._places[~known, k, None] for k in (0, 1))
            near = np.argpartition(across**2 + down**2, min(AROUND, known.sum()) - 1, axis=1)[:, :AROUND]
            step[~known] = middle(step[known][near], axis=1)
        return self._places + step

    def _correct(self, q: np.ndarray, link: int, gray: np.ndarray, directions: np.ndarray) -> None:
        """The point's place: as the chain says, less what the features of its link are off around it, and its look."""
        features = self.features
        expected = features.project(np.array([POINT]), q)[0]
        on = self._on_link(link)
        self.seen, covariance = len(on), self.on_link.covariance(q)
        enough = self.seen >= LEAST_SEEN
        self.unseen = 0 if enough else self.unseen + 1
        first = self._own_image(on)
        self.held = enough and len(first) >= LEAST_SEEN
        self._own, self._sighting = -1.0, None
        if not (np.abs(expected) < 1e5).all():  # behind the camera, or nan, by a chain that is wrong
            self.unseen, self._covariance = max(self.unseen, 1), ANYWHERE
            return
        if enough:
            there = features.project(first, q)
            among = are_among(self._live, first, len(features))
            off = self._places[among] - there - self.on_link.astray(q)
            distances = np.linalg.norm(there - expected, axis=1)
            self._offset, covariance = off_by_features(covariance, off, directions[among], distances)
        else:
            self._offset = np.zeros(2)  # the last that were seen were being covered: what covers them took them along
        place = expected + self._offset
        if self.on_link.depth is not None:
            place, covariance = self._by_look(q, gray, place, covariance)
        self.point, self._covariance = place, covariance

    def _by_look(
        self, q: np.ndarray, gray: np.ndarray, place: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Place and covariance, the depth's doubt and the own look included, which is seen where its depth slips to."""
        assert self.on_link.depth is not None
        _, affine, by_depth = self.on_link.view(q[None])
        slip = self.on_link.slip * by_depth[0]
        beside = covariance + (BASIC**2 + (0.0 if self.held else UNTIED**2)) * np.eye(2)
        seen = self._look.seen(gray, place + slip, affine[0], self._searched(by_depth[0], beside))
        self._own = seen.correlation
        self._sighting = seen.place if seen.correlation > LIKE and seen.as_expected else None
        off = self.on_link.depth.deviation * by_depth[0]
        covariance = covariance + np.outer(off, off)
        if not self.held or seen.correlation < ALIKE or not seen.as_expected:
            return place, covariance  # untied, it is sought so far around that something else may look as much like it
        return with_look(place, covariance, seen.place - slip, seen.drift)

    def _searched(self, by_depth: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """Covariance ``(2, 2)`` [px^2] of a search: by the depth, and what else may be off."""
        assert self.on_link.depth is not None
        off = max(DOUBT * self.on_link.depth.deviation, LEAST_OPEN) * by_depth
        return np.outer(off, off) + beside

    def _find_in(self, keyframes: Sequence[int]) -> None:
        """Find the point itself in the images of some keyframes."""
        features = self.features
        if self.on_link.depth is None or not len(keyframes):
            return
        chosen = [features.keyframes[k] for k in keyframes]
        expected, maps, by_depth = self.on_link.view(np.array([one.positions for one in chosen]))
        expected = expected + self.on_link.slip * by_depth
        for k, one, place, map_, off in zip(keyframes, chosen, expected, maps, by_depth, strict=True):
            found, correlation = self._look.found(one.image, place, map_, self._searched(off, ASIDE**2 * np.eye(2)))
            seen, weight = correlation > BELIEVED, NOISE / max(NOISE, self._look.drift(correlation))
            features.keyframes[k] = one.with_place(POINT, found if seen else None, weight)

    def _uncertainty(self) -> float:
        """Standard deviation of the place [px]; infinite where nothing tells the depth."""
        if self.on_link.depth is None:
            return np.inf
        return self._doubt * place_uncertainty(self._covariance, self._offset, self.held, self._own)

    def _refine(self) -> None:
        """Chain, features and the point, adjusted to all keyframes."""
        self.features.refine(np.append(self._live, POINT), self._first[self._first != POINT])
        self.on_link.place(self._first)

    def _keep(self, gray: np.ndarray, q: np.ndarray, directions: np.ndarray) -> None:
        """A keyframe: decide what it tells of features, look for new ones, and learn from it in the next two images.

        Of features that are known it holds those alone that look as they did at first: the others may have drifted.
        """
        features = self.features
        kept = np.isin(self._live, self._sure) | (features.states[self._live] != FeatureState.KNOWN)
        keyframe = Keyframe(q.copy(), self._live[kept], self._places[kept], gray, directions[kept])
        features.keep(keyframe.with_place(POINT, self._sighting))
        self._kept_at = q
        young = (features.states[self._live] == FeatureState.YOUNG) & (self._live != POINT)
        features.assign(self._live[young])
        kept = features.states[self._live] != FeatureState.DROPPED
        self._live, self._places = self._live[kept], self._places[kept]
        self._look_for_more(gray)
        self._due = [self._find_before, self._learn]  # all at once would take longer than an image

    def _find_before(self) -> None:
        """Find the point in some of the keyframes before the last."""
        others = len(self.features.keyframes) - 1
        self._find_in(sorted({k % others for k in range(self._next, self._next + AGAIN)}))
        self._next += AGAIN

    def _learn(self) -> None:
        """Adjust all to the keyframes, and forget what they no longer hold."""
        features = self.features
        self._refine()
        if len(features) > MOST_FEATURES:
            renumbered = features.forget_unseen(np.concatenate([self._live, self._first]))
            self._sure = renumbered[np.intersect1d(self._sure, self._live)]
            self._live, self._first = renumbered[self._live], renumbered[self._first]
            self._looks.renumber(renumbered)

    def _look_for_more(self, gray: np.ndarray) -> None:
        """New features on and about what is in sight of each link."""
        features = self.features
        found = more_features(features, self._live, self._places, self.on_link.link, self.point, gray)
        if not len(found):
            return
        numbers = features.added(len(found))
        self._looks.take(numbers, gray, found)
        self._live, self._places = np.append(self._live, numbers), np.vstack([self._places, found])
        features.keyframes[-1] = features.keyframes[-1].with_more(numbers, found)

    def _look_back(
        self,
        history: Sequence[tuple[np.ndarray, np.ndarray]],
        body: np.ndarray,
        link: int | None,
        trace: Trace | None,
    ) -> None:
        """Features of the last image, followed back to the first one, and their links."""
        features, gray = self.features, self._gray
        beside = body.astype(np.uint8)
        keep_apart(beside, [self.point], APART + 1)
        begun = np.vstack([self.point, new_features(gray, beside, FIRST_FEATURES, APART + 1)])
        self._first = numbers = features.added(len(begun))
        self._begun = begun
        self.on_link.begin(begun, direction_weights(gray, begun))
        self._looks.take(numbers, gray, begun)
        features.keyframes = followed_back(history, numbers, begun, trace)
        self._live, self._places = numbers, begun.copy()
        features.assign(numbers)
        if link is not None:
            features.links[POINT] = link
        elif features.states[POINT] != FeatureState.KNOWN:
            known = numbers[features.states == FeatureState.KNOWN]
            if len(known):
                near = np.argsort(np.linalg.norm(begun[known] - self._begun[POINT], axis=1))[:VOTES]
                features.links[POINT] = int(np.bincount(features.links[known[near]]).argmax())
        kept_on = features.states != FeatureState.DROPPED
        kept_on[POINT] = False  # it is known by its own look
        self._live, self._places = numbers[kept_on], begun[kept_on]
