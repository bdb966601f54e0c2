"""The covariance of a surface's places tells how far off they are: bodies of known lines, tracks with known noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_body import CENTER, FOCAL, SIZE, postures, serial_body

from dense_vs.body_model import BodyModel
from dense_vs.body_model.adjustment import adjust
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.held_out import share_within_deviation
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.precision import covariances, precision_of
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.track_problem import BodyState
from dense_vs.errors import DenseVSError

JOINTS = postures(3, 40)
FAR = np.array([0.5, -0.45, 0.4])
WITHIN_ONE, WITHIN_TWO = 2.279, 6.18  # squares of a distance that 68 % and 95.4 % of a plane's normal lie within


def fitted(seed, noise=0.4, slide=0.0):
    """A body and its fit to noisy tracks, begun at the truth; ``slide`` an error that goes with the posture [px]."""
    body = serial_body(3, per_link=60, seed=4)
    tracks = body.tracks(JOINTS, noise=noise, seed=seed)
    rng = np.random.default_rng([seed, 1])
    turned = (JOINTS[:, 0] * JOINTS[:, 1] / 0.09)[:, None, None]
    tracks = replace(
        tracks,
        pixels=tracks.pixels + slide * rng.normal(size=(1, len(body.links), 2)) * turned,
        references=np.repeat(np.arange(18), 10),
    )
    chain = Chain(body.axes, body.anchors, np.zeros(3), body.parents)
    begun = BodyState(chain, body.points, FOCAL)
    state, _, error = adjust(
        begun,
        tracks.joints,
        tracks.pixels,
        body.links,
        CENTER,
        (FOCAL, 0.15),
        0.5,
        2,
        20,
    )
    return body, BodyFit(state, body.links, tracks, CENTER, np.ones(3, bool), error, body.links)


def on_the_tracks(body, found, deviation, seed):
    """A surface of the tracks' points, each at its true pixel in one of two keyframes, its depth off by a share."""
    rng = np.random.default_rng([seed, 2])
    count = len(body.links)
    seen_at = rng.integers(0, 2, count) * 25
    points = np.zeros((count, 3))
    for k in (0, 25):
        rotation, translation = found.state.chain.link_poses(JOINTS[k][None])
        R, t = rotation[0, body.links], translation[0, body.links]
        depth = (np.einsum("mij,mj->mi", R, found.state.points) + t)[:, 2] * np.exp(deviation * rng.normal(size=count))
        rays = np.column_stack([(body.pixels(JOINTS[k]) - CENTER) / found.state.focal, np.ones(count)])
        on = seen_at == k
        points[on] = np.einsum("mji,mj->mi", R, rays * depth[:, None] - t)[on]
    return Surface(points, body.links, np.ones(count), np.zeros(count, np.uint8), seen_at)


def distances(body, found, surface, q):
    """Squared distance of each point's place from the true one in units of its covariance, and that covariance."""
    precision = replace(precision_of(found, surface, JOINTS), place=0.02)  # their places in the keyframes are exact
    state = found.state
    covariance = covariances(state.chain, state.focal, surface.points, surface.links, precision, q)
    rotation, translation = state.chain.link_poses(q[None])
    at = 0, surface.links
    p = np.einsum("pij,pj->pi", rotation[at], surface.points) + translation[at]
    off = state.focal * p[:, :2] / p[:, 2:] + CENTER - body.pixels(q)
    return np.einsum("pi,pij,pj->p", off, np.linalg.inv(covariance), off), covariance, precision


@pytest.mark.parametrize(("noise", "deviation"), [(0.4, 0.02), (2.0, 0.02)])
def test_so_many_places_are_within_their_deviation_as_should_be(noise, deviation):
    found = []
    for seed in range(8):
        body, fit = fitted(seed, noise)
        found.append(distances(body, fit, on_the_tracks(body, fit, deviation, seed), FAR)[0])
    squared = np.concatenate(found)
    assert 0.55 < np.mean(squared < WITHIN_ONE) < 0.83
    assert np.mean(squared < WITHIN_TWO) > 0.85


def test_depths_of_a_link_that_are_off_its_tracks_count():
    body, fit = fitted(0)
    _, near, precision = distances(body, fit, on_the_tracks(body, fit, 0.01, 0), FAR)
    assert precision.depths == pytest.approx(0.01, rel=0.5)
    _, far, precision = distances(body, fit, on_the_tracks(body, fit, 0.05, 0), FAR)
    assert precision.depths == pytest.approx(0.05, rel=0.5)
    assert np.median(np.trace(far, axis1=1, axis2=2)) > 4 * np.median(np.trace(near, axis1=1, axis2=2))


def test_lines_are_less_certain_where_tracks_are_off():
    sizes = []
    for slide in (0.0, 1.0):
        body, fit = fitted(0, 0.4, slide)
        surface = on_the_tracks(body, fit, 0.0, 0)
        precision = replace(precision_of(fit, surface, JOINTS), place=0.0, depths=np.zeros(len(surface.links)))
        state = fit.state
        by_lines = covariances(state.chain, state.focal, surface.points, surface.links, precision, FAR)
        sizes.append(np.median(np.trace(by_lines, axis1=1, axis2=2)))
    assert sizes[1] > 2 * sizes[0]


def test_the_unit_of_length_is_no_error():
    body, fit = fitted(0)
    surface = on_the_tracks(body, fit, 0.02, 0)
    _, covariance, _ = distances(body, fit, surface, FAR)
    state = fit.state
    larger = replace(fit, state=replace(state, chain=state.chain.scaled(7.0), points=7 * state.points))
    _, same, _ = distances(body, larger, replace(surface, points=7 * surface.points), FAR)
    np.testing.assert_allclose(same, covariance, rtol=0.05, atol=1e-3)


def modeled(fit, surface):
    precision, state = precision_of(fit, surface, JOINTS), fit.state
    limits = np.array([[-0.3, 0.3]] * 3)
    content = ModelContent(state.chain, state.focal, CENTER, SIZE, surface, np.ones(3, bool), limits, 0.4, precision)
    return BodyModel(content), precision, state


def test_places_held_out_are_counted_within_their_deviation():
    within, astray = [], []
    for seed in range(4):
        body, fit = fitted(seed)
        model = modeled(fit, on_the_tracks(body, fit, 0.02, seed))[0]
        wide = np.concatenate([JOINTS, postures(3, 10, reach=0.5, seed=7)])
        tracks = body.tracks(wide, noise=0.2, seed=seed)
        within.append(share_within_deviation(model, tracks, 40))
        pixels = tracks.pixels.copy()
        pixels[40:] += 6.0
        astray.append(share_within_deviation(model, replace(tracks, pixels=pixels), 40))
    assert 0.55 < np.mean(within) < 0.9
    assert np.mean(astray) < 0.25 * np.mean(within)
    pixels = tracks.pixels.copy()
    pixels[45] = np.nan  # an image in which nothing is seen leaves the others
    assert share_within_deviation(model, replace(tracks, pixels=pixels), 40) == pytest.approx(within[-1], abs=0.1)
    pixels[40:] = np.nan
    assert np.isnan(share_within_deviation(model, replace(tracks, pixels=pixels), 40))


@pytest.mark.parametrize(("held_out", "asked"), [(3, [0, 1, 2]), (8, [*range(8)]), (22, [*range(0, 22, 3)])])
def test_at_most_eight_held_out_images_are_asked_evenly_spread(held_out, asked):
    """Each of ten tracks is on a point of the model, before and after; the postures are numbers of images."""
    places, count = np.arange(20.0).reshape(10, 2), []

    def points(q):
        count.append(int(q[0]))
        return SimpleNamespace(visible=np.ones(10, bool), pixels=places, covariances=np.tile(np.eye(2), (10, 1, 1)))

    tracks = SimpleNamespace(
        seen=np.ones((5 + held_out, 10), bool),
        joints=np.arange(5.0 + held_out)[:, None],
        pixels=np.tile(places, (5 + held_out, 1, 1)),
    )
    assert share_within_deviation(SimpleNamespace(points=points), tracks, 5) == 1.0
    assert count == [4, *(5 + k for k in asked)]


def test_points_of_a_model_have_it_also_once_saved(tmp_path):
    body, fit = fitted(0)
    surface = on_the_tracks(body, fit, 0.02, 0)
    model, precision, state = modeled(fit, surface)
    points = model.points(FAR)
    expected = covariances(state.chain, state.focal, surface.points, surface.links, precision, FAR)
    np.testing.assert_array_equal(points.covariances, expected)
    np.testing.assert_allclose(points.deviations**2, 0.5 * (expected[:, 0, 0] + expected[:, 1, 1]))
    model.save(tmp_path / "body.npz")
    again = BodyModel.load(tmp_path / "body.npz").points(FAR)
    np.testing.assert_allclose(again.deviations, points.deviations, rtol=0.02)
    with np.load(tmp_path / "body.npz", allow_pickle=False) as stored:
        arrays = dict(stored)
    for name, value, message in (
        ("precision_depths", np.zeros(3), "precision_depths has shape"),
        ("precision_keyframes", np.full(len(surface.links), 9), "precision_keyframes reach 9"),
        ("precision_keyframes", np.append(arrays["precision_keyframes"][1:], 9), "precision_keyframes reach 9"),
        ("precision_keyframes", np.append(arrays["precision_keyframes"][1:], -1), "precision_keyframes reach"),
    ):
        np.savez(tmp_path / "bad.npz", **{**arrays, name: value})
        with pytest.raises(DenseVSError, match=message):
            BodyModel.load(tmp_path / "bad.npz")
    for name in [name for name in arrays if name.startswith("precision")]:
        del arrays[name]
    np.savez(tmp_path / "older.npz", **arrays)
    assert np.isnan(BodyModel.load(tmp_path / "older.npz").points(FAR).covariances).all()
