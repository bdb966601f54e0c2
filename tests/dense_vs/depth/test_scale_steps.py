"""Distances from lengths, step by step: discs of known size, densities by plain loops, regions as perspective says."""

import numpy as np
import pytest

from dense_vs.depth import scale_posterior
from dense_vs.depth.region_shape import RegionShape
from dense_vs.depth.region_track import TrackOptions, _Table, _with_fragments, follow_region
from dense_vs.depth.scale_posterior import DistancePosterior, ScaleModel, distance_posterior, lengths

ANGLES = np.arange(16) * np.pi / 8
UNIT = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
SIZE = (480, 640)
CENTER = np.array([319.5, 239.5])


def ellipse(a=20.0, b=20.0, center=CENTER, border=False):
    """An ellipse along the image's axes: exact area, moments, reach; the outline is that of a disc of its mean size."""
    center = np.asarray(center, float)
    reach = np.hypot(a * UNIT[0], b * UNIT[1])
    return RegionShape(np.pi * a * b, center, np.diag([a * a / 4, b * b / 4]), reach + center @ UNIT,
                       np.pi * (a + b), border)  # fmt: skip


# Lengths.


def test_lengths_are_widths_the_root_of_the_area_and_deviations():
    found = lengths(ellipse(30.0, 10.0, (100.0, 50.0)))
    np.testing.assert_allclose(found[:8], 2 * np.hypot(30 * UNIT[0, :8], 10 * UNIT[1, :8]))
    assert found[8] == pytest.approx(np.sqrt(np.pi * 300))
    np.testing.assert_allclose(found[9:], 0.5 * np.hypot(30 * UNIT[0, :8:2], 10 * UNIT[1, :8:2]))
    point = RegionShape(1.0, CENTER, np.zeros((2, 2)), np.zeros(16), 1.0, False)
    np.testing.assert_allclose(lengths(point)[9:], np.sqrt(1 / 12))  # a pixel's own


def test_lengths_of_a_disc_grow_as_its_radius_does():
    slope = (lengths(ellipse(20.01, 20.01)) - lengths(ellipse(19.99, 19.99))) / 0.02
    np.testing.assert_allclose(scale_posterior._growth(ellipse()), slope, rtol=1e-6)


@pytest.mark.parametrize("model", [ScaleModel(), ScaleModel(pixel_noise=1.0, relative_noise=0.05, solidity=0.7)])
def test_the_least_error_is_of_pixels_of_size_and_of_parallax(model):
    """A solid off the axis by (80, -60) px of 640 changes along x by an eighth, along y by three thirty-seconds."""
    shape = ellipse(30.0, 10.0, CENTER + np.array([80.0, -60.0]))
    found = scale_posterior._least_error(shape, SIZE, model)
    L = lengths(shape)
    expected = np.eye(13) * (model.pixel_noise**2 + model.relative_noise**2 * shape.area)
    for share, along in ((80 / 640, np.cos), (60 / 640, np.sin)):
        part = np.concatenate([along(ANGLES[:8]) ** 2, [0.5], along(ANGLES[:8:2]) ** 2])
        stretch = model.solidity * share * part * L
        expected += np.outer(stretch, stretch)
    np.testing.assert_allclose(found, expected)


# The density.


def density(Y, s, weight, grow, least, growths):
    """The matrix-t density by loops: what is left of weighted lengths across the weighted scales."""
    total = 0.0
    degrees = 0.5 * max(weight.sum() - 1.0, 0.5)
    for n, prior in growths:
        rows = np.sqrt(weight)[:, None] * (Y - n * grow)
        across = np.sqrt(weight) * s
        left = rows - np.outer(across, across @ rows) / (across @ across)
        total += prior * np.linalg.det(left.T @ left + weight.sum() * least) ** -degrees
    return np.log(total)


@pytest.mark.parametrize("views", [2, 5])
def test_the_density_integrates_out_size_and_growth(views):
    rng = np.random.default_rng(0)
    Y, scale = rng.uniform(5, 9, (views, 3)), rng.uniform(0.2, 1, (4, views))
    weight, grow = rng.uniform(0.1, 1, views), np.array([2.0, 1.8, 0.5])
    least = np.diag([1.0, 2.0, 0.5])
    model = ScaleModel()
    found = scale_posterior._log_density(Y, scale, weight, grow, least, model)
    growths = scale_posterior._growth_prior(model)
    np.testing.assert_allclose(found, [density(Y, s, weight, grow, least, growths) for s in scale], rtol=1e-9)


def test_growth_is_none_where_the_outline_is_exact_and_some_pixels_else():
    assert scale_posterior._growth_prior(ScaleModel(exact=1.0)) == [(0.0, 1.0)]
    growths, shares = np.array(scale_posterior._growth_prior(ScaleModel(exact=0.0, grown=2.0, grown_spread=1.5))).T
    np.testing.assert_allclose(growths, np.arange(-4.0, 8.1, 0.75))
    assert shares.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(shares / shares[8], np.exp(-0.5 * ((growths - 2.0) / 1.5) ** 2), rtol=1e-9)
    mixed = np.array(scale_posterior._growth_prior(ScaleModel(exact=0.4, grown=2.0, grown_spread=1.5)))[:, 1]
    narrow = np.exp(-0.5 * (growths / 0.5) ** 2)
    np.testing.assert_allclose(mixed, 0.4 * narrow / narrow.sum() + 0.6 * shares, rtol=1e-9)


@pytest.mark.parametrize("degrees", [4.0, 1.0])
def test_views_that_do_not_agree_lose_weight(degrees):
    """By Student's t over the mean squared error of a view, in units of the usual one."""
    rng = np.random.default_rng(1)
    scale, grow = np.linspace(1, 0.3, 6), np.array([2.0, 1.0, 0.0, 0.5])
    least = np.diag([1.0, 4.0, 9.0, 1.0])
    Y = np.outer(scale, [50.0, 40, 30, 20]) + np.outer(rng.normal(size=6), grow) + rng.normal(0, 1.5, (6, 4))
    Y[3] += [30, -25, 40, 10]
    weight = rng.uniform(0.5, 1.0, 6)
    found = scale_posterior._view_weights(Y, scale, weight, grow, least, degrees)
    nearest = (weight * scale) @ Y / np.sum(weight * scale**2)
    size = np.empty(6)
    for k in range(6):
        off = Y[k] - scale[k] * nearest
        off = off - grow * (off @ grow) / (grow @ grow)
        size[k] = np.mean(off**2 / least.diagonal())
    usual = max(np.median(size), 1.0)
    np.testing.assert_allclose(found, np.minimum(1.0, (degrees + 1) / (degrees + size / usual)))
    assert found[3] < 0.5
    exact = np.outer(scale, [50.0, 40, 30, 20])
    np.testing.assert_allclose(scale_posterior._view_weights(exact, scale, weight, grow, least, degrees), 1.0)


def test_where_all_views_agree_their_weight_is_by_the_least_error():
    rng = np.random.default_rng(2)
    scale, grow, weight = np.linspace(1, 0.3, 6), np.array([2.0, 1.0, 0.0, 0.5]), np.ones(6)
    least = np.diag([1.0, 4.0, 9.0, 1.0])
    Y = np.outer(scale, [50.0, 40, 30, 20]) + rng.normal(0, 0.2, (6, 4))
    Y[5] += [2.0, -3.0, 0.0, 3.0]
    found = scale_posterior._view_weights(Y, scale, weight, grow, least, 2.0)
    off = Y[5] - scale[5] * (scale @ Y / np.sum(scale**2))
    off = off - grow * (off @ grow) / (grow @ grow)
    size = np.mean(off**2 / least.diagonal())
    assert 1.5 < size < 10
    np.testing.assert_allclose(found, [1.0] * 5 + [3.0 / (2.0 + size)])


def log_normal(mean=0.3, spread=0.4):
    log = np.linspace(mean - 8 * spread, mean + 8 * spread, 4001)
    mass = np.exp(-0.5 * ((log - mean) / spread) ** 2)
    return DistancePosterior(np.exp(log), mass / mass.sum(), np.ones(3))


def test_figures_of_a_log_normal_distance():
    """Its median of p / z is exp(m - s^2), its quantiles are those of the normal."""
    found = log_normal()
    assert found.log_std() == pytest.approx(0.4, rel=1e-4)
    assert found.least_relative_error() == pytest.approx(np.exp(0.3 - 0.16), rel=1e-4)
    assert found.quantile(0.5) == pytest.approx(np.exp(0.3), rel=1e-4)
    assert found.quantile(0.841345) == pytest.approx(np.exp(0.7), rel=1e-4)
    assert found.quantile(0.158655) == pytest.approx(np.exp(-0.1), rel=1e-4)


@pytest.mark.parametrize("chosen", [None, (0, 4, 8)])
@pytest.mark.parametrize("outliers", [4.0, np.inf])
def test_an_exact_approach_tells_its_distance(chosen, outliers):
    back = np.linspace(0.0, 0.4, 8)
    shapes = [ellipse(*(np.array([60.0, 45.0]) * 0.3 / (0.3 + b))) for b in back]
    model = ScaleModel(exact=1.0, lengths=chosen, outlier_degrees=outliers)
    found = distance_posterior(shapes, 5.0 + back, SIZE, model)
    assert found.probability.sum() == pytest.approx(1.0)
    assert found.distance[found.probability.argmax()] == pytest.approx(0.3, rel=0.06)
    assert found.distance[[0, -1]].tolist() == pytest.approx([0.03 * 0.4, 1000 * 0.4])
    np.testing.assert_allclose(found.view_weight, 1.0)
    shapes[5] = ellipse(90.0, 20.0)
    spoiled = distance_posterior(shapes, 5.0 + back, SIZE, model)
    if np.isfinite(outliers):
        assert spoiled.view_weight[5] < 0.5 < np.delete(spoiled.view_weight, 5).min()
    else:
        np.testing.assert_array_equal(spoiled.view_weight, 1.0)


def test_without_a_change_the_prior_decides():
    """Student's t with three degrees of freedom over log(distance / travel), of the spread that is told."""
    model = ScaleModel(log_distance=0.5, pixel_noise=1e6)
    found = distance_posterior([ellipse()] * 2, np.array([0.0, 0.2]), SIZE, model)
    expected = (1 + (np.log(found.distance / 0.2) / 0.5) ** 2 / 3) ** -2.0
    np.testing.assert_allclose(found.probability, expected / expected.sum(), rtol=1e-3, atol=1e-9)


# Following a region.


def views(distance=0.3, back=(0.0, 0.1, 0.25), offset=(40.0, -25.0), size=50.0):
    """A disc off the center, as perspective shows it farther away."""
    found = []
    for b in back:
        s = distance / (distance + b)
        found.append([ellipse(size * s, size * s, CENTER + s * np.array(offset))])
    return found, np.array(back)


def test_costs_are_of_size_and_place_at_each_distance():
    seed = ellipse(50.0, 50.0, CENTER + np.array([40.0, -25.0]))
    other = [
        ellipse(20.0, 22.0, CENTER + np.array([25.0, -9.0])),
        ellipse(30.0, 30.0, CENTER + np.array([20.0, -12.0]), border=True),
    ]
    scale, options = np.array([0.5, 0.4]), TrackOptions()
    found = _Table(other).costs(seed, scale, CENTER, 640, options)
    for k, s in enumerate(scale):
        for r, region in enumerate(other):
            size = np.sqrt(seed.area) * s
            off_size = (0.5 * np.log(region.area) - np.log(size)) / (0.15 + 1 / size)
            spread = 0.25 * size + 0.04 * 640 * (1 - s) + 1.0
            off_place = np.hypot(*(region.centroid - CENTER - s * np.array([40.0, -25.0]))) / spread
            assert found[k, r] == pytest.approx(off_size**2 + off_place**2 + (2.7 if region.touches_border else 0.0))
    farther = _Table(other).costs(seed, np.array([1.5]), CENTER, 640, options)
    assert np.isfinite(farther).all()
    assert _Table([]).costs(seed, scale, CENTER, 640, options).shape == (2, 0)


def test_the_region_that_moves_as_perspective_says_is_followed():
    found, back = views()
    truth = [regions[0] for regions in found]
    for regions, size in zip(found, (55.0, 75.0, 95.0), strict=True):
        clutter = ellipse(size, size, CENTER + np.array([-200.0, 100.0]))
        regions.insert(0, clutter)  # larger, but it grows where the camera goes away
    assert [one is right for one, right in zip(follow_region(found, back, SIZE), truth, strict=True)] == [True] * 3
    found[1] = found[1][:1]
    assert follow_region(found, back, SIZE)[1] is None
    found[1] = []
    assert follow_region(found, back, SIZE)[1] is None
    found[0] = []
    assert [one is not None for one in follow_region(found, back, SIZE)] == [False, False, True]
    assert follow_region([[], [], []], back, SIZE) == [None] * 3
    still = [[clutter], [], [truth[0], clutter]]
    assert follow_region(still, np.zeros(3), SIZE) == [clutter, None, truth[0]]


def test_of_two_that_move_alike_the_larger_or_the_nearer_to_the_center_is_taken():
    large, back = views(size=50.0, offset=(30.0, 0.0))
    small, _ = views(size=20.0, offset=(-30.0, 0.0))
    far, _ = views(size=50.0, offset=(-250.0, 0.0))
    for others in (small, far):
        both = [[*a, *b] for a, b in zip(others, large, strict=True)]
        assert all(one is a[0] for one, a in zip(follow_region(both, back, SIZE), large, strict=True))


@pytest.mark.parametrize(("off", "larger"), [(60.0, True), (250.0, False)])
def test_a_larger_region_is_taken_unless_it_is_far_from_the_center(off, larger):
    large, back = views(size=50.0, offset=(off, 0.0))
    small, _ = views(size=40.0, offset=(0.0, 0.0))
    both = [[*a, *b] for a, b in zip(large, small, strict=True)]
    taken = large if larger else small
    assert follow_region(both, back, SIZE)[0] is taken[0][0]


@pytest.mark.parametrize(("share", "tried"), [(0.049, False), (0.051, True)])
def test_specks_are_no_seeds(share, tried):
    """A twentieth of the largest region of its view is the least."""
    large, back = views(size=40.0, offset=(300.0, 0.0))
    size = 40.0 * np.sqrt(share)
    specks, _ = views(size=size, offset=(0.0, 0.0))
    both = [[*a, *b] for a, b in zip(large, specks, strict=True)]
    found = follow_region(both, back, SIZE, TrackOptions(size_weight=0.0))
    assert (found[0] is specks[0][0]) == tried


def test_seeds_are_of_the_largest_regions_of_the_nearest_views():
    found, back = views(back=(0.0, 0.1, 0.2, 0.3), offset=(0.0, 0.0))
    growing = [ellipse(60.0 + k, 60.0, CENTER + np.array([150.0, 90.0])) for k in range(6)]
    crowded = [[*growing, *regions] for regions in found]
    usual = follow_region(crowded, back, SIZE)
    assert usual[0] is not found[0][0]  # it is the seventh
    assert follow_region(crowded, back, SIZE, TrackOptions(seeds=7))[0] is found[0][0]
    late = [growing[:1]] * 3 + [found[3]]
    assert follow_region(late, back, SIZE)[3] is not found[3][0]  # the fourth view is no seed
    assert follow_region(late, back, SIZE, TrackOptions(seed_views=4, size_weight=9.0)) is not None


@pytest.mark.parametrize(("off", "taken"), [(0.0, True), (14.9, True), (16.5, False), (-14.9, True), (-16.5, False)])
def test_fragments_within_the_outline_are_joined(off, taken):
    """The seed of 40 px reaches 20 px at half its size, about the middle of what was found, and a pixel beside."""
    seed = ellipse(40.0, 40.0, (500.0, 100.0))
    main, other = ellipse(18.0, 18.0, (200.0, 150.0)), ellipse(5.0, 5.0, (200.0 + off, 150.0))
    found = _with_fragments([other, main], 1, seed, 0.5, CENTER)
    assert found.area == pytest.approx(main.area + (other.area if taken else 0.0))
    across = ellipse(5.0, 5.0, (200.0, 150.0 + off))
    assert (_with_fragments([across, main], 1, seed, 0.5, CENTER) is main) != taken
    assert _with_fragments([other, main], -1, seed, 0.5, CENTER) is None
    assert _with_fragments([main], 0, seed, 0.5, CENTER) is main
