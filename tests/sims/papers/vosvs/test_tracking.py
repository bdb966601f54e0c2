"""The loop that follows, on a servo made by hand, and the figures that are made of where the thing was."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.papers.vosvs import track_person, tracking
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.tracking import Track, follow, table_rows

HEAD = configuration("head")
IMAGE, MASK = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), bool)


class World:
    def __init__(self):
        self.waited = []
        self.joint_names = ("head_pan", "head_tilt")

    def wait(self, frames):
        self.waited.append(frames)


def servo_of(ends):
    """A servo whose runs take the given numbers of looks, or all that are left, and end as given."""
    left = list(ends)

    class Servo:
        def __init__(self, *_, on_look, **options):
            self.on_look = on_look
            Servo.options = options

        def run(self, most):
            end, looks = left.pop(0)
            for _ in range(min(looks, most)):
                self.on_look(None, IMAGE, MASK)
            return SimpleNamespace(end=end)

    return Servo


def tracked(monkeypatch, ends, looks, *, search=False, found=False):
    monkeypatch.setattr(tracking, "MaskServo", servo_of(ends))
    searched = []
    monkeypatch.setattr(tracking, "search_object", lambda *_: searched.append(True) or SimpleNamespace(found=found))
    monkeypatch.setattr(tracking, "ManipulatorRobot", lambda world, settle_frames: "robot")
    asked = []

    def place():
        asked.append(len(asked))
        return np.array([float(asked[-1]), 0.0])

    result = follow(World(), HEAD, object(), np.zeros((2, 2)), looks, max_step=0.1, true_place=place, search=search)
    return *result, searched


def test_looks_go_on_after_a_loss(monkeypatch):
    ends = [(ServoEnd.LOST, 4), (ServoEnd.EXHAUSTED, 99)]
    centroids, lost, tiles, searched = tracked(monkeypatch, ends, 12)
    assert lost == 1
    assert not searched
    np.testing.assert_array_equal(centroids[:, 0], np.arange(12))
    assert [label for label, _ in tiles] == [f"head, look {k}" for k in (1, 3, 5, 7, 9, 11)]


def test_looks_after_giving_up_count_as_unseen(monkeypatch):
    centroids, lost, _, _ = tracked(monkeypatch, [(ServoEnd.LOST, 2)] * 9, 20)
    assert lost == tracking.GIVE_UP + 1
    assert len(centroids) == 20
    assert np.isfinite(centroids[:8]).all()
    assert np.isnan(centroids[8:]).all()


def test_what_a_search_finds_is_followed_on(monkeypatch):
    centroids, lost, _, searched = tracked(monkeypatch, [(ServoEnd.LOST, 2)] * 10, 20, search=True, found=True)
    assert lost == len(searched) == 10
    assert np.isfinite(centroids).all()
    _, lost, _, searched = tracked(monkeypatch, [(ServoEnd.LOST, 2)] * 9, 20, search=True, found=False)
    assert lost == len(searched) == 4


def track(config, offsets, lost=0, traveled=1.0):
    target = np.array([320.0, 240.0])
    return Track(config, 5, target + np.array(offsets, dtype=float), target, lost, traveled, [])


def test_rows_of_a_track():
    nan = [np.nan, np.nan]
    ones = [
        track("head", [[3, -10], [0, 4], nan, [-20, 1]], lost=2, traveled=2.0),
        track("head", [[0, 0], [-30, 8], nan, nan], lost=1, traveled=4.0),
        track("base", [[1, 1], [5, 2], [0, 0], [0, 3]]),
    ]
    rows = {row.name: row for row in table_rows(ones, "person", (5, 6))}
    assert rows["head: looks with the person in view"].ours == pytest.approx(62.5)
    assert rows["head: looks with the person in view"].unit == "%"
    assert rows["head: true error, median"].ours == 10.0
    assert rows["head: true error, 90th percentile"].ours == pytest.approx(26.0)
    assert rows["head: times lost"].ours == 3
    assert rows["head: the person's way"].ours == 3.0
    assert rows["base: looks with the person in view"].ours == 100.0
    assert rows["base: true error, median"].ours == 2.0
    assert all(row.paper is None and row.seeds == (5, 6) for row in rows.values())


def test_the_person_walks_on_clear_floor_before_the_robot():
    rng = np.random.default_rng(0)
    places = np.array([track_person.draw_place(rng) for _ in range(300)])
    assert (places[:, 0] - track_person.BASE[0]).min() > 1.5  # the whole shirt is in view
    assert places[:, 1].min() > 0.77 + 0.3  # beside the higher bin
    assert places[:, 1].max() < 4.2  # before the cabinet
    assert np.ptp(places, axis=0).min() > 2.0


def test_person_is_followed_by_what_was_learned(monkeypatch):
    world = World()
    world.set_posture = lambda q: asked.update(zip(JOINTS, q, strict=True))
    world.pixels_of = lambda camera, geoms: np.pad(np.ones((1, 1), bool), ((240, 239), (330, 309)))
    world.before_frame = None
    person = SimpleNamespace(show=lambda pose: None, geoms=lambda cloth: np.array([1]))
    asked = {}

    def followed(world, one, segmenter, pinv, looks, **options):
        asked.update(options, one=one, looks=looks, pinv=pinv)
        walker = world.before_frame.walker
        assert walker.place.tolist() == [0.6, 2.5]
        assert walker.heading == pytest.approx(np.pi / 2)
        assert world.before_frame._speeds == (0.4, 0.9)
        for _ in range(30):
            world.before_frame()
        return np.tile(options["true_place"](), (looks, 1)), 2, [("a", IMAGE)]

    monkeypatch.setattr(track_person, "follow", followed)
    ready = SimpleNamespace(world=world, seed=5)
    one = track_person.follow_person(ready, person, "head", "masks", "J+", 7, 0.2, SimpleNamespace(update=None))
    assert world.before_frame is None
    assert (asked["base_forward"], asked["base_lateral"], asked["head_tilt"]) == (-1.5, 2.5, -0.1)
    assert asked["mask_seconds"] == 0.2
    assert asked["max_step"] == 0.3
    assert asked["one"].name == "head"
    assert one.lost == 2
    np.testing.assert_array_equal(one.centroids, np.tile([330.0, 240.0], (7, 1)))
    assert 0.0 < one.traveled < 1.0
