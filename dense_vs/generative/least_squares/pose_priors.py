"""Priors on the hand's poses from noisy poses and Cartesian actions: Gothoskar (8), Gothoskar (12).

The paper's D_pose is the Frobenius norm of the difference of two matrices; here the rotation vector between them and
the difference of translations, each divided by its own noise, as meters and radians have no common unit.
"""

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelState
from dense_vs.generative.rotations import rotation_vectors


class PoseReadings:
    """Squares of pose deviations times information, the second term of Gothoskar (8).

    Args:
        poses: ``(T, 4, 4)`` read.
        information: pixel variance over the variances of rotation [rad] and translation, two numbers.
    """

    def __init__(self, poses: np.ndarray, information: tuple[float, float]):
        self.poses = poses
        self.information = np.repeat(information, 3)

    def deviations(self, state: PixelState) -> np.ndarray:
        """Rotation vectors and shifts ``(T, 6)`` from the readings."""
        assert state.rotation is not None
        assert state.translation is not None
        turned = rotation_vectors(state.rotation @ self.poses[:, :3, :3].swapaxes(1, 2))
        return np.hstack([turned, state.translation - self.poses[:, :3, 3]])

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]."""
        return float((self.information * self.deviations(state) ** 2).sum())

    def add(self, state: PixelState, equations: NormalEquations) -> None:
        """Add to the samples' blocks."""
        assert equations.local is not None
        assert equations.local_gradient is not None
        equations.local[:, np.arange(6), np.arange(6)] += self.information
        equations.local_gradient += self.information * self.deviations(state)

    def spread(self, state: PixelState, own: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Variance ``(T, 6)`` of the deviations where the samples' blocks have covariance ``own``."""
        return np.einsum("tii->ti", own)


class PoseActions:
    """Squares of ``P_{t+1} P_t^-1`` against ``A_t`` times information, the second term of Gothoskar (12).

    Args:
        actions: ``(T - 1, 4, 4)`` commanded.
        information: as :class:`PoseReadings`.
    """

    def __init__(self, actions: np.ndarray, information: tuple[float, float]):
        self.actions = actions
        self.information = np.repeat(information, 3)

    def deviations(self, state: PixelState) -> np.ndarray:
        """Rotation vectors and shifts ``(T - 1, 6)`` of the moves from the actions."""
        relative, carried = self._moves(state)
        assert state.translation is not None
        turned = rotation_vectors(relative @ self.actions[:, :3, :3].swapaxes(1, 2))
        return np.hstack([turned, state.translation[1:] - carried - self.actions[:, :3, 3]])

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]."""
        return float((self.information * self.deviations(state) ** 2).sum())

    def add(self, state: PixelState, equations: NormalEquations) -> None:
        """Add to the samples' blocks and to those between neighbors."""
        assert equations.local is not None
        assert equations.local_gradient is not None
        before, after = self._derivatives(state)
        weighted = self.information[:, None] * before, self.information[:, None] * after
        deviations = self.deviations(state)
        equations.local[:-1] += before.swapaxes(1, 2) @ weighted[0]
        equations.local[1:] += after.swapaxes(1, 2) @ weighted[1]
        equations.chained = after.swapaxes(1, 2) @ weighted[0]
        equations.local_gradient[:-1] += np.einsum("tij,ti->tj", weighted[0], deviations)
        equations.local_gradient[1:] += np.einsum("tij,ti->tj", weighted[1], deviations)

    def spread(self, state: PixelState, own: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Variance ``(T - 1, 6)`` of the deviations; ``across`` are the covariances of a sample with the one before."""
        before, after = self._derivatives(state)
        total = before @ own[:-1] @ before.swapaxes(1, 2) + after @ own[1:] @ after.swapaxes(1, 2)
        mixed = after @ across @ before.swapaxes(1, 2)
        return np.einsum("tii->ti", total + mixed + mixed.swapaxes(1, 2))

    def _moves(self, state: PixelState) -> tuple[np.ndarray, np.ndarray]:
        assert state.rotation is not None
        assert state.translation is not None
        relative = state.rotation[1:] @ state.rotation[:-1].swapaxes(1, 2)
        return relative, np.einsum("tij,tj->ti", relative, state.translation[:-1])

    def _derivatives(self, state: PixelState) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the deviations by the turn and shift of the sample before and of the one after."""
        relative, carried = self._moves(state)
        assert state.translation is not None
        steps = len(relative)
        before, after = np.zeros((steps, 6, 6)), np.zeros((steps, 6, 6))
        before[:, :3, :3], before[:, 3:, 3:] = -relative, -relative
        before[:, 3:, :3] = -relative @ _cross(state.translation[:-1])
        after[:, :3, :3], after[:, 3:, 3:] = np.eye(3), np.eye(3)
        after[:, 3:, :3] = _cross(carried)
        return before, after


def _cross(vectors: np.ndarray) -> np.ndarray:
    """Matrices [v]x with [v]x w = v x w."""
    matrix = np.zeros((*vectors.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return matrix
