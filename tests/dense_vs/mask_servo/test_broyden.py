"""The Hadamard-Broyden update against (11) element by element, against the secant condition, and learning a camera."""

import numpy as np
import pytest
from reference_broyden import hadamard_broyden

from dense_vs import DenseVSError, HadamardBroyden

COUPLING = np.array([[0, 1], [1, 0], [0, 0], [1, 0]])


def random_case(seed):
    rng = np.random.default_rng(seed)
    return 0.001 * rng.normal(size=(4, 2)), rng.normal(0, 0.1, 4), rng.normal(0, 40, 2)


@pytest.mark.parametrize("coupling", [None, COUPLING])
def test_update_is_the_papers(coupling):
    for seed in range(5):
        pinv, dq, de = random_case(seed)
        learner = HadamardBroyden(pinv, coupling, alpha=0.1, min_cosine=0.0)
        step = learner.update(dq, de)
        assert step.outcome == "updated"
        expected = hadamard_broyden(pinv, dq, de, coupling, 0.1)
        np.testing.assert_allclose(learner.pinv, expected, rtol=1e-12)
        np.testing.assert_allclose(step.pinv, expected, rtol=1e-12)


def test_broydens_own_update_explains_the_motion():
    """Broyden (1965), (4.5): the new inverse maps the change of the error onto the motion that made it."""
    pinv, dq, de = random_case(3)
    learner = HadamardBroyden(pinv, alpha=1.0, min_cosine=0.0)
    learner.update(dq, de)
    np.testing.assert_allclose(learner.pinv @ de, dq, rtol=1e-9)


def test_uncoupled_elements_stay_zero():
    learner = HadamardBroyden(0.001 * COUPLING, COUPLING)
    for seed in range(6):
        _, dq, de = random_case(seed)
        learner.update(dq, de)
    assert not learner.pinv[COUPLING == 0].any()


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_servoing_converges_whatever_the_first_sign(signs):
    """Two joints, each moving one image coordinate; the paper's 0.001 H and alpha = 0.1, an object within view."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        pixels_per_joint = np.array(signs) / rng.uniform(0.0005, 0.003, 2)
        learner = HadamardBroyden(0.001 * np.eye(2), np.eye(2), alpha=0.1)
        q, e = np.zeros(2), rng.uniform(-200, 200, 2)
        for _ in range(300):
            learner.observe(q, e)
            step = np.clip(-learner.pinv @ e, -0.1, 0.1)
            q, e = q + step, e + pixels_per_joint * step
            if np.abs(e).max() > 320:  # out of view: the robot goes back and goes on with what it learned
                learner.forget_observation()
                e = rng.uniform(-200, 200, 2)
            if np.abs(e).max() < 5:
                break
        assert np.abs(e).max() < 5, f"seed {seed}"
        np.testing.assert_array_equal(np.sign(np.diag(learner.pinv)), signs)


def test_the_denominator_is_held_away_from_zero():
    pinv = np.array([[0.001, 0.0], [0.0, 0.001]])
    learner = HadamardBroyden(pinv, np.eye(2), min_cosine=0.05)
    step = learner.update([0.1, 0.1], [100.0, -100.0 + 1e-9])  # dq at a right angle to J+ de
    assert step.outcome == "guarded"
    assert abs(step.denominator) < 1e-6
    assert np.abs(step.pinv - pinv).max() < 0.1 * np.abs(pinv).max() * (1 / 0.05 + 1)


def test_nothing_is_learned_from_what_tells_nothing():
    learner = HadamardBroyden(0.001 * np.eye(2), np.eye(2))
    assert learner.update([0.01, 0.01], [5.0, 5.0]).outcome == "too little motion"
    assert learner.update([0.1, 0.1], [0.0, 0.0]).outcome == "no change of features"
    assert HadamardBroyden(np.zeros((2, 2))).update([0.1, 0.1], [5.0, 5.0]).outcome == "no estimate"
    np.testing.assert_array_equal(learner.pinv, 0.001 * np.eye(2))
    assert [step.changed for step in learner.history] == [False, False]


def test_small_motions_add_up_until_there_are_enough():
    whole = HadamardBroyden(0.001 * np.eye(2), np.eye(2))
    whole.update([0.03, 0.012], [20.0, 9.0])
    parts = HadamardBroyden(0.001 * np.eye(2), np.eye(2))
    assert parts.observe([0.0, 0.0], [50.0, 60.0]) is None
    outcomes = [parts.observe([0.03 * s, 0.012 * s], [50.0 + 20 * s, 60.0 + 9 * s]).outcome for s in (0.2, 0.45, 1.0)]
    assert outcomes == ["too little motion", "too little motion", "updated"]
    np.testing.assert_allclose(parts.pinv, whole.pinv, rtol=1e-12)


def test_alpha_zero_keeps_what_was_learned():
    learner = HadamardBroyden(0.001 * np.eye(2), alpha=0.0)
    learner.update([0.1, 0.1], [50.0, 20.0])
    np.testing.assert_array_equal(learner.pinv, 0.001 * np.eye(2))


def test_bad_input_is_refused_and_changes_nothing():
    learner = HadamardBroyden(0.001 * np.eye(2), np.eye(2))
    with pytest.raises(DenseVSError, match=r"dq has shape \(3,\)"):
        learner.update([0.1, 0.1, 0.1], [1.0, 2.0])
    with pytest.raises(DenseVSError, match="de is"):
        learner.update([0.1, 0.1], [np.nan, 2.0])
    assert learner.history == []
    for arguments, message in (
        ({"pinv0": [1.0, 2.0]}, "pinv0"),
        ({"pinv0": np.eye(2), "coupling": np.eye(3)}, "coupling has shape"),
        ({"pinv0": np.eye(2), "coupling": 0.5 * np.eye(2)}, "expected 0 and 1"),
        ({"pinv0": np.eye(2), "alpha": -0.1}, "alpha is -0.1"),
        ({"pinv0": np.eye(2), "min_motion": np.inf}, "min_motion is inf"),
        ({"pinv0": np.eye(2), "min_cosine": True}, "min_cosine is True"),
    ):
        with pytest.raises(DenseVSError, match=message):
            HadamardBroyden(**arguments)


def test_a_coupling_of_flags_is_one_of_zeros_and_ones():
    pinv, dq, de = random_case(3)
    by_flags, by_numbers = HadamardBroyden(pinv, COUPLING.astype(bool)), HadamardBroyden(pinv, COUPLING)
    for learner in (by_flags, by_numbers):
        learner.update(dq, de)
    np.testing.assert_array_equal(by_flags.pinv, by_numbers.pinv)


def test_small_motions_add_up_until_they_are_enough():
    """Each is below the least motion; the third is learned from with the change since the first, and begins anew."""
    pinv = 0.001 * np.ones((4, 2))
    observed, updated = (HadamardBroyden(pinv, COUPLING, min_motion=0.05) for _ in range(2))
    q, e = np.zeros(4), np.array([40.0, -20.0])
    step, change = np.full(4, 0.005), np.array([-3.0, 2.0])
    outcomes = [observed.observe(q + k * step, e + k * change) for k in range(5)]
    assert outcomes[0] is None
    assert [one.outcome.value for one in outcomes[1:3]] == ["too little motion"] * 2
    updated.update(3 * step, 3 * change)
    assert outcomes[3].outcome == "updated"
    np.testing.assert_allclose(outcomes[3].pinv, updated.pinv, rtol=1e-12)
    assert outcomes[4].outcome.value == "too little motion"


def test_an_update_of_which_any_element_overflows_is_not_taken():
    pinv = np.array([[1.7e308, 0.0], [0.0, 0.001]])
    learner = HadamardBroyden(pinv, alpha=1.0, min_cosine=0.0)
    step = learner.update(np.array([1e2, 1e-3]), np.array([-1e-307, 1.0]))
    assert step.outcome == "overflow"
    np.testing.assert_array_equal(learner.pinv, pinv)
