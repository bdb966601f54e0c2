"""Points in many worlds: as one world at a time, on device arrays, restarted alone, and in a CUDA graph."""

import numpy as np
import pytest
import warp as wp
from planar_scene import PlanarScene

from dense_vs import DenseVSError, PointTracker
from dense_vs.kernels.tracking.point_tracking import TrackedPoints, begin_tracks, carry_tracks, locate_tracks

WORLDS = 3
POINTS = np.array([[40.0, 34.0], [64.5, 50.5], [90.25, 62.75]])
OPTIONS = {"min_correlation": 0.85, "max_jump": 2.5, "lost_after": 5}


@pytest.fixture(scope="module")
def film():
    """Images (T, worlds, H, W), their flow, and where the points truly are (T, worlds, K, 2)."""
    scenes = [PlanarScene(seed=seed) for seed in range(WORLDS)]
    time = np.arange(12) / 30
    paths = [
        np.stack([0.1 * np.sin(5 * time + k), 0.08 * np.sin(7 * time), (k - 1) * time, 0.1 * np.sin(4 * time)], axis=1)
        for k in range(WORLDS)
    ]
    worlds = list(zip(scenes, paths, strict=True))
    images = np.array([[scene.image(path[t]) for scene, path in worlds] for t in range(12)])
    flows = np.array(
        [[scene.flow(path[t], path[t + 1]) for scene, path in worlds] for t in range(11)], dtype=np.float32
    )
    flows += np.random.default_rng(0).normal(0, 0.2, flows.shape).astype(np.float32)  # as estimated flow is
    places = [[scene.to_image(scene.to_plane(POINTS, path[0]), path[t]) for scene, path in worlds] for t in range(12)]
    return images, flows, np.array(places)


START = np.tile(POINTS, (WORLDS, 1, 1))


@pytest.mark.parametrize("method", ["aligned", "fixed_point", "paper"])
def test_worlds_are_tracked_as_one_world_is(film, method):
    images, flows, places = film
    weights = np.random.default_rng(0).uniform(size=images.shape[1:]) < 0.98
    together = PointTracker(START, images[0], weights=weights, method=method)
    alone = [PointTracker(POINTS, images[0, k], weights=weights[k], method=method) for k in range(WORLDS)]
    for flow, image in zip(flows, images[1:], strict=True):
        together.update(flow, image)
        for k, tracker in enumerate(alone):
            tracker.update(flow[k], image[k])
    assert together.points.shape == (WORLDS, 3, 2)
    assert together.lost.shape == together.correlation.shape == (WORLDS, 3)
    for k, tracker in enumerate(alone):
        np.testing.assert_array_equal(together.points[k], tracker.points)
        np.testing.assert_array_equal(together.correlation[k], tracker.correlation)
        np.testing.assert_array_equal(together.lost[k], tracker.lost)
    if method == "aligned":
        assert np.linalg.norm(together.points - places[-1], axis=-1).max() < 0.1


def test_takes_warp_arrays_and_gives_arrays_of_its_own(film):
    images, flows, _ = film
    numpy = PointTracker(START, images[0])
    warp = PointTracker(START, wp.array(images[0], device="cpu"))
    warp.update(wp.array(flows[0], dtype=wp.vec2, device="cpu"), wp.array(images[1], device="cpu"))
    before = numpy.points
    np.testing.assert_array_equal(numpy.update(flows[0], images[1]), warp.points)
    np.testing.assert_array_equal(before, START)


def test_a_point_without_flow_is_sought_where_it_was(film):
    images, flows, places = film
    holes = flows[0].copy()
    holes[1] = np.nan
    tracker = PointTracker(START, images[0], max_jump=5.0)
    tracker.update(holes, images[1])
    assert np.linalg.norm(tracker.points - places[1], axis=-1).max() < 0.05
    carried = PointTracker(START, images[0], method="fixed_point")
    carried.update(holes, images[1])
    np.testing.assert_array_equal(carried.points[1], POINTS)
    np.testing.assert_array_equal(carried.lost.all(axis=1), [False, True, False])


def test_a_world_begins_anew_alone(film):
    images, flows, places = film
    weights = wp.ones(images.shape[1:], dtype=float, device="cpu")
    tracks = TrackedPoints.empty(WORLDS, 3, 25, "cpu")

    def begin(frame, where):
        starts = wp.array(places[frame], dtype=wp.vec2d, device="cpu")
        image = wp.array(images[frame], device="cpu")
        begin_tracks(tracks, image, weights, starts, wp.array(where, dtype=int, device="cpu"))

    begin(0, [1, 1, 1])
    for frame in range(1, 12):
        black = images[frame].copy()
        black[1] = 0
        carry_tracks(tracks, wp.array(flows[frame - 1], dtype=wp.vec2, device="cpu"), 4)
        locate_tracks(tracks, wp.array(black, device="cpu"), **OPTIONS)
    np.testing.assert_array_equal(tracks.lost.numpy(), np.array([0, 1, 0])[:, None].repeat(3, axis=1))
    np.testing.assert_array_equal(tracks.unseen.numpy()[1], 11)
    kept = tracks.points.numpy()[[0, 2]]
    begin(11, [0, 1, 0])
    np.testing.assert_array_equal(tracks.points.numpy()[[0, 2]], kept)
    np.testing.assert_array_equal(tracks.points.numpy()[1], places[11, 1])
    np.testing.assert_array_equal(tracks.lost.numpy(), 0)
    np.testing.assert_array_equal(tracks.correlation.numpy()[1], 1)
    carry_tracks(tracks, wp.zeros(images.shape[1:], dtype=wp.vec2, device="cpu"), 4)
    locate_tracks(tracks, wp.array(images[11], device="cpu"), **OPTIONS)
    np.testing.assert_allclose(tracks.points.numpy()[1], places[11, 1], atol=1e-3)
    assert (tracks.correlation.numpy()[1] > 0.999).all()


def test_refusals_name_the_worlds(film):
    images, flows, _ = film
    tracker = PointTracker(START, images[0])
    with pytest.raises(DenseVSError, match=r"gray has shape \(96, 128\).*expected uint8 of shape \(3, 96, 128\)"):
        tracker.update(flows[0], images[1, 0])
    with pytest.raises(DenseVSError, match=r"flow has .*expected float32 of shape \(3, 96, 128, 2\)"):
        tracker.update(flows[0, 0], images[1])
    with pytest.raises(DenseVSError, match=r"points has shape \(2, 3, 2\).*expected .*\(3, any, 2\)"):
        PointTracker(START[:2], images[0])
    with pytest.raises(DenseVSError, match=r"gray has shape \(96, 128\).*\(worlds, H, W\) with points"):
        PointTracker(START, images[0, 0])
    with pytest.raises(DenseVSError, match=r"weights have shape \(96, 128\).*expected \(3, 96, 128\)"):
        PointTracker(START, images[0], weights=np.ones((96, 128)))


@pytest.mark.gpu
def test_the_same_on_a_gpu_in_a_graph(film):
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    images, flows, _ = film
    on_cpu = PointTracker(START, images[0])
    image, flow = wp.array(images[0], device="cuda:0"), wp.zeros(images.shape[1:], dtype=wp.vec2, device="cuda:0")
    on_gpu = PointTracker(START, image)
    on_gpu.update(flow, image)  # compiles before the capture
    on_gpu.redefine(START, image)
    with wp.ScopedCapture("cuda:0") as capture:
        on_gpu.update(flow, image)
    for step, present in zip(flows, images[1:], strict=True):
        flow.assign(step)
        image.assign(present)
        wp.capture_launch(capture.graph)
        on_cpu.update(step, present)
        np.testing.assert_allclose(on_gpu.points.numpy(), on_cpu.points, atol=0.01)  # px, as alignment leaves
    np.testing.assert_allclose(on_gpu.correlation.numpy(), on_cpu.correlation, atol=1e-3)
    np.testing.assert_array_equal(on_gpu.lost.numpy(), on_cpu.lost)
