"""Simulated mask sequences: reproducible, as described, and in perspective."""

import numpy as np
import pytest

from dense_vs.depth import depth_from_masks
from dense_vs.sims.cli.depth_train import train
from dense_vs.sims.depth_training.mask_sequences import simulate_masks


@pytest.fixture(scope="module")
def sequences():
    return [simulate_masks(np.random.default_rng([5, index])) for index in range(40)]


def test_sequences_are_as_described(sequences):
    for sequence in sequences:
        views = len(sequence.camera_back)
        assert sequence.masks.shape == (views, 480, 640)
        assert sequence.masks.dtype == np.uint8
        assert set(np.unique(sequence.masks)) <= {0, 1}
        assert sequence.camera_back[0] == 0
        assert (np.diff(sequence.camera_back) >= 0).all()
        assert sequence.distance > 0
    assert any(not mask.any() for sequence in sequences for mask in sequence.masks)


def test_the_same_seed_gives_the_same_sequence(sequences):
    again = simulate_masks(np.random.default_rng([5, 0]))
    np.testing.assert_array_equal(again.masks, sequences[0].masks)
    assert again.distance == sequences[0].distance


def test_the_truth_is_the_one_of_the_masks(sequences):
    """Were the perspective or its truth off, no method could come near in half of the sequences."""
    errors = [
        abs(depth_from_masks(one.masks, one.camera_back).distance / one.distance - 1)
        for one in sequences[:25]
        if sum(mask.any() for mask in one.masks) > 2
    ]
    assert np.median(errors) < 0.1


def test_training_learns_what_can_be_learnt():
    """A ratio that two of the features tell, and noise."""
    rng = np.random.default_rng(0)
    features = rng.normal(size=(1500, 6))
    log_ratio = 0.2 * np.tanh(features[:, 0]) + 0.1 * features[:, 3] + rng.normal(0, 0.02, 1500)
    learned, figures = train(features, log_ratio, seed=0)
    robust, corrected = (float(value) for value in figures[0][1:])
    assert corrected < 0.5 * robust
    assert 0.9 < learned.factor < 1.1
