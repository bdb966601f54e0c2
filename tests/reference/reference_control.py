"""Tracking (15) and the servo law (17) of DIJE in float64."""

import numpy as np
from reference_sampling import bilinear


def carried_as_printed(p, u):
    """(15): p + interpolate(U, p)."""
    return p + bilinear(u, p[:, 0], p[:, 1])


def carried_to_fixed_point(p_old, u, steps=200):
    """The place p with p = p_old + u(p), by plain iteration carried on until it stands still."""
    p = p_old
    for _ in range(steps):
        p = p_old + bilinear(u, p[:, 0], p[:, 1])
    return p


def servo_step(J, error, gain):
    """(17): k_p J# (p_target - p), the pseudoinverse from the singular value decomposition."""
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    return gain * Vt.T @ (U.T @ error / s)


def damped_servo_step(J, error, gain, damping):
    """argmin |J dq - k_p e|^2 + d^2 |dq|^2, solved as an ordinary least-squares problem."""
    n = J.shape[1]
    A = np.vstack([J, damping * np.eye(n)])
    b = np.concatenate([gain * error, np.zeros(n)])
    return np.linalg.lstsq(A, b, rcond=None)[0]
