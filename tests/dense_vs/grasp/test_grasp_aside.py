"""Grasping among other objects: the check is made aside, and what was grasped by mistake stays there."""

import numpy as np
import pytest
from flat_room import FOCAL, HEIGHT, WIDTH, Disc, FlatRoom, Said

from dense_vs.grasp import GraspOutcome, GripperModel
from dense_vs.grasp.loop import GraspLoop, HandGeometry

CENTER = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
GRIP, BEHIND = 0.17, 0.03
INTRINSICS = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
ASIDE = (0.05, 0.6)


class TwoDiscs(FlatRoom):
    """A red disc that is asked for, and a green one; the nearer to the gripper's axis is caught."""

    def __init__(self, asked, other):
        super().__init__(Disc(np.array(asked), 0.02, 0.1), start=(0.0, 0.0, 0.31, 0.0))
        self.discs = {"red": self.disc, "green": Disc(np.array(other), 0.02, 0.1)}
        self.grip, self.axis, self.slack = GRIP, np.array([-BEHIND, 0.0]), 0.02
        self.hand, self.released, self.mistaken = None, [], []

    def read(self):
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        for channel, (name, disc) in enumerate(self.discs.items()):
            held = self.hand == name
            offset, distance = (self.axis, self.grip) if held else (disc.place - self.q[:2], self.q[2] - disc.height)
            scale = FOCAL / max(distance, 1e-3)
            center = np.array(CENTER) + scale * offset
            image[np.hypot(x - center[0], y - center[1]) < scale * disc.radius, channel] = 255
        return image, self.time

    def open(self):
        if self.hand is not None:
            self.discs[self.hand].place = self.q[:2] + self.axis
            self.released.append((self.hand, *self.q[:3]))
        self.hand = None
        return Said(0.135, False)

    def close(self):
        if self.hand is None and self.q[2] - self.grip <= 0.1 + 1e-6:
            far = {n: np.hypot(*(d.place - self.q[:2] - self.axis)) for n, d in self.discs.items()}
            nearest = self.mistaken.pop(0) if self.mistaken else min(far, key=lambda name: far[name])
            self.hand = nearest if far[nearest] <= 0.06 else None
        return Said(0.04 if self.hand else 0.0, False)


class Color:
    def __init__(self, channel):
        self.channel = channel

    def segment(self, image):
        return image[..., self.channel] > 128


def grasp(world, **options):
    pose = np.array([[0, -1, 0, -BEHIND], [1, 0, 0, 0], [0, 0, 1, GRIP], [0, 0, 0, 1]], dtype=float)
    model = GripperModel(opening=0.135, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    target = (CENTER[0] - FOCAL * BEHIND / GRIP, CENTER[1])
    hand = HandGeometry(GRIP, target, CENTER, INTRINSICS, model, bite=0.0)
    pinv = np.diag([-0.2 / FOCAL, -0.2 / FOCAL])
    loop = GraspLoop(
        world, world, Color(0), world, hand, lift="lift", wrist="wrist", base=("forward", "right"), pinv=pinv, **options
    )
    return loop.run(0.1)


def test_what_is_asked_for_is_checked_aside():
    world = TwoDiscs((0.02, 0.01), (0.05, 0.02))
    run = grasp(world, others=(Color(1),), aside=ASIDE)
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.HELD]
    assert world.hand == "red"
    np.testing.assert_allclose(world.q[:2] + world.axis, np.add((0.02, 0.01), ASIDE), atol=0.015)


def test_what_hinders_is_put_aside_and_left():
    world = TwoDiscs((0.02, 0.01), (0.05, 0.02))
    world.mistaken = ["green"]
    run = grasp(world, others=(Color(1),), aside=ASIDE)
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.WRONG, GraspOutcome.HELD]
    assert run.held
    assert world.hand == "red"
    ((name, forward, right, lift),) = world.released
    assert name == "green"
    np.testing.assert_allclose([forward - BEHIND, right], np.add((0.02, 0.01), ASIDE), atol=0.015)
    assert lift == pytest.approx(0.1 + GRIP, abs=0.005)  # put down, not dropped


def test_without_the_others_the_wrong_one_would_be_believed_by_the_fingers():
    world = TwoDiscs((0.02, 0.01), (0.05, 0.02))
    world.mistaken = ["green"]
    run = grasp(world, aside=ASIDE)
    assert run.held
    assert world.hand == "green"


def test_the_hand_comes_back_after_a_miss():
    world = TwoDiscs((0.02, 0.01), (0.6, 0.6))
    places, close = [], world.close

    def closing():
        places.append(world.q.copy())
        if len(places) <= 2:  # closed and raised: the first attempt catches nothing
            return Said(0.0, False)
        return close()

    world.close = closing
    run = grasp(world, others=(Color(1),), aside=ASIDE)
    assert [one.check.outcome for one in run.attempts] == [GraspOutcome.MISSED, GraspOutcome.HELD]
    np.testing.assert_allclose(places[2][:2], places[0][:2], atol=0.01)
    np.testing.assert_allclose(places[1][:2] - places[0][:2], ASIDE, atol=1e-6)


def test_an_object_that_was_put_aside_is_looked_for_there():
    world = TwoDiscs((0.02, 0.01), (0.05, 0.02))
    close, closed = world.close, []

    def closing():
        said = close()
        closed.append(said)
        return Said(0.0, False) if len(closed) <= 2 else said  # a slip of the encoder: it is put down as missed

    world.close = closing
    run = grasp(world, others=(Color(1),), aside=ASIDE)
    outcomes = [one.check.outcome for one in run.attempts]
    assert outcomes == [GraspOutcome.MISSED, GraspOutcome.LOST, GraspOutcome.HELD]
    assert world.hand == "red"


def test_fingers_keep_clear_of_other_objects():
    """Across the narrow side of a disc any angle would do: a neighbor decides."""
    world = TwoDiscs((0.02, 0.01), (0.02, 0.08))  # beside it along the image's y, where the fingers are at 0
    alone = grasp(TwoDiscs((0.02, 0.01), (0.02, 0.08)), aside=ASIDE)
    among = grasp(world, others=(Color(1),), aside=ASIDE)
    assert abs(alone.attempts[0].angle) < 0.01
    assert abs(among.attempts[0].angle) > np.deg2rad(20)
