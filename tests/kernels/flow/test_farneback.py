"""Polynomial expansion against its definition, and flow against OpenCV's function and the exact flow."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.flow.farneback import Farneback, FarnebackOptions
from dense_vs.kernels.flow.polynomial_expansion import applicability

AGREEMENT = 0.01  # px, mean; float32 sums in another order, where a window holds little texture
INNER = (slice(16, -16), slice(16, -16))
OPTIONS = {
    "15/3/3": FarnebackOptions(),
    "11/2/1": FarnebackOptions(winsize=11, levels=2, iterations=1),
    "wide": FarnebackOptions(winsize=13, levels=2, iterations=2, poly_n=7, poly_sigma=1.5),
    "gaussian": FarnebackOptions(winsize=21, levels=1, iterations=2, gaussian_window=True),
    "odd": FarnebackOptions(pyr_scale=0.7, winsize=12, levels=4, iterations=1, poly_sigma=1.2),
    "flat": FarnebackOptions(levels=0),
}
SIZES = [(240, 320), (91, 133)]


def texture(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Smooth noise at three scales."""
    rng = np.random.default_rng(seed)
    image = sum(cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), s) * s for s in (1.2, 3, 8))
    return np.clip(128 + 45 * (image - image.mean()) / image.std(), 0, 255).astype(np.uint8)


def motions(height: int, width: int) -> dict[str, np.ndarray]:
    """Exact flows at the present image's pixels, up to about 5 px."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    x, y = x - width / 2, y - height / 2
    still = np.zeros_like(x)
    bump = np.exp(-(x**2 + y**2) / (2 * (width / 8) ** 2))
    flows = {
        "half a pixel": (still + 0.4, still - 0.3),
        "translation": (still + 4.2, still + 2.5),
        "rotation": (-0.025 * y, 0.025 * x),
        "scaling": (0.02 * x, 0.02 * y),
        "local": (3 * bump, -2 * bump),
    }
    return {name: np.stack(flow, axis=-1).astype(np.float32) for name, flow in flows.items()}


def moved(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """The image after a flow."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float32)
    return cv2.remap(image, x - flow[..., 0], y - flow[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def opencv(previous: np.ndarray, present: np.ndarray, options: FarnebackOptions) -> np.ndarray:
    """OpenCV's answer in our convention."""
    window = cv2.OPTFLOW_FARNEBACK_GAUSSIAN if options.gaussian_window else 0
    flow = cv2.calcOpticalFlowFarneback(
        present,
        previous,
        np.empty((*present.shape, 2), dtype=np.float32),
        options.pyr_scale,
        options.levels,
        options.winsize,
        options.iterations,
        options.poly_n,
        options.poly_sigma,
        window,
    )
    return -flow


def between(method: Farneback, previous: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Flow between two batches of images."""
    for image in (previous, present):
        method.image.assign(np.ascontiguousarray(image).reshape(method.image.shape))
        method.push()
    method.calculate()
    return method.flow.numpy().copy()


@pytest.mark.parametrize("tiles", [False, True], ids=["passes", "tiles"])
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("name", OPTIONS)
def test_agrees_with_opencv(name, size, tiles):
    options = OPTIONS[name]
    previous = texture(*size)
    method = Farneback(1, *size, options, device="cpu", threads=2, tiles=tiles)
    for motion, flow in motions(*size).items():
        present = moved(previous, flow)
        u = between(method, previous, present)[0]
        assert np.linalg.norm(u - opencv(previous, present, options), axis=2).mean() < AGREEMENT, motion
        if size == SIZES[0] and name != "flat":  # a window is a smaller part of the motion there
            assert np.median(np.linalg.norm(u - flow, axis=2)[INNER]) < 0.06, motion


def test_expansion_is_the_weighted_least_squares_fit():
    radius, sigma = 5, 1.1
    rng = np.random.default_rng(0)
    image = rng.normal(size=(2 * radius + 1,) * 2)
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(float)
    basis = np.stack([np.ones_like(x), x, y, x**2, y**2, x * y], axis=-1).reshape(-1, 6)
    root = np.exp(-(x**2 + y**2) / (4 * sigma**2)).reshape(-1, 1)
    fit = np.linalg.lstsq(basis * root, image.reshape(-1) * root[:, 0], rcond=None)[0]

    weights, (over_s2, over_variance, s2) = applicability(radius, sigma)
    g0, g1, g2 = (np.concatenate([sign * w[:0:-1], w]) for w, sign in zip(weights, (1, -1, 1), strict=True))
    m00, m10, m01, m20, m02, m11 = (
        b @ image @ a for a, b in ((g0, g0), (g1, g0), (g0, g1), (g2, g0), (g0, g2), (g1, g1))
    )
    ours = [m10 * over_s2, m01 * over_s2, (m20 - s2 * m00) * over_variance, (m02 - s2 * m00) * over_variance]
    np.testing.assert_allclose([*ours, m11 * over_s2**2], fit[1:], atol=1e-4)


def test_worlds_are_independent_and_threads_give_the_same_bits():
    size = (45, 67)
    previous = np.stack([texture(*size, seed) for seed in range(3)])
    present = np.stack([moved(image, flow) for image, flow in zip(previous, motions(*size).values(), strict=False)])
    together = between(Farneback(3, *size, device="cpu", threads=2), previous, present)
    assert together.shape == (3, *size, 2)
    for world in range(3):
        alone = between(Farneback(1, *size, device="cpu", threads=5), previous[world], present[world])
        np.testing.assert_array_equal(alone[0], together[world])


def test_a_sequence_keeps_nothing_but_the_latest_image():
    images = [texture(40, 50, seed) for seed in range(4)]
    method = Farneback(1, 40, 50, device="cpu")
    between(method, images[3], images[2])
    for previous, present in zip([images[2], *images[:-1]], images, strict=True):
        method.image.assign(present[None])
        method.push()
        method.calculate()
        expected = between(Farneback(1, 40, 50, device="cpu"), previous, present)
        np.testing.assert_array_equal(method.flow.numpy(), expected)


def test_a_restarted_world_has_no_flow():
    size = (40, 50)
    images = [np.stack([texture(*size, seed), texture(*size, seed)]) for seed in range(2)]
    method = Farneback(2, *size, device="cpu")
    method.restarted.assign(np.array([0, 1], np.int32))
    u = between(method, *images)
    assert not u[1].any()
    method.restarted.zero_()
    method.calculate()
    np.testing.assert_array_equal(method.flow.numpy()[0], u[0])
    np.testing.assert_array_equal(method.flow.numpy()[1], u[0])


def test_takes_float_images():
    previous = texture(60, 70)
    present = moved(previous, motions(60, 70)["rotation"])
    u = between(Farneback(1, 60, 70, device="cpu"), previous, present)
    f = between(Farneback(1, 60, 70, dtype=wp.float32, device="cpu"), previous, present)
    np.testing.assert_allclose(f, u, atol=1e-4)


@pytest.mark.parametrize("size", [(16, 16), (17, 61), (45, 16), (33, 32)], ids=str)
def test_smallest_and_odd_sizes(size):
    previous, present = texture(*size), texture(*size, 1)
    u = between(Farneback(1, *size, device="cpu", threads=3), previous, present)
    assert np.isfinite(u).all()
    same = between(Farneback(1, *size, device="cpu"), previous, previous)
    assert not same.any()


def test_no_texture_is_no_flow():
    flat = np.full((40, 50), 200, np.uint8)
    assert not between(Farneback(1, 40, 50, device="cpu"), flat, flat + 20).any()


def test_refuses_small_images():
    with pytest.raises(ValueError, match="expected sides of at least 16"):
        Farneback(1, 15, 40, device="cpu")


@pytest.mark.parametrize(
    "options",
    [{"pyr_scale": 1.0}, {"levels": -1}, {"winsize": 2}, {"iterations": 0}, {"poly_n": 0}, {"poly_sigma": 0.0}],
    ids=str,
)
def test_refuses_options(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))} is .*; expected "):
        FarnebackOptions(**options)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_captured_graph_agrees_with_the_cpu():
    size = (120, 160)
    images = [np.stack([texture(*size, 1), texture(*size, 2)])]
    for _ in range(3):
        images.append(np.stack([moved(image, motions(*size)["rotation"]) for image in images[-1]]))
    on_cpu = Farneback(2, *size, device="cpu")
    on_gpu = Farneback(2, *size, device="cuda:0")
    between(on_gpu, images[1], images[0])  # compiles before the capture
    with wp.ScopedCapture("cuda:0") as capture:
        on_gpu.push()
        on_gpu.calculate()
    for previous, present in pairwise(images):
        on_gpu.image.assign(present)
        wp.capture_launch(capture.graph)
        difference = on_gpu.flow.numpy() - between(on_cpu, previous, present)
        assert np.abs(difference).mean() < 1e-3
