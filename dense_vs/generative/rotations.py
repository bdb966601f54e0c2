"""Rotations in the forms that learning needs: matrices of rotation vectors and back, and directions across an axis."""

import numpy as np
from scipy.spatial.transform import Rotation


def rotation_matrices(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices of rotation vectors ``(..., 3)`` [rad]."""
    return Rotation.from_rotvec(np.reshape(vectors, (-1, 3))).as_matrix().reshape(*np.shape(vectors), 3)


def rotation_vectors(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors [rad] of rotation matrices ``(..., 3, 3)``."""
    vectors = Rotation.from_matrix(np.reshape(matrices, (-1, 3, 3))).as_rotvec()
    return vectors.reshape(np.shape(matrices)[:-1])


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """Matrices ``(..., 3, 3)`` that cross vectors ``(..., 3)`` with what they are multiplied by."""
    x, y, z = np.moveaxis(np.asarray(vectors, dtype=np.float64), -1, 0)
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*np.shape(vectors), 3)


def tangents(axes: np.ndarray) -> np.ndarray:
    """Two unit vectors across each unit vector, ``(..., 3)`` to ``(..., 2, 3)``."""
    smallest = np.eye(3)[np.abs(axes).argmin(axis=-1)]
    first = np.cross(axes, smallest)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(axes, first)], axis=-2)
