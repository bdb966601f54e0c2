"""Where the nearest surface point of a place is, and what a placed point's error comes to, by hand."""

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, postures, serial_body

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.link_assignment import place_points
from dense_vs.body_model.nearest_point import BESIDE, nearest_point


def test_a_place_takes_the_nearest_surface_point():
    points = np.full((20, 30), -1)
    points[10, 10], points[10, 13], points[0, 0], points[19, 29] = 1, 2, 3, 4
    places = np.array([[10.0, 10.0], [10.4, 9.6], [11.0, 10.0], [12.0, 10.0], [0.4, 0.4], [29.0, 19.0], [20.0, 3.0]])
    expected = [1, 1, 1, 2, 3, 4, -1]
    assert nearest_point(points, places).tolist() == expected
    for away in range(1, 12):
        found = nearest_point(points, np.array([[10.0, 10.0 - away], [10.0 - away, 10.0]]))
        assert (found == 1).all() == (away <= BESIDE)
    for x, y, there in ((8, 9, 1), (9, 12, 1), (12, 8, 2), (11, 11, 1), (0, 2, 3), (27, 19, 4), (29, 17, 4)):
        assert nearest_point(points, np.array([[float(x), float(y)]])).tolist() == [there], (x, y)
    diagonal = nearest_point(points, np.array([[10.0 - BESIDE, 10.0 - 1]]))  # beyond the circle, within the square
    assert diagonal.tolist() == [-1]
    assert nearest_point(points, np.array([[-500.0, 5.0], [1e9, 5.0]])).tolist() == [-1, -1]


@pytest.mark.parametrize("off", [0.0, 1.0, 3.0])
def test_the_cost_of_a_point_is_the_mean_of_its_robust_errors(off):
    """Half of the images show it off to either side, which no place explains: e^2 / (e^2 + 9), e over the noise."""
    body = serial_body(2, per_link=6, seed=1)
    way = postures(2, count=12)
    tracks = body.tracks(way, noise=0.0)
    pixels = np.stack([body.pixels(q) for q in way])
    pixels[::2, :, 0] += off
    pixels[1::2, :, 0] -= off
    pixels[:3, 0] = np.nan
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    placed = place_points(chain, FOCAL, CENTER, way, pixels, body.links, body.points, 0.5)
    errors = placed.errors
    assert np.isnan(errors[:3, 0]).all()
    squared = (errors / 0.5) ** 2
    np.testing.assert_allclose(placed.cost, np.nanmean(squared / (squared + 9), axis=0), rtol=1e-9, atol=1e-12)
    position = np.stack([body_position(body, chain, placed.points, q) for q in way])
    shown = FOCAL * position[..., :2] / position[..., 2:] + CENTER
    np.testing.assert_allclose(errors, np.linalg.norm(shown - pixels, axis=2), rtol=1e-6, atol=1e-6)
    if not off:
        np.testing.assert_allclose(placed.points, body.points, atol=1e-6)
    else:
        assert np.nanmedian(errors) == pytest.approx(off, rel=0.25)
    assert len(tracks.joints) == 12


def body_position(body, chain, points, q):
    rotation, translation = chain.link_poses(q[None])
    return np.einsum("mij,mj->mi", rotation[0, body.links], points) + translation[0, body.links]


def test_points_come_to_their_places_from_elsewhere():
    body = serial_body(2, per_link=10, seed=2)
    way = postures(2, count=30, reach=0.5)
    pixels = np.stack([body.pixels(q) for q in way])
    chain = Chain(body.axes, body.anchors, np.zeros(2), body.parents)
    begin = body.points * 1.15
    placed = place_points(chain, FOCAL, CENTER, way, pixels, body.links, begin, 0.5)
    near = np.linalg.norm(placed.points - body.points, axis=1)
    assert np.median(near) < 1e-3
    assert np.median(placed.cost) < 1e-4
    none = np.full_like(pixels, np.nan)
    unseen = place_points(chain, FOCAL, CENTER, way, none, body.links, begin, 0.5)
    np.testing.assert_array_equal(unseen.cost, 0.0)
    np.testing.assert_allclose(unseen.points, begin)
