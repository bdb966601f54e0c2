"""Soft, late and noisily read joints."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.compliance import Compliance

JOINTS = ("left-shoulder-p", "left-elbow-p", "right-elbow-p")
SMALL = {"device": "cpu", "height": 24, "width": 32}


def followed(compliance, frames=12):
    """Share of a commanded 0.1 rad that the joint has moved after each frame, without the noise of its reading."""
    world = SimWorld("upper-body", joints=JOINTS, compliance=compliance, **SMALL)
    column = world.scene.model.joint(JOINTS[1]).qposadr[0]
    start = world.physics.host_state(0).qpos[column]
    shares = []
    for frame in range(frames):
        world.step([0.0, 0.1 if frame == 0 else 0.0, 0.0])
        shares.append((world.physics.host_state(0).qpos[column] - start) / 0.1)
    return np.array(shares)


@pytest.mark.slow
def test_soft_joints_follow_late_and_arrive():
    stiff, soft = followed(False, 30), followed(True, 30)
    assert np.all(stiff[:8] > soft[:8])
    lag = [np.argmax(shares > 0.63) for shares in (stiff, soft)]
    assert lag[1] - lag[0] >= 3  # frames; the actuator alone takes 0.1 s
    np.testing.assert_allclose([stiff[-1], soft[-1]], 1.0, atol=0.02)
    assert followed(Compliance(lag=0.3))[5] < soft[5]


def test_soft_joints_yield_to_the_tools_weight():
    sunk = {}
    for compliance in (False, True):
        world = SimWorld("upper-body-rake", joints=JOINTS, compliance=compliance, **SMALL)
        before = world.project("rake-tip")
        for _ in range(40):
            world.step()
        sunk[compliance] = world.project("rake-tip")[1] - before[1]
        rest = world.project("rake-tip")
        world.step()
        assert np.abs(world.project("rake-tip") - rest).max() < 0.02  # it has settled
    assert abs(sunk[False]) < 0.01
    assert sunk[True] > 0.05  # px of an image of 32


def test_a_compliant_robot_starts_at_rest():
    world = SimWorld("upper-body", joints=JOINTS, compliance=Compliance(reading_noise=0.0), **SMALL)
    start, _ = world.joints()
    for _ in range(5):
        world.step()
    np.testing.assert_allclose(world.joints()[0], start, atol=1e-9)


def test_readings_have_noise_and_the_truth_has_not():
    world = SimWorld("upper-body", joints=JOINTS, compliance=Compliance(reading_noise=0.01), seed=4, **SMALL)
    columns = world.scene.model.jnt_qposadr[world.scene.joint_ids]
    errors = []
    for _ in range(60):
        world.step([0.0, 0.0, 0.0])
        first, again = world.joints()[0], world.joints()[0]
        np.testing.assert_array_equal(first, again)
        times, positions = world.joint_history()
        assert len(times) == len(positions)
        np.testing.assert_array_equal(positions[-1], first)
        errors.append(positions - world.physics.host_state(0).qpos[columns])
    errors = np.concatenate(errors)
    assert errors.std() == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(errors[:-1, 0], errors[1:, 0])[0, 1]) < 0.15
    np.testing.assert_array_equal(world.true_flow(), 0.0)
    other = SimWorld("upper-body", joints=JOINTS, compliance=Compliance(reading_noise=0.01), seed=4, **SMALL)
    for _ in range(60):
        other.step()
    np.testing.assert_array_equal(other.joints()[0], first)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Compliance(stiffness=0.0), "stiffness is 0.0; expected"),
        (lambda: Compliance(lag=float("nan")), "lag is nan; expected"),
        (lambda: Compliance(reading_noise=-0.1), "reading_noise is -0.1; expected"),
        (lambda: SimWorld("upper-body", compliance=0.3, **SMALL), "compliance is 0.3; expected True, False or"),
    ],
)
def test_bad_compliance(make, message):
    with pytest.raises(DenseVSError, match=message):
        make()


def test_a_file_says_itself_how_soft_it_is(eye_in_hand_file):
    with pytest.raises(DenseVSError, match="expected False with an MJCF file"):
        SimWorld(eye_in_hand_file, compliance=True, **SMALL)
