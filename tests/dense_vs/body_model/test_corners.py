"""Corners on a surface lie within it, on its links and at its depths; those about a fit's points take theirs."""

from dataclasses import replace

import numpy as np
import pytest

from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.corners import (
    APART,
    INSIDE,
    LEAST_IN_ONE,
    NEAR,
    Corners,
    _most_named,
    corners_about,
    corners_on,
)
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.surface_image import SurfaceImage
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks

SIZE, FOCAL, CENTER = (120, 160), 150.0, (79.5, 59.5)
HOME = np.zeros(2)
NEARER, FARTHER = np.s_[20:60, 30:90], np.s_[60:100, 30:90]  # of link 0 at depth 1, of link 1 at depth 2
NOISE = np.random.default_rng(3).integers(0, 255, SIZE).astype(np.uint8)


@pytest.fixture
def fit():
    """A fit of two joints whose points are two rectangles of the image, in their home posture."""
    chain = Chain(np.array([[0.0, 0, 1], [0, 1, 0]]), np.array([[0.1, 0, 1], [0, 0, 1.5]]), HOME, np.array([-1, 0]))
    x, y = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    points, links = [], []
    for link, part, depth in ((0, NEARER, 1.0), (1, FARTHER, 2.0)):
        rays = np.stack([(x[part] - CENTER[0]) / FOCAL, (y[part] - CENTER[1]) / FOCAL, np.ones(x[part].shape)], -1)
        points.append(depth * rays.reshape(-1, 3))
        links.append(np.full(len(points[-1]), link))
    points, links = np.concatenate(points), np.concatenate(links)
    tracks = PointTracks(np.zeros((1, 2)), np.zeros((1, len(links), 2)), np.zeros(len(links), int), SIZE)
    return BodyFit(BodyState(chain, points, FOCAL), links, tracks, CENTER, np.ones(2, bool), 0.3, links)


def surface_and_drawing(fit):
    count = len(fit.links)
    surface = Surface(fit.state.points, fit.links, np.ones(count), np.zeros(count, np.uint8))
    lens = fit.lens
    return surface, SurfaceImage(fit.state.chain, surface.points, surface.links, FOCAL, lens, SIZE)


def projected(fit, corners, q):
    rotation, translation = (pose[0] for pose in fit.state.chain.link_poses(q[None]))
    there = np.einsum("kij,kj->ki", rotation[corners.links], corners.points) + translation[corners.links]
    return fit.lens.bent(FOCAL * there[:, :2] / there[:, 2:] + np.array(CENTER)), there[:, 2]


@pytest.mark.parametrize("posture", [HOME, np.array([0.15, 0.05])], ids=["home", "turned"])
def test_corners_on_a_surface_are_within_it(fit, posture):
    surface, drawn = surface_and_drawing(fit)
    corners = corners_on(fit, surface, drawn, NOISE, posture)
    assert len(corners.links) >= LEAST_IN_ONE / 2
    assert set(corners.links) == {0, 1}
    front = drawn.front(posture).index
    links = np.where(front >= 0, surface.links[front], -1)
    for (x, y), link in zip(np.rint(corners.places).astype(int), corners.links, strict=True):
        around = links[y - INSIDE : y + INSIDE + 1, x - INSIDE : x + INSIDE + 1]
        assert np.mean(around == link) > 0.8  # small holes are closed
    places, depths = projected(fit, corners, posture)
    np.testing.assert_allclose(places, corners.places, atol=1e-9)
    np.testing.assert_allclose(depths[corners.links == 0], 1.0, rtol=0.1)
    apart = np.linalg.norm(corners.places[:, None] - corners.places, axis=2) + 1e3 * np.eye(len(corners.places))
    assert apart.min() >= APART - 1


def test_where_depths_jump_within_a_link_there_are_none(fit):
    """Both rectangles are on one link now, one twice as far away."""
    one = replace(fit, links=np.zeros_like(fit.links))
    surface, drawn = surface_and_drawing(one)
    for seed in range(6):
        noise = np.random.default_rng(seed).integers(0, 255, SIZE).astype(np.uint8)
        rows = np.abs(corners_on(one, surface, drawn, noise, HOME).places[:, 1] - 59.5)
        assert rows.min() > INSIDE


def test_single_pixels_of_what_is_behind_are_no_outline(fit):
    """Every third one of the nearer rectangle is here, so that all others are next to one of these."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    holes = (y[NEARER] % 3 == 0) & (x[NEARER] % 3 == 1)
    links = fit.links.copy()
    links[: holes.size][holes.ravel()] = BACKGROUND
    surface, drawn = surface_and_drawing(replace(fit, links=links))
    image = np.full(SIZE, 90, np.uint8)
    image[NEARER] = NOISE[NEARER]
    corners = corners_on(fit, surface, drawn, image, HOME)
    assert len(corners.links) >= LEAST_IN_ONE / 2
    assert not corners.links.any()


@pytest.mark.parametrize("side", [np.s_[:2], np.s_[-2:], np.s_[:, :2], np.s_[:, -2:]])
def test_a_strip_along_the_image_s_border_is_all_outline(fit, side):
    """However strong its corners are, those elsewhere are the same as without it."""
    image = (100 + NOISE % 8).astype(np.uint8)
    image[side] = np.where(NOISE[side] > 127, 255, 0)
    alone = corners_on(fit, *surface_and_drawing(fit), image, HOME)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    strip = np.column_stack([(x[side].ravel() - CENTER[0]) / FOCAL, (y[side].ravel() - CENTER[1]) / FOCAL])
    points = np.vstack([fit.state.points, np.column_stack([strip, np.ones(len(strip))])])
    links = np.append(fit.links, np.zeros(len(strip), int))
    wider = replace(fit, state=replace(fit.state, points=points), links=links)
    corners = corners_on(wider, *surface_and_drawing(wider), image, HOME)
    assert len(alone.places) >= LEAST_IN_ONE / 2
    np.testing.assert_array_equal(corners.places, alone.places)


def test_a_bent_lens_is_taken_out(fit):
    bent = replace(fit, bend=-0.08)
    surface, drawn = surface_and_drawing(bent)
    corners = corners_on(bent, surface, drawn, NOISE, HOME)
    places, _ = projected(bent, corners, HOME)
    np.testing.assert_allclose(places, corners.places, atol=1e-6)
    assert not np.allclose(places, projected(fit, corners, HOME)[0], atol=0.1)


def test_a_plain_image_has_none(fit):
    surface, drawn = surface_and_drawing(fit)
    assert not len(corners_on(fit, surface, drawn, np.full(SIZE, 90, np.uint8), HOME).links)


@pytest.mark.parametrize("bend", [0.0, -0.1])
def test_corners_about_points_take_the_link_and_depth_of_those_around(fit, bend):
    bent = replace(fit, bend=bend)
    corners = corners_about(bent, NOISE, HOME)
    places, depths = projected(bent, corners, HOME)
    np.testing.assert_allclose(places, corners.places, atol=1e-6)
    x, y = bent.lens.straight(corners.places).T
    assert ((x > 30 - NEAR - 2) & (x < 90 + NEAR + 2) & (y > 20 - NEAR - 2) & (y < 100 + NEAR + 2)).all()
    clear = np.abs(y - 59.5) > 2
    np.testing.assert_array_equal(corners.links[clear], (y > 59.5)[clear])
    np.testing.assert_allclose(depths[clear], np.where(y > 59.5, 2.0, 1.0)[clear])


@pytest.mark.parametrize("other", [0, 1])
def test_points_far_away_have_no_say(fit, other):
    """Of a lone point's corners, where the two that come next are 60 px away, and of another link or depth."""
    chosen = [np.argmin(np.linalg.norm(fit.state.points[:, :2] / fit.state.points[:, 2:] - at, axis=1))
              for at in (np.array([[30, 60], [85, 20], [86, 21]]) - CENTER) / FOCAL]  # fmt: skip
    chosen = np.array(chosen)
    links = np.array([1, 0, other])
    alone = replace(fit, state=replace(fit.state, points=fit.state.points[chosen]), links=links)
    corners = corners_about(alone, NOISE, HOME)
    near = np.linalg.norm(corners.places - (30, 60), axis=1) < NEAR + 1
    assert near.sum() >= 3
    np.testing.assert_array_equal(corners.links[near], 1)
    np.testing.assert_allclose(projected(alone, corners, HOME)[1][near], fit.state.points[chosen[0], 2])


def test_of_links_that_are_named_as_often_the_nearest_is_taken():
    assert _most_named(np.array([3, 1])) == 3
    assert _most_named(np.array([3, 1, 1])) == 1
    assert _most_named(np.array([2, 0, 1])) == 2


def test_points_are_put_into_the_home_posture(fit):
    q = np.array([0.3, -0.2])
    places, links, depths = np.array([[50.0, 40.0], [60.0, 80.0]]), np.array([0, 1]), np.array([1.1, 1.9])
    corners = Corners.at(fit, places, links, depths, q)
    there, deep = projected(fit, corners, q)
    np.testing.assert_allclose(there, places, atol=1e-9)
    np.testing.assert_allclose(deep, depths)
