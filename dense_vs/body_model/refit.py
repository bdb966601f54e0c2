"""A fit anew, from places that it says where to look for: each point's patch, turned as the chain has it by then.

Tracks are followed before anything is known of the body: by shifts alone, from one image to the next, and lost where a
surface turns. Once lines and depths are about known, every point is sought in all images at once where it has to be,
by its patch in its own image as an affine map shows it there (ECC, Evangelidis & Psarakis 2008). These places reach
across the whole recording and do not drift, and the lens's bend shows in them: the axes of commercial arms come out two
to five times nearer than by the first tracks.

That is done twice. At first points are corners on and about those of the fit, most of which are outlines: of plain arms
up to two in three are beside the arm, where its outline crosses a line of the floor. So a first surface is found by
this fit, the points are corners within it then, and what a swaying camera moved is taken out. Beyond the papers.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.corners import Corners, corners_about, corners_on
from dense_vs.body_model.fit import BodyFit, assign_links, in_units
from dense_vs.body_model.fitted_surface import surface_of
from dense_vs.body_model.image_sway import motions_to_first
from dense_vs.body_model.sought_points import SoughtPoints
from dense_vs.body_model.spread import spread
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.surface_image import SurfaceImage
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks
from dense_vs.flow.camera_motion import CameraMotion

IMAGES = 40  # at most, in which points are sought
REFERENCES = 12  # of these, in which they are chosen
EVERY = 2, 1  # one in so many of IMAGES is looked through, in each round of looking and adjusting
ON_SURFACE = 1, 1, 1  # the same for points on the surface
ROUGH = SurfaceOptions(keyframes=5)  # of that surface, which need not be complete
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
    where = spread(len(images), IMAGES)
    looked, joints = [images[int(k)] for k in where], tracks.joints[where]

    def sought(choose: Callable[[np.ndarray, np.ndarray], Corners]) -> SoughtPoints:
        points = SoughtPoints(looked, joints, found.center)
        for row in spread(len(looked), REFERENCES):
            points.add(choose(looked[row], joints[row]), int(row))
        return points

    near = sought(lambda image, q: corners_about(found, image, q))
    every = EVERY if len(looked) >= max(EVERY) * LEAST_SEEN else ON_SURFACE  # few images are all looked through
    first = _adjusted(found, near, every, focal_prior, tracks.size)
    if first is found:
        return found
    surface = surface_of(first, images, tracks.joints, ROUGH)
    if not len(surface.links):
        return first
    state = first.state
    drawn = SurfaceImage(state.chain, surface.points, surface.links, state.focal, first.lens, tracks.size)
    sways = motions_to_first(looked, [drawn.front(q).index >= 0 for q in joints])
    on = sought(lambda image, q: corners_on(first, surface, drawn, image, q))
    return _adjusted(first, on, ON_SURFACE, focal_prior, tracks.size, sways)


def _adjusted(
    found: BodyFit,
    sought: SoughtPoints,
    every: tuple[int, ...],
    focal_prior: tuple[float, float],
    size: tuple[int, int],
    sways: Sequence[CameraMotion] | None = None,
) -> BodyFit:
    """The fit by points that are sought in every so many images, in rounds; as it was where too few are seen.

    Args:
        found: the fit.
        sought: points; those that another link explains better change over.
        every: one in so many images is looked at, in each round.
        focal_prior: see :func:`refit`.
        size: (height, width) of the images.
        sways: what takes the places of each image to those of a camera that does not sway.
    """
    if len(sought.links) < LEAST_POINTS:
        return found
    state = BodyState(found.state.chain, sought.points, found.state.focal, found.bend)
    for one_in in every:
        places, directions = sought.places(state, one_in)
        for row, sway in enumerate(sways or ()):
            places[row] = sway.moved(places[row])
        seen = np.isfinite(places[..., 0])
        followed = _straight(found, sought, places, directions, state.bend, size)
        links, points, costs = assign_links(state, found.center, followed, state.points, found.learned, NOISE)
        kept = (seen.sum(axis=0) >= LEAST_SEEN) & (costs < BELIEVED) & (links != BACKGROUND)
        if kept.sum() < LEAST_POINTS:
            return found
        sought.links = links
        part, _, error = adjust(
            replace(state, points=points[kept]), sought.joints, places[:, kept], links[kept], found.center,
            focal_prior, NOISE, PASSES, ITERATIONS, BEND_DEVIATION, directions[:, kept],
        )  # fmt: skip
        points[kept] = part.points
        state = replace(part, points=points)
    return replace(
        found,
        state=in_units(BodyState(state.chain, state.points[kept], state.focal)),
        links=links[kept],
        tracks=_straight(found, sought, places, directions, state.bend, size).select(kept),
        error=error,
        bend=state.bend,
        doubt=DOUBT,
    )


def _straight(
    found: BodyFit, sought: SoughtPoints, places: np.ndarray, directions: np.ndarray, bend: float, size: tuple[int, int]
) -> PointTracks:
    """Places as a lens that does not bend would show them."""
    straight, seen = np.full_like(places, np.nan), np.isfinite(places[..., 0])
    straight[seen] = replace(found, bend=bend).lens.straight(places[seen])
    return PointTracks(sought.joints, straight, sought.references, size, directions)
