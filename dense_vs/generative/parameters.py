"""The unknowns of the generative model.

Beyond the paper, which uses DH parameters: a joint is a line, a unit direction and a point, in the home pose, with two
tangent parameters each; features are given in the home pose as well, so neither base nor tool frame is needed. Unlike
DH parameters this has no singularity at parallel axes. The origin is camera 0 unless a Cartesian state defines it.
"""

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass
class ModelParameters:
    """Everything that the model predicts pixels with.

    Attributes:
        axes: ``(n, 3)`` unit directions of the joints in the home pose.
        points: ``(n, 3)`` a point on each joint's line.
        home: ``(n,)`` [rad] the home pose: angles enter the chain as q - home.
        features: ``(m, 3)`` in the home pose.
        links: ``(m,)`` the joint, counted from 1, behind which a feature stands.
        camera_rotation: ``(c, 3, 3)`` world to camera.
        camera_translation: ``(c, 3)``.
        intrinsics: ``(c, 6)`` fx, fy, cx, cy [px], k1, k2.
        base_rotation: ``(3, 3)`` of a pose of the whole arm, for a base that was moved after learning.
        base_translation: ``(3,)``.

    Lengths are in a unit of the model's own, as images leave the scale open.
    """

    axes: np.ndarray
    points: np.ndarray
    home: np.ndarray
    features: np.ndarray
    links: np.ndarray
    camera_rotation: np.ndarray
    camera_translation: np.ndarray
    intrinsics: np.ndarray
    base_rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    base_translation: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def joint_count(self) -> int:
        """Joints of the chain."""
        return len(self.axes)

    def copy(self) -> "ModelParameters":
        """Arrays of its own."""
        return replace(self, **{name: np.array(value) for name, value in vars(self).items()})


def finite_rows(points: np.ndarray) -> np.ndarray:
    """Which points ``(..., 3)`` are known, bool ``(...)``: unknown ones are NaN."""
    return np.asarray(np.isfinite(points).all(axis=-1))
