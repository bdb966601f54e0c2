"""How well a body's surface is known: the covariance of lines, focal length and depths, and what it comes to in pixels.

The bundle adjustment leaves lines and focal length theta with the covariance C = S^+ (sum g g') S^+, S its normal
equations once the tracks' points are eliminated (Schur complement), g the gradient of some tracks that began in one
image. Errors of a track are alike in all images, so the tracks' own scatter counts, not the number of their pixels. S
is singular along the open unit of length; so is C.

A point of the surface is known by a pixel in a keyframe and a depth there. Where theta moves, its depth follows as that
of the tracks around it does; what is left is its own error of depth, by how far its link's surface is off its tracks.
So its place u in another posture has the covariance

    sum_j (du / d theta_j)(du / d theta_j)' + s^2 (du / d log z)(du / d log z)' + b^2 I

with theta_j along the columns of a square root of C, s the relative deviation of depths of its link, b that of a place.
Beyond the papers.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.track_problem import NEAREST, TrackProblem

GROSS = 3.0  # times the usual error: weights fall beyond, as in the fit
TOGETHER = 8  # tracks of one image that count as one source of error
FOCAL_DEVIATION = 0.15  # of the logarithm of the focal length, before anything is seen
NOISE = 0.5  # px, of a track
SINGULAR = 1e-9  # of the largest eigenvalue: directions that leave every pixel where it is
NEAR = 4  # tracks around a point, whose depths its own follows
LEAST_DEPTH, MOST_DEPTH = 0.003, 0.2  # of the relative deviation of depths
LEAST_COMPARED = 8  # tracks of a link from which it has a deviation of its own
LEAST_STEP = 5e-4  # a shorter step of the root of the covariance is not believed: what the model lacks is more
BESIDE = 3.0  # px between a track and a point of the surface that are compared


@dataclass(frozen=True)
class Precision:
    """What is known of a body's errors.

    Attributes:
        lines: ``(R, 4 N + 1)`` square root of the covariance: steps of one standard deviation each of the lines, as
            :meth:`Chain.moved` takes them, and of the logarithm of the focal length.
        depth_steps: ``(P, R)`` by which the logarithm of each point's depth follows each of these.
        depths: ``(P,)`` relative standard deviation of each point's own depth.
        postures: ``(V, N)`` of the keyframes [rad].
        keyframes: ``(P,)`` in which of these each point was found.
        place: standard deviation of a point's place in its keyframe, in x and in y [px].
    """

    lines: np.ndarray
    depth_steps: np.ndarray
    depths: np.ndarray
    postures: np.ndarray
    keyframes: np.ndarray
    place: float

    @property
    def information(self) -> np.ndarray:
        """Inverse of the covariance, ``(4 N + 1, 4 N + 1)``; 0 along what it does not know, as the unit of length."""
        length = np.linalg.norm(self.lines, axis=1, keepdims=True)
        along = np.divide(self.lines, length, out=np.zeros_like(self.lines), where=length > 0)
        known = along / np.maximum(length, LEAST_STEP)
        return known.T @ known

    def scaled(self, factor: float, slides: np.ndarray) -> "Precision":
        """The same in another unit of length, as :meth:`.Chain.scaled`; ``slides`` bool ``(N,)``: joints that do."""
        joints = len(slides)
        lines = self.lines.copy()
        of_lines = lines[:, : 4 * joints].reshape(len(lines), joints, 4)  # a view
        of_lines *= np.where(slides[:, None], factor, [1.0, 1.0, factor, factor])
        return replace(self, lines=lines)

    def turned(self, rotation: np.ndarray, before: Chain, after: Chain) -> "Precision":
        """The same of a chain that was turned, as :meth:`.Chain.turned`.

        Args:
            rotation: ``(3, 3)`` by which it was.
            before, after: the chain.
        """
        joints, lines = before.joint_count, self.lines.copy()
        steps = lines[:, : 4 * joints].reshape(len(lines), joints, 4)  # a view
        across = np.einsum("nki,nli->nkl", after.across, before.across @ rotation.T)
        both = np.einsum("nkl,rnpl->rnpk", across, steps.reshape(len(lines), joints, 2, 2)).reshape(steps.shape)
        shifts = np.append(steps[..., :3] @ rotation.T, steps[..., 3:], axis=-1)
        steps[...] = np.where(before.slides[:, None], shifts, both)
        return replace(self, lines=lines, postures=self.postures + (after.home - before.home))


def precision_of(found: BodyFit, surface: Surface, postures: np.ndarray) -> Precision:
    """What a fit and its surface leave open.

    Args:
        found: the fit.
        surface: with ``seen_at``.
        postures: ``(K, N)`` of the images that the surface was found in [rad].
    """
    indices, keyframes = np.unique(surface.seen_at, return_inverse=True)
    lines, responses = _adjusted(found)
    tracks = _TracksOnLinks(found, responses)
    count = len(surface.links)
    steps, depths = np.zeros((count, len(lines)), np.float32), np.zeros(count)
    ratios: dict[int, list[np.ndarray]] = {int(link): [] for link in np.unique(surface.links)}
    for k, posture in enumerate(postures[indices]):
        chosen = np.flatnonzero(keyframes == k)
        seen = tracks.at(posture, lines)
        there = _positions(found.state.chain, posture, surface.points[chosen], surface.links[chosen])
        for link in np.unique(surface.links[chosen]):
            on, own = surface.links[chosen] == link, np.flatnonzero(found.links == link)
            if not len(own):
                continue
            places = there[on, :2] / there[on, 2:]
            distance, near = cKDTree(seen.places[own]).query(places, k=np.arange(min(NEAR, len(own))) + 1)
            weight = 1 / (distance + 1 / found.state.focal)
            weight /= weight.sum(axis=1, keepdims=True)
            steps[chosen[on]] = np.einsum("pk,pkr->pr", weight, seen.steps[own[near]])
            beside, nearest = cKDTree(places).query(seen.places[own])
            close = beside * found.state.focal < BESIDE
            ratio = np.abs(np.log(there[on, 2][nearest] / seen.depths[own]))
            ratios[int(link)].append(ratio[close])
    usual = _deviation(np.concatenate([ratio for of_link in ratios.values() for ratio in of_link] or [np.zeros(0)]))
    for link, of_link in ratios.items():
        compared = np.concatenate([*of_link, np.zeros(0)])
        depths[surface.links == link] = _deviation(compared) if len(compared) >= LEAST_COMPARED else usual
    return Precision(lines, steps, depths, postures[indices], keyframes, max(found.error / 1.1774, 0.3))


def covariances(
    chain: Chain, focal: float, points: np.ndarray, links: np.ndarray, precision: Precision, q: np.ndarray
) -> np.ndarray:
    """Covariance of the places of surface points at a posture, ``(P, 2, 2)`` [px^2]; infinite behind the camera.

    Args:
        chain, focal: of the body.
        points: ``(P, 3)`` in the home posture.
        links: ``(P,)``.
        precision: of the same body.
        q: ``(N,)`` [rad].
    """
    postures = np.vstack([precision.postures, q])
    rotation, translation = chain.link_poses(postures)
    at = precision.keyframes, links
    there = np.einsum("pij,pj->pi", rotation[at], points) + translation[at]

    def places(chain: Chain, focal_share: float, log_depths: np.ndarray) -> np.ndarray:
        rotation, translation = chain.link_poses(postures)
        # From a keyframe to q on every link: R_q R_k', t_q - R_q R_k' t_k.
        turn = np.einsum("lij,vlkj->vlik", rotation[-1], rotation[:-1])
        shift = translation[-1] - np.einsum("vlij,vlj->vli", turn, translation[:-1])
        seen = there * np.exp(log_depths)[:, None]
        seen[:, :2] /= focal_share
        p = np.einsum("pij,pj->pi", turn[at], seen) + shift[at]
        depth = np.where(p[:, 2:] > NEAREST, p[:, 2:], np.nan)
        return focal * focal_share * p[:, :2] / depth

    nothing = np.zeros(len(points))
    base = places(chain, 1.0, nothing)
    total = np.tile(precision.place**2 * np.eye(2), (len(points), 1, 1))
    small = 0.01
    joints = chain.joint_count
    for step, log_depths in zip(precision.lines, precision.depth_steps.T, strict=True):
        moved = chain.moved(small * step[: 4 * joints].reshape(joints, 4))
        off = (places(moved, float(np.exp(small * step[-1])), small * log_depths) - base) / small
        total += np.einsum("pi,pj->pij", off, off)
    by_depth = (places(chain, 1.0, np.full(len(points), small)) - base) / small * precision.depths[:, None]
    total += np.einsum("pi,pj->pij", by_depth, by_depth)
    return np.nan_to_num(total, nan=np.inf)


def _adjusted(found: BodyFit) -> tuple[np.ndarray, np.ndarray]:
    """Square root of the covariance ``(R, 4 N + 1)``, and how the tracks' points follow, ``(M, 3, 4 N + 1)``."""
    tracks, state = found.tracks, found.state
    whole = TrackProblem(
        tracks.joints, tracks.pixels, found.links, found.center, np.ones(tracks.pixels.shape[:2]), (state.focal, 1.0),
        directions=tracks.directions,
    )  # fmt: skip
    squared = np.minimum((whole.errors(state) ** 2).sum(axis=1), 1e12)
    scale = max(NOISE, found.error / 1.1774)
    weights = np.zeros(tracks.pixels.shape[:2])
    weights[whole.image, whole.point] = 1 / (1 + squared / (GROSS * scale) ** 2) ** 2
    size = 4 * state.chain.joint_count + 1
    reduced, scatter = np.zeros((size, size)), np.zeros((size, size))
    responses = np.zeros((len(found.links), 3, size))
    groups = 0
    for group in _groups(tracks.references):
        # The focal length's prior is added once, below.
        some = tracks.select(group)
        problem = TrackProblem(
            some.joints, some.pixels, found.links[group], found.center, weights[:, group], (state.focal, 1e6), NOISE,
            directions=some.directions,
        )  # fmt: skip
        part = type(state)(state.chain, state.points[group], state.focal)
        equations = problem.linearize(part)
        assert equations.local is not None
        assert equations.coupling is not None
        assert equations.local_gradient is not None
        traces = np.trace(equations.local, axis1=1, axis2=2)
        local = equations.local + (1e-9 * traces + 1e-12)[:, None, None] * np.eye(3)
        responses[group] = -np.linalg.solve(local, equations.coupling)
        reduced += equations.shared + np.einsum("mis,mit->st", equations.coupling, responses[group])
        g = equations.shared_gradient + np.einsum("mis,mi->s", responses[group], equations.local_gradient)
        scatter += np.outer(g, g)
        groups += 1
    reduced[-1, -1] += (NOISE / FOCAL_DEVIATION) ** 2
    scatter *= groups / max(groups - 1, 1)
    inverse = _inverse(0.5 * (reduced + reduced.T))
    values, vectors = np.linalg.eigh(inverse @ scatter @ inverse)
    kept = values > 1e-12 * max(float(values[-1]), 1e-300)
    return found.doubt * (vectors[:, kept] * np.sqrt(values[kept])).T, responses


def _groups(references: np.ndarray) -> list[np.ndarray]:
    """Tracks that began in one image, some at a time."""
    groups = []
    for reference in np.unique(references):
        of_one = np.flatnonzero(references == reference)
        groups += np.array_split(of_one, max(1, round(len(of_one) / TOGETHER)))
    return groups


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of normal equations whose unknowns differ in size; what moves no pixel stays."""
    root = np.sqrt(np.diagonal(matrix))
    scale = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=values > SINGULAR * values[-1])
    return (vectors * inverse) @ vectors.T * np.outer(scale, scale)


@dataclass(frozen=True)
class _SeenTracks:
    """Tracks' points at a posture: normalized places ``(M, 2)``, depths ``(M,)``, steps ``(M, R)`` of log depths."""

    places: np.ndarray
    depths: np.ndarray
    steps: np.ndarray


class _TracksOnLinks:
    """The fit's points, and how their depths follow lines and focal length."""

    def __init__(self, found: BodyFit, responses: np.ndarray):
        self._found, self._responses = found, responses

    def at(self, posture: np.ndarray, lines: np.ndarray) -> _SeenTracks:
        """The points at a posture ``(N,)`` [rad]."""
        state, links = self._found.state, self._found.links
        joints = state.chain.joint_count
        base = _positions(state.chain, posture, state.points, links)
        small = 0.01
        steps = np.zeros((len(links), len(lines)))
        for r, line in enumerate(lines):
            chain = state.chain.moved(small * line[: 4 * joints].reshape(joints, 4))
            points = state.points + small * self._responses @ line
            moved = _positions(chain, posture, points, links)
            steps[:, r] = np.log(np.maximum(moved[:, 2], NEAREST) / np.maximum(base[:, 2], NEAREST)) / small
        depth = np.maximum(base[:, 2], NEAREST)
        return _SeenTracks(base[:, :2] / depth[:, None], depth, steps)


def _positions(chain: Chain, posture: np.ndarray, points: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Camera frame ``(P, 3)``."""
    rotation, translation = chain.link_poses(posture[None])
    return np.einsum("pij,pj->pi", rotation[0, links], points) + translation[0, links]


def _deviation(off: np.ndarray) -> float:
    """Standard deviation from absolute values, some of which are gross."""
    usual = 1.4826 * float(np.median(off)) if len(off) else MOST_DEPTH
    return float(np.clip(usual, LEAST_DEPTH, MOST_DEPTH))
