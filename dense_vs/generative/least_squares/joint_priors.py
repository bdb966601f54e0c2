"""Priors on the samples' joints from noisy joint readings and joint actions: Gothoskar (10), Gothoskar (14)."""

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelState


class JointReadings:
    """``sum_t (j_t - j_t^o)^2`` times lambda, the second term of Gothoskar (10).

    Args:
        joints: ``(T, n)`` read [rad].
        information: lambda, pixel variance over joint variance [px^2/rad^2].
    """

    def __init__(self, joints: np.ndarray, information: float):
        self.joints, self.information = joints, information

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]."""
        return float(self.information * ((state.joints - self.joints) ** 2).sum())

    def add(self, state: PixelState, equations: NormalEquations) -> None:
        """Add to the samples' blocks."""
        assert equations.local is not None
        assert equations.local_gradient is not None
        joints = self.joints.shape[1]
        equations.local[:, np.arange(joints), np.arange(joints)] += self.information
        equations.local_gradient += self.information * (state.joints - self.joints)


class JointActions:
    """``sum_t (j_{t+1} - j_t - a_t)^2`` times lambda, the second term of Gothoskar (14).

    Args:
        actions: ``(T - 1, n)`` commanded [rad].
        information: lambda, pixel variance over the variance of a step [px^2/rad^2]; or ``(T - 1, n)`` of them.
    """

    def __init__(self, actions: np.ndarray, information: float | np.ndarray):
        self.actions = actions
        self.information = np.broadcast_to(np.asarray(information, dtype=float), actions.shape)

    def cost(self, state: PixelState) -> float:
        """Sum of squares [px^2]."""
        return float((self.information * (np.diff(state.joints, axis=0) - self.actions) ** 2).sum())

    def add(self, state: PixelState, equations: NormalEquations) -> None:
        """Add to the samples' blocks and to those between neighbors."""
        assert equations.local is not None
        assert equations.local_gradient is not None
        steps = len(self.actions)
        at = np.arange(self.actions.shape[1])
        equations.local[:-1, at, at] += self.information
        equations.local[1:, at, at] += self.information
        chained = np.zeros((steps, len(at), len(at)))
        chained[:, at, at] = -self.information
        equations.chained = chained
        pull = self.information * (np.diff(state.joints, axis=0) - self.actions)
        equations.local_gradient[:-1] -= pull
        equations.local_gradient[1:] += pull
