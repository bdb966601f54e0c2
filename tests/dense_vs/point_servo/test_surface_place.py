"""Where the surface is about a pixel, on images made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.point_servo.surface_place import SurfacePlace, surface_at


def body_seen():
    links, depths = np.full((20, 30), -1), np.full((20, 30), np.inf)
    links[8:12, 10:13], depths[8:12, 10:13] = 2, 1.5
    links[8:12, 13:15], depths[8:12, 13:15] = 0, 0.5
    depths[9, 11] = 1.9
    points = np.where(links < 0, -1, np.arange(600).reshape(20, 30))
    return SimpleNamespace(links=links, depths=depths, points=points)


def test_it_is_that_of_most_pixels_around():
    seen = body_seen()
    relief = np.log([1.9, *[1.5] * 11]).std()
    assert surface_at(seen, np.array([11.4, 9.6])) == SurfacePlace(2, 1.5, relief=pytest.approx(relief))
    assert surface_at(seen, np.array([16.0, 9.0])) == SurfacePlace(0, 0.5)  # two pixels beside it
    assert surface_at(seen, np.array([17.0, 9.0])) is None
    seen.links[:2, :2], seen.depths[:2, :2] = 1, 3.0
    assert surface_at(seen, np.array([0.0, 0.0])) == SurfacePlace(1, 3.0)


def test_its_depth_follows_the_lines_as_those_points_of_the_surface_do():
    seen, random = body_seen(), np.random.default_rng(0)
    precision = SimpleNamespace(lines=random.normal(size=(3, 9)), depth_steps=random.normal(size=(600, 3)))
    place = surface_at(seen, np.array([12.0, 9.0]), precision)
    lines, follows = place.steps
    assert place.relief == surface_at(seen, np.array([12.0, 9.0])).relief > 0
    on = [30 * y + x for y in range(8, 12) for x in range(10, 13)]  # not those of link 0 beside it
    np.testing.assert_array_equal(lines, precision.lines)
    np.testing.assert_allclose(follows, precision.depth_steps[on].mean(axis=0))


def test_its_relief_is_that_of_its_link_five_pixels_about_it():
    """What lies set back beside a place is where its own depth may be off to."""
    seen, place = body_seen(), np.array([14.2, 8.8])
    seen.links[:], seen.depths[:] = 2, 1.5
    seen.links[9, 12], seen.depths[9, 12] = 0, 0.5  # another link
    assert surface_at(seen, place).relief == pytest.approx(0.0, abs=1e-12)
    seen.depths[13, 17] = seen.depths[9, 8] = seen.depths[15, 14] = 3.0  # 5, 6 and 6 px away
    everything = [seen.depths[v, u] for v, u in np.argwhere(seen.links == 2) if (u - 14) ** 2 + (v - 9) ** 2 <= 25]
    assert everything.count(3.0) == 1
    assert surface_at(seen, place).relief == pytest.approx(np.log(everything).std())
    assert surface_at(seen, place).depth == 1.5
