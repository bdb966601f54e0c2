"""Where the fit starts: lines and depths from J at one posture (``axes_from_jacobian``).

Most tracks of a plain robot say little: on the first links they hardly move, and along outlines they slide. So the
search looks at a core of them, of every link those whose J stands out of its uncertainty and whose link is plainest by
the evidence. Where a filter has run, its dense J says more, and gives candidates too. Each has its reflection in depth
beside it, as under a narrow field of view a body and its reflection have almost the same J. Which tree of joints is
right is not always plain from which joints move what, so the order in which the joints are given is tried beside the
tree that was found.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.axes_from_jacobian import AxesState, axes_from_jacobian, with_median_one
from dense_vs.body_model.chain import BACKGROUND, Chain, ancestors
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.track_jacobian import TrackJacobians, joint_set_evidence
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks
from dense_vs.errors import DenseVSError

FOCAL_HELD = 0.03  # deviation of the logarithm of the focal length while a start is sought
LEAST_TRACKS = 12
WELL_SEEN = 12  # images of a track that takes part
CORE = 20  # tracks of every link
PLAIN = 20.0  # ratio of J to its deviation, and logarithm of the odds of a link, from which more says no more
CANDIDATES, DISTINCT = 20, 16  # lines that J gives, of these those that differ
ALIKE = 0.97  # least cosine between the directions of lines that count as the same
IMAGES = 20  # to which candidates of the core are adjusted
KEPT = 6  # of these, of each tree
MOVED = 0.03  # of the image's width: J of a joint that moves a pixel is at least such [1/rad]
DENSE_DEVIATION = 5.0  # px/rad, of a filter's J


@dataclass(frozen=True)
class Start:
    """A candidate.

    Attributes:
        state: lines, focal length and the points of the tracks that it rests on.
        chosen: indices of these; none where it follows from a filter's J.
    """

    state: BodyState
    chosen: np.ndarray


def find_starts(
    tracks: PointTracks,
    measured: TrackJacobians,
    trees: Sequence[np.ndarray],
    slides: np.ndarray,
    learned: np.ndarray,
    focal: float,
    center: tuple[float, float],
    *,
    noise: float,
    starts: int,
    seed: int,
    dense: DenseMotion | None = None,
) -> list[Start]:
    """Candidates of every tree.

    Args:
        tracks: M tracks.
        measured: their J.
        trees: the joint that carries each joint ``(N,)``, -1 for none, in one or more ways.
        slides: bool ``(N,)``, the joints that slide.
        learned: bool ``(N,)``, the joints that are looked for.
        focal: focal length [px].
        center: principal point [px].
        noise: standard deviation of a track's pixel [px].
        starts: random directions that the search begins at, of each tree.
        seed: of these.
        dense: a filter's J, where one has run.

    Raises:
        DenseVSError: too few tracks that are seen long enough.
    """
    found = []
    for parents in trees:
        chosen, links = core(tracks, measured, parents, learned, noise)
        few = tracks.select(chosen).in_images(IMAGES)
        adjusted = []
        for begun in _candidates(measured.select(chosen), links, parents, slides, focal, center, starts, seed):
            state, cost, _ = adjust(
                begun, few.joints, few.pixels, links, center, (focal, FOCAL_HELD), noise, 2, 8,
                directions=few.directions,
            )  # fmt: skip
            adjusted.append((cost, Start(state, chosen)))
        found += [start for _, start in sorted(adjusted, key=lambda one: one[0])[:KEPT]]
        if dense is not None:
            part, links = dense_core(dense, parents, learned, tracks.size[1], seed)
            for begun in _candidates(part, links, parents, slides, focal, center, starts, seed):
                found.append(Start(begun, np.zeros(0, int)))
    return found


def _candidates(
    part: TrackJacobians,
    links: np.ndarray,
    parents: np.ndarray,
    slides: np.ndarray,
    focal: float,
    center: tuple[float, float],
    starts: int,
    seed: int,
) -> list[BodyState]:
    """Lines and points from J of tracks on given links."""
    rays = np.column_stack([(part.places - center) / focal, np.ones(len(links))])
    found = axes_from_jacobian(
        part, ancestors(parents)[links], parents, focal, center,
        slides=slides, starts=starts, keep=CANDIDATES, seed=seed,
    )  # fmt: skip
    pairs = [(one, reflected(one)) for one in distinct([state for _, state in found], DISTINCT)]
    return [
        BodyState(candidate.chain, rays / candidate.inverse_depths[:, None], focal)
        for pair in pairs
        for candidate in pair
    ]


def dense_core(
    dense: DenseMotion, parents: np.ndarray, learned: np.ndarray, width: int, seed: int
) -> tuple[TrackJacobians, np.ndarray]:
    """Some pixels of every link and the link of each, by which joints move them."""
    size = np.where(learned, np.linalg.norm(dense.jacobians, axis=1), 0.0)
    candidates = np.array([*np.flatnonzero(learned), BACKGROUND])
    carried = ancestors(parents)[candidates]
    least = MOVED * width
    missed = np.stack([np.where(one, least**2, size**2).sum(axis=1) for one in carried])
    links = candidates[missed.argmin(axis=0)]
    order = np.random.default_rng(seed).permutation(len(links))
    chosen = np.concatenate([order[links[order] == link][:CORE] for link in candidates[:-1]])
    chosen, count = np.sort(chosen), size.shape[1]
    spread = np.tile(np.eye(count) * DENSE_DEVIATION**2, (len(chosen), 1, 1))
    part = TrackJacobians(
        dense.posture, dense.pixels[chosen], dense.jacobians[chosen], spread, size[chosen] > least,
        np.zeros(len(chosen)), np.ones(len(chosen), bool),
    )  # fmt: skip
    return part, links[chosen]


def core(
    tracks: PointTracks, measured: TrackJacobians, parents: np.ndarray, learned: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of every link the tracks that say most of it: their indices, and the link of each.

    Raises:
        DenseVSError: fewer than :data:`LEAST_TRACKS`.
    """
    candidates = np.array([*np.flatnonzero(learned), BACKGROUND])
    evidence = joint_set_evidence(tracks, measured, ancestors(parents)[candidates], noise)
    links = candidates[evidence.argmax(axis=1)]
    best = np.sort(evidence, axis=1)
    odds = best[:, -1] - best[:, -2]
    deviation = np.sqrt(np.einsum("mnn->m", measured.covariances) + 1)
    plain = np.minimum(np.linalg.norm(measured.jacobians, axis=(1, 2)) / deviation, PLAIN) * np.minimum(odds, PLAIN)
    width = tracks.size[1]
    inside = (measured.places > -0.5 * width).all(axis=1) & (measured.places < 1.5 * width).all(axis=1)
    good = measured.usable & inside & (tracks.seen.sum(axis=0) >= WELL_SEEN)
    chosen = []
    for link in candidates[:-1]:
        on = np.flatnonzero(good & (links == link))
        chosen += [*on[np.argsort(-plain[on], kind="stable")][:CORE]]
    if len(chosen) < LEAST_TRACKS:
        raise DenseVSError(f"{len(chosen)} tracks are seen long enough to start from; expected {LEAST_TRACKS}")
    chosen = np.sort(np.array(chosen))
    return chosen, links[chosen]


def distinct(states: Sequence[AxesState], most: int) -> list[AxesState]:
    """The first few of some candidates that differ, at unit median depth."""
    kept: list[AxesState] = []
    for state in states:
        near = any(
            np.abs(np.sum(state.chain.directions * other.chain.directions, axis=1)).min() > ALIKE for other in kept
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


def in_order(learned: np.ndarray) -> np.ndarray:
    """Each joint that is learned carried by the one before it, as joints are usually given; the others by none."""
    parents = np.full(len(learned), -1)
    joints = np.flatnonzero(learned)
    parents[joints[1:]] = joints[:-1]
    return parents
