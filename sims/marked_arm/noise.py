"""Noisy controllers and noisy joint readings (Gothoskar et al., section "Noisy Control").

Two laws, to be said with every figure. ``"independent"``, the paper's: each move ends off by N(0, sigma) in every
coordinate, however short it is, so no servo can end closer. ``"proportional"``: by N(0, sigma) times the length of the
move over :data:`REFERENCE_MOVE`, so a move of that length errs as much as under the other law and a short one less.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.checks import check_choice, check_number

LAWS = ("independent", "proportional")
REFERENCE_MOVE = 1.0  # rad (of the joint step's norm), or m and rad of a Cartesian step's translation and rotation


@dataclass(frozen=True)
class NoisyController:
    """Executes joint or Cartesian steps with noise of standard deviation ``sigma`` (rad; m and rad) under a law."""

    sigma: float
    law: str
    rng: np.random.Generator

    def __post_init__(self) -> None:
        check_choice("law", self.law, LAWS)
        check_number("sigma", self.sigma, least=0.0)

    def joint_step(self, step: np.ndarray) -> np.ndarray:
        """The joints' true motion (n,) [rad]."""
        return step + self._scale(np.linalg.norm(step)) * self.rng.normal(size=step.shape)

    def transform(self, action: np.ndarray) -> np.ndarray:
        """The hand's true motion (4, 4): noise on x, y, z and on roll, pitch, yaw of the transform."""
        angles = Rotation.from_matrix(action[:3, :3]).as_euler("xyz")
        turn = np.linalg.norm(Rotation.from_matrix(action[:3, :3]).as_rotvec())
        done = np.eye(4)
        done[:3, 3] = action[:3, 3] + self._scale(np.linalg.norm(action[:3, 3])) * self.rng.normal(size=3)
        noise = self._scale(turn) * self.rng.normal(size=3)
        done[:3, :3] = Rotation.from_euler("xyz", angles + noise).as_matrix()
        return done

    def _scale(self, length: float | np.floating) -> float:
        return self.sigma if self.law == "independent" else self.sigma * float(length) / REFERENCE_MOVE


def noisy_pose(pose: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """A reading (4, 4) of a pose, off by N(0, sigma) in x, y, z [m] and in roll, pitch, yaw [rad]."""
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz") + rng.normal(0.0, sigma, 3)
    read = np.eye(4)
    read[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    read[:3, 3] = pose[:3, 3] + rng.normal(0.0, sigma, 3)
    return read
