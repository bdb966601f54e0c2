"""What is behind a body: from images that it has left a pixel in; and how badly that explains an image."""

import numpy as np
import pytest

from dense_vs.body_model.background import as_bright, background_of, bare_cost

H, W = 24, 40
NOISE = 2.0


@pytest.fixture
def passing():
    """A dark block that passes before a bright wall, in noisy images; where it is in each, and the wall."""
    rng = np.random.default_rng(0)
    wall = rng.uniform(100, 160, (H, W)).astype(np.float32)
    images, covered = [], []
    for left in range(0, 30, 2):
        block = np.zeros((H, W), bool)
        block[8:16, left : left + 10] = True
        image = np.where(block, 40.0, wall) + rng.normal(0, NOISE, (H, W))
        images.append(image.astype(np.float32))
        covered.append(block)
    return images, covered, wall


def test_it_is_what_is_seen_where_nothing_is_in_front(passing):
    images, covered, wall = passing
    found = background_of(images, covered)
    assert np.isfinite(found).all()
    assert np.abs(found - wall).max() < 2.5 * NOISE
    assert np.abs(found - wall).mean() < 0.5 * NOISE  # the usual look of many


def test_it_is_unknown_where_something_is_always_in_front(passing):
    images, covered, _ = passing
    hidden = [mask.copy() for mask in covered]
    for k, mask in enumerate(hidden):
        mask[2, 3], mask[2, 4] = k >= 3, k >= 4  # uncovered three and four times
    found = background_of(images, hidden)
    assert np.isnan(found[2, 3])
    assert np.isfinite(found[2, 4])
    assert np.isnan(found).sum() == 1


def test_one_gross_image_changes_nothing(passing):
    images, covered, wall = passing
    images[3] = np.full((H, W), 255.0, np.float32)
    assert np.abs(background_of(images, covered) - wall).max() < 3 * NOISE


def test_an_image_takes_the_exposure_of_another_by_what_most_pixels_say(passing):
    images, _, wall = passing
    like = wall.copy()
    like[:3] = np.nan
    np.testing.assert_allclose(as_bright(0.8 * images[4], like), images[4], rtol=0.01)  # the block does not count
    black = np.zeros((H, W), np.float32)
    np.testing.assert_array_equal(as_bright(black, like), black)


def test_a_body_that_was_in_front_in_other_images_does_not_speak_against_the_background(passing):
    """Nor does a plain body, which looks as it did in other images, speak for it."""
    images, covered, _ = passing
    here, block = images[7], covered[7]
    others = [image for k, image in enumerate(images) if k != 7]
    still = np.mean([np.abs(here - other) for other in others], axis=0)
    passed = np.any(covered, axis=0) & ~block
    assert still[passed].mean() > 15  # the wall beside the block looks as if it had moved
    plain = block.copy()
    plain[:, :18] = plain[:, 20:] = False
    still[plain] = 0.0  # as the inside of a large one would
    cost = bare_cost(here, background_of(images, covered), still)
    assert cost[passed].mean() < 3 * NOISE
    assert cost[plain].min() > 50
    away = ~np.any(covered, axis=0)
    assert np.all(cost[away] <= still[away] + 1e-5)
    assert cost[away].mean() > 0.7 * still[away].mean()


def test_where_the_background_is_unknown_the_images_alone_speak(passing):
    images, covered, _ = passing
    still = np.random.default_rng(1).uniform(0, 20, (H, W))
    nowhere = np.full((H, W), np.nan, np.float32)
    np.testing.assert_array_equal(bare_cost(images[0], nowhere, still), still)
    some = background_of(images, covered)
    some[:, 20:] = np.nan
    np.testing.assert_array_equal(bare_cost(images[0], some, still)[:, 20:], still[:, 20:])
