"""J of every track, and which joints move it, from its own pixels and the joints.

A track's place is quadratic in the joints over the postures of some seconds: p(q) = p0 + J dq + dq' H dq / 2 about a
posture that all tracks share. With normal priors on p0, J and H this is a linear Gaussian model, so its posterior, and
the evidence for each set of joints that may move the point, follow in closed form. The evidence chooses the set: a
joint that explains nothing costs evidence (beyond the papers; a point on link k has zero columns for joints after k).
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from dense_vs.body_model.tracks import PointTracks

LEAST_SEEN = 8  # images
EXPECTED = 0.3  # of the image's width: standard deviation of J and H before anything is known [1/rad, 1/rad^2]
_TIGHT = 4.0  # times the noise: residuals beyond count as gross errors


@dataclass(frozen=True)
class TrackJacobians:
    """What a quadratic model says of M tracks.

    Attributes:
        posture: ``(N,)`` that it is about [rad].
        places: ``(M, 2)`` of the tracks there [px].
        jacobians: ``(M, 2, N)`` [px/rad], zero for joints that do not move the point.
        covariances: ``(M, N, N)`` of either row of J [px^2/rad^2].
        moved_by: bool ``(M, N)``.
        noise: ``(M,)`` root mean square of the residuals [px].
        usable: bool ``(M,)``: seen often enough, and explained.
    """

    posture: np.ndarray
    places: np.ndarray
    jacobians: np.ndarray
    covariances: np.ndarray
    moved_by: np.ndarray
    noise: np.ndarray
    usable: np.ndarray

    def select(self, tracks: np.ndarray) -> "TrackJacobians":
        """Some of the tracks, by index or mask."""
        parts = {field.name: getattr(self, field.name)[tracks] for field in fields(self) if field.name != "posture"}
        return replace(self, **parts)


def track_jacobians(tracks: PointTracks, posture: np.ndarray, noise: float) -> TrackJacobians:
    """Fit every track.

    Args:
        tracks: the tracks.
        posture: ``(N,)`` [rad] about which.
        noise: standard deviation of a track's pixel [px].
    """
    joint_count = tracks.joints.shape[1]
    model = _Quadratic(tracks, posture, noise)
    usable = model.counts >= LEAST_SEEN
    chosen = np.ones((len(usable), joint_count), bool)
    best, open_ = model.evidence(chosen), usable.copy()
    while open_.any() and chosen[open_].any():
        which = np.flatnonzero(open_)
        fewer = np.repeat(chosen[which, None], joint_count, axis=1)
        fewer[:, range(joint_count), range(joint_count)] = False
        trials = np.stack([model.evidence(fewer[:, n], which) for n in range(joint_count)], axis=1)
        trials[~chosen[which]] = -np.inf
        n = trials.argmax(axis=1)
        better = trials[range(len(which)), n] >= best[which]
        open_[which[~better]] = False
        chosen[which[better], n[better]] = False
        best[which] = np.where(better, trials[range(len(which)), n], best[which])
        open_ &= chosen.any(axis=1)
    mean, covariance = model.posterior(chosen)
    errors = np.where(usable, model.errors(mean), np.inf)
    places = np.where(usable[:, None], mean[:, 0], np.nan)
    jacobians = np.where(usable[:, None, None], mean[:, 1 : 1 + joint_count].transpose(0, 2, 1), 0.0)
    covariances = np.where(usable[:, None, None], covariance[:, 1 : 1 + joint_count, 1 : 1 + joint_count], 0.0)
    moved_by = chosen & usable[:, None]
    explained = usable & (errors < _TIGHT * noise)
    return TrackJacobians(np.asarray(posture), places, jacobians, covariances, moved_by, errors, explained)


def joint_set_evidence(tracks: PointTracks, measured: TrackJacobians, sets: np.ndarray, noise: float) -> np.ndarray:
    """Logarithm of the evidence ``(M, K)`` that these and no other joints move each track, up to a track's constant.

    Args:
        tracks: M tracks.
        measured: their J; only its posture counts.
        sets: bool ``(K, N)``, joints that may move a track.
        noise: standard deviation of a track's pixel [px].
    """
    model = _Quadratic(tracks, measured.posture, noise)
    count = tracks.pixels.shape[1]
    evidence = [model.evidence(np.tile(chosen, (count, 1))) for chosen in sets]
    return np.where(model.counts[:, None] > 0, np.stack(evidence, axis=1), 0.0)


class _Quadratic:
    """The linear Gaussian models of M tracks.

    A set of joints leaves some of the P columns out: the information about them is the prior's alone, which changes
    neither the others' posterior nor, with the prior's determinant, the evidence.

    Attributes:
        counts: ``(M,)`` images that each track is seen in.
    """

    def __init__(self, tracks: PointTracks, posture: np.ndarray, noise: float):
        joint_count = tracks.joints.shape[1]
        step = tracks.joints - posture
        pairs = np.triu_indices(joint_count)
        quadratic = step[:, pairs[0]] * step[:, pairs[1]] * np.where(pairs[0] == pairs[1], 0.5, 1.0)
        self._design = np.column_stack([np.ones(len(step)), step, quadratic])
        expected = EXPECTED * tracks.size[1]
        self._prior = np.concatenate([[1e6], np.full(joint_count + len(pairs[0]), expected**2)])
        self._needs = np.zeros((len(self._prior), joint_count), bool)  # joints that a column is of
        self._needs[1 + np.arange(joint_count), np.arange(joint_count)] = True
        rest = 1 + joint_count + np.arange(len(pairs[0]))
        self._needs[rest, pairs[0]] = self._needs[rest, pairs[1]] = True
        self._noise, self._seen = noise, tracks.seen
        self._target = np.where(self._seen[..., None], tracks.pixels, 0.0)
        self.counts = self._seen.sum(axis=0)
        products = (self._design[:, :, None] * self._design[:, None]).reshape(len(step), -1)
        width = len(self._prior)
        self._information = (self._seen.T.astype(float) @ products).reshape(-1, width, width) / noise**2
        self._right = np.einsum("tp,tmi->mpi", self._design, self._target, optimize=True) / noise**2
        self._squares = (self._target**2).sum(axis=(0, 2)) / noise**2

    def evidence(self, chosen: np.ndarray, which: np.ndarray | slice = np.s_[:]) -> np.ndarray:
        """Logarithm of the evidence of a set of joints, bool ``(M, N)``, for each of some tracks, up to a constant."""
        information, right = self._equations(chosen, which)
        lower = np.linalg.cholesky(information)
        half = np.linalg.solve(lower, right)
        fit = self._squares[which] - (half**2).sum(axis=(1, 2))
        log_determinant = 2 * np.log(np.einsum("mpp->mp", lower)).sum(axis=1) + np.log(self._prior).sum()
        return -0.5 * fit - log_determinant  # two rows share the determinant

    def posterior(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean ``(M, P, 2)``, covariance ``(M, P, P)`` with a set of joints for each track; 0 for what is left out."""
        information, right = self._equations(chosen, np.s_[:])
        covariance = np.linalg.inv(information)
        used = self._used(chosen)
        covariance *= used[:, :, None] & used[:, None]
        return covariance @ right, covariance

    def errors(self, mean: np.ndarray) -> np.ndarray:
        """Root mean squares ``(M,)`` of what means ``(M, P, 2)`` leave [px]."""
        residual = self._target - np.einsum("tp,mpi->tmi", self._design, mean, optimize=True)
        squares = np.where(self._seen[..., None], residual**2, 0.0).sum(axis=(0, 2))
        return np.sqrt(squares / np.maximum(2 * self.counts, 1))

    def _used(self, chosen: np.ndarray) -> np.ndarray:
        return np.logical_not((self._needs & ~chosen[:, None]).any(axis=2))

    def _equations(self, chosen: np.ndarray, which: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        used = self._used(chosen)
        information = self._information[which] * (used[:, :, None] & used[:, None])
        information[:, range(len(self._prior)), range(len(self._prior))] += 1 / self._prior
        return information, self._right[which] * used[..., None]
