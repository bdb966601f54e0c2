"""From tracks to joints' lines, camera and points on links: the whole fit.

1. J of every track and the joints that move it (``track_jacobian``), from which the order of the joints follows
   (``joint_tree``).
2. Candidates of lines and depths from the J of those tracks whose link is plainest (``start``).
3. In turns: every track to the link that explains it best (``link_assignment``), bundle adjustment of all
   (``adjustment``). Many candidates on few tracks and images, fewer on more; the one with the least robust error stays.
4. Where it is not known which joints slide, all turned so far; those that slide explain more as slides
   (``joint_kinds``).
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.joint_kinds import with_slides
from dense_vs.body_model.joint_tree import joint_parents
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.link_assignment import Placed, place_points
from dense_vs.body_model.start import FOCAL_HELD, LEAST_TRACKS, WELL_SEEN, Start, find_starts, in_order
from dense_vs.body_model.track_jacobian import LEAST_SEEN, TrackJacobians, track_jacobians
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks
from dense_vs.checks import check_flags, check_kind, check_number, check_options, check_whole, is_list, shown
from dense_vs.errors import DenseVSError

MOVING = 1.5  # px from its mean place that a point must get, or it is taken for background
# Tracks and images that candidates are tried on, turns, and how many are kept.
_STAGES = ((80, 12, 1, 16), (160, 20, 2, 5), (260, 40, 1, 3))
_GLANCED = 3  # every so many images, for a short adjustment
_OUT_OF_ORDER = 1.1  # times what is unexplained: joints in another order than that given have to explain clearly more
_DENSE_SHARE = 0.3  # of the error of a filter's J beside that of the tracks, where candidates are compared


@dataclass(frozen=True, kw_only=True)
class BodyFitOptions:
    """What a fit is told beside the tracks.

    Attributes:
        focal_length: of the camera [px], held if given; else it starts at the image's width and is estimated.
        focal_deviation: standard deviation of the logarithm of a focal length that is not given.
        parents: the joint that carries each joint, -1 for none; found from the tracks if not given.
        slides: whether each joint slides or turns; found from the tracks if not given.
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
    slides: tuple[bool, ...] | None = None
    noise: float = 0.5
    starts: int = 40
    rounds: int = 3
    believed: float = 0.4
    seed: int = 0
    most_tracks: int = 600
    most_images: int = 120

    def __post_init__(self):
        if self.focal_length is not None:
            check_number("focal_length", self.focal_length, above=0)
        check_number("focal_deviation", self.focal_deviation, above=0)
        check_number("noise", self.noise, above=0)
        check_number("believed", self.believed, above=0, below=1)
        for name in ("starts", "rounds", "most_tracks", "most_images"):
            check_whole(name, getattr(self, name), least=1)
        check_whole("seed", self.seed, least=0)
        for name in ("parents", "slides"):
            if getattr(self, name) is not None and not is_list(getattr(self, name)):
                raise DenseVSError(f"{name} is {shown(getattr(self, name))}; expected a value for each joint, or None")
        if self.parents is not None:
            parents = tuple(check_whole("one of parents", one, least=-1) for one in self.parents)
            object.__setattr__(self, "parents", parents)
        if self.slides is not None:
            slides = check_flags("slides", self.slides, len(self.slides))
            object.__setattr__(self, "slides", tuple(slides.tolist()))

    def focal_prior(self, width: int) -> tuple[float, float]:
        """Mean of the focal length [px] in images of a width [px], and standard deviation of its logarithm.

        Raises:
            DenseVSError: a width that is not above 0.
        """
        width = check_whole("width", width, least=1)
        return (float(width), self.focal_deviation) if self.focal_length is None else (self.focal_length, 0.0)


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
        bend: of the lens, see :class:`.Lens`; the tracks are as one that does not bend would show them.
        doubt: times that lines may be farther off than the scatter of the tracks tells.
    """

    state: BodyState
    links: np.ndarray
    tracks: PointTracks
    center: tuple[float, float]
    learned: np.ndarray
    error: float
    all_links: np.ndarray
    bend: float = 0.0
    doubt: float = 1.0

    @property
    def lens(self) -> Lens:
        """The camera's."""
        return Lens.of_center(np.array(self.center), self.bend)


UNKNOWN = -2  # link of a track that no link explains


def fit_body(tracks: PointTracks, options: BodyFitOptions | None = None, dense: DenseMotion | None = None) -> BodyFit:
    """Fit lines, camera and points to tracks.

    Args:
        tracks: the tracks.
        options: as given, or the defaults.
        dense: a filter's J, where one has run: it helps to find where the fit starts.

    Raises:
        DenseVSError: parts of another kind, too few tracks that move, joints that move nothing, or no start that
            fits.
    """
    options = check_options("options", options, BodyFitOptions)
    height, width = check_kind("tracks", tracks, PointTracks).size
    if dense is not None:
        check_kind("dense", dense, DenseMotion)
    center = (width - 1) / 2, (height - 1) / 2
    prior = options.focal_prior(width)
    focal = prior[0]
    seen = tracks.seen.sum(axis=0)
    moving = (_travel(tracks.pixels) > MOVING) & (seen >= LEAST_SEEN)
    if moving.sum() < LEAST_TRACKS:
        raise DenseVSError(f"{int(moving.sum())} tracks move; expected at least {LEAST_TRACKS}")
    used = _share(tracks.select(moving), options)
    home = np.median(used.joints, axis=0)
    measured = track_jacobians(used, home, options.noise)
    parents, learned = _parents(measured, used, options)
    trees = [parents]
    if options.parents is None and (parents != in_order(learned)).any():
        trees.append(in_order(learned))
    turns = _Turns(used, center, learned, options)

    @cache
    def whole(slides: tuple[bool, ...]) -> _Turn:
        starts = find_starts(
            used, measured, trees, np.array(slides), learned, focal, center,
            noise=options.noise, starts=options.starts, seed=options.seed, dense=dense,
        )  # fmt: skip
        return turns.best(starts, measured.places, focal, prior, dense)

    if options.slides is not None:
        found = whole(tuple(options.slides))
    else:
        found = with_slides(
            whole((False,) * len(parents)),
            learned,
            1.1774 * float(np.median(measured.noise[np.isfinite(measured.noise)])),
            take=lambda one: turns.take(one, prior),
            glance=turns.glance,
            restart=lambda slides: whole(tuple(slides.tolist())),
        )
        slides = found.state.chain.slides
        if slides.any():  # known now, which the search for a start did not
            found = min(found, whole(tuple(slides.tolist())), key=lambda one: one.cost)
    state = in_units(replace(found.state, points=found.points[found.believed]))
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
    return tracks.in_images(options.most_images)


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


def _nothing_known(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Links, costs, belief and error of tracks before the first turn."""
    return np.zeros(count, int), np.ones(count), np.zeros(count, bool), np.inf


class _Turns:
    """Every track to the link that explains it best, then bundle adjustment of all, in turns."""

    def __init__(self, tracks: PointTracks, center: tuple[float, float], learned: np.ndarray, options: BodyFitOptions):
        self.tracks, self.center, self.learned, self.options = tracks, center, learned, options

    def best(
        self,
        starts: list[Start],
        places: np.ndarray,
        focal: float,
        prior: tuple[float, float],
        dense: DenseMotion | None,
    ) -> _Turn:
        """The candidate that explains most, after all turns.

        Args:
            starts: candidates.
            places: ``(M, 2)`` of the tracks in the home posture [px].
            focal: held while candidates are compared [px].
            prior: mean and deviation of the logarithm of the focal length then.
            dense: a filter's J, where one has run.
        """
        options, held = self.options, (focal, FOCAL_HELD)

        def first(candidates: list[_Turn], count: int) -> list[_Turn]:
            return sorted(candidates, key=lambda one: self._doubt(one, dense))[:count]

        candidates = [self._begin(start, places) for start in starts]
        shuffled = np.random.default_rng(options.seed).permutation(len(places))
        for tracks, images, turns, kept in _STAGES:
            part = np.sort(shuffled[:tracks])
            few = _Turns(self.tracks.select(part).in_images(images), self.center, self.learned, options)
            tried = [few._of_part(one, part, turns, held) for one in candidates]
            candidates = first(tried, kept)
        for focal_prior, kept in ((held, 2), (prior, 1)):
            candidates = first([self.take(one, focal_prior) for one in candidates], kept)
        found = candidates[0]
        for _ in range(options.rounds - 1):
            found = self.take(found, prior)
        return found

    def _doubt(self, turn: _Turn, dense: DenseMotion | None) -> float:
        """What candidates leave unexplained, more where their joints are not in the given order."""
        doubt, chain = turn.cost, turn.state.chain
        if dense is not None:
            depth = max(float(np.median(turn.points[:, 2])), 1e-6)
            doubt += _DENSE_SHARE * dense.disagreement(chain, turn.state.focal, self.center, self.learned, depth)
        given = self.options.parents is not None or (chain.parents == in_order(self.learned)).all()
        return doubt if given else _OUT_OF_ORDER * doubt

    def _of_part(self, turn: _Turn, part: np.ndarray, turns: int, prior: tuple[float, float]) -> _Turn:
        """Some turns with a part of a candidate's tracks, which this has; the other points stay."""
        some = _Turn(turn.state, turn.points[part], *_nothing_known(len(part)))
        for _ in range(turns):
            some = self.take(some, prior)
        points = turn.points.copy()
        points[part] = some.points
        return replace(turn, state=some.state, points=points, costs=some.costs)

    def _begin(self, start: Start, places: np.ndarray) -> _Turn:
        """From lines and the points of some tracks; the others start at the median depth."""
        count, state = len(places), start.state
        depth = float(np.median(state.points[:, 2]))
        rays = np.column_stack(
            [(np.nan_to_num(places, nan=self.center[0]) - self.center) / state.focal, np.ones(count)]
        )
        points = rays * depth
        if len(start.chosen):
            points[start.chosen] = state.points
        return _Turn(state, points, *_nothing_known(count))

    def take(self, turn: _Turn, prior: tuple[float, float]) -> _Turn:
        """One turn; without one where too few tracks fit."""
        options = self.options
        links, points, costs = assign_links(
            turn.state, self.center, self.tracks, turn.points, self.learned, options.noise
        )
        believed = (costs < options.believed) & (links != BACKGROUND)
        if believed.sum() < LEAST_TRACKS:
            return replace(turn, links=links, points=points, costs=costs, believed=believed)
        some = self.tracks.select(believed)
        state, _, error = adjust(
            replace(turn.state, points=points[believed]), some.joints, some.pixels, links[believed], self.center,
            prior, options.noise, 2, 8, directions=some.directions,
        )  # fmt: skip
        points[believed] = state.points
        return _Turn(state, points, links, costs, believed, error)

    def glance(self, turn: _Turn) -> float:
        """The mean robust error of the believed tracks after a short adjustment, in some of the images."""
        if turn.believed.sum() < LEAST_TRACKS:
            return np.inf
        some = self.tracks.select(turn.believed).of_images(slice(None, None, _GLANCED))
        state = replace(turn.state, points=turn.points[turn.believed])
        links, noise = turn.links[turn.believed], self.options.noise
        prior = state.focal, FOCAL_HELD
        return adjust(
            state, some.joints, some.pixels, links, self.center, prior, noise, 2, 8, directions=some.directions
        )[1]


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
        # By whole distances: across its edge alone, too many links explain a track.
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
    well = measured.usable & (tracks.seen.sum(axis=0) >= WELL_SEEN)
    parents, learned = joint_parents(measured.moved_by[well])
    if not learned.any():
        raise DenseVSError("no joint moves any track; expected joints that move, and a camera that sees what they move")
    if options.parents is not None:
        if len(options.parents) != joints:
            raise DenseVSError(f"parents are {options.parents}; expected {joints} numbers, one a joint")
        parents = np.asarray(options.parents)
    if options.slides is not None and len(options.slides) != joints:
        raise DenseVSError(f"slides are {options.slides}; expected {joints} truth values, one a joint")
    return parents, learned


def in_units(state: BodyState) -> BodyState:
    """The state in the unit of length in which the points' median distance is 1."""
    factor = 1 / float(np.median(state.points[:, 2]))
    return replace(state, chain=state.chain.scaled(factor), points=state.points * factor)
