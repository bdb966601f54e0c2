"""Learning J+ and following a chain, with servos, searches and truths that say how they end."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.mask_servo.loop import ServoEnd, ServoRun
from dense_vs.sims.papers.vosvs import jacobian_learning, track, tracking
from dense_vs.sims.papers.vosvs.configurations import configuration
from dense_vs.sims.papers.vosvs.jacobian_learning import Update, learn_configuration

MASK = np.zeros((480, 640), bool)
MASK[200:280, 300:340] = True


class Taught:
    """A servo whose runs end as told; each look's J+ is the last one's plus one where it learned something."""

    runs: list = None

    def __init__(self, camera, robot, segmenter, *, pinv, on_look, **options):
        self.learner, self.on_look, self.options = pinv, on_look, options
        self.region = SimpleNamespace(retreats=5)
        Taught.made = self

    def run(self, left):
        end, changes, moves = Taught.runs.pop(0)
        Taught.left.append(left)
        looks = []
        for change in changes:
            Taught.pinv = Taught.pinv + change
            q = float(len(looks)) if moves else 0.0
            looks.append(SimpleNamespace(pinv=Taught.pinv.copy(), centroid=np.array([1.0, 2.0]), joints=np.array([q])))
            self.on_look(None, "image", "mask")
        return ServoRun(end, looks)


@pytest.fixture
def learned(monkeypatch):
    def run(runs, responses=2, looks=30, **options):
        one = configuration("base")
        learner = SimpleNamespace(pinv=np.zeros((2, 2)))
        put, postures = [], []
        world = SimpleNamespace(set_posture=postures.append)
        Taught.runs, Taught.left, Taught.pinv = list(runs), [], np.zeros((2, 2))
        monkeypatch.setattr(jacobian_learning, "_learner", lambda *_: learner)
        monkeypatch.setattr(jacobian_learning, "MaskServo", Taught)
        monkeypatch.setattr(jacobian_learning, "put_in_view", lambda *_: put.append(len(Taught.left)))
        monkeypatch.setattr(jacobian_learning, "true_pinv", lambda *_: np.full((2, 2), float(len(Taught.left))))
        monkeypatch.setattr(jacobian_learning, "forget_images", lambda _: None)
        for name in ("ManipulatorCamera", "ManipulatorRobot"):
            monkeypatch.setattr(jacobian_learning, name, lambda *_: None)
        told = {"responses": responses, "looks": looks, **options}
        result = learn_configuration(
            world,
            one,
            "Mug",
            None,
            np.random.default_rng(0),
            **{name: value for name, value in told.items() if value is not None},
        )
        return result, put, postures

    return run


DONE, LOST, LIMIT, SPENT = ServoEnd.CONVERGED, ServoEnd.LOST, ServoEnd.AT_LIMIT, ServoEnd.EXHAUSTED


def test_j_is_learned_until_enough_responses_have_converged(learned):
    result, put, postures = learned(
        [
            (LOST, [0, 1, 1], True),
            (DONE, [0, 1, 0, 0], True),
            (LIMIT, [1, 1], True),
            (DONE, [0, 0], True),
            (DONE, [9], True),
        ],
        keep_images=True,
    )
    assert result.converged
    assert (result.updates, result.looks) == (3, 7)  # changes and images until it first converged
    assert result.restarts == 2
    assert result.retreats == 5
    assert [one.end for one in result.episodes] == [LOST, DONE, LIMIT, DONE]
    assert [len(one.images) for one in result.episodes] == [3, 4, 0, 0]
    assert [len(one.looks) for one in result.episodes] == [3, 4, 2, 2]
    np.testing.assert_array_equal(result.history[:, 0, 0], [0, 1, 2, 3, 4, 5])
    assert [one[0, 0] for one in result.true] == [2.0, 4.0]
    assert Taught.left == [30, 27, 23, 21]
    # The object is put elsewhere at the beginning, after a response that converged and at a limit.
    assert put == [0, 2, 3]
    assert len(postures) == 4
    options = Taught.made.options
    assert (options["max_step"], options["tolerance"], options["target"]) == (0.3, 8.0, (320.0, 240.0))


def test_a_robot_that_never_gets_there_has_learned_nothing(learned):
    result, put, _ = learned([(LOST, [0] * 10, False), (LOST, [1] * 10, True), (SPENT, [0] * 10, True)])
    assert not result.converged
    assert result.updates is None
    assert result.looks == 30
    assert result.restarts == 2  # what ran out of images was not put back for anything
    assert put == [0, 1]  # where nothing moved there is nothing to learn from
    assert result.true == []


def test_the_last_image_ends_it(learned):
    result, put, _ = learned([(DONE, [0] * 30, True)])
    assert result.converged
    assert len(result.episodes) == 1
    assert put == [0]
    assert result.episodes[0].images == []  # not asked for


def test_a_single_image_that_is_left_is_used_too(learned):
    result, _, _ = learned([(DONE, [0] * 29, True), (DONE, [0], True)])
    assert Taught.left == [30, 1]
    assert len(result.true) == 2


def test_five_responses_of_at_most_150_images_are_learned_from(learned):
    result, put, _ = learned([(DONE, [1], True)] * 9, responses=None, looks=None)
    assert len(result.episodes) == 5
    assert Taught.left == [150, 149, 148, 147, 146]
    assert put == [0, 1, 2, 3, 4]


def test_updates_learn_from_a_thousandth_of_h():
    one = configuration("arm both")
    for update in Update:
        learner = jacobian_learning._learner(one, update)
        np.testing.assert_allclose(learner.pinv, 0.001 * one.coupling)
    assert type(jacobian_learning._learner(one, Update.FEATUREWISE)).__name__ == "FeaturewiseBroyden"


def test_a_tenth_of_what_a_motion_showed_is_learned():
    """The base moved 0.1 m ahead and 0.05 m aside, and each feature by 10 px: J+ is to become 0.01 and 0.005."""
    one = configuration("base")
    for update, expected in (
        # One at a time, an element goes a tenth of the way from 0.001 to what was seen.
        (Update.FEATUREWISE, [[0.0019, 0.0], [0.0, 0.0014]]),
        # By (11) dq - J+ de is (0.09, 0.04), dq^T J+ is (1, 0.5) / 10^4 and the denominator 15 / 10^4.
        (Update.PRINTED, [[0.001 + 0.1 * 0.09 / 15, 0.0], [0.0, 0.001 + 0.1 * 0.02 / 15]]),
        (Update.GUARDED, [[0.001 + 0.1 * 0.09 / 15, 0.0], [0.0, 0.001 + 0.1 * 0.02 / 15]]),
        (
            Update.ORIGINAL,
            [[0.001 + 0.1 * 0.09 / 15, 0.1 * 0.045 / 15], [0.1 * 0.04 / 15, 0.001 + 0.1 * 0.02 / 15]],
        ),
    ):
        learner = jacobian_learning._learner(one, update)
        assert not learner.observe(np.zeros(2), np.zeros(2))
        learner.observe(np.array([0.1, 0.05]), np.array([10.0, 10.0]))
        np.testing.assert_allclose(learner.pinv, expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("moved", "learned"), [(0.0079, False), (0.0081, True)])
def test_motions_below_eight_millimeters_teach_nothing(moved, learned):
    one = configuration("base")
    for update in (Update.PRINTED, Update.GUARDED, Update.ORIGINAL):
        learner = jacobian_learning._learner(one, update)
        learner.observe(np.zeros(2), np.zeros(2))
        learner.observe(np.array([moved, 0.0]), np.array([10.0, 0.0]))
        assert (learner.pinv[0, 0] != 0.001) == learned


def test_the_printed_update_has_no_guard_and_ours_has():
    """A motion that is nearly at a right angle to what J+ says of it: (11) leaps, the guarded one does not."""
    one = configuration("base")
    after = {}
    for update in (Update.PRINTED, Update.GUARDED):
        learner = jacobian_learning._learner(one, update)
        learner.observe(np.zeros(2), np.zeros(2))
        learner.observe(np.array([0.1, 0.1]), np.array([10.0, -9.9]))
        after[update] = np.abs(learner.pinv).max()
    assert after[Update.PRINTED] > 0.05  # 0.1 * 0.09 / (dq^T J+ de = 10^-5) * 10^-4 = 0.09
    assert after[Update.GUARDED] < 0.02


class Dragged:
    """A chain that moves 0.5 m a look."""

    def __init__(self):
        self.x, self.laid, self.before_frame, self.frames = 0.0, None, None, 0

    def store(self):
        pass

    def set_posture(self, q):
        pass

    def lay_chain(self, name, ground, rng):
        self.laid = ground

    def object_position(self, name):
        return np.array([self.x, 0.0, 0.0])


@pytest.fixture
def followed(monkeypatch):
    def run(config, runs, found=()):
        world, seen, searches = Dragged(), list(runs), list(found)
        hand = SimpleNamespace(gone=False)
        hand.let_go = lambda: setattr(hand, "gone", True)
        made = {}

        class Servo:
            def __init__(self, camera, robot, segmenter, **options):
                made.update(options)

            def run(self, left):
                assert world.before_frame is hand
                end, looks = seen.pop(0)
                for _ in range(min(looks, left)):
                    world.x += 0.5
                    made["on_look"](None, np.zeros((480, 640, 3), np.uint8), MASK)
                return ServoRun(end, [])

        monkeypatch.setattr(tracking, "MaskServo", Servo)
        monkeypatch.setattr(track, "DraggingHand", lambda world, name, speed, rng: made.update(speed=speed) or hand)
        monkeypatch.setattr(tracking, "search_object", lambda *_: SimpleNamespace(found=searches.pop(0)))
        monkeypatch.setattr(track, "true_centroid", lambda world, *_: np.array([world.x, 1.0]))
        monkeypatch.setattr(track, "floor_point", lambda world, camera, pixel: made.update(pixel=pixel) or "ground")
        for name in ("ManipulatorCamera", "ManipulatorRobot"):
            monkeypatch.setattr(tracking, name, lambda *_, **__: None)
        ready = SimpleNamespace(world=world, seed=4, segmenter=lambda _: None, pinv=lambda config: f"J+ of {config}")
        bar = SimpleNamespace(set_description=lambda _: None, update=lambda: None)
        one = track.follow_chain(ready, config, 12, bar)
        assert world.before_frame is None
        assert hand.gone
        return one, made

    return run


def test_a_chain_is_followed_through_losses(followed):
    one, made = followed("base", [(LOST, 3), (LOST, 2), (SPENT, 99)], found=[True, False])
    assert one.lost == 2
    assert len(one.centroids) == 12
    np.testing.assert_allclose(one.centroids[:, 0], 0.5 * np.arange(1, 13))
    assert one.traveled == pytest.approx(6.0)
    assert [name for name, _ in one.tiles] == [f"base, look {k}" for k in (1, 3, 5, 7, 9, 11)]
    assert (one.config, one.seed, made["pinv"], made["speed"]) == ("base", 4, "J+ of base", 0.2)
    assert made["pixel"].tolist() == [320.0, 240.0]
    assert (made["gain"], made["max_step"], made["tolerance"], made["patience"]) == (0.8, 0.12, 0.0, 4)


def test_the_head_gives_up_that_cannot_search(followed):
    one, made = followed("head", [(LOST, 1)] * 5)
    assert one.lost == 4
    assert len(one.centroids) == 12
    assert np.isfinite(one.centroids).all(axis=1).tolist() == [True] * 4 + [False] * 8
    assert made["speed"] == 0.25
    assert made["pixel"].tolist() == [320.0, 340.0]


def test_the_base_gives_up_where_it_does_not_find_the_chain_again(followed):
    one, _ = followed("base", [(LOST, 1)] * 6, found=[False, False, False, True, False])
    assert one.lost == 5  # found once more the fourth time
