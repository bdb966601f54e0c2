"""Joints from a pose of the hand: the inverse kinematics of the paper's inference, from several starts at once.

The paper takes the solver of Beeson and Ames (2015). Here it is Levenberg-Marquardt on the turn and the shift that are
left to the pose, every start for itself. A pose may have several solutions, and a start may end in none.
"""

import numpy as np

from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.prediction import link_poses
from dense_vs.generative.rotations import rotation_vectors

SOLVED = 1e-9  # rad, and share of the arm's reach


def joints_of_pose(
    parameters: ModelParameters, pose: np.ndarray, starts: np.ndarray, max_iterations: int = 100
) -> tuple[np.ndarray, np.ndarray]:
    """Where each start ends: joints ``(S, n)`` [rad], and how far they leave the hand from the pose, ``(S,)``.

    Args:
        parameters: of the model.
        pose: ``(4, 4)`` of the hand, as ``GenerativeModel.infer_poses`` gives it: its motion from the home pose.
        starts: ``(S, n)`` joints [rad].
        max_iterations: at most.

    Returns:
        The joints, and the norm of what is left: rotation [rad], and translation of the features' center as a share of
        the arm's reach.
    """
    center = np.nanmean(parameters.features, axis=0)
    reach = float(np.linalg.norm(parameters.points - center, axis=1).max())
    joints = np.array(starts, dtype=float)
    damping = np.full(len(joints), 1e-3)
    left, jacobian = _left(parameters, pose, joints, center, reach)
    for _ in range(max_iterations):
        cost = (left**2).sum(axis=1)
        active = (cost > SOLVED**2) & (damping < 1e8)
        if not active.any():
            break
        transposed = jacobian.swapaxes(1, 2)
        matrix = transposed @ jacobian + damping[:, None, None] * np.eye(joints.shape[1])
        step = np.linalg.solve(matrix, transposed @ left[..., None])[..., 0]
        candidate = np.where(active[:, None], joints + step, joints)
        new_left, new_jacobian = _left(parameters, pose, candidate, center, reach)
        better = active & ((new_left**2).sum(axis=1) < cost)
        joints[better], left[better], jacobian[better] = candidate[better], new_left[better], new_jacobian[better]
        damping = np.where(better, np.maximum(damping / 10, 1e-12), np.where(active, 10 * damping, damping))
    return joints, np.linalg.norm(left, axis=1)


def _left(
    parameters: ModelParameters, pose: np.ndarray, joints: np.ndarray, center: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Turn and shift still to make ``(S, 6)``, and those that the joints make ``(S, 6, n)``."""
    rotation, translation = link_poses(parameters, joints)
    place = rotation[:, -1] @ center + translation[:, -1]
    turn = rotation_vectors(pose[:3, :3] @ rotation[:, -1].swapaxes(1, 2))
    shift = (pose[:3, :3] @ center + pose[:3, 3] - place) / reach
    axes = np.einsum("snij,nj->sni", rotation[:, :-1], parameters.axes)
    points = np.einsum("snij,nj->sni", rotation[:, :-1], parameters.points) + translation[:, :-1]
    moves = np.cross(axes, place[:, None] - points) / reach
    return np.hstack([turn, shift]), np.concatenate([axes, moves], axis=2).swapaxes(1, 2)
