"""Flow of many worlds at once, against the flow of each pair alone."""

import numpy as np
import pytest
import warp as wp

from dense_vs import BatchFlow, DenseVSError, FlowEstimator
from dense_vs.flow.batch_flow import BATCH_METHODS
from dense_vs.flow.estimator import ON_DEVICE, to_gray


@pytest.fixture(scope="module")
def sequence(scene):
    """Images of two worlds, (frames, worlds, height, width)."""
    steps = np.array([[0.0, 0, 0, 0], [0.02, 0.01, 0, 0], [0.03, 0.03, 0.01, 0], [0.05, 0.03, 0.01, 0.01]])
    return np.stack([[scene.image(q), scene.image(-q)] for q in steps])


def alone(sequence, frame, world):
    return FlowEstimator("farneback-warp", *sequence.shape[2:], device="cpu")(
        sequence[frame - 1, world], sequence[frame, world]
    )


def test_each_world_has_the_flow_of_its_own_images(sequence):
    batch = BatchFlow(2, *sequence.shape[2:], device="cpu")
    for frame, images in enumerate(sequence):
        flow = batch.update(wp.array(images, device="cpu"))
        assert flow is batch.flow
        for world in range(2):
            expected = alone(sequence, frame, world) if frame else np.zeros((*images.shape[1:], 2))
            np.testing.assert_array_equal(flow.numpy()[world], expected)


def test_a_world_restarts_alone(sequence):
    batch = BatchFlow(2, *sequence.shape[2:], device="cpu")
    batch.update(wp.array(sequence[0], device="cpu"))
    batch.restarted.assign(np.array([0, 1], np.int32))
    flow = batch.update(wp.array(sequence[1], device="cpu"))
    np.testing.assert_array_equal(flow.numpy()[0], alone(sequence, 1, 0))
    assert not flow.numpy()[1].any()
    flow = batch.update(wp.array(sequence[2], device="cpu"))
    np.testing.assert_array_equal(flow.numpy()[1], alone(sequence, 2, 1))


def test_colour_images_and_images_written_in_place(sequence):
    rng = np.random.default_rng(0)
    size = sequence.shape[2:]
    rgb = rng.integers(0, 256, (2, 1, *size, 3), dtype=np.uint8)
    coloured, written = BatchFlow(1, *size, device="cpu"), BatchFlow(1, *size, device="cpu")
    for image in rgb:
        coloured.update(wp.array(image, dtype=wp.vec3ub, device="cpu"))
        written.gray.assign(to_gray(image[0])[None])
        written.update()
    np.testing.assert_array_equal(coloured.flow.numpy(), written.flow.numpy())


def test_pairs_that_do_not_continue_each_other(sequence):
    flow = FlowEstimator("farneback-warp", *sequence.shape[2:], device="cpu")
    flow(sequence[0, 0], sequence[1, 0])
    np.testing.assert_array_equal(flow(sequence[2, 0], sequence[3, 0]), alone(sequence, 3, 0))
    buffer = sequence[1, 0].copy()
    flow(sequence[0, 0], buffer)
    buffer[:] = sequence[2, 0]
    np.testing.assert_array_equal(flow(buffer, sequence[3, 0]), alone(sequence, 3, 0))


def test_the_names_are_known_without_importing_warp():
    assert tuple(BATCH_METHODS) == ON_DEVICE


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((1, 32, 32), {"method": "dis"}, "flow method 'dis' is unknown; expected one of farneback-warp"),
        ((0, 32, 32), {}, "worlds is 0; expected a whole number of at least 1"),
        ((1, 15, 32), {}, "height is 15; expected a whole number of at least 16"),
        ((1, 32, 32), {"device": "tpu"}, "device 'tpu' is not present"),
        ((1, 32, 32), {"threads": 0}, "threads is 0"),
    ],
)
def test_refuses(arguments, options, message):
    with pytest.raises(DenseVSError, match=message):
        BatchFlow(*arguments, **{"device": "cpu", **options})


def test_refuses_images():
    batch = BatchFlow(2, 20, 30, device="cpu")
    for bad in (np.zeros((2, 20, 30), np.uint8), wp.zeros((1, 20, 30), dtype=wp.uint8, device="cpu"), 3):
        with pytest.raises(
            DenseVSError, match=r"expected a Warp array of uint8 or vec3ub of shape \(2, 20, 30\) on cpu"
        ):
            batch.update(bad)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_captured_graph_follows_the_sequence(sequence):
    batch = BatchFlow(2, *sequence.shape[2:], device="cuda:0")
    images = wp.array(sequence[0], device="cuda:0")
    batch.update(images)
    with wp.ScopedCapture("cuda:0") as capture:
        batch.update(images)
    for frame in range(1, len(sequence)):
        images.assign(sequence[frame])
        wp.capture_launch(capture.graph)
        for world in range(2):
            difference = batch.flow.numpy()[world] - alone(sequence, frame, world)
            assert np.abs(difference).mean() < 1e-3
