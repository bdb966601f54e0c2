"""The unknowns of the generative model, and how they move by a step of the solver.

Beyond the paper, which uses DH parameters: a joint is a line, a unit direction and a point, in the home pose, with two
tangent parameters each; features are given in the home pose as well, so neither base nor tool frame is needed. Unlike
DH parameters this has no singularity at parallel axes. The origin is camera 0 unless a Cartesian state defines it.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class ModelParameters:
    """Everything that the model predicts pixels with.

    Attributes:
        axes: ``(n, 3)`` unit directions of the joints in the home pose.
        points: ``(n, 3)`` a point on each joint's line.
        centre: ``(n,)`` [rad] the home pose: angles enter the chain as q - centre.
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
    centre: np.ndarray
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


def turn(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices of rotation vectors ``(..., 3)`` [rad]."""
    return Rotation.from_rotvec(np.reshape(vectors, (-1, 3))).as_matrix().reshape(*np.shape(vectors), 3)


def rotation_vector(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors [rad] of rotation matrices ``(..., 3, 3)``."""
    vectors = Rotation.from_matrix(np.reshape(matrices, (-1, 3, 3))).as_rotvec()
    return vectors.reshape(np.shape(matrices)[:-1])


def tangents(axes: np.ndarray) -> np.ndarray:
    """Two unit vectors across each unit vector, ``(..., 3)`` to ``(..., 2, 3)``."""
    smallest = np.eye(3)[np.abs(axes).argmin(axis=-1)]
    first = np.cross(axes, smallest)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(axes, first)], axis=-2)


def link_poses(parameters: ModelParameters, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation ``(T, n + 1, 3, 3)`` and translation ``(T, n + 1, 3)`` of every link's motion from the home pose."""
    samples = len(joints)
    rotation, translation = parameters.base_rotation, parameters.base_translation
    rotations = [np.broadcast_to(rotation, (samples, 3, 3))]
    translations = [np.broadcast_to(translation, (samples, 3))]
    for axis, point, angle in zip(parameters.axes, parameters.points, (joints - parameters.centre).T, strict=True):
        step = turn(angle[:, None] * axis)
        translations.append(translations[-1] + np.einsum("tij,tj->ti", rotations[-1], point - step @ point))
        rotations.append(rotations[-1] @ step)
    return np.stack(rotations, axis=1), np.stack(translations, axis=1)
