"""Gradients through a Denavit-Hartenberg chain and through rotation vectors, by hand where the paper uses autograd."""

import numpy as np


def chain_gradient(frames: np.ndarray, moment: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Gradient ``(6 + 4 n,)`` by the base's turn and shift and the DH rows.

    Args:
        frames: ``(T, n + 1, 4, 4)``.
        moment: ``(T, 3)`` derivative of the loss by a turn of the hand about the world's origin.
        force: ``(T, 3)`` by a shift.
    """
    origin = frames[0, 0, :3, 3]
    parts = [(moment - np.cross(origin, force)).sum(axis=0), force.sum(axis=0)]
    for row in range(frames.shape[1] - 1):
        z, before = frames[:, row, :3, 2], frames[:, row, :3, 3]
        x, after = frames[:, row + 1, :3, 0], frames[:, row + 1, :3, 3]
        parts.append(
            np.array(
                [
                    (z * (moment - np.cross(before, force))).sum(),
                    (z * force).sum(),
                    (x * force).sum(),
                    (x * (moment - np.cross(after, force))).sum(),
                ]
            )
        )
    return np.concatenate(parts)


def left_jacobian(vectors: np.ndarray) -> np.ndarray:
    """Derivative ``(k, 3, 3)`` of the turn exp(v) R by v ``(k, 3)``, as a turn on the left."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    cross -= cross.swapaxes(1, 2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * cross @ cross
