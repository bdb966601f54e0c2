"""The servo law on mask features: (10), limits, and a feature that is lost."""

import numpy as np
import pytest

from dense_vs import DenseVSError, FeatureServo

PINV = np.array([[0.002, 0.0], [0.0, -0.001], [0.0, 0.0005]])


def test_step_is_the_papers():
    servo = FeatureServo([320, 240], gain=0.5)
    command = servo.step(PINV, [400.0, 200.0])
    np.testing.assert_allclose(command.error, [80.0, -40.0])
    np.testing.assert_allclose(command.dq, -0.5 * PINV @ [80.0, -40.0])
    assert command.state == "servoing"
    assert not command.at_limit.any()


def test_it_stops_within_the_tolerance():
    command = FeatureServo([320, 240], tolerance=5).step(PINV, [324.0, 236.0])
    assert command.state == "converged"
    assert not command.dq.any()


def test_a_long_step_is_shortened_as_a_whole():
    free = FeatureServo([0.0, 0.0]).step(PINV, [300.0, 200.0]).dq
    bounded = FeatureServo([0.0, 0.0], max_step=[0.1, 0.5, 0.5]).step(PINV, [300.0, 200.0]).dq
    np.testing.assert_allclose(bounded, free * (0.1 / 0.6))
    np.testing.assert_allclose(FeatureServo([0.0, 0.0], max_step=0.1).step(PINV, [300.0, 200.0]).dq, bounded)


def test_joint_limits_are_kept_and_told():
    servo = FeatureServo([0.0, 0.0], joint_limits=[[-0.3, 0.3], [-1, 1], [-1, 1]])
    command = servo.step(PINV, [300.0, 200.0], positions=[-0.2, 0.0, 0.0])
    np.testing.assert_allclose(command.dq, [-0.1, 0.2, -0.1])
    assert command.at_limit.tolist() == [True, False, False]
    outside = servo.step(PINV, [300.0, 200.0], positions=[-0.4, 0.0, 0.0])
    assert outside.dq[0] == 0.0
    back = servo.step(PINV, [-300.0, 200.0], positions=[-0.4, 0.0, 0.0])
    assert back.dq[0] == pytest.approx(0.6)


def test_a_lost_feature_stops_the_robot_and_is_told():
    servo = FeatureServo([320, 240], patience=3)
    for seen in (None, [np.nan, 240.0]):
        command = servo.step(PINV, seen)
        assert command.state == "waiting"
        assert not command.dq.any()
        assert np.isnan(command.error).all()
    assert servo.step(PINV, None).state == "lost"
    assert servo.step(PINV, [400.0, 200.0]).state == "servoing"
    assert servo.step(PINV, [320.0, np.nan]).state == "waiting"
    servo.step(PINV, None)
    servo.reset()
    assert servo.step(PINV, [np.nan, np.nan]).state == "waiting"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gain": np.nan}, "gain"),
        ({"tolerance": -1}, "tolerance"),
        ({"patience": 0}, "patience"),
        ({"max_step": 0.0}, "max_step"),
        ({"joint_limits": [[1.0, 0.0]]}, "joint_limits"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(DenseVSError, match=message):
        FeatureServo([320, 240], **options)


def test_bad_input_is_refused():
    servo = FeatureServo([320, 240], joint_limits=[[-1, 1]] * 3, max_step=[0.1, 0.1])
    with pytest.raises(DenseVSError, match="positions are missing"):
        servo.step(PINV, [0.0, 0.0])
    with pytest.raises(DenseVSError, match="max_step has shape"):
        servo.step(PINV, [0.0, 0.0], positions=[0.0, 0.0, 0.0])
    plain = FeatureServo([320, 240])
    with pytest.raises(DenseVSError, match="pinv has shape"):
        plain.step(np.eye(3), [0.0, 0.0])
    with pytest.raises(DenseVSError, match="features have shape"):
        plain.step(PINV, [0.0, 0.0, 0.0])


@pytest.mark.parametrize(("gain", "size"), [(1e300, 1.0), (1.0, 1e200), (1e200, 1e200), (1e308, 1e307)])
def test_no_number_is_too_large_for_a_step(gain, size):
    bounded = FeatureServo([0.0, 0.0], gain, max_step=[0.1, 0.2, 0.3]).step(size * PINV, [300.0, 200.0]).dq
    usual = FeatureServo([0.0, 0.0], 1e6, max_step=[0.1, 0.2, 0.3]).step(PINV, [300.0, 200.0]).dq
    np.testing.assert_allclose(bounded, usual, rtol=1e-9)
    if size > 1e150 and gain > 1e150:
        with pytest.raises(DenseVSError, match=r"step is .*expected a smaller gain"):
            FeatureServo([0.0, 0.0], gain).step(size * PINV, [300.0, 200.0])


def test_a_step_that_is_too_large_for_one_joint_alone_is_shortened_as_a_whole():
    pinv = [[1e200, 0.0], [0.0, 1.0]]
    dq = FeatureServo([0.0, 0.0], 1e150, max_step=[0.1, 0.2]).step(pinv, [300.0, 200.0]).dq
    np.testing.assert_allclose(dq, [-0.1, 0.0], atol=1e-12)


def test_the_defaults_are_those_documented():
    servo = FeatureServo([320, 240])
    assert (servo.gain, servo.tolerance, servo.patience, servo.max_step) == (1.0, 5.0, 10, None)
    assert servo.step(PINV, [325.0, 240.0]).state == "converged"
    assert servo.step(PINV, [325.1, 240.0]).state == "servoing"
