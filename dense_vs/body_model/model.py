"""A body that is known everywhere: its links, axes and surface, learned from a video and joint readings.

    model = BodyModel.fit(images, joints)
    J = model.jacobian(q)                       # of every pixel, at any posture, without an image
    place = model.trace(pixel, q_seen, q)       # where a point of the body will be

Joins what DIJE has, J at every pixel without markers, to what Gothoskar et al. have, one model for all postures (beyond
both papers). Lengths are in a unit of the model's own, as one camera's images leave the scale open.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from dense_vs.arrays import points_array, real_vector, share_image
from dense_vs.body_model.body_change import BodyChange
from dense_vs.body_model.body_views import BodyImage, BodyPoints
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.fit import BodyFit, BodyFitOptions, fit_body
from dense_vs.body_model.fitted_surface import surface_of
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.metric_scale import meters_by_unit
from dense_vs.body_model.model_file import WHAT, ModelContent, body_arrays, body_content
from dense_vs.body_model.nearest_point import nearest_point
from dense_vs.body_model.precision import covariances, precision_of
from dense_vs.body_model.refit import refit
from dense_vs.body_model.surface import Surface, SurfaceOptions
from dense_vs.body_model.surface_image import SurfaceImage
from dense_vs.body_model.tracks import PointTrackOptions, PointTracks, follow_points, gray_images
from dense_vs.checks import check_kind, check_options, is_list
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays
from dense_vs.generative.rotations import rotation_matrices
from dense_vs.kernels.jacobian.present_state import PresentState


class BodyModel:
    """Links, lines of the joints, camera and surface of a body with N joints.

    Made by :meth:`fit` or :meth:`load`.

    Attributes:
        chain: the joints' lines in the home posture.
        focal_length: of the camera [px].
        center: principal point (x, y) [px].
        lens: how it bends the image, about the principal point.
        size: (height, width) of the image [px].
        surface: points on links.
        learned: bool ``(N,)``; joints that moved too little to be learned have no part in the model.
        joint_range: ``(N, 2)`` lowest and highest position seen while learning [rad].
        error: median distance between tracks and model [px].
        precision: of all of these; None where it is not known.
    """

    def __init__(self, content: ModelContent):
        self.chain: Chain = content.chain
        self.focal_length = content.focal_length
        self.center = content.center
        self.lens = Lens.of_center(np.array(content.center), content.bend)
        self.size = content.size
        self.surface: Surface = content.surface
        self.learned = content.learned
        self.joint_range = content.joint_range
        self.error = content.error
        self.precision = content.precision

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of: without the memory that images are drawn in, which it makes itself."""
        return {name: value for name, value in vars(self).items() if name != "_drawing"}

    @classmethod
    def fit(
        cls,
        images: Sequence[np.ndarray] | np.ndarray,
        joints: Any,
        *,
        tracks: PointTracks | None = None,
        track_options: PointTrackOptions | None = None,
        fit_options: BodyFitOptions | None = None,
        surface_options: SurfaceOptions | None = None,
        dense: DenseMotion | None = None,
    ) -> "BodyModel":
        """Learn a body.

        Args:
            images: K gray images uint8 ``(H, W)``, in order of time, of a camera that stands still.
            joints: ``(K, N)`` joint positions of the images [rad].
            tracks: points that were followed already; followed here if not given.
            track_options, fit_options, surface_options: as given, or the defaults.
            dense: a filter's J, where one has run: it helps to find where the fit starts.

        Raises:
            DenseVSError: images, joints or options that do not fit each other, too little that moves, or no body that
                fits.
        """
        followed = check_options("track_options", track_options, PointTrackOptions)
        fit_options = check_options("fit_options", fit_options, BodyFitOptions)
        surface_options = check_options("surface_options", surface_options, SurfaceOptions)
        images = gray_images(images)
        q = real_vector(joints, "joints", (len(images), -1))
        if tracks is None:
            tracks = follow_points(images, q, followed)
        elif check_kind("tracks", tracks, PointTracks).size != images[0].shape or tracks.joints.shape[1] != q.shape[1]:
            raise DenseVSError(
                f"tracks are of images {tracks.size} and {tracks.joints.shape[1]} joints; "
                f"expected {images[0].shape} and {q.shape[1]}"
            )
        found = fit_body(tracks, fit_options, dense)
        looked = [np.ascontiguousarray(images[k]) for k in range(0, len(images), followed.stride)]
        if len(looked) == len(tracks.joints):
            found = refit(found, tracks, looked, fit_options.focal_prior(tracks.size[1]))
        return cls.from_fit(found, looked, q[:: followed.stride], surface_options)

    @classmethod
    def from_fit(
        cls,
        found: BodyFit,
        images: Sequence[np.ndarray],
        joints: np.ndarray,
        options: SurfaceOptions | None = None,
    ) -> "BodyModel":
        """The model of a fit that is done, with the surface that some images show.

        Args:
            found: lines, camera and points.
            images: gray images uint8 ``(H, W)``, as the lens shows them.
            joints: ``(K, N)`` of these images [rad].
            options: of the surface, as given, or the defaults.
        """
        state, surface = found.state, surface_of(found, images, joints, options)
        joint_range = np.stack([joints.min(axis=0), joints.max(axis=0)], axis=1)
        precision = precision_of(found, surface, joints) if len(surface.links) else None
        return cls(
            ModelContent(
                state.chain, state.focal, found.center, found.tracks.size, surface, found.learned, joint_range,
                found.error, precision, found.bend,
            )
        )  # fmt: skip

    @property
    def joint_count(self) -> int:
        """N."""
        return self.chain.joint_count

    def image(self, q: Any) -> BodyImage:
        """Which point of the body is at every pixel at a posture ``(N,)`` [rad]."""
        front = self._drawing.front(self._posture(q, "q"))
        links, depths = np.full(self.size, BACKGROUND), np.full(self.size, np.inf)
        body = front.index >= 0
        seen = front.index[body]
        links[body], depths[body] = self.surface.links[seen], front.positions[seen, 2]
        return BodyImage(front.index.copy(), links, depths)

    def jacobian(self, q: Any) -> np.ndarray:
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad]; 0 off the body."""
        return self.known(q)[0]

    def known(self, q: Any) -> tuple[np.ndarray, np.ndarray]:
        """J at a posture ``(N,)`` [rad], float32 ``(H, W, 2, N)`` [px/rad], and the body's pixels, bool ``(H, W)``."""
        posture = self._posture(q, "q")
        front = self._drawing.front(posture)
        return self._drawing.jacobian(posture, self.learned, front), front.index >= 0

    def moved(self, q: Any, dq: Any) -> tuple[np.ndarray, np.ndarray]:
        """J dq of a joint step ``(N,)`` [rad], float32 ``(H, W, 2)`` [px], 0 off the body, and the body's pixels.

        As by :meth:`known`, and sooner; :meth:`flow` is that of the whole turn.
        """
        posture, step = self._posture(q, "q"), self._posture(dq, "dq")
        front = self._drawing.front(posture)
        return self._drawing.motion(posture, self.learned, front, step), front.index >= 0

    def corrected_jacobian(self, q: Any, measured: Any) -> np.ndarray:
        """J at a posture, the depth of each pixel corrected by a J that was measured; 0 off the body.

        Depth is what a body of one camera's images knows least, and changes J in one direction of 2 N only: where the
        measured J says more of it than the body does, it decides. Where the measured one is far from what any depth
        gives, as where something covers the body, it has little say.

        Args:
            q: ``(N,)`` [rad].
            measured: ``(H, W, 2, N)`` [px/rad], as a filter's.

        Returns:
            float32 ``(H, W, 2, N)`` [px/rad].
        """
        posture = self._posture(q, "q")
        other = real_vector(measured, "measured", (*self.size, 2, self.joint_count), np.float32, copy=False)
        return self._drawing.jacobian(posture, self.learned, self._drawing.front(posture), other)

    def blend(self, q: Any, present: PresentState, share: Any) -> None:
        """Draw a filter's J to :meth:`corrected_jacobian` by shares ``(H, W)``, in place, and sooner than by that.

        Raises:
            DenseVSError: joints or shares that are not finite numbers of these shapes, or a state of another filter
                than one of a world on the CPU with these joints and images.
        """
        posture, weight = self._posture(q, "q"), share_image(share, self.size)
        of = check_kind("present", present, PresentState)
        got = (of.displacement.shape, tuple(of.state.shape[-2:]), of.displacement.device.alias)
        if got != (expected := ((1, self.joint_count), tuple(self.size), "cpu")):
            raise DenseVSError(f"present is of {got}, worlds with joints, image size and device; expected {expected}")
        self._drawing.blend(posture, self.learned, self._drawing.front(posture), of, weight)

    def depth_jacobian(self, q: Any) -> np.ndarray:
        """How depth answers to every joint at a posture ``(N,)`` [rad], float32 ``(H, W, N)``; 0 off the body.

        In the model's unit by rad: in m/rad of a model :meth:`in_meters`.
        """
        posture = self._posture(q, "q")
        front = self._drawing.front(posture)
        D = np.zeros((*self.size, self.joint_count), np.float32)
        body = front.index >= 0
        seen = front.index[body]
        velocities = self.chain.velocities(posture, front.positions[seen].astype(np.float64), self.surface.links[seen])
        D[body] = velocities[..., 2] * self.learned
        return D

    def in_meters(self, depths: Any, joints: Any) -> "BodyModel":
        """The same body with a meter as its unit of length, by some depth images: noise and holes do little to a scale.

        Args:
            depths: K images, each floating point ``(H, W)`` [m], 0 or NaN where depth is not known.
            joints: ``(K, N)`` their postures [rad].

        Raises:
            DenseVSError: depth images of another size or whole numbers, another number of postures, or less than 50
                pixels of the body with depth.
        """
        if not is_list(depths):
            raise DenseVSError(f"depths are a {type(depths).__name__}; expected a list or array of depth images")
        postures = real_vector(joints, "joints", (len(depths), self.joint_count))
        scale = meters_by_unit([self.image(q).depths for q in postures], depths)
        surface = replace(self.surface, points=scale * self.surface.points)
        precision = None if self.precision is None else self.precision.scaled(scale, self.chain.slides)
        chain = self.chain.scaled(scale)
        return BodyModel(replace(self._content(), chain=chain, surface=surface, precision=precision))

    def changed(self, change: BodyChange) -> "BodyModel":
        """The body after a change of joints' zeros or of the camera, as :func:`.find_change` finds it.

        Raises:
            DenseVSError: no change, or one of another number of joints.
        """
        count = len(check_kind("change", change, BodyChange).units)
        if count != self.joint_count:
            raise DenseVSError(f"the change is of {count} joints; expected {self.joint_count}")
        rotation = rotation_matrices(change.turn)
        points = self.surface.points @ rotation.T + change.shift
        chain = self.chain.turned(rotation, change.shift, change.offsets)
        precision = None if self.precision is None else self.precision.turned(rotation, self.chain, chain)
        surface = replace(self.surface, points=points)
        joint_range = self.joint_range + change.offsets[:, None]
        content = replace(self._content(), chain=chain, surface=surface, precision=precision, joint_range=joint_range)
        return BodyModel(content)

    def flow(self, q: Any, dq: Any) -> np.ndarray:
        """Flow, float32 ``(H, W, 2)`` [px], stored at the pixels of the posture ``q`` that was reached by ``dq``.

        It is that of the whole turn, not J dq: ``x - flow(x)`` is where the point at x was at ``q - dq``.
        """
        posture, step = self._posture(q, "q"), self._posture(dq, "dq")
        front = self._drawing.front(posture).index
        flow = np.zeros((*self.size, 2), np.float32)
        body = front >= 0
        now, before = (self._positions(where, front[body]) for where in (posture, posture - step))
        flow[body] = self._project(now) - self._project(before)
        return flow

    def points(self, q: Any) -> BodyPoints:
        """All points of the surface at a posture ``(N,)`` [rad], hidden ones too."""
        posture = self._posture(q, "q")
        positions = self._positions(posture)
        places = self._project(positions)
        front = self._drawing.front(posture).index
        height, width = self.size
        u, v = np.rint(np.clip(places, -1, max(self.size))).astype(int).T
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height) & (positions[:, 2] > 0)
        depth = np.where(front >= 0, positions[front, 2], np.inf)
        visible = inside.copy()
        visible[inside] = positions[inside, 2] <= depth[v[inside], u[inside]] * 1.02
        links = self.surface.links
        return BodyPoints(
            places, positions[:, 2], links, visible, self.surface.support, partial(self._covariances, posture)
        )

    def trace(self, pixels: Any, q_seen: Any, q: Any) -> np.ndarray:
        """Where the body's points that are at some pixels at one posture are at another.

        Args:
            pixels: ``(K, 2)`` x, y [px].
            q_seen: ``(N,)`` the posture in which they are there [rad].
            q: ``(N,)`` the other posture [rad].

        Returns:
            ``(K, 2)`` [px], NaN for a pixel that is more than 8 px off the body. One beside it, as the model's outline
            is not exact, goes with the nearest pixel of the body.
        """
        places, posture = points_array(pixels, "pixels"), self._posture(q, "q")
        there = self.image(q_seen)
        index = nearest_point(there.points, places)
        found = np.full((len(places), 2), np.nan)
        on_body = index >= 0
        if on_body.any():
            found[on_body] = self._moved(places[on_body], index[on_body], q_seen, posture)
        return found

    def rays(self, pixels: Any) -> np.ndarray:
        """Directions ``(K, 3)`` before the camera, of depth 1, in which pixels ``(K, 2)`` are seen.

        Raises:
            DenseVSError: pixels that are not finite numbers.
        """
        away = (self.lens.straight(points_array(pixels, "pixels")) - self.center) / self.focal_length
        return np.column_stack([away, np.ones(len(away))])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        with atomic_write(path) as stream:
            np.savez_compressed(stream, **self.stored())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "BodyModel":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: not such a file, another version of it, or damaged.
        """
        return cls.of_stored(read_arrays(path, WHAT), path)

    def stored(self) -> dict[str, Any]:
        """The arrays that :meth:`save` writes, by name."""
        return body_arrays(self._content())

    @classmethod
    def of_stored(cls, arrays: dict[str, np.ndarray], path: str | os.PathLike[str]) -> "BodyModel":
        """A body from :meth:`stored`, as read from a file at some path.

        Raises:
            DenseVSError: as :meth:`load`.
        """
        return cls(body_content(arrays, path))

    def _content(self) -> ModelContent:
        return ModelContent(
            self.chain, self.focal_length, self.center, self.size, self.surface, self.learned, self.joint_range,
            self.error, self.precision, self.lens.bend,
        )  # fmt: skip

    def _covariances(self, q: np.ndarray) -> np.ndarray:
        if self.precision is None:
            return np.full((len(self.surface.links), 2, 2), np.nan)
        return covariances(self.chain, self.focal_length, self.surface.points, self.surface.links, self.precision, q)

    def _posture(self, q: Any, name: str) -> np.ndarray:
        return real_vector(q, name, (self.joint_count,))

    @cached_property
    def _drawing(self) -> SurfaceImage:
        surface = self.surface
        return SurfaceImage(self.chain, surface.points, surface.links, self.focal_length, self.lens, self.size)

    def _positions(self, q: np.ndarray, index: np.ndarray | None = None) -> np.ndarray:
        """The surface's points ``(P, 3)``, or those of an index, in the camera frame."""
        rotation, translation = self.chain.link_poses(q[None])
        points, links = self.surface.points, self.surface.links
        if index is not None:
            points, links = points[index], links[index]
        positions = np.empty_like(points)
        for link in np.unique(links):
            on = links == link
            positions[on] = points[on] @ rotation[0, link].T + translation[0, link]
        return positions

    def _project(self, positions: np.ndarray) -> np.ndarray:
        depth = np.where(positions[:, 2:] > 1e-6, positions[:, 2:], np.nan)
        return np.nan_to_num(self.lens.bent(self.focal_length * positions[:, :2] / depth + self.center), nan=-1e6)

    def _moved(self, places: np.ndarray, index: np.ndarray, q_seen: Any, q: Any) -> np.ndarray:
        """Places at ``q`` of pixels at ``q_seen``, each at its surface point's depth and on its link."""
        links = self.surface.links[index]
        both = np.stack([self._posture(q_seen, "q_seen"), self._posture(q, "q")])
        rotation, translation = self.chain.link_poses(both)
        seen = self._positions(both[0], index)
        rays = self.rays(places)
        home = np.einsum("pji,pj->pi", rotation[0, links], rays * seen[:, 2:] - translation[0, links])
        return self._project(np.einsum("pij,pj->pi", rotation[1, links], home) + translation[1, links])
