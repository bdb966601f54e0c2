"""How a rigid link of a serial chain moves in the image, fitted to tracked points and joint positions (beyond DIJE).

A point X on the link (camera frame, in the posture q0) is, in the posture q, at

    X(q) = exp(s_1 (q_1 - q0_1)) ... exp(s_N (q_N - q0_N)) X,    p = center + f (X_x, X_y) / X_z,

the product of exponentials of the joints' axes s_j, lines in the camera frame, the joint nearest to the base first.
Axes, f and the points of one link are found together by Levenberg's method from places that were seen; lengths are in
units of the first point's depth in q0, as no image tells the scale. Nothing is known of the robot but its joint
readings and that its N joints turn, one after the other.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

FOCAL_SPREAD = 0.3  # standard deviation of ln f about its first guess
DEPTH_SPREAD = 0.15  # of the points' depths about the first one's, its depth being 1
MOST_GUESSES = 16  # nearly all lead to the same motion
_STEP = 1e-6  # of the numeric derivatives by the axes


@dataclass(frozen=True)
class LinkMotion:
    """A chain's axes and the points of its last link.

    Attributes:
        reference: ``(N,)`` q0 [rad].
        directions: ``(N, 3)`` of the axes, unit vectors, camera frame.
        places: ``(N, 3)`` point of each axis that is nearest to the camera's center [first point's depths].
        focal: f [px].
        center: ``(2,)`` of the image [px].
        points: ``(K, 3)`` X [first point's depths].
    """

    reference: np.ndarray
    directions: np.ndarray
    places: np.ndarray
    focal: float
    center: np.ndarray
    points: np.ndarray

    def poses(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations ``(T, 3, 3)`` and shifts ``(T, 3)`` of the link at ``positions`` ``(T, N)`` [rad]."""
        angles = np.atleast_2d(positions) - self.reference
        rotation = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
        shift = np.zeros((len(angles), 3))
        for axis, place, angle in zip(self.directions[::-1], self.places[::-1], angles.T[::-1], strict=True):
            turn = _rotations(axis, angle)
            rotation = turn @ rotation
            shift = np.einsum("tij,tj->ti", turn, shift - place) + place
        return rotation, shift

    def project(self, positions: np.ndarray) -> np.ndarray:
        """Where the points are seen, ``(T, K, 2)`` [px], in the postures ``(T, N)`` [rad]; nan behind the camera."""
        rotation, shift = self.poses(positions)
        return self._seen(np.einsum("tij,kj->tki", rotation, self.points) + shift[:, None])

    def _seen(self, X: np.ndarray) -> np.ndarray:
        depth = np.where(X[..., 2:] > 0.02, X[..., 2:], np.nan)
        return self.center + self.focal * X[..., :2] / depth

    def moved(self, change: np.ndarray) -> "LinkMotion":
        """With the axes and f changed by ``(4 N + 1,)`` tangent coordinates."""
        by_axis = change[:-1].reshape(-1, 4)
        first, second = _tangents(self.directions)
        directions = self.directions + by_axis[:, :1] * first + by_axis[:, 1:2] * second
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        places = self.places + by_axis[:, 2:3] * first + by_axis[:, 3:] * second
        places -= directions * np.sum(directions * places, axis=1, keepdims=True)
        return replace(self, directions=directions, places=places, focal=self.focal * np.exp(change[-1]))

    def with_points(self, pixels: np.ndarray, depth: float = 1.0) -> "LinkMotion":
        """With the points seen at ``(K, 2)`` px in the reference posture, all at one depth, in place of its own."""
        rays = (np.atleast_2d(pixels) - self.center) / self.focal
        return replace(self, points=depth * np.column_stack([rays, np.ones(len(rays))]))


def refine(
    motion: LinkMotion,
    positions: np.ndarray,
    seen: np.ndarray,
    weights: np.ndarray,
    *,
    focal_guess: float,
    iterations: int = 5,
    scale: float = 1.0,
    damping: float = 1e-3,
) -> tuple[LinkMotion, float]:
    """Fit axes, f and points to what was seen; the motion and its cost.

    Args:
        motion: to start from.
        positions: ``(T, N)`` joint positions [rad].
        seen: ``(T, K, 2)`` places [px]; anything where the weight is 0.
        weights: ``(T, K)`` of the places.
        focal_guess: [px], what f is held to loosely.
        iterations: of Levenberg's method.
        scale: residual [px] from which a place counts less and less, Cauchy's.
        damping: of the first iteration.
    """
    cost, weighted, residual = _cost(motion, positions, seen, weights, focal_guess, scale)
    for _ in range(iterations):
        normal = _Normal(motion, positions, residual, weighted, focal_guess, scale)
        for _ in range(4):
            change, shifts = normal.solve(damping)
            tried = replace(motion.moved(change), points=motion.points + shifts)
            new = _cost(tried, positions, seen, weights, focal_guess, scale)
            if np.isfinite(new[0]) and new[0] <= cost:
                gain = cost - new[0]
                motion, (cost, weighted, residual), damping = tried, new, max(damping / 5, 1e-9)
                break
            damping *= 10
        else:
            break
        if gain < 1e-5 * cost:
            break
    return motion, cost


def uncertainty(
    motion: LinkMotion,
    positions: np.ndarray,
    weights: np.ndarray,
    posture: np.ndarray,
    *,
    focal_guess: float,
    scale: float,
) -> float:
    """Standard deviation of the first point's place in a posture [px], if the places' errors were independent.

    Args:
        motion: as :func:`refine` gave it.
        positions, weights: of the places it was fitted to.
        posture: ``(N,)`` [rad].
        focal_guess, scale: as in :func:`refine`.
    """
    normal = _Normal(motion, positions, np.zeros((*weights.shape, 2)), weights / scale**2, focal_guess, scale)
    rest = np.linalg.inv(normal.C[1:] + 1e-6 * np.eye(3))
    A = normal.A - np.einsum("kal,klm,kbm->ab", normal.B[1:], rest, normal.B[1:], optimize=True)
    H = np.block([[A, normal.B[0]], [normal.B[0].T, normal.C[0]]]) + 1e-9 * np.eye(len(A) + 3)
    by_axes, by_point = _derivatives(replace(motion, points=motion.points[:1]), np.atleast_2d(posture))
    G = np.hstack([by_axes[0, 0], by_point[0, 0]])
    return float(np.sqrt(max(np.trace(G @ np.linalg.solve(H, G.T)), 0.0)))


def _cost(motion, positions, seen, weights, focal_guess, scale):
    """Robust cost, the places' weights ``(T, K)`` once robust, and residuals ``(T, K, 2)``."""
    residual = np.where(weights[..., None] > 0, seen - motion.project(positions), 0.0)
    if np.isnan(residual).any():
        return np.inf, weights, residual
    squared = np.sum(residual**2, axis=2) / scale**2
    cost = np.sum(weights * np.log1p(squared))
    cost += np.sum(((motion.points[:, 2] - 1) / _depth_spreads(len(motion.points))) ** 2)
    cost += (np.log(motion.focal / focal_guess) / FOCAL_SPREAD) ** 2
    return float(cost), weights / (1 + squared) / scale**2, residual


def _depth_spreads(count: int) -> np.ndarray:
    spreads = np.full(count, DEPTH_SPREAD)
    spreads[0] = 1e-4  # the unit of length
    return spreads


class _Normal:
    """Normal equations whose point blocks are eliminated."""

    def __init__(self, motion, positions, residual, weights, focal_guess, scale):
        by_axes, by_point = (np.nan_to_num(one) for one in _derivatives(motion, positions))  # behind the camera: unseen
        heavy = by_axes * weights[..., None, None]
        heavy_point = by_point * weights[..., None, None]
        self.A = np.einsum("tkia,tkib->ab", heavy, by_axes, optimize=True)
        self.a = np.einsum("tkia,tki->a", heavy, residual)
        self.B = np.einsum("tkia,tkij->kaj", heavy, by_point, optimize=True)
        self.C = np.einsum("tkil,tkij->klj", heavy_point, by_point)
        self.c = np.einsum("tkil,tki->kl", heavy_point, residual)
        spreads = _depth_spreads(len(motion.points))
        self.C[:, 2, 2] += 1 / spreads**2
        self.c[:, 2] -= (motion.points[:, 2] - 1) / spreads**2
        self.A[-1, -1] += 1 / FOCAL_SPREAD**2
        self.a[-1] -= np.log(motion.focal / focal_guess) / FOCAL_SPREAD**2

    def solve(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of the axes and f, and of the points."""
        C = self.C + (damping * np.einsum("kii->ki", self.C) + 1e-6)[..., None] * np.eye(3)
        A = self.A + np.diag(damping * np.diag(self.A) + 1e-6)
        inverse = np.linalg.inv(C)
        BC = np.einsum("kaj,kjl->kal", self.B, inverse)
        S = A - np.einsum("kal,kbl->ab", BC, self.B)
        change = np.linalg.solve(S, self.a - np.einsum("kal,kl->a", BC, self.c))
        shifts = np.einsum("kij,kj->ki", inverse, self.c - np.einsum("kaj,a->kj", self.B, change))
        return change, shifts


def _derivatives(motion: LinkMotion, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the places by the axes and f ``(T, K, 2, 4 N + 1)``, and by each place's own point ``(T, K, 2, 3)``."""
    rotation, shift = motion.poses(positions)
    X = np.einsum("tij,kj->tki", rotation, motion.points) + shift[:, None]
    depth = X[..., 2]
    by_place = np.zeros((*depth.shape, 2, 3))
    by_place[..., 0, 0] = by_place[..., 1, 1] = motion.focal / depth
    by_place[..., :, 2] = -motion.focal * X[..., :2] / depth[..., None] ** 2
    count = 4 * len(motion.directions) + 1
    base = motion.project(positions)
    by_axes = np.stack(
        [(motion.moved(step).project(positions) - base) / _STEP for step in _STEP * np.eye(count)], axis=-1
    )
    return by_axes, np.einsum("tkij,tjl->tkil", by_place, rotation)


def first_guesses(
    positions: np.ndarray,
    seen: np.ndarray,
    weights: np.ndarray,
    reference: np.ndarray,
    pixels: np.ndarray,
    center: np.ndarray,
    focal: float,
) -> list[LinkMotion]:
    """Motions to start :func:`refine` from, from how the points move by each joint near the reference posture.

    With the points at one depth, their shift, turn and growth give the velocity V of the first point and the axis's
    component w_z. As |w| = 1 and w is at right angles to V, two directions remain for each joint.
    """
    count = positions.shape[1]
    dq = positions - reference
    pairs = [(i, j) for i in range(count) for j in range(i, count)]
    terms = np.column_stack([dq, *(dq[:, i] * dq[:, j] for i, j in pairs)])
    velocities = np.zeros((len(pixels), 2, count))
    for k, pixel in enumerate(pixels):
        w = np.sqrt(weights[:, k])[:, None]
        A = (terms * w).T @ (terms * w) + 1e-6 * np.eye(terms.shape[1])
        velocities[k] = np.linalg.solve(A, (terms * w).T @ ((seen[:, k] - pixel) * w))[:count].T
    rays = (pixels - center) / focal
    rows, goals = [], []
    for (x, y), (u, v) in zip(rays - rays[0], velocities / focal, strict=True):
        rows += [[1, 0, -x, -y], [0, 1, -y, x]]
        goals += [u, v]
    ridge = np.diag([0.0, 0.0, 1.0, 1.0]) * 0.01 * np.mean(np.sum((rays - rays[0]) ** 2, axis=1)) * len(rays)
    M = np.array(rows)
    solved = np.linalg.solve(M.T @ M + ridge, M.T @ np.array(goals))  # V_x, V_y, V_z, w_z of each joint
    first = np.append(rays[0], 1.0)
    choices = []
    for joint in range(count):
        Vx, Vy, Vz, wz = solved[:, joint]
        # V_x, V_y above are relative to the image; the point's own velocity also moves along its ray.
        V = np.array([Vx + first[0] * Vz, Vy + first[1] * Vz, Vz])
        wz = np.clip(wz, -0.95, 0.95)
        across = np.hypot(V[0], V[1]) + 1e-9
        along = np.clip(-wz * V[2] / across, -1, 1) * np.sqrt(1 - wz**2)
        rest = np.sqrt(max(1 - wz**2 - along**2, 0.0))
        n = V[:2] / across
        found = []
        for sign in (1, -1):
            w = np.array([along * n[0] - sign * rest * n[1], along * n[1] + sign * rest * n[0], wz])
            w /= np.linalg.norm(w)
            V_at_right_angles = V - w * (w @ V)
            place = first - np.cross(V_at_right_angles, w)  # w x (X - place) = V
            found.append((w, place - w * (w @ place)))
        choices.append(found)
    points = np.column_stack([rays, np.ones(len(rays))])
    every = list(itertools.islice(itertools.product((0, 1), repeat=count), MOST_GUESSES))
    if count > np.log2(MOST_GUESSES):
        every = np.random.default_rng(0).integers(0, 2, (MOST_GUESSES, count)).tolist()
    chosen = [[choice[which] for choice, which in zip(choices, one, strict=True)] for one in every]
    return [
        LinkMotion(reference, np.array([w for w, _ in axes]), np.array([c for _, c in axes]), focal, center, points)
        for axes in chosen
    ]


def _rotations(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rotations ``(T, 3, 3)`` about a unit vector."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angles)[:, None, None] * K + (1 - np.cos(angles))[:, None, None] * (K @ K)


def _tangents(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles to each of ``(N, 3)`` and to each other."""
    aside = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)
