"""Labels by motion and color beside a float64 reference, frame by frame, and every limit of the classes around them."""

from concurrent.futures import Future
from dataclasses import asdict

import cv2
import numpy as np
import pytest
import warp as wp
from scipy import ndimage

from dense_vs import DenseVSError, SelfBody
from dense_vs.body import refined_labels
from dense_vs.body.appearance import Appearance
from dense_vs.body.cluster_worker import ClusterWorker, EvaluatedClusters
from dense_vs.body.motion_evidence import SelfMotion, SelfMotionOptions
from dense_vs.body.refined_labels import RefinedLabels, _moving_parts

H, W = 30, 80


class ByHand:
    """The module's docstrings, pixel by pixel; colors are those of ``Appearance``, smoothing is OpenCV's box."""

    def __init__(self):
        self.colors, self.learned = Appearance(), []

    def observe(self, image, unexplained, moved):
        motion = np.full((H, W), -1.5)
        for y, x in np.ndindex(H, W):
            if np.isfinite(unexplained[y, x]):
                motion[y, x] = np.clip(np.log(0.3 / max(unexplained[y, x], 1e-3)), -3, 3)
            if not moved[y, x]:
                motion[y, x] = min(motion[y, x], -1.5)
        bins = self.colors.color_bins(image)
        color = np.clip(self.colors.log_odds(bins).astype(float), -3.0, 1.5)
        sure = np.argwhere((motion + color > 1.0) & (motion > 0.3))
        for y, x in np.ndindex(H, W):
            near = len(sure) and np.abs(sure - [y, x]).max(axis=1).min() <= 20
            if not near and np.isfinite(unexplained[y, x]):
                color[y, x] = min(color[y, x], 0.0)
        odds = motion + color
        around = ndimage.uniform_filter(odds, 5, mode="mirror")
        own, other = (around > 1.4) & (motion > 0.5), (around < -1.4) & (motion <= -0.5)
        self.learned.append(own.sum() >= 60)
        if self.learned[-1]:
            self.colors.learn(bins, own, other)
        return odds, motion


def frames(count, seed=0, size=9):
    """A red arm before a gray street, of which parts move by themselves and some say nothing, and somebody in red."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        body = np.zeros((H, W), bool)
        body[8 : 8 + size, 4 + k : 4 + k + size] = True
        red = body | ((np.arange(W) >= 60) & (np.arange(W) < 66))
        image = np.where(red[..., None], [200, 40, 40], [90, 100, 90]) + rng.integers(-8, 8, (H, W, 3))
        unexplained = np.where(body, 0.02, 1.2) * rng.uniform(0.5, 1.5, (H, W))
        unexplained[rng.random((H, W)) < 0.1] = np.nan
        unexplained[0, :5] = 1e-7
        moved = rng.random((H, W)) < 0.95
        yield image.astype(np.uint8), unexplained.astype(np.float32), moved


@pytest.mark.parametrize("size", [9, 12])
def test_log_odds_are_those_of_motion_and_color(size):
    labels, reference = RefinedLabels(), ByHand()
    for image, unexplained, moved in frames(6, size=size):
        labels.observe(image, unexplained, moved)
        odds, motion = reference.observe(image, unexplained, moved)
        np.testing.assert_allclose(labels._motion, motion, atol=1e-5)
        np.testing.assert_allclose(labels._odds, odds, atol=1e-4)
    assert any(reference.learned) == (size == 12)
    own = labels.own()
    assert labels.own() is own
    likely = refined_labels.guided_filter(image, odds.astype(np.float32), 4, 1e-3) > 0
    np.testing.assert_array_equal(own, _moving_parts(likely, motion.astype(np.float32)))


@pytest.mark.parametrize(("pixels", "kept"), [(59, False), (60, True)])
@pytest.mark.parametrize(("odds", "moves"), [(0.01, True), (0.0, False), (-0.01, False)])
def test_parts_of_sixty_pixels_that_motion_speaks_for(pixels, kept, odds, moves):
    likely = np.zeros((H, W), bool)
    likely.reshape(-1)[:pixels] = True
    motion = np.full((H, W), odds, np.float32)
    found = _moving_parts(likely, motion)
    np.testing.assert_array_equal(found, likely & (kept and moves))


def test_a_part_s_motion_is_a_mean_of_odds_of_at_most_two():
    likely = np.zeros((H, W), bool)
    likely[5:15, 5:15] = likely[15:25, 15:25] = True  # they touch by a corner only
    motion = np.zeros((H, W), np.float32)
    motion[5:15, 5:15] = np.where(np.arange(10) < 5, 3.0, -2.0)  # clipped, they are as much for it as against
    motion[5, 5] = 1.9
    motion[15:25, 15:25] = np.where(np.arange(10) < 5, 2.0, -9.0)
    motion[15, 24] = -1.9
    np.testing.assert_array_equal(np.argwhere(_moving_parts(likely, motion))[[0, -1]], [[15, 15], [24, 24]])
    assert _moving_parts(likely, motion).sum() == 100


# Colors.


def test_bins_of_colors_and_what_is_counted():
    image = np.random.default_rng(0).integers(0, 256, (9, 11, 3), dtype=np.uint8)
    colors = Appearance()
    bins = colors.color_bins(image)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(int)
    for y, x in np.ndindex(9, 11):
        light, a, b = lab[y, x]
        a, b = (min(max(3 * (v - 128) + 128, 0), 255) for v in (a, b))
        assert bins[y, x] == 64 * (light // 32) + 8 * (a // 32) + b // 32
    gray = image[..., 0]
    np.testing.assert_array_equal(colors.color_bins(gray), colors.color_bins(np.repeat(gray[..., None], 3, axis=2)))


@pytest.mark.parametrize(("seen", "told"), [(199, False), (200, True)])
def test_two_hundred_pixels_of_each_say_something(seen, told):
    colors = Appearance()
    bins = np.zeros((20, 30), int)
    bins[10:] = 300
    own = np.zeros((20, 30), bool)
    own.reshape(-1)[:seen] = True
    colors.learn(bins, own, bins == 300)
    odds = colors.log_odds(bins)
    assert bool(odds.any()) == told
    assert odds.dtype == np.float32
    if told:
        assert odds[0, 0] == pytest.approx(np.log((0.125 + 5e-5) / 5e-5), rel=1e-5)
        assert odds[10, 0] == pytest.approx(-np.log((0.125 + 5e-5) / 5e-5), rel=1e-5)
    colors.learn(bins, own, bins == 300)
    np.testing.assert_allclose(colors._counts.sum(axis=(1, 2, 3)), [300 * 1.998, seen * 1.998], rtol=1e-6)


# Algorithm 1 beside the frames.


def worker(**options):
    return ClusterWorker((1, 4, 5), 2, 3, wp.get_device("cpu"),
                         **{"seed": 0, "synchronous": True, "reading": "printed", "max_lag": 2, **options})  # fmt: skip


def given(one):
    rng = np.random.default_rng(0)
    return wp.array(
        rng.normal(size=(1, 4, 5, 2, 2)).astype(np.float32), dtype=one._k_means.jacobian.dtype, device="cpu"
    )


def test_the_state_of_the_runs(monkeypatch):
    one, runs = worker(), []
    results = [EvaluatedClusters(np.ones((2, 2, 2)), np.ones(2))]
    monkeypatch.setattr("dense_vs.body.cluster_worker.run_algorithm_1", lambda *work: runs.append(work) or results)
    assert one.status().state == "waiting"
    assert not one.poll()
    J = given(one)
    assert one.offer(J, None, warm=True)
    assert one.poll()
    assert (one.status().state, one.status().runs, one.status().lag) == ("ready", 1, 0)
    assert runs[0][2:] == ([], True, "printed")
    np.testing.assert_array_equal(one._k_means.members.numpy(), 1)
    members = wp.array(np.zeros((1, 4, 5)), dtype=wp.int8, device="cpu")
    one._running = Future()  # a run is under way
    for lag, state in ((1, "ready"), (2, "ready"), (3, "behind")):
        assert not one.offer(J, members, warm=False)
        assert (one.status().state, one.status().lag, one.status().skipped) == (state, lag, lag)
        assert not one.wait(0.0)
    one._running.set_result([EvaluatedClusters(np.zeros((0, 2, 2)), np.zeros(0))])
    assert one.wait(None)
    assert not one.poll()  # nothing to cluster
    assert one.results is results
    assert one.offer(J, members, warm=False)
    np.testing.assert_array_equal(one._k_means.members.numpy(), 0)
    assert one.poll()
    assert (one.status().state, one.status().runs, one.status().lag) == ("ready", 2, 0)
    assert runs[1][2:] == (results, False, "printed")


def test_a_run_that_raises_is_told_and_the_next_is_tried(monkeypatch):
    one = worker()

    def fail(*_):
        raise ValueError("no memory")

    monkeypatch.setattr("dense_vs.body.cluster_worker.run_algorithm_1", fail)
    assert one.offer(given(one), None, warm=False)
    assert not one.poll()
    assert (one.status().state, one.status().error) == ("failed", "ValueError: no memory")
    good = [EvaluatedClusters(np.ones((1, 2, 2)), np.ones(1))]
    monkeypatch.setattr("dense_vs.body.cluster_worker.run_algorithm_1", lambda *_: good)
    assert one.offer(given(one), None, warm=False)
    assert one.poll()
    assert (one.status().state, one.status().error, one.status().lag) == ("ready", "", 0)


def test_a_run_begins_with_centers_only_where_they_are_as_many_as_wanted():
    from dense_vs.body.cluster_worker import run_algorithm_1

    asked = []

    class Found:
        clusters = 2

        def __call__(self, rngs, starts):
            asked.append(starts)
            return [type("C", (), {"centers": self.centers[k]}) for k in range(len(rngs))]

    k_means = Found()
    rng = np.random.default_rng(1)
    two, one, none = rng.normal(size=(2, 2, 3)), rng.normal(size=(1, 2, 3)), np.zeros((0, 2, 3))
    k_means.centers = [two, one]
    first = run_algorithm_1(k_means, [None] * 2, [], True, "printed")
    assert asked == [[None, None]]
    k_means.centers = [two * 1.1, none]
    second = run_algorithm_1(k_means, [None] * 2, first, True, "printed")
    assert asked[1][0] is first[0].centers
    assert asked[1][1] is None
    assert second[1] is first[1]  # nothing to cluster: what is known stays
    assert second[0].centers is k_means.centers[0]
    run_algorithm_1(k_means, [None] * 2, first, False, "printed")
    assert asked[2] == [None, None]


# The body.


def test_the_defaults_of_self_recognition():
    assert asdict(SelfMotionOptions()) == {
        "decay": 0.93, "rest": 0.1, "still": 0.2, "due": 0.5, "unexplained": 0.125, "least_energy": 0.1,
        "process_noise": 1e4, "measurement_noise": 0.1, "initial_variance": 1e4, "max_joint_step": 100.0,
    }  # fmt: skip
    body = SelfBody(device="cpu")
    assert (body.clusters_wanted, body.threshold, body.method, body.min_jacobian) == (5, 0.2, "motion", 6.0)
    assert body._worker_options == {"seed": 0, "synchronous": False, "reading": "printed", "max_lag": 90}
    assert SelfBody(method="paper", device="cpu").min_jacobian == 0.0
    assert SelfBody(min_jacobian=2.5, device="cpu").min_jacobian == 2.5
    assert (body.evaluation.shape, body.centers.shape) == ((0,), (0, 2, 0))
    assert body.wait()
    body.close()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"clusters": 1}, None), ({"clusters": 127}, None), ({"threshold": 0.0}, None), ({"threshold": 1.0}, None),
        ({"min_jacobian": 0.0}, None), ({"min_jacobian": 1e300}, "min_jacobian"),
        ({"max_lag": 1}, None), ({"seed": 0}, None), ({"worlds": 65536}, None),
        ({"joint_scale": [0.0, 1.0]}, None), ({"joint_scale": [-0.1, 1.0]}, "joint_scale"),
        ({"worlds": 65537}, "worlds"), ({"height": 2, "width": 2, "joints": 1}, None),
        ({"height": 1, "width": 2, "joints": 1}, "height"), ({"height": 2, "width": 1, "joints": 1}, "width"),
        ({"height": 16385, "width": 2, "joints": 1}, "height"), ({"height": 2, "width": 2, "joints": 0}, "joints"),
        ({"height": 2, "width": 2, "joints": 65}, "joints"), ({"joints": 3}, "expected all three or none"),
        ({"height": 3}, "expected all three or none"), ({"height": 3, "joints": 3}, "expected all three or none"),
    ],
)  # fmt: skip
def test_arguments_at_their_borders(changes, why):
    if why is None:
        SelfBody(**{"device": "cpu", "synchronous": True, **changes})
        return
    with pytest.raises(DenseVSError, match=why):
        SelfBody(**{"device": "cpu", "synchronous": True, **changes})


@pytest.mark.parametrize("name", ["decay", "unexplained"])
def test_shares_are_from_0_to_1(name):
    for value in (0.0, 1.0):
        SelfMotionOptions(**{name: value})
    with pytest.raises(DenseVSError, match=name):
        SelfMotionOptions(**{name: 1.001})
    for other in ("measurement_noise", "initial_variance", "max_joint_step"):
        SelfMotionOptions(**{other: 1e-9})
        with pytest.raises(DenseVSError, match=other):
            SelfMotionOptions(**{other: 0.0})
    for other in ("rest", "still", "due", "least_energy", "process_noise"):
        assert getattr(SelfMotionOptions(**{other: 7.0}), other) == 7.0


def test_a_size_is_fixed_once():
    body = SelfBody(height=4, width=6, joints=2, device="cpu", synchronous=True)
    body.fix_size(4, 6, 2)
    for other in ((5, 6, 2), (4, 7, 2), (4, 6, 3)):
        with pytest.raises(DenseVSError, match=r"body is for \(4, 6\) pixels and 2 joints"):
            body.fix_size(*other)


@pytest.mark.parametrize("image", [False, True])
def test_labels_by_images_ask_what_joints_move_by_twenty_pixels_a_radian(monkeypatch, image):
    body = SelfBody(height=4, width=5, joints=2, device="cpu", synchronous=True)
    asked = []
    monkeypatch.setattr(SelfMotion, "moved", lambda self, least: asked.append(least) or np.zeros((1, 4, 5), bool))
    flow, seen = np.ones((4, 5, 2), np.float32), np.zeros((4, 5, 3), np.uint8)
    body.observe(flow, np.array([0.1, 0.0]), seen if image else None)
    assert asked == ([20.0] if image else [])
    assert body._refines == image


@pytest.mark.parametrize("least", [4.1, 4.2])
def test_what_the_filter_s_own_j_moves(least):
    """By the Frobenius norm in standard units."""
    motion = SelfMotion((1, 4, 5), 2, wp.get_device("cpu"), 1, SelfMotionOptions(), np.array([2.0, 0.5]))
    J = np.zeros((1, 4, 5, 2, 2), np.float32)
    J[0, 1, 2] = [[2.0, 0.0], [1.0, 2.0]]
    motion._jacobian[motion._now].assign(J)
    motion.energies.assign(np.ones((1, 4, 5, 2), np.float32))
    found = motion.moved(least)
    # A unit step of the first joint is half a radian of it; of the second it is two.
    assert found.sum() == (np.hypot(np.hypot(2.0, 1.0) / 2.0, 2.0 / 0.5) > least)
    J[0, 0, 0, 0, 0] = np.nan
    known = motion.finite(wp.array(J, dtype=motion._jacobian[0].dtype, device="cpu"))
    assert known.sum() == 19
    assert not known[0, 0, 0]


def test_energies_that_say_nothing_are_unknown():
    motion = SelfMotion((1, 4, 5), 2, wp.get_device("cpu"), 1, SelfMotionOptions())
    energies = np.zeros((1, 4, 5, 2), np.float32)
    energies[0, 0] = [[0.02, 0.2], [0.05, 0.0999], [0.2, 0.0], [0.3, 0.15], [0.1001, 0.05]]
    motion.energies.assign(energies)
    share = motion.unexplained()[0]
    np.testing.assert_allclose(share[0, [0, 3, 4]], [0.1, 2.0, 2.002], rtol=1e-4)
    assert np.isnan(share[0, 1])
    assert share[0, 2] > 1e30
    assert np.isnan(share[1:]).all()
