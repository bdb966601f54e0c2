"""How two images differ, beside a float64 reference; what is held back, counted and dated, on changes made by hand."""

import numpy as np
import pytest
from scipy import ndimage

from dense_vs.recording import distinct_images
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.recording.repeated_images import ChangeMeter, ImageChange, RepetitionFilter


def blocks(image):
    height, width = (side // 16 for side in image.shape)
    return image[: 16 * height, : 16 * width].reshape(height, 16, width, 16).mean(axis=(1, 3))


def smooth(image):
    """OpenCV's Gaussian of deviation 1 in float: nine taps, mirrored at the border."""
    taps = np.exp(-0.5 * np.arange(-4.0, 5.0) ** 2)
    taps /= taps.sum()
    return ndimage.correlate1d(ndimage.correlate1d(image, taps, 0, mode="mirror"), taps, 1, mode="mirror")


def slope(image, axis):
    found = ndimage.correlate1d(image, [-1.0, 0.0, 1.0], axis, mode="mirror")
    return ndimage.correlate1d(found, [1.0, 2.0, 1.0], 1 - axis, mode="mirror") / 8


def change(before, now):
    """By definition: least squares of the difference by the image's slope, a block at a time, 0.5 on the diagonal."""
    difference = now - before
    mean = np.abs(difference).mean()
    difference = smooth(difference)
    difference -= ndimage.uniform_filter(difference, 16, mode="mirror", origin=0)
    middle = smooth(0.5 * (before + now))
    dx, dy = slope(middle, 1), slope(middle, 0)
    energy = blocks(difference**2)
    share = np.empty(energy.shape)
    parts = [blocks(one) for one in (dx * dx, dx * dy, dy * dy, dx * difference, dy * difference)]
    for place in np.ndindex(energy.shape):
        xx, xy, yy, xd, yd = (one[place] for one in parts)
        right = np.array([xd, yd])
        share[place] = right @ np.linalg.solve([[xx + 0.5, xy], [xy, yy + 0.5]], right)
        share[place] /= max(energy[place], 0.3**2 / 4)
    size = np.sqrt(energy)
    return mean, np.quantile(size, 0.97), np.median(size), np.quantile(share, 0.95)


def texture(shift=0.0, size=(100, 140), seed=0):
    image = np.random.default_rng(seed).uniform(0, 255, (size[0] + 20, size[1] + 20))
    image = ndimage.gaussian_filter(image, 3.0, mode="wrap") * 4 - 380
    return ndimage.shift(image, (0.5 * shift, shift), mode="wrap")[10:-10, 10:-10].clip(0, 255)


@pytest.mark.parametrize("shift", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_change_by_definition(shift, noise):
    rng = np.random.default_rng(1)
    before, now = texture(), texture(shift) + noise * rng.normal(size=(100, 140)) + 2.0
    found = ChangeMeter().change(before.astype(np.float32), now.astype(np.float32))
    expected = change(before, now)
    assert found.mean == pytest.approx(expected[0], rel=1e-4)
    np.testing.assert_allclose([found.strongest, found.usual, found.explained], expected[1:], rtol=0.03)


def test_the_same_image_says_nothing_more():
    image = texture().astype(np.float32)
    assert ChangeMeter().change(image, image + np.float32(0.0195)) == ImageChange(
        pytest.approx(0.0195, rel=0.02), 0, 0, 0
    )
    assert ChangeMeter().change(image, image + np.float32(0.021)).identical is False
    assert ImageChange(0.0199, 0, 0, 0).identical
    assert not ImageChange(0.0201, 0, 0, 0).identical


@pytest.mark.parametrize(
    ("size", "prepared"),
    [
        ((48, 320), (48, 320)),
        ((48, 321), (48, 320)),
        ((240, 640), (120, 320)),
        ((20, 640), (16, 320)),
        ((9, 9), (9, 9)),
    ],
)
def test_wide_images_are_averaged_down(size, prepared):
    gray = np.random.default_rng(0).integers(0, 255, size, dtype=np.uint8)
    found = ChangeMeter().prepare(gray)
    assert (found.shape, found.dtype) == (prepared, np.float32)
    if size == (240, 640):
        np.testing.assert_allclose(found, gray.reshape(120, 2, 320, 2).mean(axis=(1, 3)), atol=0.5)


@pytest.mark.parametrize(
    ("changed", "moved"),
    [
        (ImageChange(2.51, 0.0, 0.1, 0.0), True), (ImageChange(2.49, 0.0, 0.1, 0.0), False),
        (ImageChange(0.5, 3.01, 0.1, 0.0), True), (ImageChange(0.5, 2.99, 0.1, 0.0), False),  # gray levels
        (ImageChange(0.5, 4.51, 1.0, 0.0), True), (ImageChange(0.5, 4.49, 1.0, 0.0), False),  # times the usual block
        (ImageChange(0.5, 0.31, 9.0, 0.66), True), (ImageChange(0.5, 0.29, 9.0, 0.66), False),
        (ImageChange(0.5, 0.31, 9.0, 0.64), False), (ImageChange(0.01, 99.0, 0.0, 1.0), False),
    ],
)  # fmt: skip
def test_what_has_moved(changed, moved):
    assert changed.moved == moved


STILL = ImageChange(0.5, 0.2, 0.1, 0.0)  # encoded anew
SAME = ImageChange(0.0, 0.0, 0.0, 0.0)


def told(changes):
    """What is kept, after a first image, and how many were counted, of images that differ by ``changes``."""
    one = RepetitionFilter()
    one._meter.change = lambda before, now: changes[int(now[0, 0]) - 1]
    kept = [one.keep(np.full((20, 20), k, np.uint8)) for k in range(len(changes) + 1)]
    return "".join("01"[one] for one in kept), one.repeated


def moving(mean=0.5, strongest=3.1, usual=0.1):
    return ImageChange(mean, strongest, usual, 0.9)


@pytest.mark.parametrize(
    ("changes", "kept", "repeated"),
    [
        ([moving()] * 3, "1111", 0),
        ([STILL] * 5, "100000", 0),
        ([STILL] * 6, "1000001", 0),  # a longer rest is a scene in which nothing moves
        ([STILL] * 12, "1000001000001", 0),
        (
            [SAME, moving(strongest=2.7 + 0.01)],
            "101",
            1,
        ),  # half of it would have shown: 4.5 times the least noise, twice
        ([SAME, moving(strongest=2.7 - 0.01)], "101", 0),  # it may have grown slowly
        ([SAME, moving(mean=5.01, strongest=0.4)], "101", 1),
        ([SAME, moving(mean=4.99, strongest=0.4)], "101", 0),
        ([SAME, SAME, moving(strongest=2.03 + 2.03)], "1001", 2),  # a third of it is too little, two thirds are not
        ([SAME, SAME, moving(strongest=2.03)], "1001", 1),
        ([STILL, ImageChange(0.5, 3.1, 0.4, 0.9)], "101", 1),
        ([ImageChange(0.5, 1.0, 0.5, 0.0), moving(strongest=4.4)], "101", 0),  # 4.5 times its own noise, twice
        ([ImageChange(0.5, 1.0, 0.5, 0.0), moving(strongest=4.6)], "101", 1),
        ([SAME, ImageChange(0.5, 0.2, 0.4, 0.0)], "100", 1),  # what is encoded anew was repeated before
        ([SAME, ImageChange(0.5, 0.2, 0.39, 0.0)], "100", 0),
        ([STILL, ImageChange(0.5, 0.2, 0.4, 0.0)], "100", 0),
        ([SAME, ImageChange(0.5, 0.2, 0.4, 0.0), moving(mean=9.0)], "1001", 2),  # each counts once
    ],
)
def test_what_is_held_back_and_counted(changes, kept, repeated):
    assert told(changes) == (kept, repeated)


def test_another_size_and_a_gap_begin_anew():
    one = RepetitionFilter()
    image = texture().astype(np.uint8)
    assert [one.keep(image), one.keep(image), one.keep(image[:90]), one.keep(image[:90])] == [True, False, True, False]
    one.restart()
    assert one.keep(image[:90])
    assert one.repeated == 0


class Counting(RepetitionFilter):
    """New are images whose gray differs from that before."""

    def keep(self, gray):
        new = getattr(self, "value", None) != gray[0, 0]
        self.value = gray[0, 0]
        self.repeated += not new
        return bool(new)


def dated(monkeypatch, values, stamps, fps=30.0):
    monkeypatch.setattr(distinct_images, "RepetitionFilter", Counting)
    images = [(np.full((4, 6, 3), v, np.uint8), t) for v, t in zip(values, stamps, strict=True)]
    stream = DistinctImages(images, fps)
    return list(stream), stream


@pytest.mark.parametrize(("repeats", "evened"), [(2, False), (3, True)])
def test_stamps_are_evened_where_more_than_a_tenth_repeat(monkeypatch, repeats, evened):
    values = np.arange(20)
    values[1 : 1 + repeats] = 0  # the first of 20 images repeats
    stamps = np.arange(20) / 30
    found, stream = dated(monkeypatch, values, stamps)
    assert stream.repeated == repeats
    assert stream.images == 20
    assert found[-1].evened == evened
    assert found[-1].gray.tolist() == np.full((4, 6), 19).tolist()
    assert len(found) == 20 - repeats


def test_each_image_is_dated_by_seven_before_and_six_after(monkeypatch):
    rng = np.random.default_rng(3)
    slips = rng.uniform(0, 1, 40) < 0.3
    frames = 2 * np.arange(40) + slips
    stamps = np.sort(np.concatenate([frames, frames + 0.9])) / 30  # each image twice
    found, _ = dated(monkeypatch, np.repeat(np.arange(40), 2), stamps)
    own = frames / 30
    newest = -np.inf
    for k, one in enumerate(found):
        near = own[max(k - 7, 0) : k + 7]
        place = k - max(k - 7, 0)
        # Twelve neighbors whose steps are all near the usual one: a line through them.
        counts = np.maximum(np.floor(np.diff(near) / np.diff(near).mean() + 0.25), 1)
        number = np.concatenate([[0.0], np.cumsum(counts)])
        line = np.polynomial.Polynomial.fit(number, near, 1)(number[place])
        expected = max(own[k] + np.clip(line - own[k], -1 / 30, 1 / 30), newest + 0.1 / 30)
        assert one.time == pytest.approx(expected, abs=1e-9)
        newest = one.time


def test_times_of_the_even_clock_go_on(monkeypatch):
    """However far a stamp is moved back, an image comes a tenth of a step after the one before."""
    monkeypatch.setattr(distinct_images, "even_time", lambda stamps, place, most: 1.0)
    found, _ = dated(monkeypatch, np.repeat(np.arange(10), 2), np.arange(20) / 30)
    assert [one.time for one in found] == pytest.approx(1.0 + np.arange(10) / 300)
