"""A point of the body followed by how its whole link moves, where its own look says too little (beyond DIJE).

On plain links a patch slides along outlines and shading, turns out of sight, or is covered. But the link is rigid and
the joint readings are exact: corners of the link near the point are tracked through the images of the babbling, and
with them :mod:`dense_vs.point_servo.link_motion` is fitted. It says for every posture where the point is. From then on
corners are sought where it says, which corrects it as the robot moves on; corners that turn out of sight are replaced
by new ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from dense_vs.point_servo.link_motion import LinkMotion, first_guesses, refine, uncertainty
from dense_vs.point_servo.surface_patches import SurfacePatches

CORNERS = 40  # that are looked back at, the point among them
TRACKED = 16  # that are sought in an image
SPACING = 7  # px between corners
RADIUS = 90  # px about the point in which corners are chosen
SAME_LINK = 0.8  # relative difference in J up to which two pixels may be on one rigid link
SEEDS = 14  # corners that the fit starts with
OWN_WEIGHT = 4.0  # of the point itself among the corners
HARDLY = 1e-3  # weight of corners that do not fit by then
KEYFRAMES = 60  # images of the babbling that are looked through
KEYFRAME_MOTION = 3.0  # px that the link moves by between two images that are kept
MOST_KEYFRAMES = 150
MOST_CORNERS = 150
SEEN_CORRELATION = 0.8
MOST_JUMP = 3.0  # px from where a corner is expected
MOST_TURN = 0.5  # rad of a joint since a corner was seen last: it looks different by then
FORGOTTEN = 0.9  # of the offset an image where no corners agree
LIKE, ALIKE = 0.8, 0.85  # correlations between which the point's own look comes to count alone
MOST_APART = 4.0  # px, of the two
MOST_OWN_APART = 2.0  # px, of the two, where the point's own look is taken for certain
MARGIN = 8  # px about the known corners in which new ones are chosen
RENEWED_CORRELATION = 0.9  # below it a corner's patch is taken anew
LEAST_SHARE = 0.4  # of the images that a corner is seen in
STILL = 0.3  # of the point's own motion: what moves less is not on the link
GOOD_FIT = 1.0  # px, median residual of a fit that is believed
LEAST_SEEN = 3  # corners that have to agree
AGREEMENT = 1.5  # px, of a corner with the others
FOCAL_GUESS = 0.9  # of the image's width: a lens of 58 deg
CHOSEN_EVERY = 5  # images, at most, new corners
MOST_SPREAD = 1.0  # px, of the corners in sight
MOST_UNCERTAIN = 0.35  # px, standard deviation by the fit
REFINED_EVERY = 4  # keyframes
FIT_ROUNDS = 4
SHARPNESS = 4
YOUNG = 0.05  # weight of a corner that is not proven yet
PROVEN = 6  # keyframes that a new corner has to fit in


@dataclass
class _Seen:
    """What was seen at a time."""

    positions: np.ndarray  # (N,)
    places: np.ndarray  # (K, 2) px
    weights: np.ndarray  # (K,)


class LinkTracker:
    """Follows one point on a rigid link.

    Args:
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], oldest first; in the last one the
            point is defined.
        point: ``(2,)`` [px].
        unlikeness: ``(H, W)``, relative difference of each pixel's J from the point's.
        joints: bool ``(N,)``, those that move the point; all unless given.
        window: side of the patches [px], odd.
        lost_after: images without enough corners in sight after which the point counts as lost.

    Attributes:
        motion: of the link; None where what was seen did not fit a link that turns about N axes.
        point: ``(2,)`` [px], where the point is now.
        seen: number of corners that agree on it in the last image.
        unseen: images since at least :data:`LEAST_SEEN` did.
    """

    def __init__(
        self,
        history: Sequence[tuple[np.ndarray, np.ndarray]],
        point: np.ndarray,
        unlikeness: np.ndarray,
        *,
        joints: np.ndarray | None = None,
        window: int = 25,
        lost_after: int = 15,
    ):
        self.patches = SurfacePatches(window)
        self.fit = np.inf
        self._lost_after = lost_after
        self._correlation, self._own_apart = 1.0, 0.0
        self.point = np.array(point, dtype=np.float64)
        self.motion: LinkMotion | None = None
        self.seen, self.unseen = 0, 0
        self.spread = 0.0
        self._offset = np.zeros(2)
        self._joints = np.ones(len(history[-1][1]), bool) if joints is None else joints
        history = [(image, np.asarray(q, dtype=np.float64)[self._joints]) for image, q in history]
        gray, positions = history[-1]
        self._size = np.array(gray.shape[::-1])
        self._focal_guess = FOCAL_GUESS * gray.shape[1]
        same = unlikeness <= SAME_LINK
        chosen = np.vstack([self.point, self._corners(gray, same, CORNERS - 1, np.zeros((0, 2)))])
        self._kept: list[_Seen] = self._look_back(history, chosen, same)
        x, y = np.clip(chosen.round().astype(int), 0, self._size - 1).T
        self._fit(chosen, positions, unlikeness[y, x])

    @property
    def points(self) -> np.ndarray:
        """Where the point is, ``(1, 2)`` [px], as :attr:`PointTracker.points`."""
        return self.point[None].copy()

    @property
    def lost(self) -> np.ndarray:
        """Bool ``(1,)``: whether its link has not been recognized for ``lost_after`` images. It is still sought."""
        return np.array([self.unseen >= self._lost_after])

    @property
    def correlation(self) -> np.ndarray:
        """float32 ``(1,)``, of the point's own patch in the last image; -1 where it was not found."""
        return np.array([self._correlation], np.float32)

    @property
    def certain(self) -> bool:
        """Whether it is known to about 2 px where the point is.

        By its own look, with the link not far from agreeing, or by the corners in sight and the fit's own uncertainty.
        """
        if self._correlation >= ALIKE and self._own_apart <= MOST_OWN_APART:
            return True
        if self.unseen or self.spread > MOST_SPREAD:
            return False
        return self.uncertainty(self._positions) < MOST_UNCERTAIN

    def update(
        self, gray: np.ndarray, positions: np.ndarray, unlikeness: Callable[[], np.ndarray | None] = lambda: None
    ) -> np.ndarray:
        """Find the point in the present image; its place ``(2,)`` [px].

        Args:
            gray: uint8 ``(H, W)``.
            positions: joint positions [rad].
            unlikeness: gives that of the present image; new corners are chosen where it is small.
        """
        assert self.motion is not None
        self._positions = positions = np.asarray(positions, dtype=np.float64)[self._joints]
        expected = self.motion.project(positions)[0]
        if not np.isfinite(expected[0]).all():  # behind the camera, by a motion that is wrong here
            self.seen, self.unseen, self._correlation = 0, self.unseen + 1, -1.0
            return self.point
        expected = np.where(np.isfinite(expected), expected, -1e6)
        recent = (self._missed < 3)[:, None]
        guess = expected + np.where(recent, self._residual, self._offset)
        inside = self._worth_seeking(guess, positions)
        places, correlation = guess.copy(), np.full(len(guess), -1.0)
        if inside.any():
            found, maps, quality = self.patches.align(self._pixels[inside], gray, guess[inside], self._maps[inside])
            places[inside], correlation[inside] = found, quality
        believed = (correlation > SEEN_CORRELATION) & (np.linalg.norm(places - guess, axis=1) < MOST_JUMP)
        if inside.any():
            taken = believed[inside]
            self._maps[np.flatnonzero(inside)[taken]] = maps[taken]
        residual = places - expected
        weights = np.where(believed, _weights(correlation), 0.0)
        agree = self._agree(residual, weights * self._proven)
        self._correlation = float(correlation[0]) if believed[0] else -1.0
        self._own_apart = float(np.linalg.norm(places[0] - expected[0] - self._offset))
        self.point = self._blended(expected[0] + self._offset, places[0], self._correlation)
        self._renew(gray, guess, expected, residual, correlation, believed & agree)
        self._missed = np.where(believed, 0, self._missed + inside)
        self._seen_at[believed] = positions
        self._residual[believed] = residual[believed]
        self._keep(positions, places, np.where(believed, weights, 0.0))
        self._since_chosen += 1
        if believed.sum() < TRACKED // 2 and self._since_chosen >= CHOSEN_EVERY:
            self._since_chosen = 0
            unlike = unlikeness()
            if unlike is not None:
                self._choose_more(gray, positions, unlike <= SAME_LINK, guess)
        return self.point

    @staticmethod
    def _blended(by_link: np.ndarray, by_look: np.ndarray, correlation: float) -> np.ndarray:
        """The point's own look, where it is hardly changed, tells its place better than the link does."""
        if np.linalg.norm(by_look - by_link) > MOST_APART:
            return by_link
        share = np.clip((correlation - LIKE) / (ALIKE - LIKE), 0, 1)
        return by_link + share * (by_look - by_link)

    def _worth_seeking(self, guess: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Which corners to seek: up to :data:`TRACKED`, those seen last and those seen in postures most like this."""
        inside = np.all((guess > 2) & (guess < self._size - 3), axis=1) & self._active
        unlike = np.abs(self._seen_at - positions).max(axis=1)
        order = np.where(inside & (unlike < MOST_TURN), unlike - 10.0 * (self._missed == 0), np.inf)
        order[0] = -np.inf if inside[0] else np.inf
        best = np.argsort(order)[:TRACKED]
        chosen = np.zeros(len(guess), bool)
        chosen[best] = np.isfinite(order[best]) | (best == 0)
        return chosen & inside

    def _agree(self, residual: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Which corners agree; the offset of what they show from what was expected follows them."""
        used = weights > 0
        if not used.any():
            self.seen, self.unseen = 0, self.unseen + 1
            self._offset *= FORGOTTEN
            return used
        middle = np.median(residual[used], axis=0)
        agree = used & (np.linalg.norm(residual - middle, axis=1) < AGREEMENT)
        self.seen = int(np.sum(agree & self._proven))
        if agree.sum() >= LEAST_SEEN:
            heavy = weights * agree
            mean = heavy @ residual / heavy.sum()
            self.spread = float(np.sqrt(heavy @ np.sum((residual - mean) ** 2, axis=1) / heavy.sum()))
            self._offset += 0.5 * (mean - self._offset)
            self.unseen = 0 if self.seen >= LEAST_SEEN else self.unseen + 1
        else:
            self.unseen += 1
            self._offset *= FORGOTTEN
        return agree

    def _renew(self, gray, guess, expected, residual, correlation, agree) -> None:
        """Take patches anew that look different by now, at the places that the whole link says."""
        agree[0] = False  # the point's own first look is what it is known by
        old = agree & (correlation < RENEWED_CORRELATION) & (np.linalg.norm(residual - self._offset, axis=1) < 1.0)
        if old.any():
            self._pixels[old] = self.patches.taken(gray, (expected + self._offset)[old])
            self._maps[old] = np.eye(2)

    def _keep(self, positions: np.ndarray, places: np.ndarray, weights: np.ndarray) -> None:
        """Note what is seen where the link has moved on, and refine the motion now and then."""
        assert self.motion is not None
        last = self.motion.project(self._kept[0].positions if not self._new else self._kept[-1].positions)[0, 0]
        moved = np.linalg.norm(self.motion.project(positions)[0, 0] - last)
        if moved < KEYFRAME_MOTION:
            return
        self._kept.append(_Seen(positions.copy(), places.copy(), weights.copy()))
        self._new += 1
        if len(self._kept) > MOST_KEYFRAMES:
            del self._kept[KEYFRAMES // 2 :: 7]
        if self._new % REFINED_EVERY == 0:
            self._refine(2)

    def _refine(self, iterations: int) -> None:
        assert self.motion is not None
        Q, Z, W = self._stacked()
        trust = np.where(self._proven, self._share, YOUNG)
        self.motion, _ = refine(
            self.motion, Q, Z, W * trust, focal_guess=self._focal_guess, iterations=iterations, scale=self._scale
        )
        residual = np.linalg.norm(self.motion.project(Q) - Z, axis=2)
        for k in np.flatnonzero(~self._proven & self._active):
            used = W[:, k] > 0
            if used.sum() >= PROVEN:
                good = np.median(residual[used, k]) < AGREEMENT
                self._proven[k] = good
                self._active[k] = good

    def uncertainty(self, positions: np.ndarray) -> float:
        """Standard deviation [px] of the point in a posture, as the fit says."""
        assert self.motion is not None
        Q, _, W = self._stacked()
        trust = self._proven * self._share
        options = {"focal_guess": self._focal_guess, "scale": self._scale}
        return uncertainty(self.motion, Q, W * trust, positions, **options)

    def _stacked(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = len(self._active)
        Z, W = np.zeros((len(self._kept), count, 2)), np.zeros((len(self._kept), count))
        for row, seen in enumerate(self._kept):
            Z[row, : len(seen.places)], W[row, : len(seen.weights)] = seen.places, seen.weights
        return np.array([seen.positions for seen in self._kept]), Z, W

    def _choose_more(self, gray, positions, same, guess) -> None:
        """Corners in place of those that are out of sight."""
        assert self.motion is not None
        current = self._active & (self._missed == 0)
        room = TRACKED - int(np.sum(current))
        if room <= 0 or len(self._active) > MOST_CORNERS:
            return
        found = self._corners(gray, same & self._outline(guess, gray.shape), room, guess[current])
        if not len(found):
            return
        rotation, shift = (value[0] for value in self.motion.poses(positions))
        depth = (rotation @ self.motion.points[0] + shift)[2]
        rays = np.column_stack([(found - self._offset - self.motion.center) / self.motion.focal, np.ones(len(found))])
        points = (depth * rays - shift) @ rotation
        self.motion = replace(self.motion, points=np.vstack([self.motion.points, points]))
        self._pixels = np.concatenate([self._pixels, self.patches.taken(gray, found)])
        self._maps = np.concatenate([self._maps, np.tile(np.eye(2), (len(found), 1, 1))])
        self._seen_at = np.concatenate([self._seen_at, np.tile(positions, (len(found), 1))])
        self._residual = np.concatenate([self._residual, np.tile(self._offset, (len(found), 1))])
        for name, value in (("_active", True), ("_share", 0.5), ("_proven", False), ("_missed", 0)):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.full(len(found), value, dtype=old.dtype)]))

    def _outline(self, guess: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Pixels among the places of the corners that are known to be on the link, bool ``(H, W)``."""
        mask = np.zeros(shape, np.uint8)
        hull = cv2.convexHull(guess[self._proven & self._active].astype(np.float32))
        cv2.fillConvexPoly(mask, hull.round().astype(np.int32), (1,))
        return cv2.dilate(mask, np.ones((2 * MARGIN + 1,) * 2, np.uint8)) > 0

    def _corners(self, gray: np.ndarray, same: np.ndarray, count: int, taken: np.ndarray) -> np.ndarray:
        """Up to ``count`` corners ``(K, 2)`` near the point, apart from those that are taken."""
        y, x = np.mgrid[: gray.shape[0], : gray.shape[1]]
        mask = same & ((x - self.point[0]) ** 2 + (y - self.point[1]) ** 2 < RADIUS**2)
        mask = mask.astype(np.uint8)
        for place in taken:
            cv2.circle(mask, (round(place[0]), round(place[1])), SPACING, (0,), -1)
        found = cv2.goodFeaturesToTrack(gray, count, 0.02, SPACING, mask=mask, blockSize=7)
        return np.zeros((0, 2)) if found is None else found.reshape(-1, 2).astype(np.float64)

    def _look_back(self, history, chosen: np.ndarray, same: np.ndarray) -> list[_Seen]:
        """Track corners from the last image of the history to its first; what was seen, newest first."""
        count = len(chosen)
        picked = np.unique(np.linspace(0, len(history) - 1, min(KEYFRAMES, len(history))).round().astype(int))[::-1]
        gray, positions = history[picked[0]]
        self._pixels = self.patches.taken(gray, chosen, same)
        self._maps = np.tile(np.eye(2), (count, 1, 1))
        places, maps = chosen.copy(), self._maps.copy()
        kept = [_Seen(np.array(positions), places.copy(), np.ones(count))]
        for index in picked[1:]:
            earlier, positions = history[index]
            carried = _carried(gray, earlier, places)
            found, new_maps, correlation = self.patches.align(self._pixels, earlier, carried, maps)
            believed = (correlation > SEEN_CORRELATION) & (np.linalg.norm(found - carried, axis=1) < MOST_JUMP)
            places = np.where(believed[:, None], found, carried)
            maps[believed] = new_maps[believed]
            kept.append(_Seen(np.array(positions), places, np.where(believed, _weights(correlation), 0.0)))
            gray = earlier
        return kept

    def _fit(self, chosen: np.ndarray, reference: np.ndarray, unlikeness: np.ndarray) -> None:
        """Fit the link's motion to what was seen, and leave out corners that are not on the link."""
        count = len(chosen)
        self._active, self._proven = np.ones(count, bool), np.ones(count, bool)
        self._share = np.ones(count)
        self._since_chosen = 0
        self._positions = np.asarray(reference, dtype=np.float64)
        self._missed, self._new, self._scale = np.zeros(count, int), 0, 0.5
        self._residual = np.zeros((count, 2))
        self._seen_at = np.tile(np.asarray(reference, dtype=np.float64), (count, 1))
        if len(self._kept) < 3 * len(reference) or count < LEAST_SEEN:
            return
        Q, Z, W = self._stacked()
        excursions = np.array([np.std(Z[W[:, k] > 0, k], axis=0).sum() for k in range(count)])
        able = (np.mean(W > 0, axis=0) >= LEAST_SHARE) & (excursions > STILL * excursions[0])
        able[0] = True
        heavy = np.where(np.arange(count) == 0, OWN_WEIGHT, 1.0)
        # Those most like the point first: corners of the link before it would make a motion of their own.
        order = [k for k in np.argsort(unlikeness, kind="stable") if able[k]]
        kept = np.zeros(count, bool)
        kept[order[:SEEDS]] = kept[0] = True
        center = (self._size - 1) / 2
        options = {"focal_guess": self._focal_guess}
        guesses = first_guesses(Q, Z, W * kept, np.array(reference), chosen, center, self._focal_guess)
        coarse = slice(None, None, 3)
        weights = W * kept * heavy
        tried = [refine(g, Q[coarse], Z[coarse], weights[coarse], iterations=8, **options) for g in guesses]
        motion = min(tried, key=lambda one: one[1])[0]
        middle, share = 1.0, np.where(kept, 1.0, HARDLY)
        for _ in range(FIT_ROUNDS):
            scale = float(np.clip(middle, 0.3, 1.0))
            motion, _ = refine(motion, Q, Z, W * able * share * heavy, iterations=10, scale=scale, **options)
            residual = np.linalg.norm(motion.project(Q) - Z, axis=2)
            medians = np.array([np.median(residual[W[:, k] > 0, k]) if able[k] else np.inf for k in range(count)])
            middle = float(np.median(medians[kept]))
            kept = medians <= max(2 * middle, 0.3)
            kept[0] = True
            best = max(float(np.quantile(medians[kept], 0.25)), 0.15)
            share = np.where(kept, 1 / (1 + (np.where(kept, medians, 0) / best) ** SHARPNESS), HARDLY)
        self._active, self._share = kept.copy(), share
        self._scale = float(np.clip(middle, 0.3, 1.0))
        self.fit = float(max(middle, medians[0] / 2))
        if kept.sum() >= LEAST_SEEN and self.fit < GOOD_FIT:
            self.motion = motion


def _weights(correlation: np.ndarray) -> np.ndarray:
    return np.clip((correlation - 0.7) / 0.3, 0, 1) ** 2


def _carried(gray: np.ndarray, other: np.ndarray, places: np.ndarray) -> np.ndarray:
    start = places.astype(np.float32)[:, None]
    found, status, _ = cv2.calcOpticalFlowPyrLK(gray, other, start, start.copy(), winSize=(21, 21), maxLevel=3)
    return np.where(status.reshape(-1, 1) > 0, found[:, 0], places).astype(np.float64)
