"""Rooms that masks are learned in are not the trials', their clutter neither, and clutter touches nothing."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator import training_rooms
from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS
from dense_vs.sims.mobile_manipulator.clutter_objects import (
    clutter_learned_among,
    clutter_met_in_trials,
    clutter_objects,
)
from dense_vs.sims.mobile_manipulator.clutter_placement import (
    Region,
    distance_to_boxes,
    footprint,
    footprint_radius,
    scatter,
)
from dense_vs.sims.mobile_manipulator.model import compile_model
from dense_vs.sims.mobile_manipulator.objects import household_objects
from dense_vs.sims.mobile_manipulator.scenery import (
    APART,
    HEIGHTS_APART,
    PATTERNS,
    OtherRoom,
    Surface,
    draw_scenery,
    surface_texture,
    trial_colors,
)
from dense_vs.sims.mobile_manipulator.training_rooms import TrainingRooms, learn_segmenters, learn_segmenters_here
from dense_vs.sims.mobile_manipulator.world import MobileWorld


def test_other_rooms_look_unlike_the_trials_room():
    known, rooms = trial_colors(), [draw_scenery(seed, number) for seed in (501, 502) for number in range(5)]
    for room in rooms:
        surfaces = [room.floor, room.wall, *(one.surface for one in room.supports)]
        colors = np.array([one.color for one in surfaces])
        assert np.linalg.norm(colors[:, None] - known, axis=2).min() > APART
        # What is drawn is about that color, however it is patterned.
        means = np.array([surface_texture(one).mean(axis=(0, 1)) / 255 for one in surfaces])
        assert np.linalg.norm(means[:, None] - known, axis=2).min() > APART / 2
        heights = np.array([one.height for one in room.supports])
        assert np.abs(heights[:, None] - [z for _, _, z in SUPPORTS]).min() > HEIGHTS_APART
        assert room.places[0] == SUPPORTS[0]
        assert [place[2] for place in room.places[1:]] == heights.tolist()
    assert len({room.floor for room in rooms}) == len(rooms)
    assert draw_scenery(501, 3) == draw_scenery(501, 3)


def test_a_model_is_furnished_and_its_objects_stay_as_they_are():
    room = draw_scenery(7, 0)
    usual, objects = compile_model(["Mug"], 7)
    other, _ = compile_model(["Mug"], 7, (OtherRoom(room),))
    for name, support in zip(("green_bin", "blue_bin"), room.supports, strict=True):
        geom = other.geom(name)
        np.testing.assert_allclose(geom.pos, [*support.middle, support.height / 2])
        np.testing.assert_allclose(geom.size, [*support.half, support.height / 2])
    for light, lamp in enumerate(room.lamps):
        np.testing.assert_allclose(other.light_diffuse[light], lamp.diffuse, rtol=1e-6)
        turned = other.light_dir[light] @ usual.light_dir[light] / np.linalg.norm(usual.light_dir[light])
        assert turned < 0.999
    assert other.vis.headlight.ambient[0] == pytest.approx(room.ambient)
    assert other.ngeom == usual.ngeom + 3  # walls
    assert texture(usual, "mug_body").tobytes() == texture(other, "mug_body").tobytes()
    assert objects["Mug"].name == "Mug"
    floor = texture(other, "other_floor")
    np.testing.assert_array_equal(floor, surface_texture(room.floor))


def texture(model, name):
    one = model.texture(name)
    start, size = int(one.adr[0]), int(one.height[0] * one.width[0] * 3)
    return model.tex_data[start : start + size].reshape(int(one.height[0]), int(one.width[0]), 3)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_pattern_has_its_color_and_structure(pattern):
    image = surface_texture(Surface((0.7, 0.5, 0.3), pattern, 3)).astype(float) / 255
    np.testing.assert_allclose(image.mean(axis=(0, 1)), [0.7, 0.5, 0.3], rtol=0.15)
    assert image.std(axis=(0, 1)).max() > 0.005


def test_a_pattern_that_does_not_exist():
    with pytest.raises(DenseVSError, match="pattern is 'paisley'; expected one of mottled"):
        surface_texture(Surface((0.5, 0.5, 0.5), "paisley", 0))


def test_clutter_is_none_of_the_objects_and_none_of_it_is_known():
    learned, met = set(clutter_learned_among()), set(clutter_met_in_trials())
    assert learned | met == set(clutter_objects())
    assert not learned & met
    assert not (learned | met) & set(household_objects())


def test_distance_to_boxes():
    boxes = [np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[10.0, 10.0], [11.0, 11.0]])]
    assert distance_to_boxes(np.array([1.0, 0.5]), boxes) == 0.0
    assert distance_to_boxes(np.array([5.0, 5.0]), boxes) == pytest.approx(5.0)
    assert distance_to_boxes(np.array([-3.0, 0.5]), boxes) == pytest.approx(3.0)
    assert distance_to_boxes(np.array([1.0, 1.5]), boxes) == pytest.approx(0.5)
    assert distance_to_boxes(np.array([1.0, 1.0]), []) == np.inf


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Mug", "Foam Brick", *clutter_met_in_trials()], seed=2, noise=0.0, threads=1)


def test_footprints(world):
    world.store()
    world.place("Foam Brick", (1.0, 0.0, 0.125), np.pi / 2, settle_frames=1)
    (box,) = footprint(world, "Foam Brick")
    np.testing.assert_allclose(box, [[1.0 - 0.0265, -0.039], [1.0 + 0.0265, 0.039]], atol=1e-4)
    assert footprint_radius(world, "Foam Brick") == pytest.approx(np.hypot(0.0265, 0.039), abs=1e-4)


def test_clutter_keeps_clear_of_the_object_and_on_its_support(world):
    region, rng, count = Region((1.0, 0.0), (0.17, 0.22), 0.125), np.random.default_rng(0), 0
    for _ in range(4):
        world.store()
        world.place("Mug", (1.02, -0.04, 0.125), rng.uniform(-3, 3))
        placed = scatter(world, clutter_met_in_trials()[:4], region, ["Mug"], rng, gap=0.03)
        count += len(placed)
        pairs = [(a, b) for k, a in enumerate(["Mug", *placed]) for b in placed[k:]]
        distances = [gap_between(world, a, b) for a, b in pairs]
        assert min(distances) > 0.025
        for name in placed:
            corners = np.concatenate(footprint(world, name))
            assert np.all(np.abs(corners - region.middle) < np.array(region.half) + 1e-3)
            assert world.lowest_point(name) == pytest.approx(0.125, abs=0.003)
    assert count > 10
    # Nothing is put where there is no room.
    crowded = Region((1.02, -0.04), (0.05, 0.05), 0.125)
    assert scatter(world, ["Paperback"], crowded, [], rng) == []
    assert scatter(world, ["Lime"], crowded, ["Mug"], rng) == []
    with pytest.raises(DenseVSError, match=r"gap is -0\.1"):
        scatter(world, ["Lime"], region, [], rng, gap=-0.1)


def gap_between(world, one, other):
    """Shortest way between the geoms of two objects [m], by the engine."""
    fromto = np.zeros(6)
    return min(
        mujoco.mj_geomDistance(world.model, world.state, int(a), int(b), 1.0, fromto)
        for a in world.geoms(one)
        for b in world.geoms(other)
    )


def test_images_come_from_all_rooms_in_turn(monkeypatch):
    """Their clutter is put about the object, and what one object sees does not depend on those before it."""
    rooms = TrainingRooms(["Mug", "Tuna"], 3, threads=1, rooms=2)
    scattered = []

    def spread(world, names, region, clear_of, rng, *, gap):
        scattered.append((rooms.worlds.index(world), region, tuple(clear_of)))
        return scatter(world, names, region, clear_of, rng, gap=gap)

    monkeypatch.setattr(training_rooms, "scatter", spread)
    seen = rooms.annotate("Mug", np.random.default_rng(1), count=2)
    assert [one[0] for one in scattered] == [0, 1]
    assert all(one[2] == ("Mug",) for one in scattered)
    for room, region, _ in scattered:
        assert (*region.middle, region.height) in rooms.sceneries[room].places
    assert all(200 < mask.sum() < 40_000 for mask in seen.masks)
    rooms.annotate("Tuna", np.random.default_rng(2), count=1)
    again = rooms.annotate("Mug", np.random.default_rng(1), count=2)
    for one, other in zip(seen.images, again.images, strict=True):
        np.testing.assert_array_equal(one, other)


def test_segmenters_are_learned_one_by_one(monkeypatch):
    made = []

    class Rooms:
        def __init__(self, objects, seed, threads):
            made.append((tuple(objects), seed, threads))

        def learn_segmenter(self, name):
            return f"masks of {name}"

    monkeypatch.setattr(training_rooms, "TrainingRooms", Rooms)
    assert learn_segmenters(["Mug", "Dice"], 4, 1) == {"Mug": "masks of Mug", "Dice": "masks of Dice"}
    assert made == [(("Mug", "Dice"), 4, 1)]
    pools = []

    class Pool:
        def __init__(self, jobs, mp_context):
            pools.append(jobs)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def submit(self, function, *arguments):
            return SimpleNamespace(result=lambda: function(*arguments))

    monkeypatch.setattr(training_rooms, "ProcessPoolExecutor", Pool)
    names = ["Mug", "Dice", "Tuna"]
    learned = learn_segmenters(names, 4, 1, jobs=2)
    assert list(learned.items()) == [(name, f"masks of {name}") for name in names]
    assert pools == [2]
    assert made[1:] == [(tuple(names), 4, 1)] * 2  # all rooms hold the same objects
    learn_segmenters(names, 4, 1, jobs=9)
    assert pools == [2, 3]
    monkeypatch.setattr(training_rooms, "annotate_for", lambda world, name, seed: f"{name} in {world}")
    monkeypatch.setattr(training_rooms, "fit_segmenter", lambda seen, seed: (seen, seed))
    here = {name: (f"{name} in world", 4) for name in names}
    assert learn_segmenters_here("world", names, 4) == here
    assert pools == [2, 3]
    assert learn_segmenters_here("world", names, 4, jobs=2) == here
    assert pools == [2, 3, 2]
    with pytest.raises(DenseVSError, match="jobs"):
        learn_segmenters_here("world", names, 4, jobs=0)
    with pytest.raises(DenseVSError, match="jobs"):
        learn_segmenters(names, 4, 1, jobs=0)
