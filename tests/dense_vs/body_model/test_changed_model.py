"""A body after a change is the same body, at other readings or before another camera."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_arm import TexturedArm, postures

from dense_vs.body_model import BodyChange, ChangeKind
from dense_vs.body_model.precision import Precision, covariances

OFFSETS, TURN, SHIFT = np.array([0.2, -0.1, 0.05]), np.array([0.1, -0.2, 0.3]), np.array([0.05, -0.02, 0.1])
NOTHING = np.zeros(3)


def change(offsets=NOTHING, turn=NOTHING, shift=NOTHING):
    return BodyChange(ChangeKind.UNKNOWN, offsets, turn, shift, 1.0, 1.0, 0.0, 0, (), ("rad",) * 3)


def precise(arm, seed=0):
    """The arm's model with a precision of some errors."""
    rng = np.random.default_rng(seed)
    model = arm.model()
    count = len(model.surface.links)
    model.precision = Precision(
        0.01 * rng.normal(size=(4, 13)), np.zeros((count, 4), np.float32), np.full(count, 0.02),
        postures(2), rng.integers(0, 2, count), 0.4,
    )  # fmt: skip
    return model


@pytest.mark.parametrize("slides", [False, True])
def test_readings_that_are_larger_by_offsets_are_the_same_postures(slides):
    model = TexturedArm(slides=slides).model()
    changed = model.changed(change(offsets=OFFSETS))
    for q in postures(3):
        np.testing.assert_allclose(changed.points(q + OFFSETS).pixels, model.points(q).pixels, atol=1e-9)
        np.testing.assert_allclose(changed.jacobian(q + OFFSETS), model.jacobian(q), atol=1e-3)
    np.testing.assert_allclose(changed.joint_range, model.joint_range + OFFSETS[:, None])


@pytest.mark.parametrize("slides", [False, True])
def test_a_moved_camera_sees_the_body_moved(slides):
    arm = TexturedArm(slides=slides)
    model = arm.model()
    changed = model.changed(change(turn=TURN, shift=SHIFT))
    chosen = np.arange(0, len(model.surface.links), 97)
    points, links = model.surface.points[chosen], model.surface.links[chosen]
    for q in postures(3):
        seen = arm.pixels(points, links, q, TURN, SHIFT)
        np.testing.assert_allclose(changed.points(q).pixels[chosen], seen, atol=1e-6)


def test_a_changed_model_is_saved_as_any_other(tmp_path):
    model = precise(TexturedArm()).changed(change(OFFSETS, TURN, SHIFT))
    model.save(tmp_path / "body.npz")
    again = type(model).load(tmp_path / "body.npz")
    q = postures(1)[0] + OFFSETS
    np.testing.assert_allclose(again.points(q).pixels, model.points(q).pixels, atol=1e-3)


def test_what_was_known_to_some_pixels_is_known_to_as_many_after_a_change_of_readings():
    model = precise(TexturedArm())
    q = postures(3)[2]
    before = model.points(q).covariances
    after = model.changed(change(offsets=OFFSETS)).points(q + OFFSETS).covariances
    np.testing.assert_allclose(after, before, rtol=1e-6)
    assert np.ptp(before[:, 0, 0]) > 0.01


@pytest.mark.parametrize("slides", [False, True])
def test_uncertainty_turns_with_the_camera(slides):
    """Before a camera that is rolled about its optical axis, covariances are those of before, rolled."""
    model = precise(TexturedArm(slides=slides))
    roll = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()
    chain = model.chain.turned(roll, NOTHING, NOTHING)
    precision = model.precision.turned(roll, model.chain, chain)
    q, surface = postures(3)[2], model.surface
    before = covariances(model.chain, 200.0, surface.points, surface.links, model.precision, q)
    after = covariances(chain, 200.0, surface.points @ roll.T, surface.links, precision, q)
    flat = roll[:2, :2]
    np.testing.assert_allclose(after, flat @ before @ flat.T, rtol=1e-5, atol=1e-7)
    assert not np.allclose(after, before, rtol=0.1)


def test_a_model_that_does_not_know_its_errors_does_not_after_a_change():
    model = TexturedArm().model()
    assert model.precision is None
    assert model.changed(change(OFFSETS, TURN, SHIFT)).precision is None


def test_the_model_that_is_changed_stays_as_it_was():
    model = precise(TexturedArm())
    kept = replace(model._content())
    points, home = kept.surface.points.copy(), kept.chain.home.copy()
    lines = model.precision.lines.copy()
    model.changed(change(OFFSETS, TURN, SHIFT))
    np.testing.assert_array_equal(model.surface.points, points)
    np.testing.assert_array_equal(model.chain.home, home)
    np.testing.assert_array_equal(model.precision.lines, lines)
