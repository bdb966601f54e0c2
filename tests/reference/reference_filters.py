"""One world of the dense image Jacobian's filter, equation by equation, in float64.

Each function takes the a priori estimate of one frame and returns the a posteriori one. ``J`` is
(H, W, 2, N), ``u`` (H, W, 2), ``dq`` (N,).
"""

import numpy as np
from reference_sampling import moved_image


def model_flow(J, dq):
    """(1): u = J dq."""
    return np.einsum("hwcn,n->hwc", J, dq)


def innovation(u, predicted):
    """u - J dq; zero where the flow is not a number, so that the prediction stays."""
    good = np.isfinite(u).all(axis=2, keepdims=True)
    return np.where(good, np.where(good, u, 0) - predicted, 0)


def nearer(by_model, by_flow, u, h):
    """Of two a priori states the one whose predicted flow is nearer to u; by model within 0.1 px and without u."""
    miss_by_model, miss_by_flow = (np.sum((u - model_flow(state, h)) ** 2, axis=2) for state in (by_model, by_flow))
    with np.errstate(invalid="ignore"):
        better = (miss_by_flow < miss_by_model) & (miss_by_model > 0.1**2)
    return np.where(better[..., None, None], by_flow, by_model)


def bounded(error, u, bound):
    """The innovation, no longer than bound (|u| + 0.5 px)."""
    if bound is None:
        return error
    length = np.linalg.norm(error, axis=2, keepdims=True)
    most = bound * (np.linalg.norm(u, axis=2, keepdims=True) + 0.5)
    with np.errstate(invalid="ignore"):
        return np.where(length > most, error * most / np.maximum(length, 1e-300), error)


def resting(u, predicted, rest):
    """Where neither the flow nor what is predicted reaches ``rest``."""
    with np.errstate(invalid="ignore"):
        return np.maximum(np.sum(u**2, axis=2), np.sum(predicted**2, axis=2))[..., None] < rest**2


def grown_diagonal(p, growth, p_max):
    """(9), bounded: p + q 1, at most p_max."""
    return np.minimum(p + growth, p_max)


def update_diagonal(J, p, u, dq, r):
    """(10) and (11), a variance (H, W, N) per pixel and joint."""
    denominator = (p @ (dq * dq) + r)[..., None]
    K = p * dq / denominator
    posterior = p * (1 - p * dq**2 / denominator)
    good = np.isfinite(u).all(axis=2, keepdims=True)
    return J + innovation(u, model_flow(J, dq))[..., None] * K[:, :, None, :], np.where(good, posterior, p)


def update_hosoda(J, u, dq, weight, rho):
    """(12) with W = weight I."""
    W = weight * np.eye(len(dq))
    return J + np.einsum("hwc,n->hwcn", innovation(u, model_flow(J, dq)), dq @ W) / (rho + dq @ W @ dq)


def bounded_covariance(P, p_max):
    """S P S with the diagonal S that brings every variance down to its bound."""
    s = np.minimum(1, np.sqrt(p_max / np.diagonal(P, axis1=-2, axis2=-1)))
    return P * s[..., :, None] * s[..., None, :]


def kalman(P, h, r):
    """Gain and posterior covariance of a scalar observation h^T s, in the symmetric form of Joseph."""
    K = P @ h / (h @ P @ h + r)
    A = np.eye(len(h)) - np.outer(K, h)
    return K, A @ P @ A.T + r * np.outer(K, K)


def update_full(J, P, u, dq, r):
    """Qian and Su's filter: a full covariance (H, W, N, N) per pixel."""
    posterior_J, posterior_P = np.empty_like(J), np.empty_like(P)
    error = innovation(u, model_flow(J, dq))
    for at in np.ndindex(J.shape[:2]):
        K, updated = kalman(P[at], dq, r)
        good = np.isfinite(u[at]).all()
        posterior_J[at] = J[at] + np.outer(error[at], K)
        posterior_P[at] = updated if good else P[at]
    return posterior_J, posterior_P


class SecondOrderModel:
    """Transition and observation of the state (J, H) of one image row at one pixel, as plain matrices.

    H_ij = dJ_i / dq_j is symmetric, so the state is N + N (N + 1) / 2 long; ``pairs`` are H's independent entries.
    Taylor of the image position x(q): after the step, J' = J + H dq, and the displacement, seen from the end of
    the step, is x(q + dq) - x(q) = J' dq - 1/2 dq^T H dq.
    """

    def __init__(self, joints):
        self.joints = joints
        self.pairs = [(i, j) for i in range(joints) for j in range(i, joints)]
        self.size = joints + len(self.pairs)

    def hessian_basis(self, k):
        """The symmetric matrix that the state's k-th independent entry of H stands for."""
        i, j = self.pairs[k]
        E = np.zeros((self.joints, self.joints))
        E[i, j] = E[j, i] = 1
        return E

    def transition(self, dq):
        """F: J' = J + H dq, H' = H."""
        F = np.eye(self.size)
        for k in range(len(self.pairs)):
            F[: self.joints, self.joints + k] = self.hessian_basis(k) @ dq
        return F

    def observation(self, dq):
        """h: u = h^T (J', H)."""
        curved = [-0.5 * dq @ self.hessian_basis(k) @ dq for k in range(len(self.pairs))]
        return np.concatenate([dq, curved])


class ReferenceJacobian:
    """The filter over frames, one world, with the meaning of the options of ``JacobianOptions``."""

    def __init__(self, options):
        self.o = options
        shape = options.height, options.width
        N = options.joints
        self.second = SecondOrderModel(N) if options.order == 2 else None
        columns = self.second.size if self.second else N
        self.state = np.zeros((*shape, 2, columns))
        p0 = options.initial_variance
        if options.covariance == "diagonal":
            self.p = np.full((*shape, N), p0)
        elif options.covariance == "full":
            self.P = np.broadcast_to(p0 * np.eye(N), (*shape, N, N)).copy()
        else:
            self.P = np.diag([p0] * N + [options.initial_hessian_variance] * (columns - N)).astype(float)

    @property
    def jacobian(self):
        return self.state[..., : self.o.joints] * self.o.step_factors

    @property
    def variance(self):
        if self.o.covariance == "diagonal":
            return self.p
        variance = np.diagonal(self.P, axis1=-2, axis2=-1)[..., : self.o.joints]
        own = variance * np.square(self.o.step_factors)
        return np.broadcast_to(own, (self.o.height, self.o.width, self.o.joints))

    def update(self, flow, dq, span=None):
        """``span`` is the joint displacement that the flow spans; zeros for a frame that is predicted only."""
        o, u, dq = self.o, np.asarray(flow, dtype=np.float64), np.asarray(dq, dtype=np.float64)
        span = dq if span is None else np.asarray(span, dtype=np.float64)
        one_frame = np.array_equal(span, dq)
        dq, span = dq * o.step_factors, span * o.step_factors  # the state in standard units
        F = self.second.transition(dq) if self.second else np.eye(o.joints)
        h = self.second.observation(span) if self.second else span
        step = self.second.observation(dq) if self.second else dq
        by_model = model_flow(self.state, step @ F), o.prediction_iterations
        displacement, iterations = {
            "model": by_model,
            "nearest": by_model,
            "flow": (u, 1),
            "none": (None, 0),
        }[o.prediction]
        prior = moved_image(self.state, displacement, iterations) @ F.T
        if o.prediction == "nearest" and one_frame:
            prior = nearer(prior, moved_image(self.state, u, 1) @ F.T, u, h)
        growth = o.process_noise * dq @ dq + o.drift_noise
        r = o.measurement_noise
        if o.covariance == "fixed":
            self.state = update_hosoda(prior, u, dq, o.initial_variance, r)
        elif o.covariance == "diagonal":
            p = moved_image(self.p, displacement, iterations) if o.move_variance else self.p
            self.state, self.p = update_diagonal(prior, grown_diagonal(p, growth, o.max_variance), u, dq, r)
        elif o.covariance == "full":
            P = bounded_covariance(self.P + growth * np.eye(o.joints), o.max_variance)
            self.state, self.P = update_full(prior, P, u, dq, r)
        else:
            curved = len(h) - o.joints
            Q = np.diag([growth] * o.joints + [o.hessian_noise * dq @ dq] * curved)
            bound = np.array([o.max_variance] * o.joints + [o.initial_hessian_variance] * curved)
            K, self.P = kalman(bounded_covariance(F @ self.P @ F.T + Q, bound), h, r)
            error = bounded(innovation(u, model_flow(prior, h)), u, o.max_innovation)
            still = span.any() & resting(u, model_flow(prior, h), o.rest)
            self.state = np.where(still[..., None], 0.9 * prior, prior + error[..., None] * K)
