"""A fit anew, from places that it says where to look for: each point's patch, turned as the chain has it by then.

Tracks are followed before anything is known of the body: by shifts alone, from one image to the next, and lost where a
surface turns. Once lines and depths are about known, every point is sought in all images at once where it has to be,
by its patch in its own image as an affine map shows it there (ECC, Evangelidis & Psarakis 2008). These places reach
across the whole recording and do not drift, and the lens's bend shows in them: the axes of commercial arms come out two
to five times nearer than by the first tracks. Beyond the papers.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.feature_flow import new_features
from dense_vs.body_model.fit import BodyFit, assign_links, in_units
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.spread import spread
from dense_vs.body_model.surface_patches import SurfacePatches
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks

REFERENCES = 12  # images in which points are chosen
PER_REFERENCE, OF_PIXELS, LEAST_IN_ONE = 60, 320 * 240, 20  # points in each at most, in images so large; in any image
APART = 4  # px
AROUND, NEAR = 3, 12.0  # points of the fit that a new one takes its link and depth from, and px that they may be away
IMAGES = 40  # at most, in which they are sought
EVERY = 2, 1  # one in so many of these, in each round of looking and adjusting
WINDOW = 9  # px, side of a patch
ALIKE, FARTHEST = 0.9, 2.5  # correlation, and px from where it is expected, of a place that is believed
BORDER = 4.0  # px from the image's border
LEAST_SEEN = 8  # images
LEAST_POINTS = 40
BELIEVED = 0.4  # mean robust error of a point's places, 0 to 1, up to which it takes part
NOISE = 0.5  # px
BEND_DEVIATION = 0.035  # of a webcam's lens, about none
DOUBT = 2.5  # times what the scatter tells of lines: far postures of six recordings were 8 times as far off, 5 before
PASSES, ITERATIONS = 3, 6  # of the adjustment


def refit(
    found: BodyFit,
    tracks: PointTracks,
    images: Sequence[np.ndarray],
    focal_prior: tuple[float, float],
) -> BodyFit:
    """A fit with lines, focal length and lens anew; as it was where too few points are seen again.

    Args:
        found: the fit.
        tracks: that it was made of.
        images: gray uint8 ``(H, W)`` of these.
        focal_prior: mean of the focal length [px] and the standard deviation of its logarithm; 0 holds it.

    Returns:
        Its tracks are the new places, as a lens that does not bend would show them.
    """
    looks = _Looks(found, tracks, images)
    if len(looks.links) < LEAST_POINTS:
        return found
    state = looks.begin(found.state)
    for every in EVERY:
        places, directions = looks.places(state, every)
        lens = _lens(found.center, state.bend)
        straight = np.full_like(places, np.nan)
        seen = np.isfinite(places[..., 0])
        straight[seen] = lens.straight(places[seen])
        followed = PointTracks(looks.joints, straight, looks.references, tracks.size, directions)
        links, points, costs = assign_links(state, found.center, followed, state.points, found.learned, NOISE)
        kept = (seen.sum(axis=0) >= LEAST_SEEN) & (costs < BELIEVED) & (links != BACKGROUND)
        if kept.sum() < LEAST_POINTS:
            return found
        looks.links = links
        part, _, error = adjust(
            replace(state, points=points[kept]), looks.joints, places[:, kept], links[kept], found.center,
            focal_prior, NOISE, PASSES, ITERATIONS, BEND_DEVIATION, directions[:, kept],
        )  # fmt: skip
        points[kept] = part.points
        state = replace(part, points=points)
    pinhole = BodyState(state.chain, state.points[kept], state.focal)
    lens = _lens(found.center, state.bend)
    straight[seen] = lens.straight(places[seen])
    followed = PointTracks(looks.joints, straight, looks.references, tracks.size, directions)
    return replace(
        found,
        state=in_units(pinhole),
        links=links[kept],
        tracks=followed.select(kept),
        error=error,
        bend=state.bend,
        doubt=DOUBT,
    )


def _lens(center: tuple[float, float], bend: float) -> Lens:
    return Lens.of_center(np.array(center), bend)


class _Looks:
    """Points as their own images show them, sought in others; the arguments are those of :func:`refit`."""

    def __init__(self, found: BodyFit, tracks: PointTracks, images: Sequence[np.ndarray]):
        self._center, self._size = found.center, tracks.size
        self._where = spread(len(images), IMAGES)
        self._images, self.joints = [images[int(k)] for k in self._where], tracks.joints[self._where]
        self._patches = SurfacePatches(WINDOW)
        chosen = [
            self._choose(found, images[int(k)], tracks.joints[k], int(k)) for k in spread(len(images), REFERENCES)
        ]
        self._begun, self.links, self._points, self._postures, self.references, self._pixels = (
            np.concatenate(part) for part in zip(*chosen, strict=True)
        )

    def _choose(self, found: BodyFit, image: np.ndarray, q: np.ndarray, reference: int) -> tuple[np.ndarray, ...]:
        """Corners of an image on and about the fit's points, each with the link and the depth of those around it."""
        state, center = found.state, np.array(found.center)
        rotation, translation = (pose[0] for pose in state.chain.link_poses(q[None]))
        position = np.einsum("mij,mj->mi", rotation[found.links], state.points) + translation[found.links]
        front = position[:, 2] > 1e-3
        position, links = position[front], found.links[front]
        places = state.focal * position[:, :2] / position[:, 2:] + center
        near = np.zeros(image.shape, np.uint8)
        for x, y in np.rint(np.clip(places, -99, 9999)).astype(int):
            cv2.circle(near, (int(x), int(y)), int(NEAR), 1, -1)
        count = max(LEAST_IN_ONE, min(PER_REFERENCE, round(PER_REFERENCE * image.size / OF_PIXELS)))
        corners = new_features(image, near > 0, count, APART).reshape(-1, 2)
        apart = np.linalg.norm(places[None] - corners[:, None], axis=2)
        around = np.argsort(apart, axis=1)[:, :AROUND]
        voted = np.array([np.bincount(links[some]).argmax() for some in around], int)
        depths = np.where(np.equal(links[around], voted[:, None]), position[around, 2], np.nan)
        depth = np.nanmedian(depths, axis=1)
        rays = np.column_stack([(corners - center) / state.focal, np.ones(len(corners))])
        home = np.einsum("mji,mj->mi", rotation[voted], rays * depth[:, None] - translation[voted])
        count = len(corners)
        return (
            corners,
            voted,
            home,
            np.tile(q, (count, 1)),
            np.full(count, reference),
            self._patches.taken(image, corners),
        )

    def begin(self, state: BodyState) -> BodyState:
        """The fit's lines, with the points chosen."""
        return BodyState(state.chain, self._points, state.focal)

    def places(self, state: BodyState, every: int) -> tuple[np.ndarray, np.ndarray]:
        """Places ``(T, M, 2)`` [px], NaN where not seen, and what their errors are multiplied by ``(T, M, 2, 2)``.

        Args:
            state: that says where to look.
            every: one in so many images is looked at.
        """
        expected, maps = self._expected(state)
        places = np.full(expected.shape, np.nan)
        directions = np.zeros((*expected.shape, 2))
        height, width = self._size
        beyond = np.array([width, height]) - 1 - BORDER
        sought_at = np.isfinite(maps).all(axis=(2, 3)), np.all((expected > BORDER) & (expected < beyond), axis=2)
        inside = np.logical_and(*sought_at)
        for row, image in list(enumerate(self._images))[::every]:
            own = self.references == self._where[row]
            sought = np.flatnonzero(inside[row] & ~own)
            there, _, correlation = self._patches.align(
                self._pixels[sought], image, expected[row, sought], maps[row, sought]
            )
            off = np.linalg.norm(there - expected[row, sought], axis=1)
            good = (correlation > ALIKE) & (off < FARTHEST)
            places[row, sought[good]] = there[good]
            places[row, own] = self._begun[own]
            seen = np.isfinite(places[row, :, 0])
            directions[row, seen] = direction_weights(image, places[row, seen])
        return places, directions

    def _expected(self, state: BodyState) -> tuple[np.ndarray, np.ndarray]:
        """Where the points have to be in every image ``(T, M, 2)`` [px], and maps ``(T, M, 2, 2)`` from their own.

        Around a point its surface is taken for one that faces the camera; the alignment finds how it is slanted.
        """
        lens, chain, center = _lens(self._center, state.bend), state.chain, np.array(self._center)
        every = np.arange(len(self.links))
        rotation, translation = chain.link_poses(self._postures)
        rotation, translation = rotation[every, self.links], translation[every, self.links]
        depth = np.einsum("mj,mj->m", rotation[:, 2], state.points) + translation[:, 2]

        def home(beside: tuple[float, float]) -> np.ndarray:
            away = (lens.straight(self._begun + np.array(beside)) - center) / state.focal
            here = np.column_stack([away, np.ones(len(away))]) * depth[:, None]
            return np.einsum("mji,mj->mi", rotation, here - translation)

        turned, moved = chain.link_poses(self.joints)

        def seen(points: np.ndarray) -> np.ndarray:
            position = np.einsum("tmij,mj->tmi", turned[:, self.links], points) + moved[:, self.links]
            far = np.where(position[..., 2:] > 1e-3, position[..., 2:], np.nan)
            return lens.bent(state.focal * position[..., :2] / far + center)

        middle, right, below = (seen(home(beside)) for beside in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
        return middle, np.stack([right - middle, below - middle], axis=-1)
