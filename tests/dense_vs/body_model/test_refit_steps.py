"""The steps of a fit anew, by plates that slide over a wall by whole pixels, so that every place is known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dense_vs.body_model import refit as refit_module
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.corners import Corners
from dense_vs.body_model.fit import BodyFit
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.refit import LEAST_SEEN, refit
from dense_vs.body_model.sought_points import SoughtPoints
from dense_vs.body_model.surface import Surface
from dense_vs.body_model.track_problem import BodyState
from dense_vs.body_model.tracks import PointTracks

SIZE, FOCAL, CENTER = (120, 160), 150.0, (79.5, 59.5)
CHAIN = Chain(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.array([-1, -1]), np.eye(3)[:2] / FOCAL)
# Two slides, 1 px by a unit each at depth 1: to the right and down. Where their plates are at first, and one on the
# first of them that jumps to and fro besides.
RIGHT, DOWN, JUMPING = np.s_[8:56, 34:120], np.s_[72:108, 34:150], np.s_[32:56, 90:120]
NEAR_HOME = [(0, 0), (2, -1), (-1, 1), (1, 2), (-2, -2), (2, 1), (-1, -2), (1, -1), (-2, 2), (0, -2)]
JOINTS = np.array([*NEAR_HOME, (16, 7), (24, -7), (-9, 4), (30, -5)], float)
JUMPS = [(0, 0), *[(2, 0), (0, -2), (-2, 0), (0, 2)] * 4][: len(JOINTS)]  # px


def grid(columns, rows):
    return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)


# Corners and links that they are first taken for: those of MISTAKEN are on the first plate, those of STILL on the wall.
ON_RIGHT, ON_DOWN = grid(np.arange(42, 86, 8), [16, 24, 32, 40]), grid(np.arange(42, 146, 10), [82, 90, 98])
MISTAKEN, STILL, JUMPS_AT = grid([92, 100, 108], [16, 24]), grid([12], [16, 40, 64, 88, 104]), grid([105], [44])
PLACES = np.concatenate([ON_RIGHT, ON_DOWN, MISTAKEN, STILL, JUMPS_AT])
COUNTS = [len(some) for some in (ON_RIGHT, ON_DOWN, MISTAKEN, STILL, JUMPS_AT)]
TAKEN_FOR = np.repeat([0, 1, 1, 0, 0], COUNTS)
KIND = np.repeat(["right", "down", "mistaken", "still", "jumping"], COUNTS)


def textured(seed):
    smooth = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, SIZE), (0, 0), 2.0)
    return np.clip(128 + 50 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def image(q, jump):
    wall, *plates = (textured(seed) for seed in range(4))
    (right, down), (x, y) = q.astype(int), jump
    for part, plate, (dx, dy) in (
        (RIGHT, plates[0], (right, 0)),
        (DOWN, plates[1], (0, down)),
        (JUMPING, plates[2], (right + x, y)),
    ):
        rows, columns = part
        wall[rows.start + dy : rows.stop + dy, columns.start + dx : columns.stop + dx] = plate[part]
    return wall


def fit_of(places, links, bend=0.0):
    """A fit whose points are at places of the image at home, at depth 1."""
    lens = Lens.of_center(np.array(CENTER), bend)
    points = np.column_stack([(lens.straight(places) - CENTER) / FOCAL, np.ones(len(places))])
    tracks = PointTracks(JOINTS[:1], places[None], np.zeros(len(places), int), SIZE)
    return BodyFit(BodyState(CHAIN, points, FOCAL), links, tracks, CENTER, np.ones(2, bool), 0.3, links, bend)


@pytest.fixture(scope="module")
def adjusted():
    """The fit by these corners after two rounds, with the kind of each of its points."""
    images = [image(q, jump) for q, jump in zip(JOINTS, JUMPS, strict=True)]
    sought, found = SoughtPoints(images, JOINTS, CENTER), fit_of(PLACES, TAKEN_FOR)
    sought.add(Corners(PLACES, TAKEN_FOR, found.state.points), 0)
    first, _ = sought.places(found.state, 1)
    assert (np.isfinite(first[..., 0]).sum(axis=0) >= LEAST_SEEN).all()  # no point is left out for that
    fit = refit_module._adjusted(found, sought, (1, 1), (FOCAL, 0.0), SIZE)
    begun = fit.lens.bent(fit.tracks.pixels[0])
    which = np.linalg.norm(begun[:, None] - PLACES, axis=2).argmin(axis=1)
    np.testing.assert_allclose(begun, PLACES[which], atol=1e-6)
    return fit, KIND[which]


def test_points_are_on_the_links_that_explain_them(adjusted):
    fit, kinds = adjusted
    np.testing.assert_array_equal(fit.links, kinds == "down")
    for kind in ("right", "down", "mistaken"):
        assert (kinds == kind).sum() == (kind == KIND).sum()


def test_points_that_change_over_are_sought_where_their_new_link_has_them(adjusted):
    """By the other link they were expected too far away in the last images."""
    fit, kinds = adjusted
    seen = fit.tracks.seen[:, kinds == "mistaken"]
    assert seen.all()
    there = fit.lens.bent(fit.tracks.pixels[:, kinds == "mistaken"])
    moved = np.stack([JOINTS[:, 0], np.zeros(len(JOINTS))], axis=1)
    np.testing.assert_allclose(there, MISTAKEN + moved[:, None], atol=0.1)


def test_points_that_stand_still_take_no_part(adjusted):
    fit, kinds = adjusted
    assert not (kinds == "still").any()
    assert not (fit.links == BACKGROUND).any()


def test_points_that_no_link_explains_take_no_part(adjusted):
    _, kinds = adjusted
    assert not (kinds == "jumping").any()


def test_corners_are_on_the_surface_as_the_lens_shows_it(monkeypatch):
    """A plate at the image's border, where a lens that does not bend would show it 6 px farther outside."""
    bend, noise = -0.12, np.random.default_rng(1).integers(0, 255, SIZE).astype(np.uint8)
    plate = grid(np.arange(4, 40, 0.5), np.arange(4, 40, 0.5))  # as a pinhole shows it
    lens = Lens.of_center(np.array(CENTER), bend)
    assert np.linalg.norm(lens.bent(plate[0]) - plate[0]) > 6
    bent = fit_of(lens.bent(plate), np.zeros(len(plate), int), bend)
    surface = Surface(bent.state.points, bent.links, np.ones(len(plate)), np.zeros(len(plate), np.uint8))
    rounds = []
    monkeypatch.setattr(refit_module, "_adjusted", lambda found, sought, *_: rounds.append(sought) or bent)
    monkeypatch.setattr(refit_module, "surface_of", lambda *_: surface)
    still = PointTracks(np.zeros((3, 2)), np.zeros((3, 1, 2)), np.zeros(1, int), SIZE)
    assert refit(replace(bent, bend=0.0), still, [noise] * 3, (FOCAL, 0.0)) is bent
    _, on = rounds
    assert len(on.links) > 20
    seen = FOCAL * on.points[:, :2] / on.points[:, 2:] + CENTER
    assert seen.min() > 4 - 0.5
    assert seen.max() < 39.5 + 0.5
