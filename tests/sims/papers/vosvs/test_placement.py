"""Where objects stand, how a hand drags them, and what a trial does with them, in worlds made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.papers.vosvs import object_placement
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.dragging_hand import DraggingHand
from dense_vs.sims.papers.vosvs.object_placement import _hidden, floor_point, put_in_view, start_posture

K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
DOWN = np.diag([1.0, -1.0, -1.0])  # a camera that looks down, its image's up away from the robot
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class World:
    """One camera of a known pose, and one object that is where it is put."""

    def __init__(self, rotation=DOWN, place=(1.0, 2.0, 1.0), height=0.1, links=0):
        self.pose = np.eye(4)
        self.pose[:3, :3], self.pose[:3, 3] = rotation, place
        self.objects = {"Mug": SimpleNamespace(height=height, links=links)}
        self.placed, self.chained = [], []
        self.masks = None
        self.state = SimpleNamespace(geom_xpos=np.zeros((0, 3)))

    def camera_pose(self, camera):
        return self.pose

    def intrinsics(self, camera):
        return K

    def place(self, name, place, turn):
        assert -np.pi <= turn <= np.pi
        self.placed.append((*place, turn))

    def lay_chain(self, name, place, rng):
        self.chained.append(place)

    def true_mask(self, camera, name):
        mask = np.zeros((480, 640), bool)
        if self.masks:
            row, column = self.masks.pop(0)
            mask[row, column] = True
        else:
            mask[240, 320] = True
        return mask

    def geoms(self, name):
        return slice(None)

    def depth(self, camera):
        return self.depths


def test_a_pixel_s_point_on_the_floor_and_above_it():
    world = World()
    np.testing.assert_allclose(floor_point(world, "grasp", np.array([320.0, 240.0])), [1.0, 2.0, 0.0])
    np.testing.assert_allclose(floor_point(world, "grasp", np.array([420.0, 340.0])), [1.2, 1.8, 0.0])
    np.testing.assert_allclose(floor_point(world, "grasp", np.array([420.0, 240.0]), 0.5), [1.1, 2.0, 0.5])
    ahead = World(AHEAD)
    np.testing.assert_allclose(floor_point(ahead, "head", np.array([320.0, 490.0])), [3.0, 2.0, 0.0])
    assert floor_point(ahead, "head", np.array([320.0, 240.0])) is None  # the horizon
    assert floor_point(ahead, "head", np.array([320.0, 239.0])) is None
    assert floor_point(ahead, "head", np.array([320.0, 240.6])) is not None


def put(world, monkeypatch, centroids, hidden=(), config="base", **options):
    """Put the object in view where the centroids come one after the other; some places are hidden."""
    remaining, hides = list(centroids), list(hidden)
    monkeypatch.setattr(object_placement, "true_centroid", lambda *_: np.array(remaining.pop(0)))
    monkeypatch.setattr(object_placement, "_hidden", lambda *_: bool(hides and hides.pop(0)))
    return put_in_view(world, configuration(config), "Mug", np.random.default_rng(0), **options)


GOOD = (400.0, 300.0)


@pytest.mark.parametrize(
    ("centroid", "good"),
    [
        ((369.1, 300.0), True),  # 49 px, seven tenths of the least offset, from the target at (320, 240)
        ((368.9, 300.0), False),
        ((270.9, 300.0), True),
        ((400.0, 288.9), False),
        ((400.0, 191.1), False),
        ((400.0, 190.9), True),
        ((576.9, 300.0), True),  # 257 and 177 px from the middle: seven tenths of the border from the edge
        ((577.1, 300.0), False),
        ((62.9, 300.0), False),
        ((400.0, 416.9), True),
        ((400.0, 417.1), False),
        ((400.0, 62.9), False),
        ((np.nan, np.nan), False),
    ],
)
def test_an_object_stands_off_its_target_and_inside_the_image(monkeypatch, centroid, good):
    found = put(World(), monkeypatch, [centroid, GOOD])
    np.testing.assert_array_equal(found, centroid if good else GOOD)


def test_the_target_is_the_configuration_s(monkeypatch):
    """That of H_base grasp is at (220, 240)."""
    np.testing.assert_array_equal(put(World(), monkeypatch, [(268.9, 300.0), GOOD], config="base grasp"), GOOD)
    close = (269.1, 300.0)
    np.testing.assert_array_equal(put(World(), monkeypatch, [close, GOOD], config="base grasp"), close)


@pytest.mark.parametrize(
    ("place", "whole"),
    [
        ((12, 320), True),
        ((11, 320), False),
        ((467, 12), True),
        ((468, 12), False),
        ((240, 11), False),
        ((240, 627), True),
        ((240, 628), False),
    ],
)
def test_an_object_is_whole_in_the_image(monkeypatch, place, whole):
    world = World()
    world.masks = [place]
    found = put(world, monkeypatch, [(390.0, 300.0), GOOD])
    assert (found[0] == 390.0) == whole


def test_an_object_that_is_hidden_or_has_no_place(monkeypatch):
    np.testing.assert_array_equal(put(World(), monkeypatch, [(390.0, 300.0), GOOD], hidden=[True]), GOOD)
    with pytest.raises(DenseVSError, match="found no place for 'Mug' in 7 tries; expected one in view of 'base'"):
        put(World(), monkeypatch, [(320.0, 240.0)] * 7, tries=7)
    far = World(place=(0.0, 0.0, 3.0))
    with pytest.raises(DenseVSError, match="200 tries"):
        put(far, monkeypatch, [])  # no place is near enough to be looked at


def places(monkeypatch, world, config, count=150):
    """Pixels and distances of the places that are tried."""
    monkeypatch.setattr(object_placement, "true_centroid", lambda *_: np.array(GOOD))
    monkeypatch.setattr(object_placement, "_hidden", lambda *_: False)
    rng = np.random.default_rng(1)
    for _ in range(count):
        put_in_view(world, configuration(config), "Mug", rng)
    ground = np.array([one[:2] for one in world.placed])
    eye = world.pose[:3, 3]
    depth = eye[2] - 0.5 * world.objects["Mug"].height
    off = (ground - eye[:2]) * [1, -1] * 500 / depth
    return off + np.array([320, 240]), np.hypot(np.hypot(*(ground - eye[:2]).T), depth)


def test_places_are_drawn_over_the_image_off_the_target(monkeypatch):
    world = World(height=0.4)
    pixels, distances = places(monkeypatch, world, "base")
    off = np.abs(pixels - [320, 240])
    assert off.min() >= 70 - 1e-6
    assert 210 < off[:, 0].max() <= 230
    assert 140 < off[:, 1].max() <= 150
    assert (np.abs(np.sign(pixels - [320, 240]).mean(axis=0)) < 0.3).all()  # on all sides
    assert distances.max() < 1.2
    turns = np.array([one[3] for one in world.placed])
    assert turns.min() < -2
    assert turns.max() > 2
    assert all(one[2] == 0.0 for one in world.placed)


@pytest.mark.parametrize(("config", "height", "least", "most"), [("base", 1.15, 1.15, 1.2), ("head", 2.1, 2.1, 2.2)])
def test_places_are_near_enough(monkeypatch, config, height, least, most):
    _, distances = places(monkeypatch, World(place=(0.0, 0.0, height), height=0.0), config)
    assert distances.max() <= most
    assert distances.max() > 0.98 * most
    assert distances.min() >= least


def test_a_chain_is_laid(monkeypatch):
    world = World(links=9)
    put(world, monkeypatch, [GOOD])
    assert not world.placed
    (place,) = world.chained
    assert place[2] == 0.0


@pytest.mark.parametrize(("depth", "hidden"), [(0.86, False), (0.85, False), (0.84, True)])
def test_an_object_is_hidden_by_what_stands_before_any_part_of_it(depth, hidden):
    """Its parts are 1 m from the camera; the surface of a part is at most 0.15 m before its middle."""
    world = World()
    world.state.geom_xpos = np.array([[1.0, 2.0, 0.0], [1.2, 1.8, 0.0]])
    world.depths = np.full((480, 640), 1.0)
    world.depths[340, 420] = depth
    assert _hidden(world, "grasp", "Mug") == hidden
    world.depths[:] = 0.5
    world.depths[[240, 340], [320, 420]] = 1.0
    assert not _hidden(world, "grasp", "Mug")  # what stands beside its parts hides nothing


@pytest.mark.parametrize(("depth", "hidden"), [(1.86, False), (1.84, True)])
def test_an_object_far_from_the_camera_is_hidden_where_it_is_seen(depth, hidden):
    """A part 2 m before the camera, 0.2 m to its right and below: 50 px from the middle, not 200."""
    world = World(place=(1.0, 2.0, 2.0))
    world.state.geom_xpos = np.array([[1.2, 1.8, 0.0]])
    world.depths = np.full((480, 640), 2.0)
    world.depths[290, 370] = depth
    assert _hidden(world, "grasp", "Mug") == hidden


@pytest.mark.parametrize(("pixel", "hidden"), [((0, 0), False), ((639, 479), False), ((-1, 0), True), ((0, -1), True),
                                               ((640, 0), True), ((0, 480), True)])  # fmt: skip
def test_a_part_outside_the_image_is_hidden(pixel, hidden):
    world = World()
    x, y = (np.array(pixel) - [320, 240]) / 500
    world.state.geom_xpos = np.array([[1.0, 2.0, 0.0], [1.0 + x, 2.0 - y, 0.0]])
    world.depths = np.full((480, 640), 1.0)
    assert _hidden(world, "grasp", "Mug") == hidden


def test_the_robot_starts_on_clear_floor():
    q = start_posture(configuration("base"))
    named = dict(zip(JOINTS, q, strict=True))
    assert (named["base_forward"], named["base_lateral"]) == (-3.0, 2.5)


class Chain:
    """A chain whose end is where it is pulled to."""

    def __init__(self):
        self.frames, self.end, self.pulls = 500, np.array([1.0, 1.0, 0.3]), []

    def object_position(self, name):
        return np.array([1.0, 1.0, 0.0])

    def pull_chain(self, name, place):
        if place is not None:
            self.end = place.copy()
        self.pulls.append(place is not None)
        return self.end.copy()


@pytest.fixture(scope="module")
def dragged():
    """Places of the hand, a thousand frames, at 0.25 m/s between jerks."""
    chain = Chain()
    hand = DraggingHand(chain, "Chain", 0.25, np.random.default_rng(2))
    found = [chain.end[:2].copy()]
    for _ in range(3000):
        hand()
        chain.frames += 1
        found.append(chain.end[:2].copy())
    assert chain.end[2] == 0.012
    assert chain.pulls[1:] == [True] * 3000
    hand.let_go()
    assert not chain.pulls[-1]
    return np.array(found)


def test_a_hand_is_as_fast_as_told_and_jerks_for_a_twentieth_of_every_four_seconds(dragged):
    speed = np.hypot(*np.diff(dragged, axis=0).T) / FRAME_SECONDS
    phase = np.arange(3000) % 120
    # It takes 2 frames to 0.25 m/s and 6 to 0.8 m/s.
    assert np.median(speed[phase == 5]) == pytest.approx(0.8, abs=0.01)
    assert np.median(speed[phase == 2]) < 0.7
    assert np.median(speed[(phase > 12)]) == pytest.approx(0.25, abs=0.01)
    assert speed[(phase > 20)].max() < 0.26
    assert speed.max() < 0.81


def test_a_hand_is_accelerated_gently(dragged):
    change = np.hypot(*np.diff(np.diff(dragged, axis=0), axis=0).T) / FRAME_SECONDS**2
    assert change.max() <= 4.0 + 1e-6
    assert change.max() > 3.9


def test_a_hand_winds_and_stays_in_the_room(dragged):
    away = np.hypot(*(dragged - 1.0).T)
    assert 0.8 < away.max() < 1.15
    step = np.diff(dragged, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    calm = np.abs(np.diff(heading))[(away[1:-1] < 0.85) & (np.arange(2999) % 120 > 20)]
    assert 0.02 < np.median(calm) < 0.06
    assert np.ptp(dragged, axis=0).min() > 0.9  # about the whole room
