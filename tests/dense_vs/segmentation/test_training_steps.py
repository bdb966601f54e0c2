"""What the few-shot segmenter's forests are trained with: folds, weights, pixels drawn, colors of both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.segmentation.few_shot import training
from dense_vs.segmentation.few_shot.color_words import ColorWords
from dense_vs.segmentation.few_shot.training import _draw_pixels, _folds, _histogram, _vocabulary, _weights


def test_good_candidates_of_an_image_weigh_150_together_and_the_poor_stand_for_five():
    found = _weights(np.array([0.0, 0.1, np.nextafter(0.1, 1), 0.4, 0.5, 0.75]))
    np.testing.assert_allclose(found, [5.0, 5.0, 1.0, 1.0, 150 * 0.5 / 1.25, 150 * 0.75 / 1.25])
    np.testing.assert_allclose(_weights(np.array([0.05, 0.3])), [5.0, 1.0])


@pytest.mark.parametrize(("shown", "hidden", "folds"), [(3, 4, 3), (7, 2, 5), (0, 3, 1), (1, 0, 1), (5, 5, 5)])
def test_images_that_show_the_object_are_spread_over_as_many_folds_as_there_are_up_to_five(shown, hidden, folds):
    shows = np.arange(shown + hidden) % 2 == 0
    shows[:] = False
    shows[np.random.default_rng(1).permutation(shown + hidden)[:shown]] = True
    found = _folds(shows, np.random.default_rng(0))
    for part in (found[shows], found[~shows]):
        count = np.bincount(part, minlength=folds)
        assert len(count) == folds
        assert np.ptp(count) <= 1
        assert count[0] == count.max()
    if shown == 7:  # in random order
        assert found[shows].tolist() != [0, 1, 2, 3, 4, 0, 1]


def test_pixels_are_drawn_inside_around_and_anywhere_outside():
    share = np.zeros((40, 60), np.float32)
    share[10:14, 20:26] = 1.0
    share[9, 20:26], share[14, 20:26], share[20, 40] = 0.75, 0.25, 0.26  # the borders, in neither
    seen = SimpleNamespace(features=SimpleNamespace(at=lambda y, x: np.column_stack([y, x])))
    rows, inside = _draw_pixels(seen, share, 30, np.random.default_rng(0))
    assert inside.tolist() == [True] * 30 + [False] * 90
    drawn = share[rows[:, 0], rows[:, 1]]
    assert (drawn[:30] == 1.0).all()
    assert (drawn[30:] == 0.0).all()
    y, x = rows[:30].T
    assert len(np.unique(60 * y + x)) < 24 + 1  # more than there are: some twice
    around = rows[30:60]
    assert len(np.unique(around, axis=0)) == 30
    near = np.zeros(share.shape, bool)
    for row, column in np.argwhere(share > 0.25):
        near[max(0, row - 7) : row + 8, max(0, column - 7) : column + 8] = True
    assert near[around[:, 0], around[:, 1]].all()
    assert 0 < near[rows[60:, 0], rows[60:, 1]].mean() < 0.6
    rows, inside = _draw_pixels(seen, np.zeros((40, 60), np.float32), 30, np.random.default_rng(0))
    assert inside.tolist() == [False] * 60  # nothing inside, and nothing around it
    rows, inside = _draw_pixels(seen, np.ones((4, 6), np.float32), 30, np.random.default_rng(0))
    assert inside.tolist() == [True] * 30


def test_a_color_s_word_is_that_of_its_step_of_eight():
    table = np.arange(1 << 15) % 251
    words = ColorWords(251, table.astype(np.uint8))
    image = np.random.default_rng(0).integers(0, 256, (12, 17, 3)).astype(np.uint8)
    image[0, :3] = [[255, 255, 255], [0, 0, 0], [7, 8, 248]]
    steps = image.astype(int) // 8
    expected = (steps * [1024, 32, 1]).sum(axis=2) % 251
    np.testing.assert_array_equal(words.of(image), expected)


def test_color_words_are_of_as_many_pixels_of_every_image_inside_and_outside(monkeypatch):
    asked = []
    monkeypatch.setattr(
        training.ColorWords, "fit", lambda inside, outside, **known: asked.append((inside, outside, known))
    )
    images = [np.full((8, 9, 3), level, np.uint8) for level in (10, 20, 30)]
    masks = [np.zeros((8, 9), np.float32) for _ in images]
    masks[0][2, 3] = 0.51
    images[0][2, 3] = 11
    masks[1][:] = 1.0
    masks[1][4, 4], images[1][4, 4] = 0.5, 21  # not inside
    _vocabulary(images, masks, np.random.default_rng(0), 7)
    ((inside, outside, known),) = asked
    assert known == {"words": 18, "seed": 7}
    assert np.unique(inside[:, 0], return_counts=True)[0].tolist() == [11, 20]
    assert np.bincount(inside[:, 0])[[11, 20]].tolist() == [500, 500]
    assert np.unique(outside[:, 0]).tolist() == [10, 21, 30]
    assert np.bincount(outside[:, 0])[[10, 21, 30]].tolist() == [500, 500, 500]


def test_the_histogram_of_an_object_is_of_its_own_pixels():
    words = SimpleNamespace(count=4, of=lambda image: image[..., 0])
    image = np.zeros((3, 4, 3), np.uint8)
    image[0, :, 0] = [1, 1, 2, 3]
    mask = np.zeros((3, 4), np.float32)
    mask[0, :3] = 0.6
    mask[0, 3] = 0.5
    np.testing.assert_allclose(_histogram(words, image, mask), [0, 2 / 3, 1 / 3, 0])
    assert _histogram(words, image, 0.5 * np.ones((3, 4))) is None
    np.testing.assert_allclose(_histogram(words, image, np.pad([[0.9]], ((0, 2), (0, 3)))), [0, 1, 0, 0])
