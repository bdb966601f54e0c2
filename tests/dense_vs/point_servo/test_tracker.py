"""Tracked points against a plane whose motion is known: each method's arithmetic, its drift, and losing and finding."""

import itertools

import numpy as np
import pytest
from planar_scene import SHIFT, PlanarScene
from reference_control import carried_as_printed, carried_to_fixed_point

from dense_vs import DenseVSError, FlowEstimator, PointTracker

# px; three steps of a contraction by a flow gradient below 0.1.
FIXED_POINT_TOLERANCE = 1e-3

GRID = np.stack(np.meshgrid([40.0, 64.5, 90.25], [34.0, 50.5, 62.75]), axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def swing():
    """Postures (T, 4) of a plane that turns on and on while it shifts and breathes, by up to 3 px a frame."""
    t = np.arange(101) / 30
    shift_x, shift_y, breath = 0.1 * np.sin(5 * t), 0.08 * np.sin(7 * t), 0.1 * np.sin(4 * t)
    return np.stack([shift_x, shift_y, 1.5 * t, breath], axis=1)


@pytest.fixture(scope="module")
def images(scene, swing):
    return [scene.image(q) for q in swing]


@pytest.fixture(scope="module")
def estimated_flow(scene, images):
    estimator = FlowEstimator("dis", scene.height, scene.width)
    return [estimator(a, b) for a, b in itertools.pairwise(images)]


def drift(scene, swing, images, flows, method, points=GRID):
    """Distance of every point from the truth after the sequence [px]."""
    tracker = PointTracker(points, images[0], method=method)
    for flow, image in zip(flows, images[1:], strict=True):
        tracker.update(flow, image)
    truth = scene.to_image(scene.to_plane(points, swing[0]), swing[-1])
    return np.linalg.norm(tracker.points - truth, axis=1)


def test_exact_flow_leaves_the_fixed_point_nothing_to_drift_by(scene, swing, images):
    flows = [scene.flow(a, b) for a, b in itertools.pairwise(swing)]
    solved = drift(scene, swing, images, flows, "fixed_point")
    assert solved.max() < 0.02
    assert np.median(drift(scene, swing, images, flows, "paper")) > 50 * np.median(solved)


def test_alignment_stops_the_drift_that_estimated_flow_causes(scene, swing, images, estimated_flow):
    """With errors of 0.1 px a frame the flow alone carries the points away, however it is read."""
    aligned = drift(scene, swing, images, estimated_flow, "aligned")
    assert aligned.max() < 0.15
    for method in ("fixed_point", "paper"):
        assert np.median(drift(scene, swing, images, estimated_flow, method)) > 10 * np.median(aligned)


@pytest.mark.parametrize("seed", range(3))
def test_one_step_of_each_method_without_alignment(scene, seed):
    rng = np.random.default_rng(seed)
    gray = np.zeros((scene.height, scene.width), np.uint8)
    a, b = rng.normal(0, 0.03, (2, 4))
    flow = scene.flow(a, b)
    corners = [[0.0, 0.0], [scene.width - 1, scene.height - 1], [0.3, 94.8]]
    points = np.concatenate([rng.uniform([0, 0], [scene.width - 1, scene.height - 1], (20, 2)), corners])
    paper = PointTracker(points, gray, method="paper").update(flow, gray)
    np.testing.assert_allclose(paper, carried_as_printed(points, flow), atol=1e-9)
    solved = PointTracker(points, gray, method="fixed_point").update(flow, gray)
    np.testing.assert_allclose(solved, carried_to_fixed_point(points, flow), atol=FIXED_POINT_TOLERANCE)


def test_covered_point_is_lost_and_found_again(scene):
    path = np.outer(0.1 * np.sin(np.arange(31) / 5), [1.0, 0.5, 0.3, -0.4])
    tracker = PointTracker([[64.5, 50.5], [22.0, 48.0]], scene.image(path[0]), lost_after=5)
    assert not tracker.lost.any()
    np.testing.assert_array_equal(tracker.correlation, 1)
    states = []
    for k in range(1, 31):
        image = scene.image(path[k])
        if 6 <= k <= 20:
            image[30:75, 45:90] = 90
        tracker.update(scene.flow(path[k - 1], path[k]), image)
        states.append(tracker.lost.tolist())
    assert [covered for covered, _ in states] == [9 < k <= 20 for k in range(1, 31)]
    assert not any(seen for _, seen in states)
    truth = scene.to_image(scene.to_plane(np.array([64.5, 50.5]), path[0]), path[30])
    assert np.linalg.norm(tracker.points[0] - truth) < 0.15
    assert (tracker.correlation > 0.85).all()


@pytest.mark.parametrize("method", ["fixed_point", "paper", "aligned"])
def test_point_outside_the_image_is_lost_until_it_is_back(method):
    scene = PlanarScene(64, 64)
    path = np.concatenate([np.arange(0, 40, 2.0), np.arange(40, 0, -2.0), np.zeros(4)])
    tracker = PointTracker([45.0, 30.0], scene.image(np.zeros(4)), method=method, lost_after=2)
    lost = []
    for before, after in itertools.pairwise(path):
        q_before, q = np.array([before, 0, 0, 0]) / SHIFT, np.array([after, 0, 0, 0]) / SHIFT
        tracker.update(scene.flow(q_before, q), scene.image(q))
        lost.append(bool(tracker.lost[0]))
    outside = 45.0 + path[1:] > 63
    assert (np.array(lost)[outside][2:]).all()
    assert not lost[-1]
    assert not any(lost[:5])
    np.testing.assert_allclose(tracker.points, [[45.0, 30.0]], atol=0.1)
    if method != "aligned":
        np.testing.assert_array_equal(lost, outside)
        assert np.isnan(tracker.correlation).all()


def test_mask_keeps_the_background_from_pulling():
    """A textured square slides over a still background; the point is 3 px inside its outline."""
    front, back = PlanarScene(80, 120, seed=1), PlanarScene(80, 120, seed=2)
    side = slice(25, 55)

    def view(shift):
        image, flow = back.image(np.zeros(4)), np.zeros((80, 120, 2), np.float32)
        on = np.zeros((80, 120), dtype=bool)
        on[side, 20 + shift : 60 + shift] = True
        image[on] = front.image(np.array([shift, 0, 0, 0]) / SHIFT)[on]
        flow[on] = 1.0, 0.0
        return image, flow, on

    image, _, on = view(0)
    start = np.array([57.0, 40.0])
    masked = PointTracker(start, image, weights=on)
    whole = PointTracker(start, image)
    for shift in range(1, 31):
        image, flow, _ = view(shift)
        masked.update(flow, image)
        whole.update(flow, image)
    truth = start + np.array([30.0, 0.0])
    assert np.linalg.norm(masked.points[0] - truth) < 0.1
    assert masked.correlation[0] > 0.95
    assert whole.correlation[0] < masked.correlation[0] - 0.05


def test_redefine_follows_other_points(scene, swing, images, estimated_flow):
    tracker = PointTracker([40.0, 34.0], images[0])
    for k in range(1, 11):
        tracker.update(estimated_flow[k - 1], images[k])
    points = np.array([[80.0, 50.0], [30.0, 60.0]])
    tracker.redefine(points, images[10])
    np.testing.assert_array_equal(tracker.points, points)
    assert tracker.lost.shape == tracker.correlation.shape == (2,)
    for k in range(11, 31):
        tracker.update(estimated_flow[k - 1], images[k])
    truth = scene.to_image(scene.to_plane(points, swing[10]), swing[30])
    assert np.linalg.norm(tracker.points - truth, axis=1).max() < 0.2


def test_keeps_points_of_its_own(scene, images):
    mine = np.array([[40.0, 34.0]])
    tracker = PointTracker(mine, images[0])
    mine[...] = 0
    np.testing.assert_array_equal(tracker.points, [[40.0, 34.0]])


GRAY = np.zeros((20, 30), np.uint8)
FLOW = np.zeros((20, 30, 2), np.float32)


@pytest.mark.parametrize("method", ["aligned", "fixed_point", "paper"])
def test_refusals_leave_the_points(method):
    rng = np.random.default_rng(0)
    gray = rng.integers(0, 256, GRAY.shape, dtype=np.uint8)
    tracker = PointTracker([[10.0, 8.0], [20.0, 12.0]], gray, method=method)
    holes = FLOW.copy()
    holes[8, 10] = np.nan
    for flow, image, message in (
        (FLOW[:10], gray, r"flow has shape \(10, 30, 2\).*expected float32 of shape \(20, 30, 2\)"),
        (FLOW.astype(float), gray, "flow has .*dtype float64; expected float32"),
        (None, gray, "flow has .*expected float32"),
        (holes, gray, "flow is not finite at the points"),
        (FLOW, gray[:, :20], r"gray has shape \(20, 20\).*expected uint8 of shape \(20, 30\)"),
        (FLOW, gray.astype(float), "gray has .*dtype float64; expected uint8"),
        (FLOW, np.zeros((20, 30, 3), np.uint8), r"gray has shape \(20, 30, 3\)"),
    ):
        before = [tracker.points.copy(), tracker.lost.copy(), tracker.correlation.copy()]
        with pytest.raises(DenseVSError, match=message):
            tracker.update(flow, image)
        for a, b in zip(before, (tracker.points, tracker.lost, tracker.correlation), strict=True):
            np.testing.assert_array_equal(a, b)
    for points, image, weights, message in (
        ([[40.0, 8.0]], gray, None, r"points \[\[40.0, 8.0\]\] are outside the image of 30 x 20 pixels"),
        ([[-0.1, 8.0]], gray, None, "are outside the image"),
        ([[np.nan, 8.0]], gray, None, "expected finite image points"),
        ([[1.0, 2.0, 3.0]], gray, None, "expected finite image points"),
        ([[1.0, 2.0]], gray[:10], None, "gray has shape"),
        ([[1.0, 2.0]], gray, np.ones((20, 20)), r"weights have shape \(20, 20\) .*expected \(20, 30\)"),
        ([[1.0, 2.0]], gray, np.full((20, 30), np.nan), "weights .*expected"),
        ([[1.0, 2.0]], gray, "mask", "weights .*expected"),
    ):
        with pytest.raises(DenseVSError, match=message):
            tracker.redefine(points, image, weights)
        np.testing.assert_array_equal(tracker.points, [[10.0, 8.0], [20.0, 12.0]])
    assert np.isfinite(tracker.update(FLOW, gray)).all()


@pytest.mark.parametrize("gray", [np.zeros((20, 30, 3), np.uint8), np.zeros((20, 30)), np.zeros(20, np.uint8), None])
def test_refuses_to_start_on_another_kind_of_image(gray):
    with pytest.raises(DenseVSError, match=r"gray has .*expected uint8 of shape \((H, W|20, 30)\)"):
        PointTracker([1.0, 2.0], gray)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "klt"}, "method is 'klt'; expected one of aligned, fixed_point, paper"),
        ({"window": 24}, "window is 24; expected an odd whole number"),
        ({"window": 5}, "window is 5; expected"),
        ({"window": 25.0}, "window is 25.0; expected"),
        ({"min_correlation": 1.0}, "min_correlation is 1.0; expected a number between 0 and 1"),
        ({"min_correlation": "high"}, "min_correlation is 'high'; expected a number"),
        ({"max_jump": 0}, "max_jump is 0.*expected above 0"),
        ({"max_jump": float("nan")}, "max_jump is nan.*expected above 0"),
        ({"lost_after": 0}, "lost_after 0; expected above 0 and at least 1"),
        ({"lost_after": None}, "lost_after is None; expected a number"),
        ({"speed": 3}, "unknown option .*speed.*expected some of method, window"),
    ],
    ids=str,
)
def test_refuses_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        PointTracker([1.0, 2.0], GRAY, **options)
