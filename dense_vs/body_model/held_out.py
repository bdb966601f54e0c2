"""How well a body learned from the first part of a recording predicts the rest: quality without a truth."""

from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.fit import BodyFit, BodyFitOptions, fit_body
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.model import BodyModel
from dense_vs.body_model.track_jacobian import LEAST_SEEN
from dense_vs.body_model.tracks import PointTracks
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

MOVING = 0.7  # px
SAME_PLACE = 1.0  # px between a track and the surface point that it is compared with
ASKED = 8  # held-out images whose covariances are asked for
ONE_DEVIATION = 2.279  # square of the distance that 68 % of normal errors in a plane lie within, in their own units


@dataclass(frozen=True)
class HeldOutError:
    """Distances between tracks and prediction in images that the fit has not seen.

    Attributes:
        median, p90: of the distances [px].
        standing_still: median distance from where each point was last seen in the first part, for comparison [px].
        observations: how many there are.
    """

    median: float
    p90: float
    standing_still: float
    observations: int


@dataclass
class ExplainedFlow:
    """E = 1 - sum |u - p|^2 / sum |u|^2 of predictions p, over pixels whose flow u is above 0.7 px.

    Attributes:
        moved, left: sums over what was added so far [px^2].
    """

    moved: float = 0.0
    left: float = 0.0

    def add(self, flow: np.ndarray, predicted: np.ndarray) -> None:
        """One image's flow and prediction ``(H, W, 2)`` [px]; what is not finite does not count."""
        squared = np.sum(np.square(flow, dtype=np.float64), axis=2)
        moving = np.isfinite(squared) & (squared > MOVING**2)
        self.moved += float(squared[moving].sum())
        self.left += float(np.sum((flow[moving] - predicted[moving]) ** 2))

    @property
    def share(self) -> float:
        """E; NaN where nothing moved."""
        return 1 - self.left / self.moved if self.moved else float("nan")


def first_part(tracks: PointTracks, share: float) -> PointTracks:
    """Tracks without the last share of the images."""
    first = round((1 - check_number("share", share, above=0, below=1)) * len(tracks.joints))
    return tracks.of_images(slice(first))


def held_out_error(
    tracks: PointTracks, share: float = 0.2, options: BodyFitOptions | None = None, *, found: BodyFit | None = None
) -> HeldOutError:
    """Fit the first part of the images, predict the points that are seen in the last one as well.

    Points that were not believed to be on the body in the first part do not count, gross errors of their tracks in the
    last one do.

    Args:
        tracks: of the whole recording.
        share: of the images that are held out, the last ones.
        options: of the fit.
        found: the fit of :func:`first_part`, if it is done already.

    Raises:
        DenseVSError: as :func:`fit_body`, or no point that is seen in both parts.
    """
    options = options or BodyFitOptions()
    part = first_part(tracks, share)
    first = len(part.joints)
    found = found or fit_body(part, options)
    both = (found.all_links >= 0) & (part.seen.sum(axis=0) >= LEAST_SEEN) & tracks.seen[first:].any(axis=0)
    if not both.any():
        raise DenseVSError("no point of the body is seen in both parts; expected a longer recording")
    some, links, chain, focal = tracks.select(both), found.all_links[both], found.state.chain, found.state.focal
    rays = np.column_stack([(np.nanmean(some.pixels[:first], axis=0) - found.center) / focal, np.ones(len(links))])
    before, directions = some.pixels[:first], part.select(both).directions
    placed = place_points(chain, focal, found.center, part.joints, before, links, rays, options.noise, directions)
    rotation, translation = chain.link_poses(tracks.joints[first:])
    position = np.einsum("tmij,mj->tmi", rotation[:, links], placed.points) + translation[:, links]
    predicted = focal * position[..., :2] / np.maximum(position[..., 2:], 1e-3) + found.center
    after = some.pixels[first:]
    seen = np.isfinite(after[..., 0])
    off = np.linalg.norm(predicted - after, axis=2)[seen]
    last = first - 1 - np.argmax(np.isfinite(before[::-1, :, 0]), axis=0)
    stood = np.linalg.norm(before[last, np.arange(len(links))] - after, axis=2)[seen]
    return HeldOutError(float(np.median(off)), float(np.quantile(off, 0.9)), float(np.median(stood)), int(seen.sum()))


def share_within_deviation(model: BodyModel, tracks: PointTracks, first: int) -> float:
    """Share of held-out places that lie within one deviation of the model's, 0.68 where that knows its own errors.

    A track is compared with the surface point that is at the same place in the last image of the first part that shows
    it, in so far as it is on the body there.

    Args:
        model: of the images before ``first``.
        tracks: of the whole recording.
        first: index of the first image that is held out.

    Returns:
        The share, NaN where no point is seen in both parts or the model does not know its errors.
    """
    seen = tracks.seen
    both = np.flatnonzero(seen[:first].any(axis=0) & seen[first:].any(axis=0))
    last = first - 1 - np.argmax(seen[:first][::-1, both], axis=0)
    points, offsets = np.full(len(both), -1), np.zeros((len(both), 2))
    for image in np.unique(last):
        there = model.points(tracks.joints[image])
        visible = np.flatnonzero(there.visible)
        on = np.flatnonzero(last == image)
        if not len(visible):
            continue
        apart = tracks.pixels[image, both[on]][:, None] - there.pixels[visible][None]
        nearest = np.linalg.norm(apart, axis=2).argmin(axis=1)
        offset = apart[np.arange(len(on)), nearest]
        same = np.linalg.norm(offset, axis=1) < SAME_PLACE
        points[on[same]], offsets[on[same]] = visible[nearest[same]], offset[same]
    found = []
    count = len(tracks.joints)
    for image in np.unique(np.linspace(first, count - 1, min(ASKED, count - first)).round().astype(int)):
        asked = np.flatnonzero((points >= 0) & seen[image, both])
        if not len(asked):
            continue
        there = model.points(tracks.joints[image])
        off = there.pixels[points[asked]] + offsets[asked] - tracks.pixels[image, both[asked]]
        covariance = there.covariances[points[asked]]
        known = np.isfinite(covariance).all(axis=(1, 2))
        inverse = np.linalg.inv(covariance[known])
        found.append(np.einsum("pi,pij,pj->p", off[known], inverse, off[known]) < ONE_DEVIATION)
    within = np.concatenate([*found, np.zeros(0, bool)])
    return float(within.mean()) if len(within) else float("nan")
