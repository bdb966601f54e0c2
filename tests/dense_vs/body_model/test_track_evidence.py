"""Evidence for the joints that move a track and J by them, against the density of its pixels as one normal vector."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from synthetic_body import SIZE, postures, serial_body

from dense_vs.body_model.track_jacobian import EXPECTED, LEAST_SEEN, joint_set_evidence, track_jacobians

NOISE = 0.7


def columns_of(joints, posture, chosen):
    """Columns of the quadratic model with some joints, and their prior variances."""
    step = (joints - posture)[:, chosen]
    pairs = [(i, j) for i in range(step.shape[1]) for j in range(i, step.shape[1])]
    quadratic = [step[:, i] * step[:, j] * (0.5 if i == j else 1.0) for i, j in pairs]
    design = np.column_stack([np.ones(len(step)), step, *quadratic])
    return design, np.array([1e6] + [(EXPECTED * SIZE[1]) ** 2] * (design.shape[1] - 1))


@pytest.mark.parametrize("seed", [2, 3])
def test_evidence_and_posterior_are_those_of_the_normal_density(seed):
    body = serial_body(3, seed=seed)
    joints = postures(3, 30)
    tracks = body.tracks(joints, noise=0.5, seed=seed)
    posture = joints.mean(axis=0)
    measured = track_jacobians(tracks, posture, NOISE)
    sets = np.array([[False] * 3, [True, False, False], [True, True, False], [True] * 3, [False, True, True]])
    evidence = joint_set_evidence(tracks, measured, sets, NOISE)
    for m in range(0, len(body.links), 13):
        seen = tracks.seen[:, m]
        target = tracks.pixels[seen, m]
        density = []
        for chosen in sets:
            design, prior = columns_of(joints[seen], posture, chosen)
            covariance = design * prior @ design.T + NOISE**2 * np.eye(len(target))
            density.append(sum(multivariate_normal.logpdf(target[:, i], None, covariance) for i in range(2)))
        np.testing.assert_allclose(evidence[m] - evidence[m, 0], np.array(density) - density[0], rtol=1e-6, atol=1e-4)
        if not measured.usable[m]:
            continue
        design, prior = columns_of(joints[seen], posture, measured.moved_by[m])
        covariance = np.linalg.inv(design.T @ design / NOISE**2 + np.diag(1 / prior))
        mean = covariance @ design.T @ target / NOISE**2
        count = int(measured.moved_by[m].sum())
        np.testing.assert_allclose(measured.places[m], mean[0], atol=1e-6)
        np.testing.assert_allclose(measured.jacobians[m][:, measured.moved_by[m]], mean[1 : 1 + count].T, atol=1e-5)
        assert not measured.jacobians[m][:, ~measured.moved_by[m]].any()
        assert measured.noise[m] == pytest.approx(np.sqrt(np.mean((target - design @ mean) ** 2)))
    assert measured.usable.any()


def test_the_set_of_joints_is_one_that_no_joint_less_explains_better():
    body = serial_body(3, seed=5)
    tracks = body.tracks(postures(3, 40), noise=0.5, seed=5)
    measured = track_jacobians(tracks, tracks.joints.mean(axis=0), NOISE)
    for m in np.flatnonzero(measured.usable)[::11]:
        chosen = measured.moved_by[m]
        fewer = [np.where(np.arange(3) == n, False, chosen) for n in np.flatnonzero(chosen)]
        evidence = joint_set_evidence(tracks, measured, np.array([chosen, *fewer]), NOISE)[m]
        assert evidence[0] > evidence[1:].max(initial=-np.inf)


def test_a_track_that_was_seen_too_little_says_nothing():
    body = serial_body(2, seed=2)
    tracks = body.tracks(postures(2, 40), seed=2)
    pixels = tracks.pixels.copy()
    pixels[:, 0] = np.nan
    pixels[LEAST_SEEN - 1 :, 1] = np.nan
    fewer = type(tracks)(**{**vars(tracks), "pixels": pixels})
    measured = track_jacobians(fewer, tracks.joints.mean(axis=0), NOISE)
    assert not measured.usable[:2].any()
    assert np.isnan(measured.places[:2]).all()
    assert np.isinf(measured.noise[:2]).all()
    assert not measured.moved_by[:2].any()
    assert joint_set_evidence(fewer, measured, np.ones((1, 2), bool), NOISE)[0, 0] == 0.0
