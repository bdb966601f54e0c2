"""The error of a Jacobian against a direct computation, pixel by pixel."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.jacobian.error import INNER_MARGIN, jacobian_error

# Quantiles of float64 ratios.
TOLERANCE = 1e-9


def direct(estimated, true, mask):
    """Median and 90 % over the body, median over its inside, number of pixels: loops over pixels."""
    height, width = mask.shape
    body, inside = [], []
    for y in range(height):
        for x in range(width):
            if not mask[y, x] or not true[y, x].any():
                continue
            error = np.sqrt(((estimated[y, x] - true[y, x]) ** 2).sum()) / np.sqrt((true[y, x] ** 2).sum())
            body.append(error)
            near = [
                mask[v, u]
                for v in range(max(0, y - INNER_MARGIN), min(height, y + INNER_MARGIN + 1))
                for u in range(max(0, x - INNER_MARGIN), min(width, x + INNER_MARGIN + 1))
                if np.hypot(u - x, v - y) <= INNER_MARGIN
            ]
            if all(near):
                inside.append(error)
    return np.median(body), np.quantile(body, 0.9), np.median(inside), len(body), len(inside)


@pytest.fixture
def case():
    rng = np.random.default_rng(0)
    true = rng.normal(0, 100, (30, 40, 2, 4))
    estimated = (true + rng.normal(0, 20, true.shape)).astype(np.float32)
    mask = np.zeros((30, 40), dtype=bool)
    mask[8:30, 5:25] = True  # one side on the image border, which is no outline
    mask[2:4, 30:38] = True  # too thin to have an inside
    true[10, 10] = 0  # a pixel that no joint moves
    return estimated, true, mask


def test_error(case):
    mask = case[2]
    error = jacobian_error(*case)
    median, p90, inner, pixels, inner_pixels = direct(*case)
    assert error.median == pytest.approx(median, rel=TOLERANCE)
    assert error.p90 == pytest.approx(p90, rel=TOLERANCE)
    assert error.pixels == pixels == mask.sum() - 1
    assert 0 < inner_pixels < pixels
    assert error.inner_median == pytest.approx(inner, rel=0.02)  # OpenCV's disc is not quite the circle


def test_a_pixel_that_is_hardly_moved_counts_as_any_other():
    """Motions of 0.5 px/rad and less, off by half, by all and not at all; one that no joint moves is left out."""
    true = np.zeros((1, 4, 2, 1))
    true[0, :, 0, 0] = [0.5, 0.25, 1e-3, 0.0]
    estimated = true * np.array([1.5, 0.0, 1.0, 1.0])[None, :, None, None]
    estimated[0, 3] = 7.0
    error = jacobian_error(estimated, true, np.ones((1, 4), bool))
    assert (error.median, error.inner_median, error.pixels) == (0.5, 0.5, 3)
    assert error.p90 == pytest.approx(0.5 + 0.8 * 0.5)


def test_inside_leaves_the_outline_out(case):
    _, true, mask = case
    wrong = true.copy()
    wrong[8:10, 5:25] *= 3  # two rows at the outline
    wrong[2:4] *= 3
    error = jacobian_error(wrong, true, mask)
    assert error.inner_median == 0
    assert error.p90 > 1


def test_image_border_is_no_outline():
    """A body across the top of the image, 7 px high: the upper 4 rows are inside it, and 3 of those are wrong."""
    mask = np.zeros((30, 40), dtype=bool)
    mask[:7] = True
    true = np.ones((30, 40, 2, 4))
    estimated = true.copy()
    estimated[:3] *= 3
    assert jacobian_error(estimated, true, mask).inner_median == pytest.approx(2.0)


def test_nothing_to_compare_with_is_not_a_number(case):
    estimated, true, mask = case
    for error in (jacobian_error(estimated, true, ~mask & False), jacobian_error(estimated, 0 * true, mask)):
        assert error.pixels == 0
        assert np.isnan([error.median, error.p90, error.inner_median]).all()


def test_sizes_that_differ_are_answered():
    true = np.ones((6, 8, 2, 4))
    with pytest.raises(DenseVSError, match=r"the estimate has shape \(5, 8, 2, 4\); the truth has \(6, 8, 2, 4\)"):
        jacobian_error(true[:5], true, np.ones((6, 8), dtype=bool))


@pytest.mark.parametrize(
    ("shape", "mask"),
    [((5, 6, 2), np.ones((5, 6), bool)), ((5, 6, 2, 3), np.ones((5, 7), bool)), ((5, 6, 2, 3), np.ones((5, 6)))],
)
def test_each_shape_has_to_fit(shape, mask):
    with pytest.raises(DenseVSError, match=r"expected \(H, W, 2, N\) and bool \(H, W\)"):
        jacobian_error(np.ones(shape), np.ones(shape), mask)
