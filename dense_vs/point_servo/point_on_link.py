"""A point of a link, known by its pixel when it was defined and a depth: where and how it is seen in other postures."""

from typing import Any

import numpy as np

from dense_vs.point_servo.body_features import BodyFeatures, FeatureState
from dense_vs.point_servo.place_errors import PlaceErrors
from dense_vs.point_servo.place_posterior import CHAIN, FARTHER, UNKNOWN_LINES, off_by_features
from dense_vs.point_servo.plainness import FEATURES_SLIP, OWN_SLIP, SURFACE_SLIP
from dense_vs.point_servo.planned_posture import planned_posture
from dense_vs.point_servo.point_depth import (
    LEAST_NEAR,
    SURFACE,
    UNKNOWN,
    PointDepth,
    depth_of_features,
    farther,
    point_depth,
    together,
    tried_depths,
    witnessed,
)
from dense_vs.point_servo.surface_place import SurfacePlace
from dense_vs.point_servo.turned_view import turned_view

POINT = 0  # index of the point among the features
ANYWHERE = 1e8 * np.eye(2)  # px^2, covariance of a place of which nothing is known before
SMALL = 0.01  # of the logarithm of the depth, for derivatives
NOWHERE = np.zeros(2)


class PointOnLink:
    """The first of a body's features.

    Args:
        features: of the body; index 0 is the point.
        pixel: ``(2,)`` [px], where it was defined.
        positions: joint positions ``(N,)`` [rad] then.
        surface: there, of a body model in the unit of the features' chain as it is now; None where it has none.
        plain: how plain the image was there, see :func:`.plainness`.

    Attributes:
        depth: then; None where nothing tells.
        slip: of its logarithm, by which it seems greater by the point's own look.
    """

    def __init__(
        self,
        features: BodyFeatures,
        pixel: np.ndarray,
        positions: np.ndarray,
        surface: SurfacePlace | None = None,
        plain: float = 0.0,
    ):
        self._features = features
        self._pixel, self.defined_at = np.array(pixel, dtype=np.float64), np.array(positions, dtype=np.float64)
        self.depth: PointDepth | None = None
        self._surface, self._plain, self.slip = surface, plain, OWN_SLIP * plain
        self._slope = NOWHERE  # of the surface about it, see PointDepth
        self._first_depths: np.ndarray | None = None  # of the features that were seen then, by the chain at first
        self._begun = np.zeros((0, 2)), np.zeros((0, 2, 2))  # their places then and directions
        self._astray = np.zeros(2)
        self._errors: tuple[Any, PlaceErrors, Any] | None = None
        self._viewed: tuple[Any, tuple[np.ndarray, np.ndarray, np.ndarray], Any] | None = None

    @property
    def link(self) -> int:
        """That it is on."""
        return int(self._features.links[POINT])

    def begin(self, places: np.ndarray, directions: np.ndarray) -> None:
        """Take the places of the features that were seen when it was defined.

        Args:
            places: ``(K, 2)`` [px].
            directions: ``(K, 2, 2)``, what errors of these are multiplied by.
        """
        self._begun = places, directions

    def astray(self, q: np.ndarray) -> np.ndarray:
        """How far from its place the chain has it in a posture ``(N,)`` [rad] because of where it was defined [px].

        There it is at its pixel whatever the chain says, and the features about it are not: by what these are off
        there, turned as the link has turned, their places tell less of the point's.
        """
        if self.depth is None or not self._astray.any():
            return NOWHERE
        return self.view(q[None])[1][0] @ self._astray

    def place(self, first: np.ndarray) -> None:
        """Find its depth, and what the features about it were off where it was defined, by what is known now.

        Args:
            first: indices of features that were seen when it was defined, always the same ones.
        """
        features = self._features
        surface = self._by_surface(first)
        on = features.seen_on(self.link, first) & (first != POINT)
        if len(self._begun[0]) == len(first):
            self._astray = self._off_about(first[on], *(known[on] for known in self._begun))
        first = first[on]
        there = features.positions(first, self.defined_at)
        front = there[:, 2] > 1e-3
        by_features = depth_of_features(features.pixels(there[front]), there[front, 2], self._pixel)
        self._slope = NOWHERE if by_features is None else by_features.slope
        by_features = farther(by_features, -FEATURES_SLIP * self._plain)
        around = together(by_features, surface)
        if around is None:
            if features.states[POINT] != FeatureState.KNOWN:
                return
            depth = features.positions(np.array([POINT]), self.defined_at)[0, 2]
            around = PointDepth(float(max(depth, 1e-2)), UNKNOWN)
        postures, places, directions = features.tracks(np.array([POINT]))
        seen = np.isfinite(places[:, 0, 0])
        rotation, translation = (poses[seen, self.link] for poses in features.chain.link_poses(postures))
        tried = self._at(tried_depths(around) * np.exp(self.slip))
        there = tried @ rotation.swapaxes(1, 2) + translation[:, None]  # (T, STEPS, 3)
        expected = features.pixels(there.reshape(-1, 3)).reshape(*there.shape[:2], 2)
        errors = (expected - places[seen]) @ directions[seen, 0].swapaxes(1, 2)
        relief = 0.0 if self._surface is None else self._surface.relief
        by_places = point_depth(around, np.hypot(errors[..., 0], errors[..., 1]).T)
        self.depth = witnessed(by_places, by_features, surface, relief, self._plain)
        features.points[POINT] = self._at(np.array([self.depth.depth]))[0]
        features.states[POINT] = FeatureState.KNOWN

    def _off_about(self, numbers: np.ndarray, begun: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """How far from where the chain has them features were seen about the point when it was defined [px]."""
        if len(numbers) < LEAST_NEAR:
            return NOWHERE
        there = self._features.project(numbers, self.defined_at)
        distances = np.linalg.norm(there - self._pixel, axis=1)
        return off_by_features(ANYWHERE, begun - there, directions, distances)[0]

    def _by_surface(self, first: np.ndarray) -> PointDepth | None:
        """Its depth by the body model's surface, in the chain's unit of length, which drifts with the chain."""
        features = self._features
        if self._surface is None or self._surface.link != self.link:
            return None
        known = features.seen_on(self.link, first) & (first != POINT)
        depths = features.positions(first, self.defined_at)[:, 2]
        depths[~known | (depths <= 0)] = np.nan
        if self._first_depths is None:
            self._first_depths = depths
        drift = depths / self._first_depths
        unit = float(np.nanmedian(drift)) if np.isfinite(drift).any() else 1.0
        return farther(PointDepth(self._surface.depth * unit, SURFACE), -SURFACE_SLIP * self._plain)

    def view(self, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How the point's surroundings are seen in postures ``(T, N)`` [rad].

        Returns:
            Expected places ``(T, 2)`` [px], maps ``(T, 2, 2)`` of px about the point in the first image to px there,
            and places by the logarithm of the depth ``(T, 2)`` [px].
        """
        assert self.depth is not None
        features, depth = self._features, self.depth.depth
        chain, lens, slope = features.chain, features.lens, self._slope
        # An image asks three times for the same; chain and lens are replaced, never changed.
        asked = postures.tobytes(), depth, slope.tobytes(), self.link, features.focal, id(chain), id(lens)
        if self._viewed is not None and self._viewed[0] == asked:
            return self._viewed[1]
        pixels, links, slopes = np.tile(self._pixel, (2, 1)), np.full(2, self.link), np.tile(slope, (2, 1))
        depths = depth * np.exp([0.0, SMALL])  # its own, and a little more
        places, maps = turned_view(features, pixels, depths, links, self.defined_at, postures, slopes)
        view = places[:, 0], maps[:, 0], (places[:, 1] - places[:, 0]) / SMALL
        self._viewed = asked, view, (chain, lens)  # kept, so that no others get their numbers
        return view

    def covariance(self, q: np.ndarray) -> np.ndarray:
        """Of the place ``(2, 2)`` [px^2] that the chain has it at in a posture ``(N,)`` [rad], its own depth aside."""
        if self.depth is None or self._surface is None or self._surface.steps is None:
            return UNKNOWN_LINES**2 * np.eye(2)
        by_lines = FARTHER * self._place_errors()(q[None])[0, :-1]
        return by_lines.T @ by_lines + CHAIN**2 * np.eye(2)

    def _place_errors(self) -> PlaceErrors:
        assert self.depth is not None
        features = self._features
        known = id(features.chain), features.focal, self.depth, self.link
        if self._errors is None or self._errors[0] != known:
            made = PlaceErrors(features, self._pixel, self.defined_at, self.depth, self._surface, self.link)
            self._errors = known, made, features.chain  # kept, so that no other chain gets its number
        return self._errors[1]

    def posture_for(
        self,
        target: np.ndarray,
        positions: np.ndarray,
        limits: np.ndarray,
        *,
        held: np.ndarray,
        start: np.ndarray | None = None,
    ) -> np.ndarray | None:
        """A posture ``(N,)`` [rad] in which the point is seen at a target ``(2,)`` [px], by what is known now.

        Args:
            target, positions, limits, start: as in :func:`planned_posture`.
            held: bool ``(N,)``, joints that stay where they are, as do those that the chain does not know.
        """
        if self.depth is None:
            return None
        errors = self._place_errors()
        _, views = self._seen_in(self.defined_at[None])

        def seen(postures: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            return *self._seen_in(postures), errors(postures).reshape(len(postures), -1)

        fixed = np.asarray(held, dtype=bool) | ~self._features.learned
        width, height = np.rint(2 * self._features.center + 1).astype(int).tolist()
        size = height, width
        return planned_posture(
            seen,
            views[0],
            target,
            positions,
            limits,
            fixed=fixed,
            home=self.defined_at,
            size=size,
            start=start,
        )

    def _seen_in(self, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places ``(T, 2)`` [px] and views ``(T, 3)``, see :data:`.Seen`."""
        rotation, translation = self._features.chain.link_poses(postures)
        rotation, translation = rotation[:, self.link], translation[:, self.link]
        there = rotation @ self._features.points[POINT] + translation
        views = np.einsum("tji,tj->ti", rotation, there)
        return self._features.pixels(there), views / np.linalg.norm(views, axis=1, keepdims=True)

    def _at(self, depth: np.ndarray) -> np.ndarray:
        """The point in the home posture ``(K, 3)``, by some depths ``(K,)`` of it when defined, in the chain's unit."""
        features = self._features
        rotation, translation = features.chain.link_poses(self.defined_at[None])
        here = depth[:, None] * features.rays(self._pixel[None])
        return (here - translation[0, self.link]) @ rotation[0, self.link]
