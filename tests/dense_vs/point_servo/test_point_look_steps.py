"""The steps of a look: weights, what a shift costs, how far it is sought, and where between pixels it is."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize

from dense_vs.point_servo.point_look import PointLook, _blurred, _peak, _sampled, _scales, _steps

SIZE, POINT = (96, 128), np.array([60.0, 50.0])


def texture(seed=0, smooth=2.0):
    rough = gaussian_filter(np.random.default_rng(seed).normal(size=SIZE), smooth)
    return np.clip(128 + 40 * rough / rough.std(), 0, 255).astype(np.uint8)


def window_weights(half, window, own=None):
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    weights = np.exp(-(x**2 + y**2) / (2 * (0.35 * window) ** 2))
    if own is not None:
        weights = weights * own
    return weights / weights.sum()


def blurred_window(gray, x, y, half, around=3):
    """The window about a whole pixel, blurred by 0.8 px as a picture of its own."""
    whole = gray[y - half - around : y + half + around + 1, x - half - around : x + half + around + 1].astype(float)
    return cv2.GaussianBlur(whole, (0, 0), 0.8, borderType=cv2.BORDER_REFLECT_101)


def correlation(weights, one, other):
    one, other = one - (weights * one).sum(), other - (weights * other).sum()
    return (weights * one * other).sum() / np.sqrt((weights * one**2).sum() * (weights * other**2).sum())


@pytest.mark.parametrize("window", [9, 17])
def test_the_look_is_weighted_by_a_bell_of_a_third_of_its_window(window):
    gray, half = texture(), window // 2
    look = PointLook(gray, POINT, None, window)
    weights = window_weights(half, window)
    np.testing.assert_allclose(look._weights, weights, rtol=1e-6)
    here = cv2.GaussianBlur(gray[50 - half : 51 + half, 60 - half : 61 + half].astype(np.float32), (0, 0), 0.8)
    here = here - (weights * here).sum()
    np.testing.assert_allclose(look._weighted, weights * here, atol=1e-5)
    assert look._contrast == pytest.approx(np.sqrt((weights * here**2).sum()), rel=1e-5)


@pytest.mark.parametrize(("columns", "counts"), [(5, False), (7, True)])
def test_pixels_of_other_surfaces_are_left_out_where_sixty_of_its_own_are_there(columns, counts):
    """11 rows of 5 columns are too few to tell; then all count."""
    same = np.zeros(SIZE, bool)
    same[:, 55 : 55 + columns] = True
    look = PointLook(texture(), POINT, same, 11)
    own = np.zeros((11, 11))
    own[:, :columns] = 1
    expected = window_weights(5, 11, own if counts else None)
    np.testing.assert_allclose(look._weights, expected, rtol=1e-6)


@pytest.mark.parametrize(("columns", "rows", "counts"), [(6, 10, True), (59, 1, False)])
def test_just_sixty_pixels_are_enough(columns, rows, counts):
    same = np.zeros(SIZE, bool)
    same[20 : 20 + rows, 31 : 31 + columns] = True
    look = PointLook(texture(), np.array([60.0, 50.0]), same, 61)
    assert (np.count_nonzero(look._weights) == 60) == counts


@pytest.mark.parametrize("seed", range(4))
def test_distinctness_is_the_least_that_a_shift_by_two_pixels_costs(seed):
    gray, window, half = texture(seed), 17, 8
    look = PointLook(gray, POINT, None, window)
    weights = window_weights(half, window)
    whole = blurred_window(gray, 60, 50, half, 2)
    here = cv2.GaussianBlur(gray[50 - half : 51 + half, 60 - half : 61 + half].astype(float), (0, 0), 0.8)
    found = []
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            if 1.5 <= np.hypot(dx, dy) < 2.5:
                there = whole[2 + dy : 2 + dy + window, 2 + dx : 2 + dx + window]
                found.append(correlation(weights, here, there))
    assert len(found) == 12
    assert look.distinctness == pytest.approx(1 - max(found), abs=1e-4)


def test_an_edge_and_a_plain_surface_are_not_distinct():
    edge = np.where(np.arange(128) < 58, 60, 180).astype(np.uint8) * np.ones((96, 1), np.uint8)
    assert PointLook(edge, POINT, None, 17).distinctness < 0.01
    assert PointLook(np.full(SIZE, 90, np.uint8), POINT, None, 17).distinctness <= 1.0


@pytest.mark.parametrize(
    ("distinctness", "alike", "drift"),
    [(0.2, 1.0, 0.0), (0.2, 0.8, 2.0), (0.2, 0.95, 1.0), (0.0, 0.999, 2.0), (0.2, 1.1, 0.0)],
)
def test_drift_grows_with_what_correlation_lacks(distinctness, alike, drift):
    """A look that loses 0.2 by a shift of 2 px has moved by 2 px if 0.2 is missing, by 1 px if a quarter of that is."""
    look = object.__new__(PointLook)
    look.distinctness = distinctness
    assert look.drift(alike) == pytest.approx(drift, abs=1e-6)


def still(look):
    """Without the last step, in which the patch may turn and shear."""
    look.turned = lambda gray, place, affine, most: (place, -1.0)
    return look


@pytest.mark.parametrize(
    ("deviation", "scale", "radius"),
    [(1.0, 1.0, 3), (0.33, 1.0, 2), (1.1, 1.0, 4), (3.0, 1.0, 9), (10.0, 1.0, 12), (1.0, 0.5, 6), (2.0, 2.0, 3)],
)
def test_it_is_sought_as_far_as_three_deviations(deviation, scale, radius):
    """Between 2 and 12 px of the look; what is a pixel farther out is not reached."""
    gray = texture(3, 1.2)
    look = still(PointLook(gray, POINT, None, 17))
    affine = scale * np.eye(2)
    thin = np.diag([deviation**2, 1e-2])

    def at(steps):
        """The image in which it is so many px of the look to the right of where it is expected."""
        matrix = np.column_stack([affine, POINT + np.array([steps * scale, 0]) - affine @ POINT])
        return cv2.warpAffine(gray, matrix, SIZE[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)

    place, alike = look.found(at(radius), POINT, affine, 1e3 * thin if deviation == 10.0 else thin)
    assert place[0] - POINT[0] == pytest.approx(radius * scale, abs=0.4 * scale)
    assert alike > 0.9
    place, alike = look.found(at(radius + 2), POINT, affine, 1e3 * thin if deviation == 10.0 else thin)
    assert place[0] - POINT[0] < (radius + 0.51) * scale
    assert alike < 0.97


def test_the_expectation_decides_among_places_that_are_alike_by_chance():
    """The score of every shift once more: correlation over its noise, less half of Mahalanobis' square."""
    gray, half = texture(5, 1.2), 6
    rng = np.random.default_rng(1)
    later = np.clip(gray + rng.normal(0, 25, SIZE), 0, 255).astype(np.uint8)
    weights = window_weights(half, 13)
    look = still(PointLook(gray, POINT, None, 13))
    here = cv2.GaussianBlur(gray[44:57, 54:67].astype(float), (0, 0), 0.8)
    for x, y, covariance in ((61, 49, np.diag([1.5, 0.6])), (58, 52, np.array([[1.6, 0.7], [0.7, 0.9]]))):
        radius = int(np.ceil(3 * np.sqrt(np.linalg.eigvalsh(covariance).max())))
        whole = blurred_window(later, x, y, half, radius)
        alike = np.empty((2 * radius + 1,) * 2)
        off = np.empty_like(alike)
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                there = whole[radius + dy : radius + dy + 13, radius + dx : radius + dx + 13]
                alike[dy + radius, dx + radius] = correlation(weights, here, there)
                off[dy + radius, dx + radius] = np.array([dx, dy]) @ np.linalg.solve(covariance, [dx, dy])
        noise = max(0.005, 0.25 * (1 - alike.max()))
        score = alike / noise - 0.5 * off
        row, column = np.unravel_index(score.argmax(), score.shape)
        place, told = look.found(later, np.array([x, y], float), np.eye(2), covariance)
        assert told == pytest.approx(alike[row, column], abs=1e-3)
        np.testing.assert_allclose(
            place, np.array([x, y]) + np.array([column - radius, row - radius]) + _peak(score, row, column), atol=0.05
        )


@pytest.mark.parametrize(
    ("expected", "affine", "seen"),
    [
        ([0.0, 0.0], np.eye(2), True),
        ([-0.1, 40.0], np.eye(2), False),
        ([40.0, -0.1], np.eye(2), False),
        ([127.5, 95.5], np.eye(2), True),
        ([128.0, 50.0], np.eye(2), False),
        ([60.0, 96.0], np.eye(2), False),
        ([60.0, 50.0], np.diag([0.41, 1.0]), True),
        ([60.0, 50.0], np.diag([0.39, 1.0]), False),
        ([60.0, 50.0], np.diag([2.4, 1.0]), True),
        ([60.0, 50.0], np.diag([2.6, 1.0]), False),
        ([60.0, 50.0], np.array([[np.nan, 0.0], [0.0, 1.0]]), False),
        ([np.inf, 50.0], np.eye(2), False),
    ],
)
def test_where_a_look_can_be_seen(expected, affine, seen):
    look = still(PointLook(texture(), POINT, None, 17))
    _, alike = look.found(texture(), np.array(expected), affine, np.eye(2))
    assert (alike > -1) == seen


@pytest.mark.parametrize(("level", "asked"), [(0.0, True), (150.0, False)])
@pytest.mark.parametrize(("told", "better"), [(0.5, False), (1.0, True)])
def test_only_a_place_that_is_alike_is_aligned(level, asked, told, better):
    """Noise that takes correlation below 0.85 leaves the place as the search has it, as does one that says no more."""
    gray = texture(6)
    look = PointLook(gray, POINT, None, 17)
    calls = []
    look.turned = lambda one, place, affine, most: calls.append(most) or (place + 0.25, told)
    later = np.clip(gray + np.random.default_rng(0).normal(0, 4 + level, SIZE), 0, 255).astype(np.uint8)
    plain = still(PointLook(gray, POINT, None, 17)).found(later, POINT, np.eye(2), np.eye(2))
    place, alike = look.found(later, POINT, np.eye(2), np.eye(2))
    assert calls == [1.0] * asked
    np.testing.assert_allclose(place, plain[0] + 0.25 * (asked and better))
    assert alike == (1.0 if asked and better else plain[1])
    assert (alike >= 0.85) == asked


def loss_of_a_turned_shift(gray, half, angle):
    """What correlation lacks after a shift by 2 px, once turn and shear have made up for it as far as they can."""
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 0.8)
    here, even = smooth[50 - half : 51 + half, 60 - half : 61 + half].astype(float), np.full(x.shape, 1 / x.size)

    def lost(map_):
        (a, b), (c, d) = map_.reshape(2, 2) / half
        at = 60 + 2 * np.cos(angle) + x + a * x + b * y, 50 + 2 * np.sin(angle) + y + c * x + d * y
        seen = cv2.remap(smooth, *(part.astype(np.float32) for part in at), cv2.INTER_CUBIC)
        return 1 - correlation(even, here, seen.astype(float))

    return minimize(lost, np.zeros(4), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-7}).fun


@pytest.mark.parametrize("seed", range(3))
def test_how_distinct_a_look_is_that_may_turn_and_shear(seed):
    """By its gradients, so to a third of what a search finds, as two pixels are no small shift."""
    gray = texture(seed, 5.0)
    look = PointLook(gray, POINT, None, 17)
    least = min(loss_of_a_turned_shift(gray, 8, angle) for angle in np.linspace(0, np.pi, 12, endpoint=False))
    turned = look._turned_distinctness(_blurred(_sampled(gray, POINT, np.eye(2), 8 + 2)))
    assert turned == pytest.approx(least, rel=0.35)
    assert look._looser == pytest.approx(max(1.0, look.distinctness / turned))


def test_an_alignment_of_a_round_surface_s_shade_tells_little():
    """A shift of it is like a turn and shear, so 0.99 by an alignment is no more than chance."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    rich = texture(1)
    dome = np.clip(220 - 0.5 * ((x - 65) ** 2 + (y - 46) ** 2) + 0.02 * (rich - 128.0), 0, 255).astype(np.uint8)
    noise = np.random.default_rng(0).normal(0, 12, SIZE)
    for gray, loose in ((dome, True), (rich, False)):
        look = PointLook(gray, POINT, None, 17)
        look._patches = SimpleNamespace(align=lambda _, one, places, maps: (places + 0.5, maps, np.array([0.99])))
        later = np.clip(gray + noise, 0, 255).astype(np.uint8)
        place, alike = look.found(later, POINT, np.eye(2), np.eye(2))
        still_place, still_alike = still(PointLook(gray, POINT, None, 17)).found(later, POINT, np.eye(2), np.eye(2))
        assert (look._looser > 4) == loose
        assert alike == (still_alike if loose else pytest.approx(1 - 0.01 * look._looser))
        np.testing.assert_allclose(place, still_place + (0.0 if loose else 0.5))


@pytest.mark.parametrize(
    ("alike", "away", "most", "sure"),
    [(0.94, 0.9, 1.0, True), (0.92, 0.1, 1.0, False), (0.99, 1.1, 1.0, False), (0.94, 2.9, 3.0, True),
     (0.94, 3.1, 3.0, False)],
)  # fmt: skip
def test_a_turned_look_counts_where_it_is_sure_and_near(alike, away, most, sure):
    look = PointLook(texture(), POINT, None, 17)
    moved = POINT + away * np.array([0.6, 0.8])
    look._patches = SimpleNamespace(align=lambda *given: (moved[None], None, np.array([alike])))
    place, told = look.turned(texture(), POINT, np.eye(2), most)
    np.testing.assert_allclose(place, moved if sure else POINT)
    assert look._looser > 1.1
    assert told == pytest.approx(1 - look._looser * (1 - alike) if sure else -1.0)
    if most == 3.0:  # which it is where none is given
        assert look.turned(texture(), POINT, np.eye(2))[1] == told


def test_an_image_is_drawn_as_the_look_lies():
    """A plane of gray values keeps its values at every mapped place."""
    y, x = np.mgrid[:96, :128]
    plane = (x + y).astype(np.uint8)
    affine, place = np.array([[0.5, -1.0], [1.0, 0.5]]), np.array([50.0, 40.0])
    found = _sampled(plane, place, affine, 2)
    for row in range(5):
        for column in range(5):
            at = place + affine @ [column - 2, row - 2]
            assert found[row, column] == pytest.approx(at[0] + at[1], abs=0.51)
    assert found.dtype == np.float32


@pytest.mark.parametrize("peak", [(0.3, -0.2), (-0.45, 0.4), (0.0, 0.0)])
def test_the_peak_between_steps_is_that_of_a_parabola(peak):
    y, x = np.mgrid[:5, :7]
    score = -3 * (x - 3 - peak[0]) ** 2 - 2 * (y - 2 - peak[1]) ** 2 + 9.0
    np.testing.assert_allclose(_peak(score, 2, 3), peak, atol=1e-9)
    assert _peak(score, 0, 3)[1] == _peak(score, 4, 3)[1] == 0  # at the border nothing is known beyond
    assert _peak(score, 2, 0)[0] == _peak(score, 2, 6)[0] == 0
    assert _peak(score, 1, 3)[1] == 0.5  # not farther than half a step
    assert _peak(score, 3, 3)[1] == -0.5
    assert _peak(score, 2, 1)[0] == 0.5
    assert _peak(score, 2, 5)[0] == -0.5
    np.testing.assert_array_equal(_peak(-score, 2, 3), 0.0)  # no peak
    np.testing.assert_array_equal(_peak(np.zeros((5, 7)), 2, 3), 0.0)


@pytest.mark.parametrize(("columns", "counts"), [(9, False), (10, True)])
def test_few_pixels_of_the_same_surface_are_alike_with_some_turn_or_other(columns, counts):
    """Of 25 rows of columns, the outer two of which draw on others: sought turned with 200 pixels, not with 175."""
    same = np.zeros(SIZE, bool)
    same[:, 56 : 56 + columns] = True
    look = PointLook(texture(), POINT, same, 25)
    assert look.pixels == 25 * (columns - 2)
    look.middle = None
    look.found = lambda *given: (POINT, 0.7)
    look.turned = lambda gray, place, affine: (POINT + 1, 0.95)
    seen = look.seen(texture(), POINT, np.eye(2), np.eye(2))
    assert (seen.place[0] == 61) == counts
    assert seen.correlation == (0.95 if counts else 0.7)


def test_a_plain_look_is_not_distinct_and_is_found_nowhere():
    with np.errstate(all="raise"):
        look = PointLook(np.full(SIZE, 90, np.uint8), POINT, None, 17)
        seen = look.seen(texture(), POINT, np.eye(2), np.eye(2))
        assert np.isfinite(look.drift(0.9))
    assert look.distinctness == look.middle.distinctness == 0
    assert seen.correlation == -1
    np.testing.assert_array_equal(seen.place, POINT)


def test_a_look_is_like_no_plain_image():
    look = PointLook(texture(), POINT, None, 17)
    with np.errstate(all="raise"):
        np.testing.assert_allclose(look._correlations(np.full((21, 21), 7, np.float32)), 0, atol=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_by_how_much_a_map_grows_and_shrinks(seed):
    rng = np.random.default_rng(seed)
    for affine in (rng.normal(size=(2, 2)), np.eye(2), np.outer(*rng.normal(size=(2, 2))), 1e-200 * np.eye(2)):
        np.testing.assert_allclose(_scales(affine), np.linalg.svd(affine, compute_uv=False), rtol=1e-7, atol=1e-7)
    for wrong in (np.nan, np.inf, 1e200):
        assert not _scales(np.array([[wrong, 0.0], [0.0, 1.0]]))[1] >= 0


@pytest.mark.parametrize("radius", [1, 3])
def test_steps_go_row_by_row(radius):
    expected = [(x, y) for y in range(-radius, radius + 1) for x in range(-radius, radius + 1)]
    np.testing.assert_array_equal(_steps(radius), expected)
