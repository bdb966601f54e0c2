"""Where a fit starts: the plainest tracks of every link, a filter's J, and the order in which joints are given."""

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, postures, serial_body

from dense_vs.body_model.axes_from_jacobian import AxesState
from dense_vs.body_model.chain import Chain, ancestors
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.start import CORE, core, dense_core, distinct, find_starts, in_order
from dense_vs.body_model.track_jacobian import joint_set_evidence, track_jacobians
from dense_vs.errors import DenseVSError


@pytest.fixture(scope="module")
def measured():
    body = serial_body(3, seed=0)
    way = postures(3, count=40, reach=0.2)
    tracks = body.tracks(way, noise=0.2)
    return body, tracks, track_jacobians(tracks, np.median(way, axis=0), 0.5)


def dense_of(body, posture):
    return DenseMotion(posture, body.pixels(posture), body.jacobians(posture))


def test_joints_that_are_learned_carry_each_other_in_the_order_given():
    assert in_order(np.array([True, True, True])).tolist() == [-1, 0, 1]
    assert in_order(np.array([False, True, False, True])).tolist() == [-1, -1, -1, 1]
    assert in_order(np.array([False, False])).tolist() == [-1, -1]


def test_evidence_is_for_the_joints_that_move_a_track(measured):
    body, tracks, found = measured
    sets = ancestors(body.parents)
    evidence = joint_set_evidence(tracks, found, sets, 0.5)
    assert evidence.shape == (tracks.pixels.shape[1], 4)
    assert np.mean(evidence.argmax(axis=1) == body.links) > 0.9
    # Of a track that was never seen nothing says anything.
    hidden = tracks.pixels.copy()
    hidden[:, 0] = np.nan
    none = joint_set_evidence(type(tracks)(tracks.joints, hidden, tracks.references, tracks.size), found, sets, 0.5)
    assert none[0].tolist() == [0.0] * 4
    np.testing.assert_allclose(none[1:], evidence[1:])


def test_the_core_is_of_every_link_and_nearly_all_on_it(measured):
    body, tracks, found = measured
    chosen, links = core(tracks, found, body.parents, np.ones(3, bool), 0.5)
    assert (np.diff(chosen) > 0).all()
    assert np.bincount(links, minlength=3).max() <= CORE
    assert set(links.tolist()) == {0, 1, 2}
    assert np.mean(links == body.links[chosen]) > 0.95
    short = tracks.pixels.copy()
    short[9:] = np.nan
    few = type(tracks)(tracks.joints, short, tracks.references, tracks.size)
    with pytest.raises(DenseVSError, match="expected 12"):
        core(few, found, body.parents, np.ones(3, bool), 0.5)


def test_pixels_of_a_filter_s_j_are_on_the_link_whose_joints_move_them(measured):
    body, _, found = measured
    dense = dense_of(body, found.posture)
    part, links = dense_core(dense, body.parents, np.ones(3, bool), 320, 0)
    at = {tuple(pixel): link for pixel, link in zip(dense.pixels.tolist(), body.links.tolist(), strict=True)}
    true = np.array([at[tuple(pixel)] for pixel in part.places.tolist()])
    assert np.mean(links == true) > 0.9
    assert part.usable.all()
    moved = np.linalg.norm(part.jacobians, axis=1) > 0.03 * 320
    np.testing.assert_array_equal(part.moved_by, moved)


def test_a_candidate_near_the_true_lines_is_among_those_of_tracks_and_of_a_filter(measured):
    body, tracks, found = measured
    dense = dense_of(body, found.posture)
    both = find_starts(
        tracks,
        found,
        [body.parents],
        np.zeros(3, bool),
        np.ones(3, bool),
        FOCAL,
        CENTER,
        noise=0.5,
        starts=16,
        seed=0,
        dense=dense,
    )
    true = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    lines = true.screws(found.posture)[0]

    def nearest(some):
        return max(np.abs(np.sum(one.state.chain.axes * lines, axis=1)).min() for one in some)

    by_tracks = [one for one in both if len(one.chosen)]
    by_filter = [one for one in both if not len(one.chosen)]
    assert len(by_tracks) >= 2
    assert len(by_filter) >= 2
    assert nearest(by_tracks) > 0.98
    assert nearest(by_filter) > 0.98
    for one in by_tracks:
        assert one.state.points.shape == (len(one.chosen), 3)


def test_candidates_with_nearly_the_same_lines_count_once():
    axes = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    turned = np.array([[1.0, 0, 0], [0, np.cos(0.1), np.sin(0.1)]])
    other = np.array([[0, 0, 1.0], [0, 1.0, 0]])
    states = [
        AxesState(Chain(a, np.ones((2, 3)), np.zeros(2), np.array([-1, 0])), np.full(3, 2.0))
        for a in (axes, turned, other, -axes)
    ]
    kept = distinct(states, 5)
    assert [one.chain.axes.tolist() for one in kept] == [axes.tolist(), other.tolist()]
    np.testing.assert_allclose(kept[0].inverse_depths, 1.0)
    assert len(distinct(states, 1)) == 1


def test_a_filter_s_j_agrees_with_its_own_body_and_not_with_another(measured):
    body, _, found = measured
    dense = dense_of(body, found.posture)
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    learned, depth = np.ones(3, bool), float(np.median(body.points[:, 2]))
    assert dense.disagreement(chain, FOCAL, CENTER, learned, depth) < 1e-4
    turned = Chain(body.axes[:, [1, 2, 0]], body.anchors, np.zeros(3), body.parents)
    assert dense.disagreement(turned, FOCAL, CENTER, learned, depth) > 0.2
    # What a chain says nothing of counts by what half of it is.
    still = Chain(body.axes * 0, body.anchors * 0, np.zeros(3), body.parents)
    assert dense.disagreement(still, FOCAL, CENTER, learned, depth) == pytest.approx(1 / (1 + 0.09), abs=1e-6)


def test_j_of_an_image_is_taken_where_the_body_is_and_j_is_finite():
    jacobian = np.arange(4 * 5 * 2 * 3, dtype=np.float32).reshape(4, 5, 2, 3)
    body = np.zeros((4, 5), bool)
    body[1, 2] = body[3, 4] = body[0, 0] = True
    jacobian[0, 0, 1, 2] = np.nan
    dense = DenseMotion.of_image(jacobian, np.zeros(3), body)
    assert dense.pixels.tolist() == [[2.0, 1.0], [4.0, 3.0]]
    np.testing.assert_array_equal(dense.jacobians, jacobian[[1, 3], [2, 4]])
    for wrong in (jacobian[:3], jacobian[..., 0], jacobian[..., :2]):
        with pytest.raises(DenseVSError, match="jacobian has shape"):
            DenseMotion.of_image(wrong, np.zeros(3), body)
    with pytest.raises(DenseVSError, match="bool"):
        DenseMotion.of_image(jacobian, np.zeros(3), body.astype(int))
