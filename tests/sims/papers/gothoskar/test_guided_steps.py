"""The steps of guided motion, of following a drift and of relearning, on cells and models made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.sims.papers.gothoskar import guided_motion
from dense_vs.sims.papers.gothoskar.grasp import grasp
from dense_vs.sims.papers.gothoskar.guided_motion import (
    Guide,
    _allowed_posture,
    _often_seen,
    _postures_for,
    approach,
    average_sight,
    joints_for,
    learn_arm,
    learn_structure,
)
from dense_vs.sims.papers.gothoskar.insertion import ABOVE, INSIDE, insert
from dense_vs.sims.workcell.cell import HAND_MARKERS

HOME = np.array([0.1, 0.2, 0.3])
AWAY = np.array([0.4, 0.0, 0.0])
HAND = 4 * len(HAND_MARKERS)


class Cell:
    """An arm of three joints that goes a share of the way; its tool is as high as its second joint is large."""

    def __init__(self, share=1.0, lowest=0.0):
        self.q, self.share, self.sent = HOME.copy(), share, []
        self.chain = SimpleNamespace(home=HOME, flange_pose=self.flange_pose)
        self.image_sizes = ((640, 480), (640, 480))
        self.looks = []

    def flange_pose(self, joints):
        pose = np.eye(4)
        pose[2, 3] = joints[1] + 0.08 + 0.0 * joints[0]
        return pose

    def encoders(self):
        return self.q.copy()

    def command(self, step):
        self.sent.append(np.array(step))
        self.q = self.q + self.share * step

    def see(self, markers):
        return self.looks.pop(0) if self.looks else self.view(len(markers))

    def view(self, markers):
        """Both cameras see all corners where the joints' sum says."""
        return np.full((2, 4 * markers, 2), 100.0 * self.q.sum())

    def intrinsics_guess(self):
        return "guess"


class Model:
    """Pixels are 100 times the joints' sum; joints are inferred exactly, near where the cell is."""

    def __init__(self, cell):
        self.cell, self.near = cell, []
        self.parameters = SimpleNamespace(features=np.zeros((HAND, 3)), joint_count=3)

    def pixels(self, joints):
        return np.broadcast_to(100.0 * joints.sum(axis=1)[:, None, None, None], (len(joints), 2, HAND, 2))

    def infer_joints(self, pixels, near=None):
        self.near.append(near)
        return self.cell.q.copy()


def guide_of(cell):
    return Guide(cell, Model(cell), np.arange(HAND), None)


def test_motions_are_repeated_by_what_is_inferred():
    cell = Cell(share=0.5)
    guide = guide_of(cell)
    goal = HOME + AWAY
    last = approach(guide, goal, 3)
    np.testing.assert_allclose(cell.q, HOME + 0.875 * AWAY)
    np.testing.assert_allclose([step[0] for step in cell.sent], [0.4, 0.2, 0.1])
    np.testing.assert_array_equal(last, goal)
    np.testing.assert_array_equal(guide.model.near[0], HOME)  # the encoders, as nothing was inferred before
    np.testing.assert_array_equal(guide.model.near[1], goal)
    start = HOME + 0.01
    approach(guide, goal, 1, now=start)
    np.testing.assert_array_equal(guide.model.near[-1], start)
    np.testing.assert_array_equal(approach(guide, goal, 0), goal)


def test_a_hand_that_is_near_enough_moves_no_further():
    """Off by 100 times the rest of the way along x and y: 56.6, 28.3 and 14.1 px."""
    cell = Cell(share=0.5)
    goal = HOME + AWAY
    approach(guide_of(cell), goal, 9, tolerance=15.0)
    assert len(cell.sent) == 2
    cell = Cell(share=0.5)
    approach(guide_of(cell), goal, 9, tolerance=14.0)
    assert len(cell.sent) == 3


def test_a_step_that_no_motion_makes_is_refused():
    cell = Cell()
    cell.q = np.zeros(3)
    approach(guide_of(cell), np.array([1.5, 0.0, 0.0]), 1)  # just as far as may be
    assert len(cell.sent) == 1
    for size, good in ((1.49, True), (1.51, False)):
        cell = Cell()
        if good:
            approach(guide_of(cell), HOME + size / 0.4 * AWAY, 1)
        else:
            with pytest.raises(DenseVSError, match=r"a step of 1\.51 rad was inferred; expected at most 1\.5"):
                approach(guide_of(cell), HOME + size / 0.4 * AWAY, 1)
        assert len(cell.sent) == good


def test_sights_are_means_of_what_was_seen():
    cell = Cell()
    views = np.zeros((3, 2, 8, 2))
    views[:, 0] = np.array([1.0, 2.0, 6.0])[:, None, None]
    views[1, 0, 3] = np.nan
    views[1:, 0, 6] = np.nan  # seen once
    views[:, 1, 5] = np.nan
    cell.looks = list(views)
    found = average_sight(cell, (1, 2), 3)
    np.testing.assert_array_equal(found[0, 0], 3.0)
    np.testing.assert_array_equal(found[0, 3], 3.5)
    np.testing.assert_array_equal(found[0, 6], 1.0)
    assert np.isnan(found[1, 5]).all()
    assert np.isfinite(found).sum() == 2 * 8 * 2 - 2


def test_postures_are_tried_until_enough_are_kept():
    kept = []
    for posture in _postures_for(3, kept):
        if posture % 2:
            kept.append(posture)
    assert kept == [1, 3, 5]
    postures = _postures_for(3, [4])
    assert [next(postures) for _ in range(30)] == list(range(30))
    with pytest.raises(DenseVSError, match="1 of 30 postures showed 8 corners; expected 3"):
        next(postures)
    kept = []
    for posture in _postures_for(3, kept):  # the last posture is enough
        kept += [posture] if posture in (1, 2, 29) else []
    assert len(kept) == 3


def test_the_tool_stays_above_the_table():
    cell, rng = Cell(), np.random.default_rng(0)
    found = np.array([_allowed_posture(cell, HOME, 0.3, rng) for _ in range(200)])
    off = found - HOME
    assert found[:, 1].min() > 0.2  # the flange is 0.08 m higher
    assert 0.2 < found[:, 1].min() < 0.21
    assert np.abs(off).max() <= 0.3
    assert off[:, 0].min() < -0.29
    assert off[:, 0].max() > 0.29


def test_corners_that_were_seen_twice_are_learned():
    pixels = np.full((3, 2, 4, 2), np.nan)
    pixels[:2, 0, 0] = pixels[0, :, 1] = pixels[0, 0, 2] = pixels[2, 1, 2] = 1.0
    assert _often_seen(pixels).tolist() == [0, 2]  # by any camera; the second was seen in one sample alone
    assert _often_seen(pixels[:1]).tolist() == [0, 1, 2]


def test_an_arm_is_learned_from_postures_that_show_enough(monkeypatch):
    cell, seen = Cell(), {}

    def fit(observations, **options):
        seen.update(observations=observations, **options)
        return "model"

    monkeypatch.setattr(guided_motion, "Observations", SimpleNamespace)
    monkeypatch.setattr(GenerativeModel, "fit", fit)
    few, enough = np.full((2, 16, 2), np.nan), np.full((2, 16, 2), np.nan)
    few[0, :7], enough[0, :8] = 1.0, 2.0
    cell.looks = [few, enough, enough]
    guide = learn_arm(cell, np.random.default_rng(0), 2)
    assert guide.corners.tolist() == list(range(8))
    given = seen["observations"]
    assert given.pixels.shape == (2, 2, 8, 2)
    assert given.joints.shape == (2, 3)
    np.testing.assert_allclose(given.joints, HOME + np.cumsum([np.zeros(3), *cell.sent], axis=0)[2:4])
    assert (seen["state"], seen["controller"]) == ("noisy", "joint")
    assert (given.intrinsics, guide.intrinsics, given.image_sizes) == ("guess", "guess", cell.image_sizes)
    off = given.joints - HOME
    assert 0.05 < np.abs(off).max() <= 0.3


def test_a_held_part_is_learned_where_hand_and_part_are_seen(monkeypatch):
    cell, held = Cell(), []
    guide = guide_of(cell)
    guide.intrinsics = "guess"
    learned = {}

    class Relearned:
        parameters = SimpleNamespace(features=np.array([[1.0, 2.0, 3.0]] * 8))

        def relearn(self, observations, part):
            learned.update(observations=observations, part=part)

    def view(hand, part):
        pixels = np.full((2, HAND + 12, 2), np.nan)
        pixels[0, :hand] = 1.0
        pixels[0, HAND : HAND + part] = 5.0
        return pixels

    cell.looks = [view(16, 7), view(7, 12), view(8, 8), view(16, 8)]
    monkeypatch.setattr(guided_motion, "Observations", SimpleNamespace)
    monkeypatch.setattr(guided_motion, "with_features", lambda *_: Relearned())
    structure = learn_structure(
        guide, (5, 6, 7), np.random.default_rng(0), 2, lambda: held.append("hold"), lambda: held.append("release")
    )
    assert held == ["hold", "release"] * 4
    assert learned["part"] == "structure"
    given = learned["observations"]
    assert given.pixels.shape == (2, 2, 8, 2)
    assert (given.pixels[:, 0] == 5.0).all()  # the part's corners, not the hand's
    assert (given.intrinsics, given.image_sizes) == ("guess", cell.image_sizes)
    assert structure.shape == (12, 3)
    assert np.isfinite(structure[:8]).all()
    assert np.isnan(structure[8:]).all()
    # The joints are those inferred from the hand, looked for near the encoders.
    np.testing.assert_allclose(given.joints, np.cumsum([HOME, *cell.sent], axis=0)[3:5])
    np.testing.assert_allclose(guide.model.near, np.cumsum([HOME, *cell.sent], axis=0)[3:5])


def test_joints_are_inferred_from_corners_that_are_known_and_seen(monkeypatch):
    guide = guide_of(Cell())
    given = {}

    def other(model, points):
        given["points"] = points
        return SimpleNamespace(infer_joints=lambda pixels, near: given.update(pixels=pixels, near=near) or [1.0, 2.0])

    monkeypatch.setattr(guided_motion, "with_features", other)
    structure, pixels = np.arange(18.0).reshape(6, 3), np.ones((2, 6, 2))
    structure[0], pixels[:, 1], pixels[0, 2] = np.nan, np.nan, np.nan
    assert joints_for(guide, structure, pixels, HOME).tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(given["points"], structure[2:])
    assert given["pixels"].shape == (2, 4, 2)
    pixels[:, 5] = np.nan
    with pytest.raises(DenseVSError, match="3 corners are known and seen; expected at least 4"):
        joints_for(guide, structure, pixels, HOME)


class Told:
    """A cell that keeps what it was told."""

    def __init__(self):
        self.events, self.chain = [], SimpleNamespace(home=np.full(3, 5.0))

    def __getattr__(self, name):
        return lambda *given: self.events.append((name, *given))

    def true_part_position(self):
        return np.array([0.0, 0.0, 0.1 * len(self.events)])

    def true_part_in_hand(self):
        return np.zeros(3)

    def true_insertion_depth(self):
        return 0.04

    def encoders(self):
        return np.full(3, 2.0)


@pytest.fixture
def tried(monkeypatch):
    """What a try asks for: the factors that it stands off by, and the motions at each."""
    cell, asked = Told(), []

    def move(guide, goal, attempts, tolerance=0.0, now=None):
        asked.append((goal[0], attempts, tolerance))
        return goal

    for name, value in (
        ("average_sight", lambda cell, markers, images: asked.append(("images", images)) or np.zeros((2, 4, 2))),
        ("stand_off", lambda hand, part, factor, axis=None: (factor, part, axis)),
        ("joints_for", lambda guide, stood, pixels, now: np.full(3, stood[0]) if not asked.append(stood) else None),
        ("approach", move),
        ("learn_structure", lambda *_: np.arange(24.0).reshape(8, 3)),
        ("rigid_motion", lambda before, after: (np.eye(3), np.full(3, 0.5))),
    ):  # fmt: skip
        monkeypatch.setattr(guided_motion, name, value)
    model = SimpleNamespace(parameters=SimpleNamespace(features=np.zeros((4, 3))))
    return SimpleNamespace(cell=cell, model=model, joints_now=lambda: np.zeros(3)), asked


def test_a_grasp_comes_nearer_closes_and_lifts(tried):
    guide, asked = tried
    rng = np.random.default_rng(0)
    places = []
    for _ in range(40):
        guide.cell.events.clear()
        asked.clear()
        assert grasp(guide, np.zeros((4, 3)), rng)
        places.append(guide.cell.events[1][1:])
    assert [event[0] for event in guide.cell.events] == ["reset", "place_part", "close_gripper", "command"]
    np.testing.assert_allclose(guide.cell.events[-1][1], 1.4 - 1.0)  # back up by the way that it came down
    motions = [one for one in asked if len(one) == 3 and isinstance(one[1], int)]
    assert motions == [(1.4, 4, 0.0), (1.3, 1, 0.0), (1.2, 1, 0.0), (1.1, 1, 0.0), (1.0, 1, 0.0)]
    assert asked[0] == ("images", 3)
    spots, turns = np.array([place for place, _ in places]), np.array([turn for _, turn in places])
    off = np.abs(spots - [0.5, 0.03])
    assert (off <= [0.07, 0.1]).all()
    assert (spots.max(axis=0) > [0.56, 0.115]).all()
    assert (spots.min(axis=0) < [0.44, -0.055]).all()
    assert 0.4 < np.abs(turns).max() <= 0.5


def test_an_insertion_comes_down_along_the_sides(tried):
    guide, asked = tried
    part = np.arange(24.0).reshape(8, 3)
    assert insert(guide, part, part, np.random.default_rng(0)) == 0.04
    motions = [one for one in asked if len(one) == 3 and isinstance(one[1], int)]
    above = [(1.4, 4), (1.32, 8), (1.295, 8), (1.289, 6)]
    level = [(1.284, 4), (1.279, 4), (1.274, 3), (1.267, 3), (1.255, 2)]
    down = [(factor, 2) for factor in (1.24, 1.2, 1.15, 1.1, 1.05, 1.0)]
    assert motions == [(factor, attempts, 0.1) for factor, attempts in (*above, *level, *down)]
    stood = [one for one in asked if len(one) == 3 and not isinstance(one[1], int)]
    for _, target, axis in stood:
        np.testing.assert_allclose(target, part + 0.5)  # where the part lies in the hand this time
        assert np.linalg.norm(axis) == pytest.approx(1.0)
    assert [event[0] for event in guide.cell.events] == [
        "reset", "place_fixture_away", "teach_grasp", "command", "place_fixture",
    ]  # fmt: skip
    np.testing.assert_allclose(guide.cell.events[3][1], 3.0)  # home from where the encoders are
    assert ("images", 5) in asked
    rng, grasps, fixtures = np.random.default_rng(1), [], []
    for _ in range(60):
        guide.cell.events.clear()
        insert(guide, part, part, rng)
        grasps.append([*guide.cell.events[2][1], guide.cell.events[2][2]])
        fixtures.append([*(guide.cell.events[4][1] - [0.5, 0.03]), guide.cell.events[4][2]])
    for values, most in ((grasps, [0.003, 0.0, 0.002, 0.05]), (fixtures, [0.06, 0.08, 0.3])):
        largest = np.abs(values).max(axis=0)
        assert (largest <= most).all()
        assert (largest >= 0.9 * np.array(most)).all()
        assert (np.abs(np.mean(values, axis=0)) <= 0.4 * np.array(most)).all()


def test_the_published_motions():
    assert [factor for factor, _ in (*ABOVE, *INSIDE)] == sorted((f for f, _ in (*ABOVE, *INSIDE)), reverse=True)
    assert INSIDE[-1][0] == 1.0
    assert ABOVE[0][0] == 1.4
