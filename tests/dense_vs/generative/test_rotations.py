"""Rotations beside SciPy's and NumPy's own."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.rotations import cross_matrices, rotation_matrices, rotation_vectors, tangents


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3)])
def test_of_any_number_of_vectors(shape):
    rng = np.random.default_rng(1)
    vectors, others = rng.normal(size=(2, *shape))
    crossed = (cross_matrices(vectors) @ others[..., None])[..., 0]
    np.testing.assert_allclose(crossed, np.cross(vectors, others), atol=1e-12)
    matrices = rotation_matrices(vectors)
    assert matrices.shape == (*shape, 3)
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    np.testing.assert_allclose(matrices.reshape(-1, 3, 3), expected, atol=1e-12)
    np.testing.assert_allclose(rotation_vectors(matrices), vectors, atol=1e-9)
    axes = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    frames = np.concatenate([axes[..., None, :], tangents(axes)], axis=-2)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, -1, -2), np.broadcast_to(np.eye(3), matrices.shape), atol=1e-12
    )
