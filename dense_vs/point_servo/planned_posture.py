"""A posture in which a point of the body is seen at its target, planned in one step with the body's chain.

DIJE (17) goes straight through the image and knows no more than the next step: on a far way joints meet their limits,
and the surface turns out of sight. With the chain a whole move is planned at once, as Gothoskar et al. do by their
model. Of the postures that bring the point to its target, one is chosen that is near, in which it is well known where
the point will be, by what the body model leaves open and by the point's depth, in which the surface is seen from where
it was seen when the point was defined, so that it looks alike, and to which the point's way is in the image.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

TRIED, REFINED = 1000, 4  # postures at random, and those of them that a search begins at,
APART = 0.4  # rad from each other at least
RANGE = 1.5  # rad about the present posture, for joints without limits
MARGIN, MARGIN_SHARE = 0.03, 0.05  # rad (m), kept from the limits; at most a share of what is between them
AIM = 5.0  # times that the way to the target counts more than errors, which a plan does not stay away from it for
# px that a change of the view by 1 (about 60 degrees), 1 rad of way and 1 rad since it was defined weigh as much as
LOOK, TRAVEL, TURNED = 1.6, 0.2, 0.25
NEAR = 100.0  # times less that the way to the target counts where a search begins
OUTSIDE = 4.0  # px^2 that a way all outside of the image weighs as much as
WAY = 12  # places that are looked at on it
OFF = 3.0  # px from the target up to which a posture is one that brings the point there
EVALUATIONS = 60

STEP = 1e-6  # rad, for derivatives

Seen = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Of postures ``(T, N)`` [rad]: places of the point ``(T, 2)`` [px], unit vectors ``(T, 3)`` from which its surface is
seen, in the frame of its link, and errors ``(T, E)`` [px] that the places may have, one standard deviation each."""


def planned_posture(
    seen: Seen,
    view: np.ndarray,
    target: np.ndarray,
    positions: np.ndarray,
    limits: np.ndarray,
    *,
    fixed: np.ndarray,
    home: np.ndarray | None = None,
    size: tuple[int, int] | None = None,
    seed: int = 0,
    start: np.ndarray | None = None,
) -> np.ndarray | None:
    """The posture ``(N,)`` [rad] to go to; None where none is found that brings the point near its target.

    Args:
        seen: what the chain says.
        view: ``(3,)`` from where the surface was seen when the point was defined.
        target: ``(2,)`` [px].
        positions: ``(N,)`` the present posture [rad].
        limits: ``(N, 2)`` of the joints [rad], infinite where there are none.
        fixed: bool ``(N,)``, joints that stay where they are.
        home: ``(N,)`` the posture that the point was defined in [rad]; the present one unless given.
        size: (height, width) of the image [px], in which the way should be; any way is as good unless given.
        seed: of the postures at random.
        start: a posture that is probably good; then none are tried at random.
    """
    q = np.asarray(positions, dtype=np.float64)
    defined = q if home is None else np.asarray(home, dtype=np.float64)
    margin = np.minimum(MARGIN, MARGIN_SHARE * np.maximum(limits[:, 1] - limits[:, 0], 0.0))
    least = np.where(np.isfinite(limits[:, 0]), limits[:, 0] + margin, q - RANGE)
    most = np.where(np.isfinite(limits[:, 1]), limits[:, 1] - margin, q + RANGE)
    free = ~np.asarray(fixed, dtype=bool) & (least < most)
    if not free.any():
        return None

    plan = _Plan(seen, view, target, q, defined, free, size)
    low, high = least[free], most[free]
    if start is None:
        random = np.random.default_rng(seed)
        tried = np.vstack([np.clip(q[free], low, high), random.uniform(low, high, (TRIED, int(free.sum())))])
        rough = plan.residuals(tried)
        rough[:, :2] /= NEAR
        starts = _unlike(tried[np.append(0, np.argsort(np.sum(rough**2, axis=1)))])
    else:
        starts = np.clip(np.asarray(start, dtype=np.float64)[free], low, high)[None]
    best, least_cost = None, np.inf
    for begin in starts:
        jac: Any = plan.slopes  # SciPy's stubs know names alone
        found = least_squares(
            lambda some: plan.residuals(some[None])[0], begin, jac, (low, high), max_nfev=EVALUATIONS, x_scale=0.1
        )
        cost = found.cost + OUTSIDE * plan.outside(found.x)
        if cost < least_cost:
            best, least_cost = found.x, cost
    assert best is not None
    posture = plan.whole(best[None])[0]
    off = seen(posture[None])[0][0] - target
    return posture if float(np.hypot(*off)) <= OFF else None


@dataclass(frozen=True)
class _Plan:
    """What :func:`planned_posture` was asked for: of postures, their free joints alone ``(T, F)`` [rad]."""

    seen: Seen
    view: np.ndarray
    target: np.ndarray
    now: np.ndarray
    defined: np.ndarray
    free: np.ndarray
    size: tuple[int, int] | None

    def whole(self, some: np.ndarray) -> np.ndarray:
        """Postures ``(T, N)`` [rad]."""
        postures = np.tile(self.now, (len(some), 1))
        postures[:, self.free] = some
        return postures

    def residuals(self, some: np.ndarray) -> np.ndarray:
        """``(T, 5 + 2 F + E)`` [px]."""
        places, views, errors = self.seen(self.whole(some))
        away = np.clip(np.nan_to_num(places - self.target, nan=1e4), -1e4, 1e4)
        ways = TRAVEL * (some - self.now[self.free]), TURNED * (some - self.defined[self.free])
        return np.hstack([AIM * away, LOOK * (views - self.view), *ways, errors])

    def slopes(self, some: np.ndarray) -> np.ndarray:
        """Of the residuals at one posture's free joints ``(F,)``, ``(5 + 2 F + E, F)`` [px/rad]."""
        values = self.residuals(some + STEP * np.vstack([np.zeros(len(some)), np.eye(len(some))]))
        return (values[1:] - values[0]).T / STEP

    def outside(self, some: np.ndarray) -> float:
        """Share of the straight way to the free joints at ``(F,)`` on which the point is outside of the image."""
        if self.size is None:
            return 0.0
        now = self.now[self.free]
        places, *_ = self.seen(self.whole(now + np.linspace(0, 1, WAY)[1:, None] * (some - now)))
        return float(np.mean(~((places >= 0) & (places < self.size[::-1])).all(axis=1)))


def _unlike(postures: np.ndarray) -> np.ndarray:
    """The first of some postures ``(T, F)`` [rad] that are unlike those before."""
    chosen = postures[:1]
    for posture in postures[1:]:
        if len(chosen) > REFINED:
            break
        if np.abs(chosen - posture).max(axis=1).min() > APART:
            chosen = np.vstack([chosen, posture])
    return chosen
