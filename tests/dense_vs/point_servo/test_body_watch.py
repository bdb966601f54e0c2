"""When a body is looked at, and when it no longer looks like its model; likeness is given by hand."""

import numpy as np
import pytest

from dense_vs.point_servo import body_watch
from dense_vs.point_servo.body_watch import EVERY, UNTOLD, BodyWatch

Q = np.zeros(1)


def image(likeness):
    return np.full((4, 5), round(100 * likeness), np.uint8)


@pytest.fixture(autouse=True)
def by_gray(monkeypatch):
    """A body looks like its model by a hundredth of the gray value."""
    monkeypatch.setattr(body_watch, "agreement", lambda model, q, gray: gray[0, 0] / 100)


def watch(usual=0.9):
    return BodyWatch("model", [(image(usual), Q)])


def see(one, likeness, images=EVERY):
    for _ in range(images):
        one.see(image(likeness), Q)


def test_it_looks_at_one_image_of_many():
    one = watch()
    see(one, 0.5, EVERY - 1)
    assert not one.latest
    see(one, 0.7, 1)
    assert [*one.latest] == [0.7]
    see(one, 0.8)
    see(one, 0.6)
    assert [*one.latest] == [0.8, 0.6]


@pytest.mark.parametrize(
    ("looks", "doubted"),
    [((0.5,), False), ((0.5, 0.5), True), ((0.77, 0.5), False), ((0.5, 0.77), False), ((0.76, 0.76), True),
     ((0.5, 0.5, 0.8), False), ((0.9, 0.5, 0.6), True), ((), False)],
)  # fmt: skip
def test_two_looks_in_a_row_below_the_usual_share_are_a_doubt(looks, doubted):
    one = watch()
    for likeness in looks:
        see(one, likeness)
    said = one.doubts
    assert bool(said) == doubted
    if doubted:
        assert said == f"it looks like its model by {looks[-1]:.2f}, usually by 0.90"


def test_what_is_usual_is_the_mean_of_some_images_that_are_right():
    history = [(image(k / 100), Q) for k in range(50, 99)]
    assert BodyWatch("model", history).usual == pytest.approx(0.74, abs=0.01)
    asked = []
    body_watch.agreement = lambda model, q, gray: asked.append(model) or 0.5
    assert BodyWatch("model", history).usual == 0.5
    assert asked == ["model"] * 8


def test_without_images_what_is_usual_is_that_of_noisy_ones():
    one = BodyWatch("model", [])
    assert one.usual == UNTOLD
    see(one, 0.72)
    see(one, 0.72)
    assert one.doubts
    see(one, 0.73)
    assert not one.doubts
