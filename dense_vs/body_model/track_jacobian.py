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
    count, joint_count = tracks.pixels.shape[1], tracks.joints.shape[1]
    places = np.full((count, 2), np.nan)
    jacobians, covariances = np.zeros((count, 2, joint_count)), np.zeros((count, joint_count, joint_count))
    moved_by = np.zeros((count, joint_count), bool)
    errors, usable = np.full(count, np.inf), np.zeros(count, bool)
    model = _Quadratic(tracks, posture)
    for m in range(count):
        seen = np.flatnonzero(tracks.seen[:, m])
        if len(seen) < LEAST_SEEN:
            continue
        fit = _fit(model.design[seen], tracks.pixels[seen, m], model.prior, model.members, noise)
        moved_by[m], mean, covariance, errors[m], usable[m] = fit
        places[m], jacobians[m] = mean[0], mean[1 : 1 + joint_count].T
        covariances[m] = covariance[1 : 1 + joint_count, 1 : 1 + joint_count]
    return TrackJacobians(np.asarray(posture), places, jacobians, covariances, moved_by, errors, usable)


def joint_set_evidence(tracks: PointTracks, measured: TrackJacobians, sets: np.ndarray, noise: float) -> np.ndarray:
    """Logarithm of the evidence ``(M, K)`` that these and no other joints move each track, up to a track's constant.

    Args:
        tracks: M tracks.
        measured: their J; only its posture counts.
        sets: bool ``(K, N)``, joints that may move a track.
        noise: standard deviation of a track's pixel [px].
    """
    model = _Quadratic(tracks, measured.posture)
    evidence = np.zeros((tracks.pixels.shape[1], len(sets)))
    for m in range(len(evidence)):
        seen = np.flatnonzero(tracks.seen[:, m])
        for k, chosen in enumerate(sets if len(seen) else ()):
            evidence[m, k] = _posterior(
                model.design[seen], tracks.pixels[seen, m], model.prior, model.members, chosen, noise
            )[0]
    return evidence


class _Quadratic:
    """Columns of the quadratic model in every image, their prior variances, and the joints that each needs."""

    def __init__(self, tracks: PointTracks, posture: np.ndarray):
        joint_count = tracks.joints.shape[1]
        step = tracks.joints - posture
        pairs = np.triu_indices(joint_count)
        quadratic = step[:, pairs[0]] * step[:, pairs[1]] * np.where(pairs[0] == pairs[1], 0.5, 1.0)
        self.design = np.column_stack([np.ones(len(step)), step, quadratic])
        expected = EXPECTED * tracks.size[1]
        self.prior = np.concatenate([[1e6], np.full(joint_count + len(pairs[0]), expected**2)])
        self.members = np.zeros((len(self.prior), joint_count), bool)
        self.members[1 + np.arange(joint_count), np.arange(joint_count)] = True
        rest = 1 + joint_count + np.arange(len(pairs[0]))
        self.members[rest, pairs[0]] = self.members[rest, pairs[1]] = True


def _fit(design: np.ndarray, target: np.ndarray, prior: np.ndarray, members: np.ndarray, noise: float):
    """The best set of joints, mean ``(P, 2)``, covariance ``(P, P)``, error [px], and whether it explains the track."""
    joint_count = members.shape[1]
    chosen = np.ones(joint_count, bool)
    best = _posterior(design, target, prior, members, chosen, noise)
    while chosen.any():
        trials = []
        for n in np.flatnonzero(chosen):
            fewer = chosen.copy()
            fewer[n] = False
            trials.append((_posterior(design, target, prior, members, fewer, noise), fewer))
        trial, fewer = max(trials, key=lambda one: one[0][0])
        if trial[0] < best[0]:
            break
        best, chosen = trial, fewer
    _, used, mean, covariance = best
    residual = np.linalg.norm(target - design[:, used] @ mean, axis=1)
    whole, whole_covariance = np.zeros((len(prior), 2)), np.zeros((len(prior), len(prior)))
    whole[used], whole_covariance[np.ix_(used, used)] = mean, covariance
    error = float(np.sqrt(np.mean(residual**2) / 2))
    return chosen, whole, whole_covariance, error, error < _TIGHT * noise


def _posterior(design, target, prior, members, chosen, noise):
    """Evidence, columns used, mean and covariance of the linear model with some joints."""
    used = np.flatnonzero(~(members & ~chosen).any(axis=1))
    A = design[:, used]
    information = A.T @ A / noise**2
    information[np.diag_indices_from(information)] += 1 / prior[used]
    lower = np.linalg.cholesky(information)
    right = A.T @ target / noise**2
    half = np.linalg.solve(lower, right)
    fit = (target**2).sum() / noise**2 - (half**2).sum()
    log_determinant = 2 * np.log(lower.diagonal()).sum() + np.log(prior[used]).sum()
    evidence = -0.5 * fit - log_determinant  # two rows share the determinant
    inverse = np.linalg.inv(lower)
    covariance = inverse.T @ inverse
    return evidence, used, covariance @ right, covariance
