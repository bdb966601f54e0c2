"""How well a body learned from the first part of a recording predicts the rest: quality without a truth."""

from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.fit import BodyFit, FitOptions, fit_body
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.track_jacobian import LEAST_SEEN
from dense_vs.body_model.tracks import PointTracks
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

MOVING = 0.7  # px


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
    return PointTracks(tracks.joints[:first], tracks.pixels[:first], tracks.references, tracks.size)


def held_out_error(
    tracks: PointTracks, share: float = 0.2, options: FitOptions | None = None, *, found: BodyFit | None = None
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
    options = options or FitOptions()
    part = first_part(tracks, share)
    first = len(part.joints)
    found = found or fit_body(part, options)
    both = (found.all_links >= 0) & (part.seen.sum(axis=0) >= LEAST_SEEN) & tracks.seen[first:].any(axis=0)
    if not both.any():
        raise DenseVSError("no point of the body is seen in both parts; expected a longer recording")
    some, links, chain, focal = tracks.select(both), found.all_links[both], found.state.chain, found.state.focal
    rays = np.column_stack([(np.nanmean(some.pixels[:first], axis=0) - found.center) / focal, np.ones(len(links))])
    before = some.pixels[:first]
    placed = place_points(chain, focal, found.center, part.joints, before, links, rays, options.noise)
    rotation, translation = chain.link_poses(tracks.joints[first:])
    position = np.einsum("tmij,mj->tmi", rotation[:, links], placed.points) + translation[:, links]
    predicted = focal * position[..., :2] / np.maximum(position[..., 2:], 1e-3) + found.center
    after = some.pixels[first:]
    seen = np.isfinite(after[..., 0])
    off = np.linalg.norm(predicted - after, axis=2)[seen]
    last = first - 1 - np.argmax(np.isfinite(before[::-1, :, 0]), axis=0)
    stood = np.linalg.norm(before[last, np.arange(len(links))] - after, axis=2)[seen]
    return HeldOutError(float(np.median(off)), float(np.quantile(off, 0.9)), float(np.median(stood)), int(seen.sum()))
