"""The steps of the fit on cases made by hand: held-out errors, axes from an exact J, shares of tracks, weights."""

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, SIZE, postures, serial_body

from dense_vs.body_model import adjustment
from dense_vs.body_model import fit as fit_module
from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.axes_from_jacobian import AxesProblem, AxesState, with_median_one
from dense_vs.body_model.chain import Chain, ancestors
from dense_vs.body_model.fit import (
    BodyFitOptions,
    _share,
    _travel,
    _Turns,
    assign_links,
    in_units,
)
from dense_vs.body_model.held_out import ExplainedFlow, first_part, held_out_error
from dense_vs.body_model.start import reflected
from dense_vs.body_model.track_jacobian import track_jacobians
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks
from dense_vs.errors import DenseVSError


def chain_of(body, home=None):
    return Chain(body.axes, body.anchors, np.zeros(len(body.axes)) if home is None else home, body.parents)


def state_of(body, focal=FOCAL):
    return BodyState(chain_of(body), body.points.copy(), focal)


def test_explained_flow_is_of_what_moves_by_more_than_seven_tenths_of_a_pixel():
    flow = np.zeros((2, 3, 2))
    flow[0] = [[0.71, 0.0], [0.0, 0.69], [3.0, 4.0]]
    flow[1, 0], flow[1, 1] = [np.nan, 1.0], [np.inf, 0.0]
    predicted = np.zeros((2, 3, 2))
    predicted[0, 2] = [3.0, 1.0]
    explained = ExplainedFlow()
    assert np.isnan(explained.share)
    explained.add(flow, predicted)
    assert explained.moved == pytest.approx(25 + 0.71**2)
    assert explained.left == pytest.approx(9 + 0.71**2)
    assert explained.share == pytest.approx(16 / (25 + 0.71**2))
    explained.add(flow, flow)
    assert explained.share == pytest.approx(1 - (9 + 0.71**2) / (2 * (25 + 0.71**2)))


@pytest.fixture(scope="module")
def recorded():
    body = serial_body(3, seed=0)
    return body, body.tracks(postures(3, count=40))


@pytest.mark.parametrize(("share", "count"), [(0.2, 32), (0.5, 20), (0.01, 40)])
def test_the_first_part_leaves_out_the_last_share(recorded, share, count):
    _, tracks = recorded
    part = first_part(tracks, share)
    assert len(part.joints) == len(part.pixels) == count
    np.testing.assert_array_equal(part.joints, tracks.joints[:count])
    for wrong in (0.0, 1.0, -0.1):
        with pytest.raises(DenseVSError, match="share is"):
            first_part(tracks, wrong)


def test_the_held_out_error_is_that_of_the_last_images(recorded):
    """An exact model predicts exact tracks; those of the last part that are off by (3, 4) px count with 5 px."""
    body, tracks = recorded
    links = body.links.copy()
    links[:2] = -2  # what was not believed does not count
    found = SimpleNamespace(all_links=links, state=state_of(body), center=CENTER)
    exact = held_out_error(tracks, 0.2, found=found)
    assert exact.median < 1e-3
    assert exact.observations == np.isfinite(tracks.pixels[32:, 2:, 0]).sum()
    pixels = tracks.pixels.copy()
    pixels[32:] += [3.0, 4.0]
    off = held_out_error(PointTracks(tracks.joints, pixels, tracks.references, SIZE), 0.2, found=found)
    assert (off.median, off.p90) == pytest.approx((5.0, 5.0), abs=1e-3)
    last = 31 - np.argmax(np.isfinite(tracks.pixels[31::-1, 2:, 0]), axis=0)
    stood = tracks.pixels[last, np.arange(2, len(links))] - tracks.pixels[32:, 2:]
    assert exact.standing_still == pytest.approx(np.nanmedian(np.linalg.norm(stood, axis=2)))
    some = tracks.pixels.copy()
    some[32:, ::4] += [30.0, 40.0]
    quarter = held_out_error(PointTracks(tracks.joints, some, tracks.references, SIZE), 0.2, found=found)
    assert quarter.median < 1e-3
    assert quarter.p90 == pytest.approx(50.0, abs=0.1)
    some[32:] = np.nan
    with pytest.raises(DenseVSError, match="no point of the body is seen in both parts"):
        held_out_error(PointTracks(tracks.joints, some, tracks.references, SIZE), 0.2, found=found)


@pytest.fixture(scope="module")
def exact_axes():
    """The problem of an exact J at zero, in the unit of length in which the median depth is 1."""
    body = serial_body(3, seed=2)
    J = body.jacobians(np.zeros(3)) / FOCAL
    normal = body.points[:, :2] / body.points[:, 2:]
    moved = ancestors(body.parents)[body.links]
    weights = np.random.default_rng(0).uniform(0.5, 2.0, moved.shape)
    scale = 1 / np.median(1 / body.points[:, 2])
    chain = Chain(body.axes, body.anchors / scale, np.zeros(3), body.parents)
    return AxesProblem(normal, J, moved, weights), AxesState(chain, scale / body.points[:, 2]), moved, weights


def test_the_true_lines_and_depths_explain_j(exact_axes):
    problem, state, _, _ = exact_axes
    np.testing.assert_allclose(problem.residuals(state), 0.0, atol=1e-6)
    pulled = problem.pull * np.sum((state.inverse_depths - 1) ** 2)
    assert problem.cost(state) == pytest.approx(pulled, rel=1e-4)
    assert 0 < problem.pull < 1e-2
    far = AxesState(state.chain, np.full_like(state.inverse_depths, 0.19))
    assert problem.cost(far) == problem.cost(AxesState(state.chain, far.inverse_depths * 0 + 5.1)) == np.inf
    for inside in (0.21, 4.9):
        assert np.isfinite(problem.cost(AxesState(state.chain, np.full_like(state.inverse_depths, inside))))


def test_weights_count_and_columns_of_other_joints_do_not(exact_axes):
    problem, state, moved, weights = exact_axes
    other = AxesState(state.chain, np.ones_like(state.inverse_depths))
    residual = problem.residuals(other)
    assert (residual[~moved.astype(bool)[:, None, :].repeat(2, axis=1)] == 0).all()
    plain = AxesProblem(np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros((0, 3), bool), np.zeros((0, 3)))
    assert plain.target.size == 0
    unweighted = AxesProblem(problem.shift[:, :, 2] * -1.0, problem.target, moved, np.ones_like(weights)).residuals(
        other
    )
    np.testing.assert_allclose(residual, unweighted * np.sqrt(weights)[:, None, :], atol=1e-12)
    assert problem.pull == pytest.approx(1e-3 * np.where(moved, weights, 0).mean() * (problem.target**2).mean())


def test_the_normal_equations_of_lines_are_the_gradient_of_their_cost(exact_axes):
    problem, state, _, _ = exact_axes
    rng = np.random.default_rng(1)
    begun = problem.move(state, 0.05 * rng.normal(size=12), 0.1 * rng.normal(size=(len(state.inverse_depths), 1)))
    equations = problem.linearize(begun)
    assert equations.cost == pytest.approx(problem.cost(begun))
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-6
        slope = (problem.cost(problem.move(begun, step)) - problem.cost(problem.move(begun, -step))) / 2e-6
        assert 2 * equations.shared_gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-7)
    for m in (0, 17, 60):
        step = np.zeros((len(begun.inverse_depths), 1))
        step[m] = 1e-6
        up, down = (problem.cost(problem.move(begun, np.zeros(12), sign * step)) for sign in (1, -1))
        assert 2 * equations.local_gradient[m, 0] == pytest.approx((up - down) / 2e-6, rel=1e-4, abs=1e-9)


def test_moments_are_those_of_the_lines_where_all_depths_are_one():
    """A flat body at depth 1: the point of each line follows from its direction alone, up to a shift along it."""
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (40, 2)), np.ones(40)])
    axes = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
    anchors = np.array([[0.1, -0.2, 1.3], [0.0, 0.3, 0.9]])
    velocity = np.cross(axes[None], points[:, None] - anchors[None])
    J = np.stack([velocity[..., 0] - points[:, None, 0] * velocity[..., 2],
                  velocity[..., 1] - points[:, None, 1] * velocity[..., 2]], axis=1)  # fmt: skip
    problem = AxesProblem(points[:, :2], J, np.ones((40, 2), bool), np.ones((40, 2)))
    found = problem.chain_for(axes, np.zeros(2), np.array([-1, 0])).points
    np.testing.assert_allclose(np.cross(found, axes), np.cross(anchors, axes), atol=1e-9)
    np.testing.assert_allclose(np.sum(found * axes, axis=1), 0.0, atol=1e-9)
    state = AxesState(Chain(axes, found, np.zeros(2), np.array([-1, 0])), np.ones(40))
    np.testing.assert_allclose(problem.residuals(state), 0.0, atol=1e-9)


def test_another_unit_of_length_changes_nothing_that_is_seen(exact_axes):
    problem, state, _, _ = exact_axes
    double = AxesState(state.chain.scaled(2.0), state.inverse_depths / 2)
    np.testing.assert_allclose(problem.residuals(double), problem.residuals(state), atol=1e-9)
    one = with_median_one(double)
    assert np.median(one.inverse_depths) == pytest.approx(1.0)
    np.testing.assert_allclose(problem.residuals(one), problem.residuals(state), atol=1e-9)


def test_a_reflected_body_looks_nearly_alike_and_twice_reflected_is_the_same(exact_axes):
    _, state, _, _ = exact_axes
    near = AxesState(state.chain, np.clip(state.inverse_depths, 0.7, 1.5))
    other = reflected(near)
    np.testing.assert_allclose(1 / other.inverse_depths, 2 - 1 / near.inverse_depths)
    np.testing.assert_allclose(other.chain.axes, -near.chain.axes * [1, 1, -1])
    np.testing.assert_allclose(other.chain.points, near.chain.points * [1, 1, -1] + [0, 0, 2])
    back = reflected(other)
    np.testing.assert_allclose(back.chain.axes, near.chain.axes)
    np.testing.assert_allclose(back.inverse_depths, near.inverse_depths)
    behind = reflected(AxesState(state.chain, np.full(3, 0.5)))  # 2 - 2 would be at the camera
    np.testing.assert_allclose(1 / behind.inverse_depths, 0.4)


def test_tracks_travel_as_far_as_they_get_from_their_mean_place():
    pixels = np.full((4, 3, 2), np.nan)
    pixels[:, 0] = [[0, 0], [6, 8], [0, 0], [0, 0]]
    pixels[1:3, 1] = [[5, 5], [5, 5]]
    assert _travel(pixels).tolist() == pytest.approx([np.hypot(4.5, 6.0), 0.0, 0.0])


def test_a_share_of_the_tracks_is_the_longest_of_every_reference_image():
    seen = np.ones((10, 6), bool)
    for m, count in enumerate((10, 4, 8, 3, 9, 2)):
        seen[count:, m] = False
    pixels = np.where(seen[..., None], np.arange(6.0)[None, :, None].repeat(2, axis=2), np.nan)
    tracks = PointTracks(np.arange(10.0)[:, None], pixels, np.array([0, 0, 0, 0, 5, 5]), SIZE)
    some = _share(tracks, BodyFitOptions(most_tracks=3, most_images=4))
    assert np.nanmax(some.pixels[0], axis=1).tolist() == [0.0, 2.0, 4.0]
    assert some.joints[:, 0].tolist() == [0, 3, 6, 9]
    whole = _share(tracks, BodyFitOptions(most_tracks=6, most_images=10))
    assert whole.pixels.shape == tracks.pixels.shape


@pytest.mark.parametrize(("noise", "gross"), [(0.5, 0.0), (0.5, 0.1)])
def test_the_adjusted_state_has_the_errors_that_are_told(recorded, noise, gross):
    body, _ = recorded
    tracks = body.tracks(postures(3, count=20), noise=noise, outliers=gross)
    state, robust, error = adjust(
        state_of(body), tracks.joints, tracks.pixels, body.links, CENTER, (FOCAL, 1e-3), noise, 2, 4
    )
    rotation, translation = state.chain.link_poses(tracks.joints)
    p = np.einsum("tmij,mj->tmi", rotation[:, body.links], state.points) + translation[:, body.links]
    off = np.linalg.norm(state.focal * p[..., :2] / p[..., 2:] + CENTER - tracks.pixels, axis=2)
    off = off[np.isfinite(off)]
    assert error == pytest.approx(np.median(off), rel=1e-6)
    squared = off**2
    assert robust == pytest.approx(np.mean(squared / (squared + (adjustment._GROSS * noise) ** 2)), rel=1e-6)
    assert error < 1.5 * noise
    assert state.focal == pytest.approx(FOCAL, rel=0.01)


def test_a_track_is_on_the_link_that_explains_it_best(recorded):
    body, tracks = recorded
    links, points, costs = assign_links(state_of(body), CENTER, tracks, body.points, np.ones(3, bool), 0.5)
    assert np.mean(links == body.links) > 0.97
    right = links == body.links
    np.testing.assert_allclose(points[right], body.points[right], atol=1e-3)
    assert costs.max() < 1e-3
    without, _, more = assign_links(state_of(body), CENTER, tracks, body.points, np.array([True, True, False]), 0.5)
    assert set(without) <= {0, 1, -1}
    assert more[body.links == 2].mean() > 0.1


def test_the_unit_is_that_of_the_median_distance(recorded):
    body, _ = recorded
    state = in_units(state_of(body))
    assert np.median(state.points[:, 2]) == pytest.approx(1.0)
    scale = 1 / np.median(body.points[:, 2])
    np.testing.assert_allclose(state.points, body.points * scale)
    np.testing.assert_allclose(
        np.cross(state.chain.points, state.chain.axes), scale * np.cross(body.anchors, body.axes), atol=1e-12
    )


def test_a_track_s_j_and_the_joints_that_move_it_follow_from_its_own_pixels(recorded):
    body, _ = recorded
    way = postures(3, count=60, reach=0.15)
    tracks = body.tracks(way, noise=0.2)
    home = np.median(way, axis=0)
    measured = track_jacobians(tracks, home, 0.2)
    true = body.jacobians(home)
    assert measured.usable.mean() > 0.95
    moved = ancestors(body.parents)[body.links].astype(bool)
    assert np.mean(measured.moved_by == moved) > 0.93
    error = np.linalg.norm(measured.jacobians - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    assert np.median(error) < 0.05
    np.testing.assert_allclose(np.median(measured.places - body.pixels(home), axis=0), 0.0, atol=0.1)
    # Errors are as large as the covariance says.
    variance = np.einsum("mnn->mn", measured.covariances)
    right = (measured.moved_by == moved).all(axis=1) & measured.usable
    ratio = (measured.jacobians - true)[right] / np.sqrt(np.maximum(variance[right], 1e-9))[:, None, :]
    assert 0.5 < np.median(np.abs(ratio[np.repeat(moved[right][:, None], 2, axis=1)])) / 0.6745 < 2.0
    assert np.median(measured.noise[right]) == pytest.approx(0.2, rel=0.25)
    few = tracks.pixels.copy()
    few[7:, 0], few[8:, 1] = np.nan, np.nan
    few[:7, 0] = few[:8, 1] = 5.0
    hidden = track_jacobians(PointTracks(way, few, tracks.references, SIZE), home, 0.2)
    assert not hidden.usable[0]
    assert np.isnan(hidden.places[0]).all()
    assert hidden.usable[1]
    assert not hidden.moved_by[1].any()


@pytest.mark.parametrize(
    ("parents", "told", "factor"),
    [
        ([-1, 0, 1], None, 1.0),
        ([-1, 0, 0], None, 1.1),  # one joint is not carried by the one before it
        ([1, 2, -1], None, 1.1),
        ([-1, 0, 0], [-1, 0, 0], 1.0),  # as it was told
    ],
)
def test_another_order_of_the_joints_has_to_explain_more(parents, told, factor):
    fit = SimpleNamespace(options=SimpleNamespace(parents=told), learned=np.ones(3, bool))
    turn = SimpleNamespace(cost=0.5, state=SimpleNamespace(chain=SimpleNamespace(parents=np.array(parents))))
    assert _Turns._doubt(fit, turn, None) == pytest.approx(0.5 * factor)


def test_what_a_filter_s_j_says_otherwise_is_doubted():
    """A quarter of its points as one part of the doubt, at the depth of the middle point."""
    asked = []

    def disagreement(chain, focal, center, learned, depth):
        asked.append((focal, center, depth))
        return 2.0

    fit = SimpleNamespace(options=SimpleNamespace(parents=None), learned=np.ones(2, bool), center="center")
    chain = SimpleNamespace(parents=np.array([-1, 0]))
    turn = SimpleNamespace(
        cost=0.5,
        state=SimpleNamespace(chain=chain, focal=300.0),
        points=np.array([[0, 0, 1.0], [9, 9, 4.0], [0, 0, 3.0]]),
    )
    share = fit_module._DENSE_SHARE
    assert _Turns._doubt(fit, turn, SimpleNamespace(disagreement=disagreement)) == pytest.approx(0.5 + share * 2.0)
    assert asked == [(300.0, "center", 3.0)]
    turn.points = -turn.points  # behind the camera
    _Turns._doubt(fit, turn, SimpleNamespace(disagreement=disagreement))
    assert asked[-1][2] == 1e-6


def test_joints_that_move_nothing_are_not_learned_and_none_at_all_is_an_error():
    moved_by = np.zeros((30, 3), bool)
    moved_by[:, 0] = moved_by[:15, 1] = True
    followed = SimpleNamespace(joints=np.zeros((40, 3)), seen=np.ones((40, 30), bool))
    told = SimpleNamespace(moved_by=moved_by, usable=np.ones(30, bool))
    parents, learned = fit_module._parents(told, followed, BodyFitOptions())
    np.testing.assert_array_equal(learned, [True, True, False])
    assert parents[0] == -1
    assert parents[1] == 0
    told.moved_by = np.zeros((30, 3), bool)
    with pytest.raises(DenseVSError, match="no joint moves any track"):
        fit_module._parents(told, followed, BodyFitOptions())
