"""Stage 2, second half: where the axes stand, by linear least squares once their directions are known.

Beyond the paper: with the rotations A_i of the links fixed, the hand's place is linear in the points p_i and in its
home place f, x = sum_i (A_{i-1} - A_i) p_i + A_n f. Along its own axis a point has no influence and across it may have
little: singular values are cut off, which leaves such points near the origin, and the origin is put among the features.
"""

import numpy as np

from dense_vs.generative.least_squares.parameters import tangents, turn


def fit_axis_points(
    joints: np.ndarray, axes: np.ndarray, places: np.ndarray, weights: np.ndarray | None = None, cutoff: float = 1e-4
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the axes ``(n, 3)`` and the hand's home place ``(3,)``.

    Args:
        joints: ``(T, n)`` [rad] from the home pose.
        axes: ``(n, 3)`` unit vectors.
        places: ``(T, 3)`` of the hand's origin, best chosen amid the features.
        weights: ``(T,)`` of the samples.
        cutoff: singular values below this share of the largest are taken as zero.
    """
    samples, count = joints.shape
    origin = np.median(places, axis=0)
    across = tangents(axes)
    rotation = np.broadcast_to(np.eye(3), (samples, 3, 3))
    blocks = []
    for axis, angle, plane in zip(axes, joints.T, across, strict=True):
        after = rotation @ turn(angle[:, None] * axis)
        blocks.append((rotation - after) @ plane.T)
        rotation = after
    design = np.concatenate([*blocks, rotation], axis=2)
    root = np.sqrt(np.ones(samples) if weights is None else weights)[:, None]
    right = (places - origin) * root
    solution = np.linalg.lstsq((design * root[..., None]).reshape(3 * samples, -1), right.ravel(), rcond=cutoff)[0]
    points = np.einsum("nk,nki->ni", solution[: 2 * count].reshape(count, 2), across)
    return points + origin, solution[2 * count :] + origin
