"""Following an object from image to image: where it is looked for, what is doubted, and what becomes of a lost one."""

import cv2
import numpy as np
import pytest
from drawn_objects import HEIGHT, WIDTH, drawn, shown_at

from dense_vs.errors import DenseVSError
from dense_vs.segmentation import FewShotOptions, FewShotSegmenter
from dense_vs.segmentation.few_shot import segmenter as module
from dense_vs.segmentation.few_shot.candidate_regions import see
from dense_vs.segmentation.few_shot.object_track import Doubt, FoundRegion, ObjectTrack, Window

SHAPE = (120, 160)


def box(top, left, height, width, score=0.8):
    pixels = np.zeros(SHAPE, dtype=bool)
    pixels[top : top + height, left : left + width] = True
    return FoundRegion(pixels, score)


def followed(*regions):
    track = ObjectTrack()
    for number, region in enumerate(regions):
        track.follow(region.pixels, region, anew=number == 0)
    return track


def test_a_window_holds_the_box_and_its_margin():
    window = Window.around(box(40, 50, 20, 30).pixels, 10)
    assert (window.rows, window.columns) == (slice(24, 70), slice(40, 90))  # begins on the grid of 8
    assert Window.around(box(40, 50, 20, 30).pixels, 0) == Window(slice(40, 60), slice(48, 80))
    assert Window.of_image(SHAPE) == Window(slice(0, 120), slice(0, 160))


@pytest.mark.parametrize("first", [0, 3, 50, 100, 119])
@pytest.mark.parametrize("size", [1, 7, 20, 60])
@pytest.mark.parametrize("margin", [0, 10, 500])
def test_a_window_stays_in_the_image_and_on_the_grid(first, size, margin):
    region = box(first, first, size, size).pixels
    window = Window.around(region, margin)
    for part, length in ((window.rows, SHAPE[0]), (window.columns, SHAPE[1])):
        last = min(first + size, length) - 1
        assert part.start % 8 == 0
        assert 0 <= part.start <= max(first - margin, 0)
        assert part.start > first - margin - 8 or part.start == 0 or part.start > length - 24
        assert min(last + 1 + margin, length) <= part.stop <= length
        assert part.stop - part.start >= 16
        assert part.stop <= max(last + 1 + margin, part.start + 16)


@pytest.mark.parametrize(
    ("region", "cut"),
    [
        ((40, 50, 20, 30), False),
        ((33, 50, 5, 5), False),
        ((32, 50, 5, 5), True),  # its first row is the window's
        ((50, 40, 5, 5), True),
        ((50, 41, 5, 5), False),
        ((75, 50, 5, 5), True),  # its last row is the window's
        ((74, 50, 5, 5), False),
        ((50, 105, 5, 5), True),
        ((50, 104, 5, 5), False),
    ],
)
def test_what_reaches_the_edge_of_a_window(region, cut):
    assert Window(slice(32, 80), slice(40, 110)).cuts(box(*region).pixels) == cut


def test_the_edge_of_the_image_cuts_nothing():
    assert not Window(slice(0, 120), slice(0, 160)).cuts(np.ones(SHAPE, dtype=bool))
    assert not Window(slice(0, 80), slice(40, 160)).cuts(box(0, 100, 20, 60).pixels)


INSIDE = Window(slice(0, 120), slice(0, 160))


@pytest.mark.parametrize(
    ("found", "window", "doubt"),
    [
        (box(40, 52, 20, 20), INSIDE, None),
        (None, INSIDE, Doubt.MISSED),
        (box(40, 52, 20, 20), Window(slice(0, 60), slice(0, 160)), Doubt.CUT),
        (box(40, 52, 20, 20), Window(slice(0, 61), slice(0, 160)), None),
        (box(40, 52, 20, 20, 0.61), INSIDE, None),  # above three quarters of 0.8
        (box(40, 52, 20, 20, 0.59), INSIDE, Doubt.FAINT),
        (box(40, 52, 28, 28), INSIDE, None),  # 1.3 times 20, and 2 px
        (box(40, 52, 29, 28), INSIDE, Doubt.RESIZED),
        (box(40, 52, 14, 14), INSIDE, None),  # 20 is not above 1.3 times 14, and 2 px
        (box(40, 52, 14, 13), INSIDE, Doubt.RESIZED),
    ],
)
def test_either_side_of_what_is_doubted(found, window, doubt):
    track = followed(box(40, 50, 20, 20))
    assert track.doubt(found, window) is doubt


def test_a_track_s_score_is_the_whole_image_s_then_a_running_mean():
    track = followed(box(40, 50, 20, 20, 0.8), box(40, 50, 20, 20, 0.6))
    assert track.score == pytest.approx(0.76)
    track.follow(box(0, 0, 5, 5).pixels, box(0, 0, 5, 5, 0.5), anew=True)
    assert track.score == 0.5
    track.forget()
    assert (track.mask, track.region, track.score) == (None, None, 0.0)
    assert track.window(SHAPE, 16) is None
    assert track.doubt(box(0, 0, 5, 5), INSIDE) is Doubt.MISSED


def test_a_window_is_of_images_of_one_size():
    track = followed(box(40, 50, 20, 20))
    assert track.window(SHAPE, 16) == Window.around(box(40, 50, 20, 20).pixels, 16)
    assert track.window((SHAPE[0] + 1, SHAPE[1]), 16) is None


def overlap(found, mask):
    return (found & mask).sum() / max((found | mask).sum(), 1)


@pytest.fixture(scope="module")
def learned():
    rng = np.random.default_rng(0)
    pairs = [drawn(rng, size) for size in (None, None, None, 4, 3, None)]
    return FewShotSegmenter(samples=300, size=WIDTH).fit(*zip(*pairs, strict=True))


@pytest.fixture
def tracker(learned, monkeypatch):
    """The segmenter, and the sizes of the images that it has looked at."""
    sizes = []

    def look(image, image_area=None):
        sizes.append(image.shape[:2])
        return see(image, image_area)

    monkeypatch.setattr(module, "see", look)
    learned.reset()
    return learned, sizes


@pytest.mark.slow
def test_an_object_that_moves_little_is_looked_for_where_it_was(tracker):
    tracker, sizes = tracker
    rng, known = np.random.default_rng(6), 0.0
    for number in range(6):
        image, mask = shown_at(60 + 8 * number, 80, rng)
        assert overlap(tracker.segment(image), mask) > 0.8
        assert tracker.everywhere == (number == 0)
        assert tracker.doubt is None
        known = tracker.score if number == 0 else known + 0.2 * (tracker.score - known)
        assert tracker._track.score == pytest.approx(known)
        assert known > 0
    assert sizes[0] == (HEIGHT, WIDTH)
    assert len(sizes) == 6
    assert max(height * width for height, width in sizes[1:]) < 0.35 * HEIGHT * WIDTH


@pytest.mark.slow
def test_an_object_that_jumps_is_found_in_the_same_image(tracker):
    tracker, sizes = tracker
    rng = np.random.default_rng(7)
    doubts = []
    for x, y in ((50, 50), (150, 110), (150 - 24, 110), (190, 150), (8, 8)):  # away, to the edge, into the corners
        image, mask = shown_at(x, y, rng)
        assert overlap(tracker.segment(image), mask) > 0.7
        doubts.append(tracker.doubt)
        assert tracker.everywhere
    assert doubts[0] is None
    assert doubts[1] is Doubt.MISSED
    assert doubts[2] in (Doubt.CUT, Doubt.MISSED, Doubt.RESIZED)
    assert Doubt.MISSED in doubts[3:]
    assert sizes.count((HEIGHT, WIDTH)) == 5
    image, mask = shown_at(9, 9, rng)
    assert overlap(tracker.segment(image), mask) > 0.7
    assert not tracker.everywhere


@pytest.mark.slow
def test_an_object_that_is_gone_leaves_no_mask_and_is_found_where_it_comes_back(tracker):
    tracker, sizes = tracker
    rng = np.random.default_rng(8)
    for number in range(2):
        assert tracker.segment(shown_at(60 + 4 * number, 80, rng)[0]).any()
    for number in range(3):
        image = drawn(rng, 0)[0]
        if number:  # something else stands where it was
            cv2.ellipse(image, (64, 80), (18, 11), 30, 0, 360, (60, 80, 170), -1)
        assert not tracker.segment(image).any()
        assert tracker.score == 0.0
        assert tracker.everywhere
        assert tracker.doubt is (None if number else Doubt.MISSED)
    assert sizes[-2:] == [(HEIGHT, WIDTH)] * 2  # nothing left to follow
    image, mask = shown_at(150, 60, rng)
    assert overlap(tracker.segment(image), mask) > 0.8


@pytest.mark.slow
def test_an_object_that_is_hidden_little_by_little_comes_back_whole(tracker):
    tracker, _ = tracker
    rng = np.random.default_rng(9)
    for hidden in (0.0, 0.1, 0.2, 0.3, 0.4, 1.1, 1.1, 0.4, 0.3, 0.2, 0.1, 0.0):
        image, mask = shown_at(90, 80, rng)
        plate = (slice(60, 102), slice(66, 70 + int(40 * hidden)))
        image[plate], mask[plate] = (90, 90, 200), False
        found = tracker.segment(image)
        assert overlap(found, mask) > 0.75 if mask.any() else not found.any()


@pytest.mark.slow
def test_a_score_that_falls_has_the_whole_image_looked_at(tracker, monkeypatch):
    tracker, sizes = tracker
    rng = np.random.default_rng(14)
    tracker.segment(shown_at(60, 80, rng)[0])
    monkeypatch.setattr(tracker._track, "score", 10 * tracker.score)
    image, mask = shown_at(62, 80, rng)
    assert overlap(tracker.segment(image), mask) > 0.8
    assert (tracker.everywhere, tracker.doubt) == (True, Doubt.FAINT)
    assert tracker._track.score == tracker.score  # what is now to be expected
    tracker.segment(shown_at(64, 80, rng)[0])
    assert (tracker.everywhere, tracker.doubt) == (False, None)
    assert [size == (HEIGHT, WIDTH) for size in sizes] == [True, False, True, False]


@pytest.mark.slow
def test_after_a_reset_nothing_is_known_of_earlier_images(tracker):
    tracker, sizes = tracker
    rng = np.random.default_rng(10)
    image, _ = shown_at(60, 80, rng)
    first = tracker.segment(image)
    tracker.segment(image)
    tracker.reset()
    assert (tracker.score, tracker.everywhere, tracker.doubt) == (0.0, False, None)
    np.testing.assert_array_equal(tracker.segment(image), first)
    assert [size == (HEIGHT, WIDTH) for size in sizes] == [True, False, True]


@pytest.mark.slow
def test_an_image_of_another_size_is_looked_at_as_a_whole(tracker):
    tracker, _ = tracker
    rng = np.random.default_rng(11)
    image, mask = shown_at(60, 80, rng)
    tracker.segment(image)
    large = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    found = tracker.segment(large)
    assert (tracker.everywhere, tracker.doubt) == (True, Doubt.OTHER_SIZE)
    assert overlap(found[::2, ::2], mask) > 0.8
    assert overlap(tracker.segment(large)[::2, ::2], mask) > 0.8
    assert not tracker.everywhere


@pytest.mark.slow
def test_bad_input_leaves_the_track_as_it_was(tracker):
    tracker, _ = tracker
    image, _ = shown_at(60, 80, np.random.default_rng(12))
    tracker.segment(image)
    for wrong in (image.astype(np.float32), image[..., 0], image[:8], None, "image"):
        with pytest.raises(DenseVSError):
            tracker.segment(wrong)
    assert tracker.segment(image).any()
    assert not tracker.everywhere


@pytest.mark.slow
def test_without_a_window_every_image_is_looked_at_as_a_whole(tracker, monkeypatch):
    tracker, sizes = tracker
    monkeypatch.setattr(tracker, "options", FewShotOptions(samples=300, size=WIDTH, window=0))
    rng = np.random.default_rng(13)
    for number in range(2):
        image, mask = shown_at(60 + 4 * number, 80, rng)
        assert overlap(tracker.segment(image), mask) > 0.8
        assert (tracker.everywhere, tracker.doubt) == (True, None)
    assert sizes == [(HEIGHT, WIDTH)] * 2
