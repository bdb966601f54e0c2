"""VOS-DE from areas: the exact least-squares solution of (20), a recorded approach, and what cannot be told."""

import numpy as np
import pytest
from shared_data import SHARED_DATA

from dense_vs import DenseVSError
from dense_vs.depth import DepthUnobservableError, depth_from_areas

LOG = SHARED_DATA / "sugar_box_approach.csv"


def test_exact_areas_give_the_exact_depth():
    z = np.linspace(0.7, 0.35, 8)
    found = depth_from_areas((30.0 / (z - 0.12)) ** 2, z)
    assert found.z_object == pytest.approx(0.12, abs=1e-12)
    assert found.c_object == pytest.approx(30.0)
    assert found.distance == pytest.approx(0.35 - 0.12)
    np.testing.assert_allclose(found.residuals, 0, atol=1e-12)
    assert found.distance_std < 1e-12
    assert found.used.all()


def test_noisy_areas_give_the_normal_equations_solution():
    rng = np.random.default_rng(0)
    z = np.linspace(0.7, 0.35, 12)
    areas = (30.0 / (z - 0.12)) ** 2 * rng.uniform(0.9, 1.1, 12)
    size = np.sqrt(areas)
    A = np.stack([size, np.ones(12)], axis=1)
    expected = np.linalg.inv(A.T @ A) @ A.T @ (z * size)
    found = depth_from_areas(areas, z)
    np.testing.assert_allclose([found.z_object, found.c_object], expected, rtol=1e-9)
    np.testing.assert_allclose(found.residuals, A @ expected - z * size, atol=1e-9)


def test_the_standard_error_is_that_of_repeated_approaches():
    """(20) has its noise in the regressor too, so only for small noise."""
    rng = np.random.default_rng(1)
    z = np.linspace(0.7, 0.35, 20)
    size = 30.0 / (z - 0.12)
    found = [depth_from_areas((size + rng.normal(0, 0.05, 20)) ** 2, z) for _ in range(300)]
    spread = np.std([one.z_object for one in found])
    told = np.mean([one.distance_std for one in found])
    assert told == pytest.approx(spread, rel=0.35)


@pytest.mark.skipif(not LOG.is_file(), reason="needs ../shared/data/sugar_box_approach.csv")
def test_the_recorded_approach_gives_the_published_depth():
    areas, z = np.loadtxt(LOG, delimiter=",", skiprows=1, unpack=True)
    assert depth_from_areas(areas, z).z_object == pytest.approx(0.17978791, abs=1e-6)


def test_views_without_a_mask_are_left_out_unless_asked_for():
    z = np.linspace(0.7, 0.35, 8)
    areas = (30.0 / (z - 0.12)) ** 2
    areas[3] = 0
    found = depth_from_areas(areas, z)
    assert found.z_object == pytest.approx(0.12, abs=1e-12)
    assert found.used.tolist() == [k != 3 for k in range(8)]
    assert np.isnan(found.residuals[3])
    assert depth_from_areas(areas, z, keep_empty=True).z_object != pytest.approx(0.12, abs=1e-3)


def test_two_views_have_no_standard_error():
    found = depth_from_areas([100.0, 400.0], [0.6, 0.4])
    assert found.z_object == pytest.approx(0.2)
    assert found.distance_std == np.inf


@pytest.mark.parametrize(
    ("areas", "camera_z", "message"),
    [
        ([100.0], [0.5], "1 views show the object"),
        ([100.0, 0.0, 0.0], [0.5, 0.4, 0.3], "1 views show the object"),
        ([100.0, 110.0, 120.0], [0.5, 0.5, 0.5], "the camera moves 0 m"),
        ([100.0, 100.0, 100.0], [0.5, 0.4, 0.3], "100 px in all 3 views"),
    ],
)
def test_an_unobservable_depth_is_told(areas, camera_z, message):
    with pytest.raises(DepthUnobservableError, match=message):
        depth_from_areas(areas, camera_z)


@pytest.mark.parametrize(
    ("areas", "camera_z", "message"),
    [
        ([100.0, -1.0], [0.5, 0.4], "expected none below 0"),
        ([100.0, np.nan], [0.5, 0.4], "finite"),
        ([100.0, 200.0], [0.5, np.inf], "camera_z have shape"),
        ([100.0, 200.0], [0.5, 0.4, 0.3], "the same length"),
        ([[100.0, 200.0]], [0.5, 0.4], r"shape \(1, 2\)"),
        (["a", "b"], [0.5, 0.4], "finite numbers"),
    ],
)
def test_bad_input_is_refused(areas, camera_z, message):
    with pytest.raises(DenseVSError, match=message):
        depth_from_areas(areas, camera_z)
