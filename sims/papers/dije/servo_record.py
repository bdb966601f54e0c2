"""The task of a servo experiment of DIJE section V-B, and the results of one seed."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.jacobian.error import JacobianError


@dataclass(frozen=True)
class ServoTask:
    """One of the experiments.

    Attributes:
        figure: of the paper.
        robot, joints: of :class:`dense_vs.sims.SimWorld`.
        points: what is controlled, one after the other without learning anew.
        close_px: true error that counts as success; ``soft_px`` where the robot is compliant [px].
        least_distance: between a target and the one before [px].
    """

    figure: str
    robot: str
    joints: tuple[str, ...]
    points: tuple[str, ...]
    close_px: float
    soft_px: float
    least_distance: float


@dataclass(frozen=True)
class TaskReach:
    """One target: which point, where to, in how many frames, and the true distance at the end [px].

    A reach ends early where the tracker has ``lost`` the point.
    """

    point: str
    target: tuple[float, ...]
    frames: int
    true_error_px: float
    lost: bool
    image: np.ndarray  # (H, W, 3) at the end
    path: tuple[int, int]  # first and last frame of the trace


@dataclass
class TaskRun:
    """Results of a seed; ``trace`` as :class:`dense_vs.sims.papers.dije.reaching.Trace`.

    ``moved_into_view`` counts the points that were so near the image's border when they were defined that a place
    farther inside was taken.
    """

    seed: int
    learned: JacobianError
    trace: Any
    reaches: list[TaskReach] = field(default_factory=list)
    moved_into_view: int = 0
    estimated: np.ndarray | None = None  # (H, W, 2, N) at the end
    true: np.ndarray | None = None
    mask: np.ndarray | None = None  # (H, W), the robot
