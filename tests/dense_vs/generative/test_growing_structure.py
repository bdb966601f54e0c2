"""Structure that grows from what cameras see together, and from one camera's views alone, on exact scenes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative.reconstruction import sample_alignment
from dense_vs.generative.reconstruction.factorization import _affine, factorize
from dense_vs.generative.reconstruction.sample_alignment import Views, align_samples, grow, robust_motions

T, M = 8, 9
TURNS = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.1, -0.5, 0.1]]).as_matrix()
SHIFTS = np.array([[0.0, 0.0, 2.0], [0.9, 0.1, 2.2]])


def hand(seed=0):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(0.5 * rng.normal(size=(T, 3))).as_matrix()
    return rotation, 0.2 * rng.normal(size=(T, 3)), rng.uniform(-0.3, 0.3, (M, 3))


def seen_by(rotation, translation, structure):
    world = np.einsum("tij,mj->tmi", rotation, structure) + translation[:, None]
    there = np.einsum("cij,tmj->tcmi", TURNS, world) + SHIFTS[:, None]
    return there[..., :2] / there[..., 2:], world


def views_of(flat, **changes):
    seen = np.isfinite(flat[..., 0])
    return Views(flat, seen, changes.get("placed", np.ones(2, bool)), TURNS, SHIFTS)


def test_features_that_placed_cameras_see_together():
    rotation, translation, structure = hand()
    flat, world = seen_by(rotation, translation, structure)
    flat[2, 1, 4] = np.nan
    views = views_of(flat)
    np.testing.assert_allclose(views.points[views.known], world[views.known], atol=1e-9)
    assert np.argwhere(~views.known).tolist() == [[2, 4]]
    assert not views_of(flat, placed=np.array([True, False])).known.any()
    behind = structure.copy()
    behind[5] = rotation[3].T @ ([0.2, 0.1, -8.0] - translation[3])  # there its rays meet, behind both cameras
    assert not views_of(seen_by(rotation, translation, behind)[0]).known[3, 5]


def test_structure_is_of_medians_and_of_motion():
    """Of what is triangulated in single samples the median, of what one camera sees at a time its rays' meeting."""
    rotation, translation, structure = hand()
    flat, _ = seen_by(rotation, translation, structure)
    flat[:, 1, 6] = np.nan  # one camera alone sees it
    flat[1:, :, 7] = np.nan
    flat[0, 1, 7] = np.nan  # seen once
    flat[4, 0, 2] += 0.5  # one mistake
    posed = np.arange(T) != 5
    moved = translation.copy()
    moved[5] += 9.0
    found = views_of(flat).structure(rotation, moved, posed)
    expected = structure.copy()
    expected[7] = np.nan
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("hidden", [False, True])
def test_samples_are_posed_one_after_the_other(hidden):
    """By what they share with those before: triangulated features, or one camera's view of enough of them."""
    rotation, translation, structure = hand(1)
    flat, _ = seen_by(rotation, translation, structure)
    if hidden:
        flat[3, 1] = np.nan  # one camera alone
        flat[4, 1, 3:] = np.nan
        flat[5, :, 3:] = np.nan  # three features of both cameras
        flat[6, 0, 3:], flat[6, 1] = np.nan, np.nan  # three features of one camera have no pose
    views = views_of(flat)
    turns, places = np.tile(np.eye(3), (T, 1, 1)), np.zeros((T, 3))
    turns[0], places[0] = rotation[0], translation[0]
    posed = np.arange(T) == 0
    start = structure.copy()
    start[6:] = np.nan
    found = grow(views, start, turns, places, posed)
    expected = np.ones(T, bool)
    expected[6] = not hidden
    assert posed.tolist() == expected.tolist()
    np.testing.assert_allclose(found, structure, atol=1e-5)
    np.testing.assert_allclose(turns[posed], rotation[posed], atol=1e-4)
    np.testing.assert_allclose(places[posed], translation[posed], atol=1e-4)


def test_seeds_are_the_samples_with_most_features_until_one_is_sound(monkeypatch):
    rotation, translation, structure = hand(2)
    flat, _ = seen_by(rotation, translation, structure)
    for t, count in enumerate((5, 9, 6, 9, 4, 8, 7, 5)):
        flat[t, :, count:] = np.nan
    seen = np.isfinite(flat[..., 0])
    tried, grown = [], sample_alignment.grow
    share = []

    def kept(views, start, turns, places, posed):
        tried.append(int(np.flatnonzero(posed)[0]))
        np.testing.assert_array_equal(start, views.points[tried[-1]])
        made = grown(views, start, turns, places, posed)
        if share:
            posed[share[0] :] = False
        return made

    monkeypatch.setattr(sample_alignment, "grow", kept)
    placed = np.ones(2, bool)
    turns, places, found, posed = align_samples(flat, seen, placed, TURNS, SHIFTS)
    assert tried == [1]
    assert posed.all()
    # The frame is that of the seed's hand: all else is moved by its pose.
    np.testing.assert_allclose(turns, rotation @ rotation[1].T, atol=1e-4)
    np.testing.assert_allclose(found, structure @ rotation[1].T + translation[1], atol=1e-4)
    again = np.einsum("tij,mj->tmi", turns, found) + places[:, None]
    np.testing.assert_allclose(again, seen_by(rotation, translation, structure)[1], atol=1e-4)
    share.append(7)  # seven of eight samples posed are not enough
    tried.clear()
    align_samples(flat, seen, placed, TURNS, SHIFTS)
    assert tried == [1, 3, 5, 6]
    line = np.outer(np.arange(M) - 4.0, [0.05, 0.02, 0.01])
    straight, _ = seen_by(rotation, translation, line)
    with pytest.raises(DenseVSError, match="no sample has three features, off a line"):
        align_samples(straight, np.isfinite(straight[..., 0]), placed, TURNS, SHIFTS)


def test_points_that_fit_badly_lose_weight_where_there_are_more_than_three():
    rotation, translation, structure = hand(3)
    _, world = seen_by(rotation, translation, structure)
    mask = np.ones((T, M), bool)
    mask[1, 3:] = False
    mask[2, 4:] = False
    world[0, 5] += [0.3, -0.2, 0.1]
    world[~mask] = np.nan
    turns, places = robust_motions(structure, world, mask)
    np.testing.assert_allclose(turns, rotation, atol=2e-2)
    np.testing.assert_allclose(places, translation, atol=2e-2)
    np.testing.assert_allclose(turns[1:], rotation[1:], atol=1e-6)


# One camera's views, of parallel rays.

LENS = np.array([[600.0, 600, 320, 240, 0, 0], [500.0, 500, 300, 200, 0, 0]])


def parallel(seed=0, frames=12, depth=1.0):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.normal(size=(frames, 3))).as_matrix()
    structure = rng.normal(size=(7, 3)) * [1.0, 0.7, depth]
    structure -= structure.mean(axis=0)
    scale, shift = rng.uniform(0.05, 0.1, frames), 0.1 * rng.normal(size=(frames, 2))
    flat = scale[:, None, None] * np.einsum("txi,mi->tmx", rotation[:, :2], structure) + shift[:, None]
    pixels = np.full((frames, 2, 7, 2), np.nan)
    pixels[:, 1] = 500 * flat + [300, 200]
    return rotation, structure, scale, flat, pixels


def test_both_reversed_reconstructions_of_parallel_views():
    _, structure, scale, flat, pixels = parallel()
    pixels[3, 1, 3:] = np.nan  # three features are too few for a frame
    pixels[5, 1, 2] = np.nan
    pixels[0:10, 1, 6] = np.nan  # seen in two frames
    known = np.arange(7) != 6
    ones = factorize(pixels, LENS, 1, np.random.default_rng(0))
    frames = np.arange(12) != 3
    agree = []
    for one in ones:
        assert one.posed.tolist() == frames.tolist()
        assert one.placed_cameras.tolist() == [False, True]
        assert np.isfinite(one.structure[:, 0]).tolist() == known.tolist()
        np.testing.assert_allclose(np.linalg.det(one.rotation), 1.0)
        # Rows of the turns times the structure, at each frame's scale, are what was seen about its middle.
        made = np.einsum("txi,mi->tmx", one.rotation[frames][:, :2], one.structure[known])
        own = flat[frames][:, known] - flat[frames][:, known].mean(axis=1, keepdims=True)
        factor = np.einsum("tmx,tmx->t", made, own) / np.einsum("tmx,tmx->t", made, made)
        np.testing.assert_allclose(factor[:, None, None] * made, own, atol=1e-3)
        np.testing.assert_allclose(factor / factor[0], scale[frames] / scale[0], rtol=1e-3)
        np.testing.assert_allclose(np.median(one.translation[frames, 2]), 1.0, rtol=0.2)
        size = np.linalg.norm(one.structure[known] - one.structure[known].mean(axis=0))
        true = structure[known] - structure[known].mean(axis=0)
        _, error = Rotation.align_vectors(true, one.structure[known] * np.linalg.norm(true) / size)
        agree.append(error < 0.01)
    assert sorted(agree) == [False, True]  # one of both is the hand, the other its mirror image


def test_an_affine_frame_shows_what_was_seen():
    _, _, _, flat, _ = parallel(3)
    flat[2, 3] = flat[4, 1] = np.nan
    axes, shifts, structure = _affine(flat, np.random.default_rng(1))
    made = np.einsum("txi,mi->tmx", axes, structure) + shifts[:, None]
    np.testing.assert_allclose(made[np.isfinite(flat)], flat[np.isfinite(flat)], atol=2e-4)
    np.testing.assert_allclose(np.cov(structure.T), np.eye(3), atol=1e-6)
    np.testing.assert_allclose(structure.mean(axis=0), 0.0, atol=1e-9)


@pytest.mark.parametrize(("frames", "enough"), [(3, True), (2, False)])
def test_three_frames_of_four_features_are_enough(frames, enough):
    *_, pixels = parallel(5)
    pixels[frames:, 1, 3:] = np.nan
    if enough:
        assert len(factorize(pixels, LENS, 1, np.random.default_rng(0))) == 2
        return
    with pytest.raises(DenseVSError, match="camera 1 saw 4 or more features of the hand in 2 samples"):
        factorize(pixels, LENS, 1, np.random.default_rng(0))


@pytest.mark.parametrize("depth", [0.0, 0.3])
def test_features_in_a_plane_are_refused(depth):
    *_, pixels = parallel(6, depth=depth)
    if depth:
        assert len(factorize(pixels, LENS, 1, np.random.default_rng(0))) == 2
        return
    with pytest.raises(DenseVSError, match="lie in a plane or line"):
        factorize(pixels, LENS, 1, np.random.default_rng(0))
