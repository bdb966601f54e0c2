"""Which joints slide and which turn, from tracks alone.

J at one posture hardly tells: a hinge whose line passes near the camera moves the image as a slide does. The motion
does: a hinge turns by the angle that its joint says, so its points move on circles, a slide moves them along straight
lines in space. Every joint is taken for a hinge at first. Then each in turn is tried as a slide, with the points and
the other joints as they are, and all of it is adjusted; of the trials that explain the tracks better, the best stays,
and the rest are tried again. A slide has one unknown less than a hinge, so where it explains as much it needs no
further excuse; it must explain clearly more all the same, as a joint that hardly moves is both.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

from dense_vs.body_model.chain import Chain

CLEARLY = 0.95  # of a hinge's robust error, over the tracks that the joint moves, that a slide's has to be below
MOST_TRIED = 2  # joints, the most promising ones
MOST_TURNS, STILL = 6, 0.97  # adjustments of all, and share of the error that the next has to leave less than
PROMISING = 1.5  # times it, after a short adjustment, up to which a slide is adjusted as a whole
# Where the fit is poor, a joint that was taken for a hinge may have misled all of it, so it is begun anew: from this
# robust error on, where tracks are so many times farther from it than noise takes them from smooth ways of their own.
POOR, BEYOND_NOISE = 0.05, 2.0
RESTARTS = 2  # joints


class Fitted(Protocol):
    """A fit as far as it is looked at here."""

    @property
    def state(self) -> Any:
        """With ``chain``."""
        ...

    @property
    def points(self) -> np.ndarray:
        """``(M, 3)`` in the home posture."""
        ...

    @property
    def links(self) -> np.ndarray:
        """``(M,)``."""
        ...

    @property
    def believed(self) -> np.ndarray:
        """Bool ``(M,)``."""
        ...

    @property
    def costs(self) -> np.ndarray:
        """Robust error of each track ``(M,)``, 0 to 1."""
        ...

    @property
    def cost(self) -> float:
        """Mean robust error of the tracks, 0 to 1."""
        ...

    @property
    def error(self) -> float:
        """Median distance between tracks and model [px]."""
        ...


F = TypeVar("F", bound=Fitted)


def with_slides(
    found: F,
    learned: np.ndarray,
    noise: float,
    *,
    take: Callable[[F], F],
    glance: Callable[[F], float],
    restart: Callable[[np.ndarray], F],
) -> F:
    """A fit whose joints slide where that explains more; the same one where none does.

    Args:
        found: all joints turn.
        learned: bool ``(N,)``, joints whose kind is asked for.
        noise: median distance between tracks and smooth ways of their own [px].
        take: adjusts all of a fit.
        glance: the robust error of a fit's believed tracks, after a short adjustment.
        restart: a fit from the beginning with given slides, bool ``(N,)``.
    """
    while True:
        chain = found.state.chain
        hinges = np.flatnonzero(learned & ~chain.slides)
        tried = [_tried_as_slide(found, int(n)) for n in hinges]
        glances = np.array([glance(one) for one in tried])
        promising = [k for k in np.argsort(glances)[:MOST_TRIED] if glances[k] < PROMISING * glance(found)]
        best, share = _best(found, [(int(hinges[k]), _settled(tried[k], take)) for k in promising])
        if share > CLEARLY and found.cost > POOR and found.error > BEYOND_NOISE * noise:
            roots = [n for n in hinges if chain.parents[n] < 0]
            again = dict.fromkeys([*roots, *hinges[np.argsort(glances)]][:RESTARTS])
            begun = [(int(n), restart(chain.slides | (np.arange(len(learned)) == n))) for n in again]
            best, share = _best(found, begun)
        if share > CLEARLY:
            return found
        found = best


def _best(found: F, trials: list[tuple[int, F]]) -> tuple[F, float]:
    """The trial that explains the tracks that its joint moves best, and the share of their error that it leaves."""
    best, least = found, np.inf
    for joint, trial in trials:
        moved = found.state.chain.moved_by[found.links][:, joint]
        share = float(trial.costs[moved].sum() / max(found.costs[moved].sum(), 1e-12)) if moved.any() else np.inf
        if share < least:
            best, least = trial, share
    return best, least


def _settled(trial: F, take: Callable[[F], F]) -> F:
    """A trial, adjusted until it explains no more."""
    best = take(trial)
    for _ in range(MOST_TURNS - 1):
        further = take(best)
        if further.cost > STILL * best.cost:
            return min(best, further, key=lambda one: one.cost)
        best = further
    return best


def _tried_as_slide(found: F, joint: int) -> F:
    """The fit with a joint as a slide, by the mean velocity of what it moves."""
    chain = found.state.chain
    moved = found.believed & chain.moved_by[found.links][:, joint]
    fit: Any = found  # a dataclass, which the protocol cannot say
    return replace(fit, state=replace(found.state, chain=as_slide(chain, joint, found.points[moved])))


def as_slide(chain: Chain, joint: int, points: np.ndarray) -> Chain:
    """A chain with a hinge as a slide that moves points ``(K, 3)`` of the home posture by their mean velocity."""
    velocity = np.cross(chain.axes[joint], points - chain.points[joint])
    axes, travel = chain.axes.copy(), chain.travel.copy()
    axes[joint] = 0.0
    travel[joint] = velocity.mean(axis=0) if len(points) else chain.axes[joint]
    return replace(chain, axes=axes, travel=travel)
