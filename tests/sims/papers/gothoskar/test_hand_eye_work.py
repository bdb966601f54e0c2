import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.gothoskar.hand_eye_work import rigid_motion, stand_off, with_features
from dense_vs.sims.papers.gothoskar.insertion import sides


def test_standing_off_stretches_the_distance_and_keeps_the_shape():
    rng = np.random.default_rng(0)
    hand, part = rng.normal(size=(5, 3)), rng.normal([0, 0, 3], size=(4, 3))
    far = stand_off(hand, part, 1.4)
    distance = [np.linalg.norm(p.mean(axis=0) - hand.mean(axis=0)) for p in (part, far)]
    np.testing.assert_allclose(distance[1], 1.4 * distance[0])
    np.testing.assert_allclose(np.diff(far, axis=0), np.diff(part, axis=0))
    np.testing.assert_allclose(stand_off(hand, part, 1.0), part)


def test_rigid_motion_ignores_unknown_corners():
    rng = np.random.default_rng(1)
    before = rng.normal(size=(6, 3))
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    after = before @ turn.T + [0.1, 0.2, 0.3]
    after[2] = np.nan
    rotation, shift = rigid_motion(before, after)
    np.testing.assert_allclose(rotation, turn, atol=1e-9)
    np.testing.assert_allclose(shift, [0.1, 0.2, 0.3], atol=1e-9)
    after[3:] = np.nan
    with pytest.raises(DenseVSError, match="2 corners"):
        rigid_motion(before, after)


def test_sides_of_markers_point_down():
    quad = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    unknown = np.full((4, 3), np.nan)
    np.testing.assert_allclose(sides(np.concatenate([quad, unknown])), [0, -1, 0])


def test_other_features_leave_the_model_as_it_was(learned):
    before = learned.parameters.features.copy()
    other = with_features(learned, before[:5] + 0.01)
    joints = learned.postures[:2]
    assert other.pixels(joints).shape[2] == 5
    assert not np.allclose(other.pixels(joints), learned.pixels(joints)[:, :, :5])
    np.testing.assert_array_equal(learned.parameters.features, before)
