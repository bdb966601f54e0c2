"""Labels that motion and color agree on: the guided filter, what colors tell, and what outlines cut off."""

import cv2
import numpy as np
import pytest

from dense_vs import DenseVSError, SelfBody
from dense_vs.body import refined_labels
from dense_vs.body.appearance import BINS, LEAST_SEEN, MEMORY, RARE, Appearance
from dense_vs.body.guided_filter import guided_filter
from dense_vs.body.refined_labels import REACH, RefinedLabels

HEIGHT, WIDTH = 60, 100
WOOD, ARM, CAN = (180, 140, 110), (60, 60, 70), (220, 150, 30)
ALL = np.ones((HEIGHT, WIDTH), bool)


def smooth_image(seed, height, width):
    rng = np.random.default_rng(seed)
    return cv2.GaussianBlur(rng.integers(0, 256, (height, width, 3)).astype(np.uint8), (0, 0), 3)


def reference_guided_filter(guide, values, radius, flatness):
    """He, Sun and Tang (2013), eqs. (14), (15) and (16), a least-squares fit in every window, in float64."""
    padded = np.pad(guide.astype(float) / 255, ((radius, radius), (radius, radius), (0, 0)), "symmetric")
    padded_values = np.pad(values.astype(float), radius, "symmetric")
    side = 2 * radius + 1
    fit = np.zeros((*values.shape, 4))
    for y, x in np.ndindex(values.shape):
        colors = padded[y : y + side, x : x + side].reshape(-1, 3)
        inside = padded_values[y : y + side, x : x + side].ravel()
        covariance = np.cov(colors.T, bias=True) + flatness * np.eye(3)
        slope = np.linalg.solve(covariance, (colors * inside[:, None]).mean(0) - colors.mean(0) * inside.mean())
        fit[y, x] = [*slope, inside.mean() - slope @ colors.mean(0)]
    fits = np.pad(fit, ((radius, radius), (radius, radius), (0, 0)), "symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(fits, (side, side), axis=(0, 1)).mean(axis=(3, 4))
    return windows


def test_guided_filter_against_a_fit_in_every_window():
    guide, values = smooth_image(0, 28, 36), np.random.default_rng(1).normal(size=(28, 36)).astype(np.float32)
    small = cv2.resize(guide.astype(np.float32), (18, 14), interpolation=cv2.INTER_AREA)
    fits = reference_guided_filter(small, cv2.resize(values, (18, 14), interpolation=cv2.INTER_AREA), 2, 1e-3)
    fits = cv2.resize(fits, (36, 28), interpolation=cv2.INTER_LINEAR)
    expected = np.sum(fits[..., :3] * (guide / 255), axis=2) + fits[..., 3]
    np.testing.assert_allclose(guided_filter(guide, values, 4, 1e-3), expected, atol=2e-3)


def test_log_odds_are_those_of_the_counted_colors():
    appearance = Appearance()
    image = np.zeros((40, 40, 3), np.uint8)
    image[:, :20], image[:, 20:] = ARM, CAN
    bins = appearance.color_bins(image)
    own = np.zeros((40, 40), bool)
    own[:, :15] = True  # 600 of the arm's color
    appearance.learn(bins, own, ~own)  # 200 and 800
    middle = 0.5**3  # of a bin's count stays in it
    expected = np.log(middle + RARE) - np.log(middle * 0.2 + RARE), np.log(RARE) - np.log(middle * 0.8 + RARE)
    odds = appearance.log_odds(bins)
    np.testing.assert_allclose(odds[:, :20], expected[0], rtol=1e-4)
    np.testing.assert_allclose(odds[:, 20:], expected[1], rtol=1e-4)
    for _ in range(3):  # what is not seen again counts less and less, for both alike
        appearance.learn(bins, np.zeros_like(own), np.zeros_like(own))
    np.testing.assert_allclose(appearance.log_odds(bins), odds, rtol=1e-3)
    assert 600 * MEMORY**4 > LEAST_SEEN


def test_too_few_pixels_tell_nothing():
    appearance = Appearance()
    bins = appearance.color_bins(smooth_image(0, 20, 20))
    assert bins.min() >= 0
    assert bins.max() < BINS**3
    own = np.zeros((20, 20), bool)
    own[:5, :20] = True
    appearance.learn(bins, own, ~own)
    np.testing.assert_array_equal(appearance.log_odds(bins), 0.0)


class Scene:
    """An arm of one color on the right of a table; what motion says of it bleeds by eight pixels."""

    def __init__(self):
        self.arm = np.zeros((HEIGHT, WIDTH), bool)
        self.arm[20:45, 55:] = True
        self.image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        self.image[:] = WOOD
        self.image[self.arm] = ARM
        self.bled = cv2.dilate(self.arm.astype(np.uint8), np.ones((17, 17), np.uint8)) > 0
        self.unexplained = np.where(self.bled, 0.15, 1.5).astype(np.float32)  # flow over an outline fits J less well
        self.unexplained[self.arm] = 0.02

    def put(self, where, color, unexplained):
        self.image[where], self.unexplained[where] = color, unexplained

    def labels(self, refined, frames=1):
        for _ in range(frames):
            refined.observe(self.image, self.unexplained, ALL)
        return refined.own()


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize("gray", [False, True])
def test_outlines_are_the_images_own(gray):
    scene = Scene()
    if gray:
        scene.image = cv2.cvtColor(scene.image, cv2.COLOR_RGB2GRAY)
    assert overlap(scene.bled, scene.arm) < 0.6
    assert overlap(scene.labels(RefinedLabels(), 5), scene.arm) > 0.95


def test_what_was_still_before_it_was_taken_is_no_part_of_the_hand():
    refined, scene = RefinedLabels(), Scene()
    can = slice(22, 40), slice(35, 47)
    scene.put(can, CAN, 1.5)
    scene.labels(refined, 10)
    scene.put(can, CAN, 0.02)  # from now on it moves with the hand
    own = scene.labels(refined, 10)
    assert own[can].mean() < 0.05
    assert overlap(own, scene.arm) > 0.95


def test_what_is_carried_for_long_does_not_become_the_hands_own():
    """The hand's colors on a tenth of it, and motion that for long says it is the hand's, teach nothing wrong."""
    refined, scene = RefinedLabels(), Scene()
    can = slice(22, 40), slice(35, 47)
    scene.put(can, CAN, 1.5)
    scene.labels(refined, 10)
    scene.put(can, CAN, 0.02)
    scene.image[22:24, 35:47] = ARM
    rng = np.random.default_rng(0)
    for _ in range(300):
        shade = rng.integers(-12, 13)
        scene.image[24:40, 35:47] = np.clip(np.array(CAN) + shade, 0, 255)
        refined.observe(scene.image, scene.unexplained, ALL)
    assert refined.own()[26:40, 35:45].mean() < 0.1


def test_plain_parts_of_the_body_are_filled_and_passers_by_in_its_colors_are_not():
    refined, scene = RefinedLabels(), Scene()
    scene.labels(refined, 5)
    plain, passer_by = (slice(25, 40), slice(75, 85)), (slice(5, 55), slice(5, 55 - 8 - REACH - 3))
    scene.put(plain, ARM, np.nan)
    scene.put(passer_by, ARM, 0.5)
    own = scene.labels(refined, 5)
    assert own[plain].all()
    assert not own[passer_by].any()


def test_colors_shared_with_the_table_leave_the_labels_to_motion():
    scene = Scene()
    scene.image = smooth_image(3, HEIGHT, WIDTH)
    scene.unexplained = np.where(scene.arm, 0.02, 1.5).astype(np.float32)
    assert overlap(scene.labels(RefinedLabels(), 5), scene.arm) > 0.85


def moving_arm(frames, seed=0):
    """Image, flow and dq of an arm that joint 0 shifts, before a table."""
    rng, scene = np.random.default_rng(seed), Scene()
    for _ in range(frames):
        dq = rng.normal(0, 0.03, 2)
        flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        flow[scene.bled] = np.array([[80.0, 0], [20, 60]]) @ dq * (1 + rng.normal(0, 0.35))
        flow[scene.arm] = np.array([[80.0, 0], [20, 60]]) @ dq
        yield scene, flow, dq


def test_a_body_that_sees_images_labels_by_them():
    size = {"height": HEIGHT, "width": WIDTH, "joints": 2, "synchronous": True, "device": "cpu"}
    body, blind, both = SelfBody(**size), SelfBody(**size), SelfBody(worlds=2, **size)
    J = np.ones((HEIGHT, WIDTH, 2, 2), np.float32) * 50
    J[30, 80] = np.nan
    scene = Scene()
    for scene, flow, dq in moving_arm(40):
        body.observe(flow, dq, scene.image)
        blind.observe(flow, dq)
        twice = [np.stack([array, array]) for array in (flow, dq, scene.image)]
        both.observe(*twice)
    assert overlap(blind.labels(J), scene.arm) < 0.7
    assert overlap(body.labels(J), scene.arm) > 0.9
    assert body.recognition(J)[30, 80] == -1
    np.testing.assert_array_equal(both.labels(np.stack([J, J])), np.stack([body.labels(J)] * 2))
    np.testing.assert_array_equal(body.labels(J), body.recognition(J) == 1)
    body.observe(flow, dq)  # an image that is missing leaves this frame's labels to motion
    blind.observe(flow, dq)
    np.testing.assert_array_equal(body.recognition(J), blind.recognition(J))


def test_refuses_images_and_stays_as_it_was():
    body = SelfBody(synchronous=True, device="cpu")
    J = np.full((HEIGHT, WIDTH, 2, 2), 50, np.float32)
    for scene, flow, dq in moving_arm(10):
        body.observe(flow, dq, scene.image)
    before = body.recognition(J)
    for bad in (scene.image[1:], scene.image.astype(float), scene.image[..., :2], "image", 3):
        with pytest.raises(DenseVSError, match=r"image is .*expected uint8 of shape \(60, 100\) or \(60, 100, 3\)"):
            body.observe(flow, dq, bad)
    np.testing.assert_array_equal(body.recognition(J), before)


class Told:
    """Colors whose log-odds are told; what is learned of them is kept."""

    def __init__(self, odds):
        self.odds, self.learned = odds.astype(np.float32), []

    def color_bins(self, image):
        return np.zeros(self.odds.shape, int)

    def log_odds(self, bins):
        return self.odds

    def learn(self, bins, own, other):
        self.learned.append((own, other))


def observed(motion, color):
    """Labels after a frame whose log-odds of motion and of color are told."""
    refined = RefinedLabels()
    refined._appearance = told = Told(color)
    refined.observe(np.zeros((*motion.shape, 3), np.uint8), 0.3 * np.exp(-motion), np.ones(motion.shape, bool))
    return refined, told


@pytest.mark.parametrize(
    ("motion", "color", "sure"),
    [
        (0.9, 0.05, False), (0.9, 0.15, True), (0.29, 1.4, False), (0.31, 1.4, True), (1.5, -0.6, False),
        (1.5, -0.4, True), (0.45, 0.45, False), (2.0, 0.0, True),
    ],
)  # fmt: skip
def test_color_speaks_for_pixels_up_to_twenty_beside_one_that_both_are_sure_of(motion, color, sure):
    motions, colors = np.full((60, 70), -0.75), np.full((60, 70), 1.5)
    motions[28, 33], colors[28, 33] = motion, color
    refined, _ = observed(motions, colors)
    near = np.zeros((60, 70), bool)
    near[8:49, 13:54] = sure
    expected = np.where(near, motions + colors, motions + np.minimum(colors, 0.0))
    np.testing.assert_allclose(refined._odds, expected, atol=1e-5)


@pytest.mark.parametrize(("pixels", "learned"), [(59, False), (60, True)])
def test_colors_are_learned_of_sixty_pixels_that_motion_and_surroundings_speak_for(pixels, learned):
    motion, color = np.full((40, 50), 0.45), np.full((40, 50), 1.5)
    motion[15, 10:40], motion[16, 10 : pixels - 20] = 0.55, 0.55
    motion[30:] = -3.0
    _, told = observed(motion, color)
    assert len(told.learned) == learned
    if learned:
        np.testing.assert_array_equal(told.learned[0][0], motion == 0.55)
        around = cv2.blur(motion + color, (5, 5))
        np.testing.assert_array_equal(told.learned[0][1], (motion == -3.0) & (around < -1.4))


def test_labels_are_the_smoothed_odds_above_0(monkeypatch):
    motion = np.full((30, 40), 0.4)
    smooth, asked = np.zeros((30, 40), np.float32), []
    smooth[:, :20], smooth[:, 20:30] = 0.01, -0.01
    monkeypatch.setattr(refined_labels, "guided_filter", lambda *given: asked.append(given) or smooth)
    refined, _ = observed(motion, np.zeros((30, 40)))
    np.testing.assert_array_equal(refined.own(), smooth > 0)
    refined.own()
    ((image, odds, radius, flatness),) = asked
    assert image.shape == (30, 40, 3)
    np.testing.assert_allclose(odds, 0.4, atol=1e-5)
    assert (radius, flatness) == (4, 1e-3)
