"""The learned depth: its network against scikit-learn's own, its file, and what it gains on simulated masks."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.depth.learned_depth import WEIGHTS, LearnedDepth, depth_features
from dense_vs.depth.mask_fit import gather_evidence
from dense_vs.depth.region_shape import mask_regions
from dense_vs.sims.depth_training.mask_sequences import simulate_masks


def test_inference_is_that_of_scikit_learn():
    sklearn = pytest.importorskip("sklearn.neural_network", reason="needs scikit-learn")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(200, 5))
    y = np.tanh(x[:, 0]) + 0.1 * x[:, 1]
    members = []
    for seed in range(2):
        network = sklearn.MLPRegressor(hidden_layer_sizes=(8, 4), early_stopping=True, random_state=seed, tol=1e-2)
        members.append(network.fit(x, y))
    layers = [list(zip(n.coefs_, n.intercepts_, strict=True)) for n in members]
    learned = LearnedDepth(np.zeros(5), np.ones(5), layers, 1.0)
    expected = np.mean([network.predict(x) for network in members], axis=0)
    np.testing.assert_allclose(learned.log_correction(x), expected, rtol=1e-10)


def test_the_weights_are_kept_whole(tmp_path):
    learned = LearnedDepth.shipped()
    learned.save(tmp_path / "weights.npz")
    read = LearnedDepth.load(tmp_path / "weights.npz")
    features = np.random.default_rng(0).normal(size=(7, len(learned.mean)))
    np.testing.assert_array_equal(read.log_correction(features), learned.log_correction(features))
    assert read.factor == learned.factor
    assert WEIGHTS.stat().st_size < 200_000


def test_another_file_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(DenseVSError, match="holds no weights of learned depth"):
        LearnedDepth.load(tmp_path / "other.npz")
    np.savez(tmp_path / "half.npz", format="dense-vs learned depth 1", layers=np.array([2]))
    with pytest.raises(DenseVSError, match="damaged"):
        LearnedDepth.load(tmp_path / "half.npz")


def test_on_new_simulated_sequences_it_is_no_worse_than_what_it_corrects():
    """Sequences of another seed than those of the training."""
    learned, robust, inside = [], [], []
    for index in range(30):
        sequence = simulate_masks(np.random.default_rng([77, index]))
        try:
            evidence = gather_evidence(mask_regions(sequence.masks), sequence.camera_back, sequence.masks.shape[1:])
        except DenseVSError:
            continue
        found = LearnedDepth.shipped()(evidence)
        learned.append(abs(found.distance / sequence.distance - 1))
        inside.append(found.interval[0] <= sequence.distance <= found.interval[1])
        posterior = evidence.posterior()
        before = evidence.result(posterior, "robust", posterior.least_relative_error())
        robust.append(abs(before.distance / sequence.distance - 1))
    assert len(learned) > 25
    assert np.median(robust) < 0.1
    assert np.mean(learned) < 1.05 * np.mean(robust)
    assert 0.5 < np.mean(inside) < 0.95


def test_features_do_not_depend_on_the_unit_of_length():
    sequence = simulate_masks(np.random.default_rng([77, 3]))
    regions, size = mask_regions(sequence.masks), sequence.masks.shape[1:]
    metres, _ = depth_features(gather_evidence(regions, sequence.camera_back, size))
    feet, _ = depth_features(gather_evidence(regions, 3.28 * sequence.camera_back, size))
    np.testing.assert_allclose(feet, metres, rtol=1e-6, atol=1e-6)
