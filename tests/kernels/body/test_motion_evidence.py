"""The running energies of self-recognition against float64."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from reference_self_body import ReferenceSelfMotion

from dense_vs.body.motion_evidence import SelfMotion, SelfMotionOptions

HEIGHT, WIDTH, JOINTS, FRAMES = 26, 34, 4, 6
DEFAULT = SelfMotionOptions()
GPU = pytest.param(
    "cuda:0", marks=[pytest.mark.gpu, pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")]
)


@pytest.fixture(scope="module")
def frames():
    """Flow (FRAMES, 2, H, W, 2) and joint steps (FRAMES, 2, N) of two worlds; the second has flow that is no number."""
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 1.0, (FRAMES, 2, HEIGHT, WIDTH, 2)).astype(np.float32)
    flow[:, :, 15:20] *= 0.02  # rows that stand still, whatever is predicted
    flow[:, :, 20:] = 0
    flow[3, 1, 4, 6:9, 0], flow[4, 1, 9] = np.nan, np.inf
    return flow, rng.normal(0, 0.05, (FRAMES, 2, JOINTS)).astype(np.float32)


def observe(frames, device="cpu", threads=2, options=DEFAULT):
    motion = SelfMotion((2, HEIGHT, WIDTH), JOINTS, wp.get_device(device), threads, options)
    for flow, dq in zip(*frames, strict=True):
        motion.observe(wp.array(flow, dtype=wp.vec2, device=device), dq)
    return motion


def reference(frames, world, options):
    expected = ReferenceSelfMotion(HEIGHT, WIDTH, JOINTS, options)
    for flow, dq in zip(frames[0][:, world], frames[1][:, world], strict=True):
        expected.observe(flow, dq)
    return expected


@pytest.mark.parametrize("device", ["cpu", GPU])
@pytest.mark.parametrize("change", [{}, {"rest": 0.0, "still": 0.5, "due": 0.1, "decay": 0.8}])
def test_energies_and_labels_follow_the_reference(frames, change, device):
    options = replace(DEFAULT, **change, unexplained=0.95)
    motion = observe(frames, device, options=options)
    rng = np.random.default_rng(1)
    J = rng.normal(0, 20, (2, HEIGHT, WIDTH, 2, JOINTS)).astype(np.float32)
    J[:, 2, 3, 0, 1], J[:, 4, 4, 1, 0] = np.nan, np.inf
    matrices = wp.array(J, dtype=wp.types.matrix((2, JOINTS), wp.float32), device=device)
    labels = motion.label(matrices, 50.0).numpy()
    for world in range(2):
        expected = reference(frames, world, options)
        # float32; a pixel whose two predictions are equally good may take either
        close = np.isclose(motion.energies.numpy()[world], expected.E, rtol=2e-3, atol=1e-4).all(axis=2)
        assert close.mean() > 0.995
        right = labels[world] == expected.labels(J[world], 50.0)
        assert right.mean() > 0.995
        for label in (-1, 0, 1):
            assert (labels[world] == label).mean() > 0.02
        assert (labels[world][[2, 4], [3, 4]] == -1).all()


def test_any_number_of_threads_gives_the_same_bits(frames):
    alone = observe(frames, threads=1).energies.numpy()
    for threads in (3, 64):
        np.testing.assert_array_equal(alone, observe(frames, threads=threads).energies.numpy())


def test_nothing_changes_while_nothing_moves(frames):
    motion = observe(frames)
    before = motion.energies.numpy().copy()
    for _ in range(3):
        motion.observe(wp.zeros((2, HEIGHT, WIDTH), dtype=wp.vec2, device="cpu"), np.zeros((2, JOINTS), np.float32))
    np.testing.assert_array_equal(motion.energies.numpy(), before)


def test_reset_forgets(frames):
    motion = observe(frames)
    first = motion.energies.numpy().copy()
    motion.reset()
    assert motion.frames == 0
    assert not motion.energies.numpy().any()
    for flow, dq in zip(*frames, strict=True):
        motion.observe(wp.array(flow, dtype=wp.vec2, device="cpu"), dq)
    np.testing.assert_array_equal(motion.energies.numpy(), first)
