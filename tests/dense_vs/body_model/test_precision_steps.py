"""What is known of a body's errors, step by step: dense algebra, places by derivatives, usual errors."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, SIZE, postures, serial_body

from dense_vs.body_model import precision as module
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.precision import Precision, covariances
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks

JOINTS = postures(2, 12)


@pytest.fixture(scope="module")
def fitted():
    """A body of two joints at its truth, with noisy tracks that began in five images."""
    body = serial_body(2, per_link=6, seed=3)
    tracks = body.tracks(JOINTS, noise=0.8, seed=1)
    tracks = PointTracks(tracks.joints, tracks.pixels, np.repeat([0, 3, 7, 9], 3), SIZE)
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    return body, BodyFit(
        BodyState(chain, body.points, FOCAL), body.links, tracks, CENTER, np.ones(2, bool), 1.0, body.links
    )


def errors(found, step, points):
    """Model less measurement of everything seen, by the body's turns one after the other."""
    state = found.state
    chain = state.chain.moved(step[:8].reshape(2, 4))
    focal = state.focal * np.exp(step[8])
    rotation, translation = chain.link_poses(found.tracks.joints)
    here = np.einsum("tmij,mj->tmi", rotation[:, found.links], points) + translation[:, found.links]
    return focal * here[..., :2] / here[..., 2:] + found.center - found.tracks.pixels


def test_the_covariance_is_that_of_dense_algebra(fitted):
    """Weights of the fit, points eliminated, and the scatter of tracks that began in one image."""
    _, found = fitted
    count, size = len(found.links), 9
    here = errors(found, np.zeros(9), found.state.points)
    seen = np.isfinite(here[..., 0])
    scale = max(0.5, 1.0 / 1.1774)
    squared = np.where(seen, np.sum(np.nan_to_num(here) ** 2, axis=2), 0.0)
    weight = np.where(seen, 1 / (1 + squared / (3 * scale) ** 2) ** 2, 0.0)
    root = np.repeat(np.sqrt(weight)[..., None], 2, axis=2)

    def rows(step, points):
        return np.nan_to_num(errors(found, step, points)) * root

    A = np.stack([(rows(d, found.state.points) - rows(-d, found.state.points)) / 2e-6 for d in 1e-6 * np.eye(9)], -1)
    B = np.stack([(rows(np.zeros(9), found.state.points + d) - rows(np.zeros(9), found.state.points - d)) / 2e-6
                  for d in 1e-6 * np.eye(3)], -1)  # fmt: skip
    r = rows(np.zeros(9), found.state.points)
    reduced, gradients = np.zeros((size, size)), {}
    responses = np.zeros((count, 3, size))
    for m in range(count):
        a, b, e = A[:, m].reshape(-1, size), B[:, m].reshape(-1, 3), r[:, m].ravel()
        responses[m] = -np.linalg.solve(b.T @ b, b.T @ a)
        reduced += a.T @ a + a.T @ b @ responses[m]
        reference = int(found.tracks.references[m])
        gradients[reference] = gradients.get(reference, 0.0) + a.T @ e + responses[m].T @ (b.T @ e)
    reduced[8, 8] += (0.5 / 0.15) ** 2
    groups = list(gradients.values())
    scatter = sum(np.outer(g, g) for g in groups) * len(groups) / (len(groups) - 1)
    inverse = np.linalg.pinv(reduced, rcond=1e-9, hermitian=True)
    expected = inverse @ scatter @ inverse
    lines, told = module._adjusted(found)
    np.testing.assert_allclose(told, responses, rtol=1e-3, atol=1e-4)
    # The unit of length is open: what is told moves pixels, so it is compared by the pixels that it moves.
    shown = (A + np.einsum("tmip,mps->tmis", B, responses))[seen].reshape(-1, size)
    np.testing.assert_allclose(shown @ lines.T @ lines @ shown.T, shown @ expected @ shown.T,
                               atol=5e-3 * np.abs(shown @ expected @ shown.T).max())  # fmt: skip


def test_tracks_of_one_image_are_taken_some_at_a_time():
    references = np.array([5] * 20 + [2] * 3 + [5] * 4 + [9] * 12)
    groups = module._groups(references)
    assert sorted(np.concatenate(groups).tolist()) == list(range(39))
    assert all(len(set(references[group])) == 1 for group in groups)
    # 3 are one, 24 are three, 12 are two (half of one and a half, to the even).
    assert [len(group) for group in groups] == [3, 8, 8, 8, 6, 6]


def test_an_inverse_leaves_out_what_moves_nothing_whatever_the_units():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(9, 4)) @ np.diag([1.0, 1e4, 1e-4, 1.0])
    rows = np.hstack([rows, np.zeros((9, 1))])
    matrix = rows.T @ rows
    found = module._inverse(matrix)
    np.testing.assert_allclose(found[:4, :4] @ matrix[:4, :4], np.eye(4), atol=1e-6)
    assert (found[4] == 0).all()
    assert (found[:, 4] == 0).all()
    both = np.hstack([rows[:, :2], rows[:, :1]])  # the first and the last move the same
    matrix = both.T @ both
    found = module._inverse(matrix)
    np.testing.assert_allclose(matrix @ found @ matrix, matrix, rtol=1e-6)


@pytest.mark.parametrize(
    ("off", "expected"),
    [([], 0.2), ([0.01] * 5, 0.014826), ([0.001] * 5, 0.003), ([0.5] * 5, 0.2), ([0.01, 0.01, 0.01, 9.0], 0.014826)],
)
def test_a_deviation_from_absolute_values_has_bounds(off, expected):
    assert module._deviation(np.array(off)) == pytest.approx(expected)
    rng = np.random.default_rng(1)
    assert module._deviation(np.abs(rng.normal(0, 0.05, 4001))) == pytest.approx(0.05, rel=0.05)


def known(body, keyframes, depth_steps, lines, depths, place):
    return Precision(lines, depth_steps, depths, JOINTS[[2, 8]], keyframes, place)


def test_places_move_with_lines_focal_length_and_depths(fitted):
    """A point keeps its pixel in its keyframe; there its depth follows as told. Steps of a hundredth of a deviation."""
    body, found = fitted
    rng = np.random.default_rng(2)
    chain, count = found.state.chain, len(body.links)
    keyframes = rng.integers(0, 2, count)
    lines = rng.normal(0, 0.01, (3, 9))
    steps = rng.normal(0, 0.02, (count, 3))
    depths = rng.uniform(0.01, 0.05, count)
    q = np.array([0.25, -0.2])
    covariance = covariances(
        chain, FOCAL, body.points, body.links, known(body, keyframes, steps, lines, depths, 0.4), q
    )
    seen_at = np.stack([body.pixels(posture) for posture in JOINTS[[2, 8]]])[keyframes, np.arange(count)]
    depth_then = np.stack([body.place(posture)[:, 2] for posture in JOINTS[[2, 8]]])[keyframes, np.arange(count)]

    def places(chain, focal, log_depths):
        depth = depth_then * np.exp(log_depths)
        rays = np.column_stack([(seen_at - CENTER) / focal, np.ones(count)])
        result = np.empty((count, 2))
        for m, link in enumerate(body.links):
            R, t = chain.link_poses(np.stack([JOINTS[[2, 8]][keyframes[m]], q]))
            home = R[0, link].T @ (rays[m] * depth[m] - t[0, link])
            here = R[1, link] @ home + t[1, link]
            result[m] = focal * here[:2] / here[2]
        return result

    for m in range(count):
        total = 0.16 * np.eye(2)
        columns = []
        for r in range(3):
            moved = [chain.moved(s * 1e-5 * lines[r, :8].reshape(2, 4)) for s in (1, -1)]
            focals = [FOCAL * np.exp(s * 1e-5 * lines[r, 8]) for s in (1, -1)]
            up, down = (places(c, f, s * 1e-5 * steps[:, r])[m] for c, f, s in zip(moved, focals, (1, -1), strict=True))
            columns.append((up - down) / 2e-5)
        one = np.full(count, 1e-5)
        columns.append((places(chain, FOCAL, one)[m] - places(chain, FOCAL, -one)[m]) / 2e-5 * depths[m])
        total = total + sum(np.outer(c, c) for c in columns)
        np.testing.assert_allclose(covariance[m], total, rtol=0.02, atol=0.02)
        if m == 4:
            break


def test_behind_the_camera_nothing_is_known(fitted):
    body, found = fitted
    points = body.points.copy()
    points[0] *= -1
    none = known(
        body, np.zeros(len(points), int), np.zeros((len(points), 0)), np.zeros((0, 9)), np.zeros(len(points)), 0.3
    )
    covariance = covariances(found.state.chain, FOCAL, points, body.links, none, np.zeros(2))
    assert np.isinf(covariance[0]).any()
    np.testing.assert_allclose(covariance[1:], np.tile(0.09 * np.eye(2), (len(points) - 1, 1, 1)), atol=1e-9)


def test_the_information_is_the_inverse_of_the_covariance_and_nothing_where_that_is_nothing():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(9, 9)))[0]
    sizes = np.array([0.3, 0.02, 1e-3, 1e-6])
    precision = Precision(
        turn[:4] * sizes[:, None], np.zeros((0, 4)), np.zeros(0), np.zeros((0, 2)), np.zeros(0, int), 0.3
    )
    expected = (turn[:4].T / np.maximum(sizes, 5e-4) ** 2) @ turn[:4]  # no root is known better than that
    np.testing.assert_allclose(precision.information, expected, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(precision.information @ turn[4:].T, 0, atol=1e-6)
    empty = replace(precision, lines=np.zeros((2, 9)))  # a root of no length says nothing
    np.testing.assert_array_equal(empty.information, 0)
