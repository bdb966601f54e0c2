"""A scene that two or three cameras share: what is completed by what is known, and the axes it is told in."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative.reconstruction import stereo
from dense_vs.generative.reconstruction.stereo import (
    Reconstruction,
    best_pair,
    centered,
    complete,
    in_first_camera,
    reconstruct,
)

LENSES = np.array([[600.0, 600, 320, 240, 0, 0], [650.0, 650, 310, 250, 0, 0], [620.0, 620, 330, 235, 0, 0]])
T, M = 9, 8


def scene(seed=0):
    """Poses of a hand of eight features before three cameras, in axes of nobody's."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(0.4 * rng.normal(size=(T, 3))).as_matrix()
    translation = 0.2 * rng.normal(size=(T, 3))
    structure = rng.uniform(-0.3, 0.3, (M, 3))
    structure -= structure.mean(axis=0)
    turns = Rotation.from_rotvec([[0.1, 0.2, 0.0], [0.1, -0.5, 0.1], [-0.2, 0.4, 0.0]]).as_matrix()
    shifts = np.array([[0.1, 0.0, 2.0], [0.9, 0.1, 2.2], [-0.7, 0.2, 2.4]])
    return Reconstruction(rotation, translation, structure, turns, shifts, np.ones(T, bool), np.ones(3, bool))


def shown(found):
    world = np.einsum("tij,mj->tmi", found.rotation, found.structure) + found.translation[:, None]
    seen = np.einsum("cij,tmj->tcmi", found.camera_rotation, world) + found.camera_translation[:, None]
    return seen[..., :2] / seen[..., 2:] * LENSES[:, None, :2] + LENSES[:, None, 2:4]


def copied(found, **changes):
    names = ("rotation", "translation", "structure", "camera_rotation", "camera_translation", "posed", "placed_cameras")
    return Reconstruction(**{name: changes.get(name, getattr(found, name).copy()) for name in names})


def assert_the_same(found, expected, atol=1e-6):
    """The same images, in the first camera's axes, and a median distance of 1 from it."""
    np.testing.assert_allclose(shown(found), shown(expected), atol=1e3 * atol)
    np.testing.assert_allclose(found.camera_rotation[0], np.eye(3), atol=atol)
    np.testing.assert_allclose(found.camera_translation[0], 0.0, atol=atol)
    assert np.median(np.linalg.norm(found.translation[found.posed], axis=1)) == pytest.approx(1.0)
    np.testing.assert_allclose(np.nanmean(found.structure, axis=0), 0.0, atol=atol)


@pytest.mark.parametrize("placed", [(True, True, True), (False, True, True), (False, False, True)])
def test_told_in_the_axes_of_the_first_camera_that_is_placed(placed):
    one = scene()
    found = in_first_camera(copied(one, placed_cameras=np.array(placed)))
    first = placed.index(True)
    np.testing.assert_allclose(found.camera_rotation[first], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found.camera_translation[first], 0.0, atol=1e-12)
    np.testing.assert_allclose(shown(found), shown(one), atol=1e-6)
    assert found.placed_cameras.tolist() == list(placed)


def test_the_unit_is_the_median_distance_of_the_hand_where_it_is_known():
    one = scene()
    one.posed[[2, 5]] = False
    one.translation[[2, 5]] += 50.0
    found = in_first_camera(one)
    distance = np.linalg.norm(one.translation @ one.camera_rotation[0].T + one.camera_translation[0], axis=1)
    np.testing.assert_allclose(np.linalg.norm(found.translation, axis=1), distance / np.median(distance[one.posed]))


def test_a_structure_about_its_middle():
    one = scene()
    before, middle = shown(one), np.array([0.3, -0.2, 0.1])
    one.structure = one.structure + middle
    one.translation = one.translation - one.rotation @ middle
    np.testing.assert_allclose(shown(one), before)
    one.structure[3] = np.nan
    found = centered(one)
    np.testing.assert_allclose(np.nanmean(found.structure, axis=0), 0.0, atol=1e-12)
    kept = np.arange(M) != 3
    np.testing.assert_allclose(shown(found)[:, :, kept], before[:, :, kept])


def test_the_pair_that_saw_most_together():
    seen = np.zeros((4, 3, 5), bool)
    seen[:, 0] = True
    seen[:3, 1] = True
    seen[:, 2, :4] = True
    assert best_pair(seen) == (0, 2, 16)
    seen[3, 1, :2] = True
    assert best_pair(seen) == (0, 1, 17)
    assert best_pair(seen[:, :1]) == (0, 0, 0)
    assert best_pair(np.zeros((4, 3, 5), bool))[2] == 0


def test_what_is_missing_is_placed_by_what_is_known():
    one = scene()
    pixels = shown(one)
    rotation, translation, structure = one.rotation.copy(), one.translation.copy(), one.structure.copy()
    posed = np.ones(T, bool)
    posed[4] = False
    rotation[4], translation[4] = np.eye(3), 0.0
    structure[6] = np.nan
    begun = copied(one, rotation=rotation, translation=translation, structure=structure, posed=posed,
                   placed_cameras=np.array([True, True, False]))  # fmt: skip
    begun.camera_rotation[2], begun.camera_translation[2] = np.eye(3), 0.0
    found = complete(begun, pixels, LENSES)
    assert_the_same(found, one)
    assert found.posed.all()
    assert found.placed_cameras.all()
    assert begun.placed_cameras.tolist() == [True, True, False]  # as it was


@pytest.mark.parametrize(("shared", "placed"), [(6, True), (5, False)])
def test_six_known_points_place_a_camera(shared, placed):
    one = scene()
    pixels = shown(one)
    hidden = np.ones((T, M), bool)
    hidden.reshape(-1)[np.arange(shared) * 11] = False
    pixels[:, 2][hidden] = np.nan
    found = complete(copied(one, placed_cameras=np.array([True, True, False])), pixels, LENSES)
    assert found.placed_cameras.tolist() == [True, True, placed]


def test_the_camera_that_sees_most_of_what_is_known_is_placed_first(monkeypatch):
    one = scene()
    pixels = shown(one)
    pixels[3:, 1] = np.nan
    order = []
    resect = stereo.resect

    def kept(world, flat):
        order.append(len(world))
        return resect(world, flat)

    monkeypatch.setattr(stereo, "resect", kept)
    begun = copied(one, placed_cameras=np.array([True, False, False]))
    found = complete(begun, pixels, LENSES)
    assert order == [T * M, 3 * M]
    assert found.placed_cameras.all()
    monkeypatch.setattr(stereo, "resect", lambda world, flat: None)
    assert complete(begun, pixels, LENSES).placed_cameras.tolist() == [True, False, False]


@pytest.mark.parametrize(("matches", "enough"), [(12, True), (11, False)])
def test_twelve_matches_of_two_cameras_are_enough(monkeypatch, matches, enough):
    one = scene()
    pixels = shown(one)
    pixels[:, 1] = np.nan
    hidden = np.ones((T, M), bool)
    hidden.reshape(-1)[:matches] = False
    pixels[:, 2][hidden] = np.nan
    asked = []
    monkeypatch.setattr(stereo, "relative_poses", lambda *given: asked.append(given) or [])
    if not enough:
        with pytest.raises(DenseVSError, match=r"cameras 0 and 2, the best pair, .* together in 11 cases"):
            next(reconstruct(pixels, LENSES, None))
        return
    assert list(reconstruct(pixels, LENSES, "rng")) == []
    first, second, focal, rng = asked[0]
    assert (first.shape, second.shape, rng) == ((12, 2), (12, 2), "rng")
    assert focal == pytest.approx((600 + 620) / 2)
    np.testing.assert_allclose(first[0], (pixels[0, 0, 0] - [320, 240]) / 600)


def test_exact_images_of_two_cameras_give_back_the_scene():
    one = scene()
    pixels = shown(one)
    found = next(reconstruct(pixels, LENSES, np.random.default_rng(0)))
    assert_the_same(found, one, 1e-3)
    assert found.posed.all()
    assert found.placed_cameras.all()
    assert isinstance(found, Reconstruction)
