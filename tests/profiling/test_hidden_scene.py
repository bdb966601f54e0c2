"""A plate before the camera and a camera that sees a part: where both are, by the whole image and by hand."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import hidden_scene
from hidden_scene import HEIGHT, WIDTH, Covering, NarrowWorld, places_out_of_sight

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.faults import FaultInjector

PLACE = np.array([100.0, 60.0])
OUTSIDE = WIDTH + 42.0  # middle of a plate that is just out of the image


@pytest.fixture
def covering(monkeypatch):
    """A plate before gray images, whose world's time and image are set by hand."""
    world = SimpleNamespace(time=5.0, joint_names=["a"])

    def init(self, world, *, seed=0):
        self.world = world

    monkeypatch.setattr(FaultInjector, "__init__", init)
    monkeypatch.setattr(FaultInjector, "read", lambda self: (world.image, world.time))
    world.image = np.full((HEIGHT, WIDTH, 3), 7, np.uint8)
    return Covering(world, seed=2)


@pytest.mark.parametrize(
    ("since", "middle"),
    [
        (0.0, (OUTSIDE + 12.0, 60.0)),
        (0.25, (100 + 6.0 + (OUTSIDE - 100) / 2, 60 + 12 * np.sin(np.pi / 3))),
        (0.5, (100 - 6.0, 60 + 12 * np.sin(np.pi / 3))),  # a third of a circle; it has come
        (1.5, (112.0, 60.0)),
        (2.5, (100 - 6.0, 60 - 12 * np.sin(np.pi / 3))),
        (2.9, (100 + 12 * np.cos(np.pi * 2 / 15) + 0.8 * (OUTSIDE - 100), 60 - 12 * np.sin(np.pi * 2 / 15))),
        (2.98, (100 + 12 * np.cos(np.pi * 0.08 / 3) + 0.96 * (OUTSIDE - 100), 60 - 12 * np.sin(np.pi * 0.08 / 3))),
        (2.984, None),  # half a frame before it ends
        (3.0, None),
    ],
)
def test_a_plate_comes_circles_and_goes(covering, since, middle):
    covering.pass_by(PLACE)
    found = covering._on_the_way(5.0 + since)
    assert found is None if middle is None else found == pytest.approx(np.array(middle))


def test_what_is_behind_a_plate_is_not_seen(covering):
    world = covering.world
    image, time = covering.read()
    assert (image is world.image, time) == (True, 5.0)
    assert not covering.plate.any()
    covering.stand(np.array([100.0, 60.0]))
    image, _ = covering.read()
    y, x = np.nonzero(covering.plate)
    assert (x.min(), x.max(), y.min(), y.max()) == (68, 131, 28, 91)
    assert (image[~covering.plate] == 7).all()
    assert (image[covering.plate] >= 20).all()
    assert image[covering.plate].std() > 30  # it has a texture
    assert (world.image == 7).all()  # what the world gave is left as it is
    covering.stand(None)
    assert covering.read()[0] is world.image
    covering.pass_by(PLACE)
    world.time = 6.5
    image, time = covering.read()
    y, x = np.nonzero(covering.plate)
    assert (x.min(), x.max(), y.min(), y.max()) == (70, 153, 18, 101)  # about (112, 60)
    assert time == 6.5
    before = image[50, 100:110]
    world.time = 6.5 + 0.375  # a quarter of a circle: the texture goes with the plate
    np.testing.assert_array_equal(covering.read()[0][62, 88:98], before)
    world.time = 8.0
    assert covering.read()[0] is world.image
    assert not covering.plate.any()


@pytest.mark.parametrize(("place", "shown"), [((0.0, 0.0), 32 * 32), ((319, 100), 33 * 64), ((400, 100), 0)])
def test_a_plate_at_the_border_is_cut(covering, place, shown):
    covering.stand(np.array(place))
    image, _ = covering.read()
    assert covering.plate.sum() == shown
    assert (image != 7).any(axis=2).sum() == shown


@pytest.fixture(scope="module")
def narrow():
    return NarrowWorld("arm", seed=4, device="cpu")


def test_the_part_that_is_seen_is_that_of_the_whole_image(narrow):
    """By a world of the same seed with all of the image: what lies at a pixel of the part lies at it plus offset."""
    whole = SimWorld("arm", seed=4, device="cpu", height=360, width=480)
    np.testing.assert_array_equal(narrow.offset, [80, 60])
    part = slice(60, 300), slice(80, 400)
    step = np.full(len(whole.joint_names), 0.02)
    for world in (narrow, whole):
        world.step(step)
    seen, all_of_it = narrow.frame(), whole.frame()
    assert seen.rgb.shape == (HEIGHT, WIDTH, 3)
    for name in ("rgb", "depth", "ids"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(all_of_it, name)[part])
    np.testing.assert_allclose(narrow.true_jacobian(), whole.true_jacobian()[part])
    mask = narrow.robot_mask()
    np.testing.assert_array_equal(mask, whole.robot_mask()[part])
    y, x = np.argwhere(mask)[len(np.argwhere(mask)) // 2]
    point, same = narrow.track_point([x, y]), whole.track_point([x + 80, y + 60])
    np.testing.assert_array_equal(point.geoms, same.geoms)
    np.testing.assert_allclose(point.local, same.local)
    for world in (narrow, whole):
        world.step(step)
    np.testing.assert_allclose(narrow.project(point), whole.project(same) - [80, 60])
    assert np.linalg.norm(narrow.project(point) - [x, y]) > 1  # it has moved


@pytest.mark.parametrize(
    ("where", "places", "ends"),
    [
        (
            "behind",
            [
                (157.0, 100.0, True),  # too near to where the point is: the plate would cover it
                (300.0, 100.0, False),  # turned away
                (306.0, 100.0, True),  # too near to the border
                (200.0, 100.0, True),
                (257.0, 100.0, True),  # behind the plate
                (258.0, 100.0, False),
                (258.0, 100.0, True),
            ],
            (3, 6),
        ),
        (
            "outside",
            [
                (100.0, 100.0, True),
                (-14.0, 100.0, True),  # not far enough
                (-61.0, 100.0, True),
                (100.0, 254.0, False),  # outside, whichever way it faces
                (100.0, 225.0, True),
                (-30.0, 100.0, True),
                (100.0, 224.0, True),
            ],
            (3, 6),
        ),
    ],
)
def test_places_out_of_sight_and_back(monkeypatch, where, places, ends):
    drawn = iter([(np.array(place[:2]), place[2]) for place in places])
    monkeypatch.setattr(hidden_scene, "_drawn", lambda *_: next(drawn))
    away, back = places_out_of_sight(None, None, np.array([100.0, 100.0]), where, (1, 2))
    for found, number in zip((away, back), ends, strict=True):
        np.testing.assert_array_equal(found, places[number][:2])


def test_a_place_that_is_not_found_is_told(monkeypatch):
    monkeypatch.setattr(hidden_scene, "_drawn", lambda *_: (np.array([100.0, 100.0]), True))
    with pytest.raises(DenseVSError, match="no way outside and back was found in 4000 random postures"):
        places_out_of_sight(None, None, np.array([100.0, 100.0]), "outside", (1, 2))


def test_a_posture_that_is_drawn_is_one_that_the_arm_can_take(narrow):
    """The middle of the joints' ranges draws the pixel that the world shows once it is there."""
    mask = narrow.robot_mask()
    y, x = np.argwhere(mask)[len(np.argwhere(mask)) // 2]
    point = narrow.track_point([x, y])
    middle = narrow.joint_limits.mean(axis=1) - narrow.joints()[0]
    pixel, _ = hidden_scene._drawn(narrow, point, SimpleNamespace(uniform=lambda low, high, count: np.zeros(count)))
    for _ in range(200):
        off = narrow.joint_limits.mean(axis=1) - narrow.joints()[0]
        if np.abs(off).max() < 1e-4:
            break
        narrow.step(np.clip(off, -0.03, 0.03))
    assert np.abs(middle).max() > 0.01
    assert pixel == pytest.approx(narrow.project(point), abs=0.2)
    random = np.random.default_rng(0)
    places = np.array([hidden_scene._drawn(narrow, point, random)[0] for _ in range(20)])
    assert np.ptp(places, axis=0).min() > 5
