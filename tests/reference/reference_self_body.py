"""DIJE's Algorithms 1 and 2 and the running energies of self-recognition, one world, in float64.

``J`` is (H, W, 2, N), ``centers`` (k, 2, N), ``u`` (H, W, 2), ``dq`` (N,).
"""

import numpy as np
from reference_filters import bounded_covariance, kalman, model_flow
from reference_sampling import bilinear, moved_image, pixel_grid


def squared_distances(J, centers):
    """(H, W, k)."""
    apart = np.asarray(J, dtype=np.float64)[..., None, :, :] - np.asarray(centers, dtype=np.float64)
    return np.sum(apart**2, axis=(-2, -1))


def nearest(J, centers):
    """Index of the nearest center, the lowest on ties; -1 where J is not finite."""
    known = np.isfinite(J).all(axis=(2, 3))
    distances = squared_distances(np.where(known[..., None, None], J, 0), centers)
    return np.where(known, np.argmin(distances, axis=2), -1)


def cluster_sums(J, members, centers):
    """Sum (k, 2, N) and number (k,) of the member vectors nearest to each center."""
    index = np.where(members, nearest(J, centers), -1)
    sums = np.array([np.sum(J[index == k].astype(np.float64), axis=0) for k in range(len(centers))])
    return sums, np.array([np.sum(index == k) for k in range(len(centers))])


def lloyd(J, members, centers, max_steps, tolerance):
    """Lloyd's steps from given centers, none of which becomes empty."""
    centers = np.asarray(centers, dtype=np.float64)
    for _ in range(max_steps):
        sums, sizes = cluster_sums(J, members, centers)
        assert (sizes > 0).all()
        moved = sums / sizes[:, None, None]
        change = np.linalg.norm(moved - centers, axis=(1, 2)).max()
        centers = moved
        if change <= tolerance * np.sqrt(np.mean(np.sum(moved**2, axis=(1, 2)))):
            break
    return centers, sizes


def evaluation(centers, previous, values, reading):
    """The loop over centers of Algorithm 1, as it is printed, and the normalization."""
    new = []
    for center in centers:
        distances = [np.linalg.norm(center - other) for other in previous]
        i = int(np.argmin(distances))
        consistency = 1 / np.sqrt(distances[i] / np.linalg.norm(center) + 0.1)
        if reading == "product":
            new.append(values[i] * (0.1 * (consistency - 1) + 1))
        else:
            new.append(values[i] * 0.1 * (consistency - 1) + 1)
    return np.array(new) / np.sum(new)


class ReferenceSelfMotion:
    """The slow filter and its energies over frames, with the meaning of ``SelfMotionOptions``."""

    def __init__(self, height, width, joints, options):
        self.o = options
        self.J = np.zeros((height, width, 2, joints))
        self.E = np.zeros((height, width, 2))
        self.P = options.initial_variance * np.eye(joints)

    def observe(self, u, dq):
        o, u, dq = self.o, np.asarray(u, dtype=np.float64), np.asarray(dq, dtype=np.float64)
        seen = np.isfinite(u).all(axis=2)
        u = np.where(seen[..., None], u, 0)
        x, y = pixel_grid(*u.shape[:2])
        motion = model_flow(self.J, dq)

        def by_flow(image):
            return bilinear(image, x - u[..., 0], y - u[..., 1])

        predicted = moved_image(motion, motion, 2)
        closer = seen & (np.sum((u - by_flow(motion)) ** 2, axis=2) < np.sum((u - predicted) ** 2, axis=2))

        def moved(image):
            choice = closer[(...,) + (None,) * (image.ndim - 2)]
            return np.where(choice, by_flow(image), moved_image(image, motion, 2))

        predicted = moved(motion)
        error = np.where(seen[..., None], u - predicted, 0)
        flow2, predicted2 = np.sum(u**2, axis=2), np.sum(predicted**2, axis=2)
        E = moved(self.E)
        E[seen & (flow2 < o.still**2) & (predicted2 > o.due**2)] = 0
        evidence = seen & (np.maximum(flow2, predicted2) >= o.rest**2)
        now = np.stack([np.sum(error**2, axis=2), flow2], axis=2)
        self.E = np.where(evidence[..., None], o.decay * E + now, E)
        grown = self.P + o.process_noise * (dq @ dq) * np.eye(len(dq))
        K, self.P = kalman(bounded_covariance(grown, o.initial_variance), dq, o.measurement_noise)
        self.J = moved(self.J) + error[..., None] * K

    def labels(self, J, min_jacobian):
        o = self.o
        size = np.sqrt(np.sum(np.asarray(J, dtype=np.float64) ** 2, axis=(2, 3)))
        own = (size > min_jacobian) & (self.E[..., 0] < o.unexplained * self.E[..., 1])
        unknown = ~np.isfinite(size) | (self.E.max(axis=2) <= o.least_energy)
        return np.where(unknown, -1, own.astype(int))
