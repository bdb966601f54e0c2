"""Points followed through images, step by step: what moves, which corners, what is believed, on made pictures."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from dense_vs.body_model import tracks
from dense_vs.body_model.tracks import PointTrackOptions, PointTracks, follow_points, moving_pixels
from dense_vs.errors import DenseVSError

SIZE = (96, 128)


def texture(seed=0, size=SIZE):
    rough = gaussian_filter(np.random.default_rng(seed).normal(size=size), 1.5)
    return np.clip(128 + 45 * rough / rough.std(), 0, 255)


def moved(gray, dx, dy):
    return np.clip(shift(gray, (dy, dx), order=3, mode="mirror"), 0, 255).astype(np.uint8)


def changing(level, noise=0.0, count=20, seed=0):
    """A square that changes by so many gray levels, on a noisy surface."""
    rng = np.random.default_rng(seed)
    images = np.full((count, *SIZE), 100.0)
    images[1::2, 30:60, 40:80] += level
    return np.clip(images + noise * rng.normal(size=images.shape), 0, 255).round().astype(np.uint8)


@pytest.mark.parametrize(("level", "moves"), [(5, False), (9, True)])
def test_pixels_move_that_change_by_more_than_six_gray_levels(level, moves):
    found = moving_pixels(list(changing(level)))
    assert found[35:55, 45:75].all() == moves
    assert not found[:20].any()
    assert found.shape == SIZE
    if moves:  # and what is 3 px beside them, smoothed by a pixel
        assert found[45, 38]
        assert not found[45, 34]
        assert not found[45, 88]


def test_noise_does_not_move():
    """Four times the usual change is noise; what changes by 80 gray levels is none."""
    found = moving_pixels(list(changing(80, noise=6.0)))
    assert found[35:55, 45:75].all()
    assert found[:20].mean() < 0.02
    assert found[70:].mean() < 0.02


def test_where_nearly_all_moves_it_is_no_noise():
    """The threshold is at most half of what changes most: here three quarters of the image change by 40."""
    images = np.full((10, *SIZE), 100, np.uint8)
    images[1::2, :, :100] = 140
    found = moving_pixels(list(images))
    assert found[:, :95].all()
    assert not found[:, 110:].any()


def test_of_many_images_some_are_looked_at():
    images = [np.full(SIZE, 100, np.uint8) for _ in range(120)]
    images[61] = np.full(SIZE, 200, np.uint8)  # every third is
    assert not moving_pixels(images).any()
    images[60] = np.full(SIZE, 200, np.uint8)
    assert moving_pixels(images).all()


def test_corners_are_the_strongest_of_each_cell_on_what_moves():
    image = np.full(SIZE, 60, np.uint8)
    spots = {(20, 20): 90, (28, 26): 140, (22, 29): 115, (60, 40): 100, (100, 70): 100, (4, 50): 200, (90, 20): 100}
    for (x, y), value in spots.items():
        image[y - 2 : y + 3, x - 2 : x + 3] = value
    mask = np.ones(SIZE, bool)
    mask[:, 80:] = False

    def near(points, place):
        return bool(len(points)) and np.linalg.norm(points - place, axis=1).min() < 3.6

    points = tracks._corners(image, mask, PointTrackOptions(per_cell=1))
    assert near(points, (28, 26))  # of three spots in the cell from (16, 16) to (31, 31) the strongest
    assert not near(points, (20, 20))
    assert near(points, (60, 40))
    assert not near(points, (100, 70))  # does not move
    assert not near(points, (4, 50))  # too near to the border
    cells = {(int(x) // 16, int(y) // 16) for x, y in np.round(points)}
    assert len(points) <= len(cells) + 2  # a corner may have gone over to the next cell by less than a pixel
    more = tracks._corners(image, mask, PointTrackOptions(per_cell=9))
    assert len(more) > len(points)
    assert tracks._corners(np.full(SIZE, 60, np.uint8), mask, PointTrackOptions()).shape == (0, 2)


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (3.4, -2.3), (-1.7, 4.2)])
def test_points_are_located_where_they_went(dx, dy):
    gray = texture()
    first, second = moved(gray, 0, 0), moved(gray, dx, dy)
    points = np.array([[40.0, 40.0], [70.5, 50.25], [90.0, 30.0]], np.float32)
    place, good = tracks._locate(first, second, points, points.copy(), PointTrackOptions())
    assert good.all()
    np.testing.assert_allclose(place, points + np.array([dx, dy]), atol=0.15)


def test_a_point_at_the_border_or_on_another_surface_is_not_believed():
    gray = texture()
    first, second = moved(gray, 0, 0), moved(gray, -3.0, 0)
    points = np.array([[10.5, 50.0], [5.5, 50.0], [60.0, 8.0], [60.0, 3.4], [121.0, 50.0]], np.float32)
    _, good = tracks._locate(first, second, points, points - np.float32([3, 0]), PointTrackOptions(window=5))
    assert good.tolist() == [True, False, True, True, True]
    up, down = moved(gray, 0, -2.0), moved(gray, 0, 2.0)
    _, good = tracks._locate(first, up, points[2:4], points[2:4] - np.float32([0, 2]), PointTrackOptions(window=5))
    assert good.tolist() == [True, False]
    low = np.array([[60.0, 87.0], [60.0, 91.6]], np.float32)
    _, good = tracks._locate(first, down, low, low + np.float32([0, 2]), PointTrackOptions(window=5))
    assert good.tolist() == [True, False]
    covered = second.copy()
    covered[30:70, 40:80] = moved(texture(5), 0, 0)[30:70, 40:80]
    inside = np.array([[60.0, 50.0]], np.float32)
    _, good = tracks._locate(first, covered, inside, inside - np.float32([3, 0]), PointTrackOptions())
    assert not good.any()


@pytest.mark.parametrize("window", [5, 15])
def test_correlation_is_that_of_the_windows(window):
    first, second = moved(texture(), 0, 0), moved(texture(1), 0, 0)
    second = (0.5 * second + 0.5 * first).astype(np.uint8)
    a, b = np.array([[40.0, 50.0], [80.0, 30.0]]), np.array([[41.0, 52.0], [80.0, 30.0]])
    half = window // 2
    found = tracks._correlation(first, second, a, b, window)
    for k in range(2):
        patches = [one[int(y) - half : int(y) + half + 1, int(x) - half : int(x) + half + 1].ravel().astype(float)
                   for one, (x, y) in ((first, a[k]), (second, b[k]))]  # fmt: skip
        assert found[k] == pytest.approx(np.corrcoef(*patches)[0, 1], abs=1e-6)
    # At the border the last pixel goes on.
    wide = np.pad(first, half, mode="edge")
    corner = tracks._correlation(first, first[::-1].copy(), np.zeros((1, 2)), np.zeros((1, 2)), window)
    other = np.pad(first[::-1], half, mode="edge")
    expected = np.corrcoef(wide[:window, :window].ravel(), other[:window, :window].ravel())[0, 1]
    assert corner[0] == pytest.approx(expected, abs=1e-6)
    assert tracks._correlation(first, second, a[:0], b[:0], window).shape == (0,)
    plain = np.full(SIZE, 7, np.uint8)
    assert tracks._correlation(plain, first, a, b, window).tolist() == [0.0, 0.0]


def test_points_are_sought_so_many_images_before_and_after_from_where_they_went(monkeypatch):
    """The next guess adds half of what the last one was off and half of what was added to it."""
    asked = []
    path = {k: 3.0 * k + 0.5 * k * k for k in range(-11, 12)}

    def locate(first, second, points, guess, options):
        asked.append((int(second[0, 0]), guess[:, 0].tolist()))
        k = int(second[0, 0]) - 10
        good = np.array([True, k < 3])[: len(points)]
        place = points.copy()
        place[:, 0] += path[k]
        return place, good

    monkeypatch.setattr(tracks, "_locate", locate)
    images = [np.full((4, 4), k, np.uint8) for k in range(20)]
    points = np.array([[50.0, 20.0], [60.0, 30.0]], np.float32)
    found = tracks._follow(images, 10, points, PointTrackOptions(reach=4))
    assert [k for k, _ in asked] == [11, 12, 13, 14, 9, 8, 7, 6]
    assert np.isfinite(found[:, 0, 0]).tolist() == [6 <= k <= 14 for k in range(20)]
    assert np.isfinite(found[:, 1, 0]).tolist() == [6 <= k <= 12 for k in range(20)]
    np.testing.assert_allclose(found[14, 0], [50 + path[4], 20])
    guess, velocity, expected = 50.0, 0.0, []
    for k in range(1, 5):
        expected.append(guess + velocity)
        velocity = 0.5 * velocity + 0.5 * (50 + path[k] - guess)
        guess = 50 + path[k]
    np.testing.assert_allclose([places[0] for _, places in asked[:4]], expected)
    asked.clear()
    ends = tracks._follow(images, 1, points[:1], PointTrackOptions(reach=4))
    assert [k for k, _ in asked] == [2, 3, 4, 5, 0]
    assert np.isfinite(ends[:6, 0, 0]).all()


def test_reference_images_and_strides(monkeypatch):
    """Of 31 images every third is looked at, of these every fourth is a reference; without corners it has no part."""
    asked = []
    monkeypatch.setattr(tracks, "moving_pixels", lambda looked: np.ones((40, 48), bool))
    monkeypatch.setattr(tracks, "_corners", lambda image, moving, options: np.zeros((0 if image[0, 0] == 12 else 2, 2)))

    def follow(looked, reference, corners, options):
        asked.append((len(looked), reference))
        return np.full((len(looked), len(corners), 2), float(reference))

    monkeypatch.setattr(tracks, "_follow", follow)
    images = [np.full((40, 48), k, np.uint8) for k in range(31)]
    joints = np.arange(31.0)[:, None]
    found = follow_points(images, joints, PointTrackOptions(reference_every=4))
    assert asked == [(11, 0), (11, 8)]
    assert found.references.tolist() == [0, 0, 8, 8]
    assert found.joints[:, 0].tolist() == list(range(0, 31, 3))
    assert found.size == (40, 48)
    assert found.pixels.shape == (11, 4, 2)
    monkeypatch.setattr(tracks, "_corners", lambda *_: np.zeros((0, 2)))
    with pytest.raises(DenseVSError, match="nothing with texture moves"):
        follow_points(images, joints)


@pytest.mark.parametrize("changes", [
    {"window": 4}, {"window": 16}, {"stride": 0}, {"reach": 1}, {"per_cell": 0}, {"reference_every": 0},
    {"max_return": 0.0}, {"min_correlation": 1.0}, {"min_correlation": 0.0},
])  # fmt: skip
def test_options_that_cannot_be(changes):
    with pytest.raises(DenseVSError):
        PointTrackOptions(**changes)
    PointTrackOptions(window=5, stride=1, reach=2, per_cell=1, reference_every=1)


@pytest.mark.parametrize("wrong", [
    [np.zeros((40, 40), np.uint8)] * 2, [np.zeros((40, 31), np.uint8)] * 3, [np.zeros((40, 40))] * 3,
    [np.zeros((40, 40, 3), np.uint8)] * 3, "images",
    [np.zeros((40, 40), np.uint8)] * 3 + [np.zeros((41, 40), np.uint8)],
])  # fmt: skip
def test_images_that_cannot_be(wrong):
    with pytest.raises(DenseVSError):
        tracks.gray_images(wrong, fewest=3, least=32)
    assert len(tracks.gray_images([np.zeros((32, 32), np.uint8)] * 3, fewest=3, least=32)) == 3


def test_tracks_that_cannot_be():
    joints, pixels, references = np.zeros((4, 2)), np.zeros((4, 3, 2)), np.zeros(3, int)
    PointTracks(joints, pixels, references, SIZE)
    nothing = np.zeros((4, 0, 2))
    infinite = pixels.copy()
    infinite[0, 0, 0] = np.inf
    given = [
        (joints, pixels[:3], references),
        (joints, nothing, references[:0]),
        (joints, infinite, references),
        (joints, pixels, references[:2]),
        (joints, pixels, references + 0.5),
        (joints, pixels[..., 0], references),
        (joints[:0], pixels[:0], references),
    ]
    for wrong in given:
        with pytest.raises(DenseVSError):
            PointTracks(*wrong, SIZE)
    infinite[0, 0, 0] = np.nan
    some = PointTracks(joints, infinite, np.array([4, 5, 6]), SIZE)
    assert not some.seen[0, 0]
    chosen = some.select(np.array([2, 0]))
    assert chosen.references.tolist() == [6, 4]
    assert np.isnan(chosen.pixels[0, 1, 0])


def test_every_cell_has_corners_of_its_own():
    """In a high, narrow image as well: a spot in each cell of 16 px; those of the last row and column are too near."""
    rows, columns = 11, 3
    spots = np.zeros((16 * rows, 16 * columns))
    spots[8::16, 8::16] = 1.0
    image = (100 + 1200 * gaussian_filter(spots, 1.5)).astype(np.uint8)
    found = tracks._corners(image, np.ones(image.shape, bool), PointTrackOptions(per_cell=1))
    assert sorted(found.round().tolist()) == sorted([16 * c + 8.0, 16 * r + 8.0] for c in range(2) for r in range(10))


def test_which_places_are_believed(monkeypatch):
    """Those that the way back ends nearer than the bound, both ways done, inside the image, and alike."""
    options = PointTrackOptions(max_return=0.5, min_correlation=0.8)
    points = np.tile(np.array([[40.0, 30.0]], np.float32), (12, 1))
    places, ends, done = points + np.float32(2), points.copy(), np.ones((2, 12), np.uint8)
    ends[1] += [0.3, 0.3]
    ends[2] += [0.5, 0.0]  # as far as the bound
    ends[3] -= [0.4, 0.4]
    done[0, 4] = done[1, 5] = 0
    edge = tracks._EDGE
    places[6], places[7] = (edge, 30), (40, edge)
    places[8], places[9] = (SIZE[1] - 1 - edge, 30), (40, SIZE[0] - 1 - edge)
    alike = np.array([0.9] * 10 + [0.8, 0.81])
    asked = []

    def flow(first, second, start, guess, **setup):
        asked.append((start.copy(), guess.copy(), setup))
        way = len(asked) - 1
        return (places if way == 0 else ends).reshape(-1, 1, 2), done[way].reshape(-1, 1), None

    monkeypatch.setattr(tracks.cv2, "calcOpticalFlowPyrLK", flow)
    believed = np.array([0, 1, 10, 11])
    monkeypatch.setattr(tracks, "_correlation", lambda first, second, a, b, window: alike[believed])
    image = np.zeros(SIZE, np.uint8)
    found, good = tracks._locate(image, image, points, points + np.float32(1), options)
    np.testing.assert_array_equal(found, places)
    assert np.flatnonzero(good).tolist() == [0, 1, 11]
    np.testing.assert_array_equal(asked[0][1].reshape(-1, 2), points + 1)
    np.testing.assert_array_equal(asked[1][0].reshape(-1, 2), places)
    np.testing.assert_array_equal(asked[1][1].reshape(-1, 2), points + np.array([1.5, -1.5], np.float32))
    assert asked[0][2]["maxLevel"] == 1
    assert asked[0][2]["criteria"] == (3, 20, 0.01)
