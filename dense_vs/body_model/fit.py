"""From tracks to joints' lines, camera and points on links: the whole fit.

1. J of every track and the joints that move it (``track_jacobian``), from which the order of the joints follows
   (``joint_tree``).
2. Lines and depths from J at one posture (``axes_from_jacobian``), which leaves several candidates: under a narrow
   field of view a body and its reflection in depth have almost the same J.
3. Bundle adjustment of the candidates on a part of the tracks; the one with the least robust error stays.
4. In turns: every track to the link that explains it best (``link_assignment``), bundle adjustment of all.
5. All joints turned so far; those that slide explain more as slides (``joint_kinds``).
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.body_model.axes_from_jacobian import AxesState, axes_from_jacobian, with_median_one
from dense_vs.body_model.chain import BACKGROUND, Chain, ancestors
from dense_vs.body_model.joint_kinds import with_slides
from dense_vs.body_model.joint_tree import joint_parents
from dense_vs.body_model.link_assignment import Placed, place_points
from dense_vs.body_model.solver import solve
from dense_vs.body_model.track_jacobian import LEAST_SEEN, TrackJacobians, track_jacobians
from dense_vs.body_model.track_problem import BodyState, TrackProblem
from dense_vs.body_model.tracks import PointTracks
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError

MOVING = 1.5  # px from its mean place that a point must get, or it is taken for background
_WELL_SEEN = 12  # images of a track that takes part in finding the start
_LEAST_TRACKS = 12
_HELD = 0.03  # deviation of the logarithm of the focal length while a start is sought
_GLANCED = 3  # every so many images, for a short adjustment
_GROSS = 3.0  # times the usual error: weights fall beyond


@dataclass(frozen=True, kw_only=True)
class BodyFitOptions:
    """What a fit is told beside the tracks.

    Attributes:
        focal_length: of the camera [px], held if given; else it starts at the image's width and is estimated.
        focal_deviation: standard deviation of the logarithm of a focal length that is not given.
        parents: the joint that carries each joint, -1 for none; found from the tracks if not given.
        noise: standard deviation of a track's pixel [px].
        starts: random directions of the joints that the search begins at.
        rounds: turns of assignment and adjustment.
        believed: largest mean robust error, 0 to 1, of a track that takes part.
        seed: of the random directions.
        most_tracks: that take part in the adjustment; the links of all are found at the end.
        most_images: that take part, spread over the recording.
    """

    focal_length: float | None = None
    focal_deviation: float = 0.15
    parents: tuple[int, ...] | None = None
    noise: float = 0.5
    starts: int = 16
    rounds: int = 3
    believed: float = 0.4
    seed: int = 0
    most_tracks: int = 400
    most_images: int = 80

    def __post_init__(self):
        if self.focal_length is not None:
            check_number("focal_length", self.focal_length, above=0)
        check_number("focal_deviation", self.focal_deviation, above=0)
        check_number("noise", self.noise, above=0)
        check_number("believed", self.believed, above=0, below=1)
        for name in ("starts", "rounds", "most_tracks", "most_images"):
            check_whole(name, getattr(self, name), least=1)
        check_whole("seed", self.seed, least=0)


@dataclass(frozen=True)
class BodyFit:
    """What a fit found.

    Attributes:
        state: lines, points of the believed tracks, focal length.
        links: ``(M,)`` link of each of these points.
        tracks: the believed tracks.
        center: principal point [px].
        learned: bool ``(N,)``, the joints that moved enough to be learned.
        error: median distance between tracks and model [px].
        all_links: link of every track that was given, :data:`UNKNOWN` where nothing explains it.
    """

    state: BodyState
    links: np.ndarray
    tracks: PointTracks
    center: tuple[float, float]
    learned: np.ndarray
    error: float
    all_links: np.ndarray


UNKNOWN = -2  # link of a track that no link explains


def fit_body(tracks: PointTracks, options: BodyFitOptions | None = None) -> BodyFit:
    """Fit lines, camera and points to tracks.

    Raises:
        DenseVSError: too few tracks that move, joints that move nothing, or no start that fits.
    """
    options = options or BodyFitOptions()
    height, width = tracks.size
    center = (width - 1) / 2, (height - 1) / 2
    focal = options.focal_length or float(width)
    prior = focal, (0.0 if options.focal_length else options.focal_deviation)
    seen = tracks.seen.sum(axis=0)
    moving = (_travel(tracks.pixels) > MOVING) & (seen >= LEAST_SEEN)
    if moving.sum() < _LEAST_TRACKS:
        raise DenseVSError(f"{int(moving.sum())} tracks move; expected at least {_LEAST_TRACKS}")
    used = _share(tracks.select(moving), options)
    home = np.median(used.joints, axis=0)
    measured = track_jacobians(used, home, options.noise, float(width))
    parents, learned = _parents(measured, used, options)
    links = _first_links(measured, parents, learned)
    turn = _Turns(used, center, learned, options)

    def whole(slides: np.ndarray) -> _Turn:
        candidates, chosen = _start(used, measured, links, slides, parents, focal, center, options)
        begun = [turn.take(turn.begin(state, chosen, measured.places), (focal, _HELD)) for state in candidates]
        begun = [turn.take(one, (focal, _HELD)) for one in sorted(begun, key=lambda one: one.cost)[:2]]
        found = min(begun, key=lambda one: one.cost)
        for _ in range(options.rounds):
            found = turn.take(found, prior)
        return found

    found = with_slides(
        whole(np.zeros(len(parents), bool)),
        learned,
        1.1774 * float(np.median(measured.noise[np.isfinite(measured.noise)])),
        take=lambda one: turn.take(one, prior),
        glance=turn.glance,
        restart=whole,
    )
    state = _in_units(replace(found.state, points=found.points[found.believed]))
    all_links = np.full(tracks.pixels.shape[1], UNKNOWN)
    all_links[~moving & (seen >= LEAST_SEEN)] = BACKGROUND
    all_links[moving] = _links_of_all(state, center, tracks.select(moving), learned, options)
    links = found.links[found.believed]
    return BodyFit(state, links, used.select(found.believed), center, learned, found.error, all_links)


def _share(tracks: PointTracks, options: BodyFitOptions) -> PointTracks:
    """The longest of the tracks, the same share of every reference image's, in images spread over the recording."""
    count = tracks.pixels.shape[1]
    if count > options.most_tracks:
        lengths = tracks.seen.sum(axis=0)
        rank = np.zeros(count)
        for reference in np.unique(tracks.references):
            of_one = np.flatnonzero(tracks.references == reference)
            rank[of_one[np.argsort(-lengths[of_one])]] = (np.arange(len(of_one)) + 0.5) / len(of_one)
        tracks = tracks.select(np.sort(np.argsort(rank, kind="stable")[: options.most_tracks]))
    images = len(tracks.joints)
    if images > options.most_images:
        rows = np.unique(np.linspace(0, images - 1, options.most_images).round().astype(int))
        tracks = PointTracks(tracks.joints[rows], tracks.pixels[rows], tracks.references, tracks.size)
    return tracks


def _links_of_all(
    state: BodyState, center: tuple[float, float], tracks: PointTracks, learned: np.ndarray, options: BodyFitOptions
) -> np.ndarray:
    """Link ``(M,)`` of every track, with the chain as it is; :data:`UNKNOWN` where none explains it."""
    middle = np.nan_to_num(np.nanmean(tracks.pixels, axis=0), nan=center[0])
    rays = np.column_stack([(middle - center) / state.focal, np.ones(len(middle))])
    links, _, costs = assign_links(state, center, tracks, rays, learned, options.noise)
    return np.where(costs < options.believed, links, UNKNOWN)


@dataclass(frozen=True)
class _Turn:
    """Where the turns of assignment and adjustment stand; ``cost`` is the mean of the tracks' robust errors."""

    state: BodyState
    points: np.ndarray
    links: np.ndarray
    costs: np.ndarray
    believed: np.ndarray
    error: float

    @property
    def cost(self) -> float:
        return float(self.costs.mean())


class _Turns:
    """Every track to the link that explains it best, then bundle adjustment of all, in turns."""

    def __init__(self, tracks: PointTracks, center: tuple[float, float], learned: np.ndarray, options: BodyFitOptions):
        self.tracks, self.center, self.learned, self.options = tracks, center, learned, options

    def begin(self, state: BodyState, chosen: np.ndarray, places: np.ndarray) -> _Turn:
        """From lines and the points of some tracks; the others start at the median depth."""
        count = len(places)
        depth = float(np.median(state.points[:, 2]))
        rays = np.column_stack(
            [(np.nan_to_num(places, nan=self.center[0]) - self.center) / state.focal, np.ones(count)]
        )
        points = rays * depth
        points[chosen] = state.points
        nothing = np.zeros(count, int)
        return _Turn(state, points, nothing, np.ones(count), nothing.astype(bool), np.inf)

    def take(self, turn: _Turn, prior: tuple[float, float]) -> _Turn:
        """One turn; without one where too few tracks fit."""
        options = self.options
        links, points, costs = assign_links(
            turn.state, self.center, self.tracks, turn.points, self.learned, options.noise
        )
        believed = (costs < options.believed) & (links != BACKGROUND)
        if believed.sum() < _LEAST_TRACKS:
            return replace(turn, links=links, points=points, costs=costs, believed=believed)
        some = self.tracks.select(believed)
        state, _, error = adjust(
            replace(turn.state, points=points[believed]), some.joints, some.pixels, links[believed], self.center,
            prior, options.noise, 2, 8,
        )  # fmt: skip
        points[believed] = state.points
        return _Turn(state, points, links, costs, believed, error)

    def glance(self, turn: _Turn) -> float:
        """The mean robust error of the believed tracks after a short adjustment, in some of the images."""
        if turn.believed.sum() < _LEAST_TRACKS:
            return np.inf
        some, rows = self.tracks.select(turn.believed), slice(None, None, _GLANCED)
        state = replace(turn.state, points=turn.points[turn.believed])
        links, noise = turn.links[turn.believed], self.options.noise
        prior = state.focal, _HELD
        return adjust(state, some.joints[rows], some.pixels[rows], links, self.center, prior, noise, 2, 8)[1]


def adjust(
    state: BodyState,
    joints: np.ndarray,
    pixels: np.ndarray,
    links: np.ndarray,
    center: tuple[float, float],
    focal_prior: tuple[float, float],
    noise: float,
    rounds: int,
    iterations: int,
) -> tuple[BodyState, float, float]:
    """Bundle adjustment with weights that fall with the error, found anew in every round.

    Returns:
        The state, its mean robust error (0 to 1) and its median error [px].
    """
    for _ in range(rounds):
        whole = TrackProblem(joints, pixels, links, center, np.ones(pixels.shape[:2]), focal_prior, noise)
        squared = np.minimum((whole.errors(state) ** 2).sum(axis=1), 1e12)
        scale = max(noise, float(np.median(np.sqrt(squared))) / 1.1774)
        weights = np.zeros(pixels.shape[:2])
        weights[whole.image, whole.point] = 1 / (1 + squared / (_GROSS * scale) ** 2) ** 2
        problem = TrackProblem(joints, pixels, links, center, weights, focal_prior, noise)
        state, _ = solve(problem, state, iterations, 1e-4)
    squared = np.minimum((whole.errors(state) ** 2).sum(axis=1), 1e12)
    robust = float(np.mean(squared / (squared + (_GROSS * noise) ** 2)))
    return state, robust, float(np.median(np.sqrt(squared)))


def assign_links(
    state: BodyState,
    center: tuple[float, float],
    tracks: PointTracks,
    points: np.ndarray,
    learned: np.ndarray,
    noise: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best link ``(M,)`` of every track, its point there ``(M, 3)`` and the mean robust error ``(M,)``."""
    count = tracks.pixels.shape[1]
    candidates = [*np.flatnonzero(learned), BACKGROUND]
    placed: list[Placed] = []
    for link in candidates:
        on_link = np.full(count, link)
        placed.append(
            place_points(state.chain, state.focal, center, tracks.joints, tracks.pixels, on_link, points, noise)
        )
    costs = np.array([one.cost for one in placed])
    best = costs.argmin(axis=0)
    links = np.array(candidates)[best]
    return links, np.array([placed[b].points[m] for m, b in enumerate(best)]), costs.min(axis=0)


def _travel(pixels: np.ndarray) -> np.ndarray:
    """Largest distance ``(M,)`` of each track from its mean place [px]; 0 where it was never seen."""
    seen = np.isfinite(pixels[..., 0])
    mean = np.where(seen[..., None], pixels, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
    return np.where(seen, np.linalg.norm(np.nan_to_num(pixels) - mean, axis=2), 0).max(axis=0, initial=0)


def _parents(measured: TrackJacobians, tracks: PointTracks, options: BodyFitOptions) -> tuple[np.ndarray, np.ndarray]:
    joints = tracks.joints.shape[1]
    well = measured.usable & (tracks.seen.sum(axis=0) >= _WELL_SEEN)
    parents, learned = joint_parents(measured.moved_by[well])
    if not learned.any():
        raise DenseVSError("no joint moves any track; expected joints that move, and a camera that sees what they move")
    if options.parents is not None:
        if len(options.parents) != joints:
            raise DenseVSError(f"parents are {options.parents}; expected {joints} numbers, one a joint")
        parents = np.asarray(options.parents)
    return parents, learned


def _first_links(measured: TrackJacobians, parents: np.ndarray, learned: np.ndarray) -> np.ndarray:
    """The link whose joints agree best with those that move each track."""
    moved = ancestors(parents)
    candidates = [*np.flatnonzero(learned), BACKGROUND]
    wrong = np.stack([(measured.moved_by[:, learned] != moved[k][learned]).sum(axis=1) for k in candidates])
    return np.array(candidates)[wrong.argmin(axis=0)]


def _start(
    tracks: PointTracks,
    measured: TrackJacobians,
    links: np.ndarray,
    slides: np.ndarray,
    parents: np.ndarray,
    focal: float,
    center: tuple[float, float],
    options: BodyFitOptions,
) -> tuple[list[BodyState], np.ndarray]:
    """The best of the candidates that J gives, adjusted on a part of the tracks, and which tracks these are."""
    good = measured.usable & (links != BACKGROUND) & (tracks.seen.sum(axis=0) >= _WELL_SEEN)
    width = tracks.size[1]
    inside = (measured.places > -0.5 * width).all(axis=1) & (measured.places < 1.5 * width).all(axis=1)
    chosen = np.flatnonzero(good & inside)
    if len(chosen) < _LEAST_TRACKS:
        raise DenseVSError(f"{len(chosen)} tracks are seen long enough to start from; expected {_LEAST_TRACKS}")
    part = replace(
        measured,
        **{
            name: getattr(measured, name)[chosen]
            for name in ("places", "jacobians", "covariances", "moved_by", "noise", "usable")
        },
    )
    found = axes_from_jacobian(
        part, ancestors(parents)[links[chosen]], parents, focal, center, slides=slides, starts=options.starts,
        seed=options.seed,
    )  # fmt: skip
    rays = np.column_stack([(part.places - center) / focal, np.ones(len(chosen))])
    trials = []
    for axes in _distinct(found):
        for candidate in (axes, reflected(axes)):
            state = BodyState(candidate.chain, rays / candidate.inverse_depths[:, None], focal)
            trials.append((np.inf, state))
    # Many candidates on few images, fewer on more.
    prior = focal, _HELD
    for stride, rounds, kept in ((4, 1, 8), (2, 2, 5)):
        rows = slice(None, None, stride)
        joints, pixels = tracks.joints[rows], tracks.pixels[rows][:, chosen]
        tried = []
        for _, begun in trials:
            state, cost, _ = adjust(begun, joints, pixels, links[chosen], center, prior, options.noise, rounds, 8)
            tried.append((cost, state))
        trials = sorted(tried, key=lambda one: one[0])[:kept]
    return [state for _, state in trials], chosen


def _distinct(found: list[tuple[float, AxesState]], most: int = 6) -> list[AxesState]:
    """The first few of the candidates that differ, at unit median depth."""
    kept: list[AxesState] = []
    for _, state in found:
        near = any(
            np.abs(np.sum(state.chain.directions * other.chain.directions, axis=1)).min() > 0.97 for other in kept
        )
        if not near and len(kept) < most:
            kept.append(with_median_one(state))
    return kept


def reflected(state: AxesState) -> AxesState:
    """The body reflected in depth about the distance 1: nearly the same J under a narrow field of view.

    A reflection turns a direction w of a line into -S w, S = diag(1, 1, -1).
    """
    chain = state.chain
    flip = np.array([1.0, 1.0, -1.0])
    depth = np.clip(2 - 1 / state.inverse_depths, 0.4, None)
    mirrored = Chain(
        -chain.axes * flip, chain.points * flip + [0, 0, 2], chain.home, chain.parents, chain.travel * flip
    )
    return AxesState(mirrored, 1 / depth)


def _in_units(state: BodyState) -> BodyState:
    """The state in the unit of length in which the points' median distance is 1."""
    factor = 1 / float(np.median(state.points[:, 2]))
    return replace(state, chain=state.chain.scaled(factor), points=state.points * factor)
