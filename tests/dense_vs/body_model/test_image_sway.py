"""What a swaying camera moved is told by what stands still, whatever the body does; else nothing is said."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model.image_sway import motions_to_first

SIZE = 120, 160
PLACES = np.array([[20.0, 15.0], [140.0, 20.0], [80.0, 100.0]])


def textured(seed, size=SIZE):
    """Blurred noise, uint8."""
    random = np.random.default_rng(seed).normal(0, 1, size)
    smooth = cv2.GaussianBlur(random, (0, 0), 1.5)
    return np.clip(128 + 60 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def seen(shift, turn, body_at):
    """A scene as a camera sees it that is shifted [px] and turned [rad], with a body before it; and the body's mask."""
    center = (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2
    moved = cv2.getRotationMatrix2D(center, np.degrees(turn), 1.0)
    moved[:, 2] += shift
    image = cv2.warpAffine(textured(1), moved, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    body = np.zeros(SIZE, bool)
    body[30:90, body_at : body_at + 50] = True
    image[body] = textured(2)[30:90, 40:90].ravel()
    return image, body, moved


@pytest.mark.parametrize(("shift", "turn"), [((0.4, -0.3), 0.0), ((-0.8, 0.2), 0.004), ((0.0, 0.0), -0.01)])
def test_places_go_back_to_where_the_first_image_has_them(shift, turn):
    first, covered, _ = seen((0.0, 0.0), 0.0, 40)
    image, body, moved = seen(shift, turn, 70)
    there = PLACES @ moved[:, :2].T + moved[:, 2]
    none, motion = motions_to_first([first, image], [covered, body])
    np.testing.assert_allclose(motion.moved(there), PLACES, atol=0.08)
    np.testing.assert_array_equal(none.moved(PLACES), PLACES)


def test_a_body_that_fills_more_than_half_is_no_camera():
    """It moves by 2 px and what stands still does not."""
    body = np.zeros(SIZE, bool)
    body[:, :100] = True
    still, on = textured(1), textured(2)
    first, image = still.copy(), still.copy()
    first[body] = on[body]
    image[body] = np.roll(on, 2, axis=1)[body]
    _, motion = motions_to_first([first, image], [body, body])
    np.testing.assert_allclose(motion.moved(PLACES), PLACES, atol=0.05)


def test_what_the_body_covers_by_then_tells_nothing():
    """A body that looks as the scene behind it comes before most of it, and moves by 2 px."""
    first, body = textured(1), np.zeros(SIZE, bool)
    body[:, :100] = True
    image = first.copy()
    image[body] = np.roll(first, 2, axis=1)[body]
    _, motion = motions_to_first([first, image], [np.zeros(SIZE, bool), body])
    np.testing.assert_allclose(motion.moved(PLACES), PLACES, atol=0.05)


@pytest.mark.parametrize("other", ["black", "unlike", "far"])
def test_where_what_stands_still_does_not_tell_nothing_is_said(other):
    first, body, _ = seen((0.0, 0.0), 0.0, 40)
    images = {"black": np.zeros(SIZE, np.uint8), "unlike": textured(5), "far": seen((5.0, 0.0), 0.0, 40)[0]}
    _, motion = motions_to_first([first, images[other]], [body, body])
    np.testing.assert_array_equal(motion.moved(PLACES), PLACES)


@pytest.mark.parametrize(("shift", "told"), [(2.9, True), (3.1, False)])
def test_more_than_a_sway_is_a_camera_that_was_moved(shift, told):
    first, body, _ = seen((0.0, 0.0), 0.0, 40)
    _, motion = motions_to_first([first, seen((shift, 0.0), 0.0, 40)[0]], [body, body])
    expected = PLACES - (shift, 0.0) if told else PLACES
    np.testing.assert_allclose(motion.moved(PLACES), expected, atol=0.05 if told else 0.0)


def test_a_part_that_agrees_with_itself_alone_is_no_camera():
    """All but a patch of the scene is another one, so few corners are found again, and these agree."""
    first, nothing = textured(1), np.zeros(SIZE, bool)
    image = textured(5)
    image[20:80, 22:92] = first[20:80, 20:90]
    _, motion = motions_to_first([first, image], [nothing, nothing])
    np.testing.assert_array_equal(motion.moved(PLACES), PLACES)


def test_where_the_body_is_everywhere_nothing_is_said():
    first, _, _ = seen((0.0, 0.0), 0.0, 40)
    image, _, _ = seen((1.0, 0.0), 0.0, 40)
    everywhere = np.ones(SIZE, bool)
    _, motion = motions_to_first([first, image], [everywhere, everywhere])
    np.testing.assert_array_equal(motion.moved(PLACES), PLACES)
