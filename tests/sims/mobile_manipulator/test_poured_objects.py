"""Objects that are poured end up in the tray, at rest, in a heap that another pour does not repeat."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator import poured_objects
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.poured_objects import COUNTER, FLOOR, TRAY, TRAY_HALF, add_tray, in_tray, pour
from dense_vs.sims.mobile_manipulator.world import MobileWorld

NAMES = ["Tuna", "Marker", "Foam Brick", "Gelatin"]


@pytest.fixture(scope="module")
def world():
    world = MobileWorld(NAMES, seed=2, device="cpu", additions=(add_tray,))
    world.set_posture(posture("above", forward=-3.0, lateral=2.5))
    return world


def test_poured_objects_lie_in_the_tray(world):
    heaps = []
    for seed in (1, 2):
        pour(world, NAMES, np.random.default_rng(seed))
        places = np.array([world.object_center(name) for name in NAMES])
        assert all(in_tray(place) for place in places)
        assert places[:, 2].min() > FLOOR
        before = places.copy()
        world.wait(15)
        np.testing.assert_allclose([world.object_center(name) for name in NAMES], before, atol=0.01)
        heaps.append(places)
    assert np.abs(heaps[0] - heaps[1]).max() > 0.02


def test_a_pour_that_does_not_stay_is_said(world, monkeypatch):
    monkeypatch.setattr(poured_objects, "_POURS", 1)
    monkeypatch.setattr(poured_objects, "TRAY", (1.0, -3.5))  # bare floor
    with pytest.raises(DenseVSError, match="expected fewer objects"):
        pour(world, ["Tuna"], np.random.default_rng(0))


@pytest.mark.parametrize(
    ("offset", "inside"),
    [
        ((0.0, 0.0, FLOOR + 0.01), True),
        ((TRAY_HALF[0] - 0.001, 0.0, FLOOR + 0.01), True),
        ((TRAY_HALF[0] + 0.001, 0.0, FLOOR + 0.01), False),
        ((0.0, -TRAY_HALF[1] + 0.001, FLOOR + 0.24), True),
        ((0.0, -TRAY_HALF[1] - 0.001, FLOOR + 0.01), False),
        ((0.0, 0.0, COUNTER), False),
        ((0.0, 0.0, FLOOR + 0.26), False),
    ],
)
def test_in_the_tray(offset, inside):
    assert in_tray(np.array([*TRAY, 0.0]) + offset) is inside
