"""Where an image tells a place and where it does not, by hand-made edges; fits to places that slide along edges."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, SIZE, serial_body
from synthetic_body import postures as way

from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.image_directions import LEAST, direction_weights
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.track_problem import BodyState, TrackProblem
from dense_vs.body_model.tracks import PointTracks, follow_points
from dense_vs.errors import DenseVSError


def edge_image(angle, size=61):
    """Gray ``(size, size)``: dark on one side of an edge through the middle whose normal has an angle to x [rad]."""
    y, x = np.mgrid[:size, :size] - size // 2
    across = x * np.cos(angle) + y * np.sin(angle)
    return (60 + 130 / (1 + np.exp(-across))).astype(np.uint8)


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, 2.4])
def test_an_edge_tells_nothing_along_itself(angle):
    weights = direction_weights(edge_image(angle), np.array([[30.0, 30.0]]))[0]
    across, along = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    np.testing.assert_allclose(weights @ across, across, atol=0.03)
    np.testing.assert_allclose(weights @ along, LEAST * along, atol=0.05)
    np.testing.assert_array_equal(weights, weights.T)


def test_a_corner_and_a_spot_tell_both():
    y, x = np.mgrid[:61, :61] - 30
    corner = np.where((x > 0) & (y > 0), 200, 50).astype(np.uint8)
    spot = (40 + 200 * np.exp(-(x**2 + y**2) / 18)).astype(np.uint8)
    for image in (corner, spot):
        values = np.linalg.eigvalsh(direction_weights(image, np.array([[30.0, 30.0]]))[0])
        assert values[0] > 0.7
        assert values[1] == pytest.approx(1)


def test_the_weight_is_the_root_of_the_ratio_of_how_the_image_changes():
    """Waves across and along: gradients of 3 to 1, so errors along count a third."""
    y, x = np.mgrid[:121, :121] * 1.0
    image = (128 + 60 * np.sin(2 * np.pi * x / 12) + 20 * np.sin(2 * np.pi * y / 12)).round().astype(np.uint8)
    weights = direction_weights(image, np.array([[60.0, 60.0], [50.0, 70.0]]))
    np.testing.assert_allclose(weights, np.tile(np.diag([1, 1 / 3]), (2, 1, 1)), atol=0.04)


def test_a_place_has_the_same_weights_alone_and_among_others():
    """Its patch alone counts, at the border too, where the image is mirrored."""
    image = np.random.default_rng(5).integers(0, 255, (90, 120)).astype(np.uint8)
    places = np.array([[3.0, 2.0], [60.2, 44.6], [118.0, 88.0], [20.0, 70.0]])
    together = direction_weights(image, places)
    for place, weights in zip(places, together, strict=True):
        np.testing.assert_allclose(direction_weights(image, place[None])[0], weights, atol=1e-4)


def test_places_outside_or_of_nothing_get_weights_all_the_same():
    image = edge_image(0.0)
    odd = np.array([[-50.0, 30.0], [300.0, 300.0], [np.nan, 2.0], [1.0, 30.0]])
    assert np.isfinite(direction_weights(image, odd)).all()
    plain = direction_weights(np.full((40, 40), 90, np.uint8), np.array([[20.0, 20.0]]))[0]
    np.testing.assert_allclose(plain, np.eye(2))  # no direction is better than another
    assert direction_weights(image, np.zeros((0, 2))).shape == (0, 2, 2)


def sliding(body, joints, rng, along=2.0, noise=0.1):
    """Tracks, each on an edge along which it slides, with what its errors are multiplied by."""
    pixels = np.stack([body.pixels(q) for q in joints])
    angles = rng.uniform(0, np.pi, pixels.shape[1])
    edge = np.column_stack([np.cos(angles), np.sin(angles)])
    shift = np.cumsum(rng.normal(0, along / 5, pixels.shape[:2]), axis=0)
    pixels = pixels + shift[..., None] * edge + rng.normal(0, noise, pixels.shape)
    across = np.column_stack([-edge[:, 1], edge[:, 0]])
    weights = np.einsum("mi,mj->mij", across, across) + LEAST * np.einsum("mi,mj->mij", edge, edge)
    return PointTracks(joints, pixels, np.zeros(len(angles), int), SIZE, np.tile(weights, (len(joints), 1, 1, 1)))


def test_lines_are_found_from_places_that_slide_along_edges():
    body, joints = serial_body(3, seed=4), way(3, 40)
    tracks = sliding(body, joints, np.random.default_rng(1))
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    off = {}
    for name, directions in (("directed", tracks.directions), ("plain", None)):
        state, _, error = adjust(
            BodyState(chain, body.points, FOCAL), joints, tracks.pixels, body.links, CENTER, (FOCAL, 0.0), 0.5, 2, 12,
            directions=directions,
        )  # fmt: skip
        turned = np.degrees(np.arccos(np.clip(np.sum(state.chain.axes * body.axes, axis=1), -1, 1)))
        off[name] = turned.max(), error
    assert off["directed"][0] < 0.5 * off["plain"][0]
    assert off["directed"][1] < 0.5 * off["plain"][1]


def test_the_normal_equations_with_directions_and_information_are_the_gradient_of_the_cost():
    body, joints = serial_body(3, seed=4), way(3, 12)
    tracks = sliding(body, joints, np.random.default_rng(3))
    random = np.random.default_rng(0)
    weights, root = random.random(tracks.pixels.shape[:2]), random.normal(size=(5, 13)) * 30
    problem = TrackProblem(
        joints, tracks.pixels, body.links, CENTER, weights, (280.0, 0.1), 0.5, 0.03, tracks.directions, root.T @ root
    )
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    moved = 0.01 * random.normal(size=13)
    state = BodyState(chain, body.points + 0.02, FOCAL, -0.06, moved)
    known = 0.5**2 * np.sum((root @ moved) ** 2)
    assert problem.cost(state) - problem.cost(replace(state, moved=0.0)) == pytest.approx(known)
    equations = problem.linearize(state)
    assert equations.cost == pytest.approx(problem.cost(state))
    none = np.zeros((len(body.links), 3))

    def slope(shared, points):
        ahead, back = problem.move(state, shared, points), problem.move(state, -shared, -points)
        return (problem.cost(ahead) - problem.cost(back)) / 4e-6

    for column in range(14):
        step = 1e-6 * np.eye(14)[column]
        assert slope(step, none) == pytest.approx(equations.shared_gradient[column], rel=1e-4, abs=1e-3)
    for point, axis in ((0, 0), (50, 2)):
        step = none.copy()
        step[point, axis] = 1e-6
        assert slope(np.zeros(14), step) == pytest.approx(equations.local_gradient[point, axis], rel=1e-4, abs=1e-3)
    ahead = problem.linearize(problem.move(state, 1e-5 * np.eye(14)[3], none))
    curvature = (ahead.shared_gradient[:13] - equations.shared_gradient[:13])[3] / 1e-5
    assert curvature == pytest.approx(equations.shared[3, 3], rel=0.1)


def test_what_was_known_before_holds_lines_that_few_tracks_leave_open():
    """Two points a link say little: lines that were known stay, however far several adjustments could take them."""
    body, joints = serial_body(3, per_link=2, seed=4), way(3, 12, reach=0.05)
    tracks = body.tracks(joints, noise=1.0)
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    turned = {}
    for name, information in (("known", np.eye(13) / 0.002**2), ("unknown", None)):
        state = BodyState(chain, body.points, FOCAL)
        for _ in range(4):
            state, _, _ = adjust(
                state, joints, tracks.pixels, body.links, CENTER, (state.focal, 0.02), 0.5, 1, 3,
                information=information,
            )  # fmt: skip
        turned[name] = np.arccos(np.clip(np.sum(state.chain.axes * body.axes, axis=1), -1, 1)).max()
        assert np.shape(state.moved) == (13,)
        assert state.focal == pytest.approx(FOCAL * np.exp(state.moved[12]))
    assert turned["known"] < 0.005
    assert turned["unknown"] > 5 * turned["known"]


def test_points_are_placed_across_their_edges():
    body, joints = serial_body(2, per_link=10, seed=2), way(2, count=40, reach=0.5)
    tracks = sliding(body, joints, np.random.default_rng(4))
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    arguments = chain, FOCAL, CENTER, joints, tracks.pixels, body.links, body.points * 1.1, 0.5
    directed, plain = place_points(*arguments, tracks.directions), place_points(*arguments)
    assert directed.cost.max() < 0.2
    assert np.median(directed.cost) < 0.3 * np.median(plain.cost)
    whole = np.tile(np.eye(2), (*tracks.pixels.shape[:2], 1, 1))
    np.testing.assert_allclose(place_points(*arguments, whole).points, plain.points, atol=1e-9)


def test_followed_points_come_with_their_directions(scene, postures):
    tracks = follow_points([scene.image(q) for q in postures], postures)
    values = np.linalg.eigvalsh(tracks.directions[tracks.seen])
    np.testing.assert_allclose(values[:, 1], 1)
    assert (values[:, 0] >= LEAST - 1e-9).all()
    np.testing.assert_array_equal(tracks.directions[~tracks.seen], 0)
    some = tracks.select(np.array([3, 1])).in_images(4)
    rows = [k for k, q in enumerate(tracks.joints) if any((q == one).all() for one in some.joints)]
    np.testing.assert_array_equal(some.directions, tracks.directions[rows][:, [3, 1]])


def test_directions_of_another_shape_are_refused():
    pixels = np.zeros((5, 3, 2))
    with pytest.raises(DenseVSError, match=r"directions has shape \(5, 3, 2\)"):
        PointTracks(np.zeros((5, 2)), pixels, np.zeros(3, int), SIZE, pixels)
