"""Depth and its row of J: against the float64 filter, on surfaces whose motion is known, and where depth jumps."""

import numpy as np
import pytest
import warp as wp
from reference_depth import ReferenceDepth

from dense_vs import DenseJacobian
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.depth_filter import JUMP, PIXELS_PER_METER, SLIDE
from dense_vs.jacobian.depth_image import depth_image

HEIGHT, WIDTH, JOINTS = 14, 19, 3
SIZE = {"height": HEIGHT, "width": WIDTH, "joints": JOINTS, "depth": True, "device": "cpu"}
# float32 against float64 over a dozen frames; depths are about 1 m, rows about 0.3 m/rad
CLOSE = {"rtol": 2e-3, "atol": 2e-4}
STILL = np.zeros((HEIGHT, WIDTH, 2), np.float32)


def slanted(rng):
    """Depth of a slanted plane, without jumps."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return 1 + 0.002 * x - 0.003 * y + 0.0005 * rng.standard_normal((HEIGHT, WIDTH))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("threads", [1, 3])
def test_agrees_with_the_reference(order, threads):
    rng = np.random.default_rng(4)
    estimator = DenseJacobian(**SIZE, order=order, threads=threads, prediction="model")
    reference = ReferenceDepth(estimator.options, PIXELS_PER_METER, SLIDE)
    for k in range(12):
        dq = rng.normal(0, 0.02, JOINTS).astype(np.float32).astype(float)
        flow = (rng.normal(0, 0.8, 2) + 0.05 * rng.standard_normal((HEIGHT, WIDTH, 2))).astype(np.float32)
        depth = slanted(rng) + 0.005 * rng.standard_normal()
        if k:  # a hole, after every pixel has begun
            depth[2:6, 3:9] = (0.0, np.nan)[k % 2]
        image = None if k == 5 else depth
        if k in (5, 8):
            estimator.predict(dq, image)
        else:
            estimator.update(flow, dq, depth=image)
        reference.update(estimator.filter.model_flow.numpy()[0], dq, None if image is None else np.nan_to_num(depth))
    np.testing.assert_allclose(estimator.depth, reference.state[..., 0], **CLOSE)
    np.testing.assert_allclose(estimator.depth_jacobian, reference.state[..., 1 : 1 + JOINTS], **CLOSE)
    np.testing.assert_allclose(estimator._with_depth().covariance[0], reference.P, rtol=1e-6, atol=1e-12)


def moved_by(estimator, row, noise, frames=300, seed=0, factors=1.0):
    """Feed depth images of a surface that stays in its pixels and comes nearer as ``row`` (N,) [m/rad] says."""
    rng = np.random.default_rng(seed)
    q, exact = np.zeros(JOINTS), slanted(rng)
    for k in range(frames):
        dq = 0.3 * np.sin(0.11 * k * (1 + 0.37 * np.arange(JOINTS)) + np.arange(JOINTS)) - q
        q = q + dq
        depth = exact + row @ q + noise * rng.standard_normal((HEIGHT, WIDTH))
        estimator.update(STILL, dq / factors, depth=depth)
    return exact + row @ q


@pytest.mark.parametrize("order", [1, 2])
def test_learns_the_row_and_a_depth_better_than_the_images(order):
    row = np.array([0.4, -0.2, 0.05])
    estimator = DenseJacobian(**SIZE, order=order, process_noise=10.0, hessian_noise=1.0)
    depth = moved_by(estimator, row, noise=0.006)
    assert np.median(np.linalg.norm(estimator.depth_jacobian - row, axis=2)) < 0.04 * np.linalg.norm(row)
    assert np.sqrt(np.mean((estimator.depth - depth) ** 2)) < 0.5 * 0.006


def test_does_not_depend_on_the_joints_units():
    row, scale = np.array([0.4, -0.2, 0.05]), np.array([0.012, 1.2, 0.012])
    one = DenseJacobian(**SIZE, order=2)
    moved_by(one, row, noise=0.003, frames=60)
    other = DenseJacobian(**SIZE, order=2, joint_scale=scale)
    moved_by(other, row, noise=0.003, frames=60, factors=0.012 / scale)
    np.testing.assert_allclose(other.depth_jacobian / (0.012 / scale), one.depth_jacobian, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(other.depth, one.depth, rtol=1e-5)
    left_out = DenseJacobian(**SIZE, order=2, joint_scale=[0.012, 0.0, 0.012])
    moved_by(left_out, row * [1, 0, 1], noise=0.003, frames=60)
    assert not left_out.depth_jacobian[..., 1].any()
    assert left_out.depth_jacobian[..., 0].all()


def test_moves_with_the_image_and_bridges_a_hole():
    """A step of depth on a surface that shifts by 2 px a frame, seen for some frames only."""
    estimator = DenseJacobian(**SIZE, order=1, measurement_noise=1e-6)
    x = np.tile(np.arange(WIDTH, dtype=float), (HEIGHT, 1))
    flow = np.broadcast_to(np.float32([2, 0]), (HEIGHT, WIDTH, 2))
    dq = np.array([0.1, 0.0, 0.0])
    for k in range(4):
        estimator.update(flow.copy(), dq, depth=1 + 0.004 * (x - 2.0 * k))
    estimator.predict(dq)
    # What has come in at the left border since then was never measured.
    np.testing.assert_allclose(estimator.depth[:, 8:], 1 + 0.004 * (x - 8.0)[:, 8:], atol=1e-3)


def two_surfaces(edge):
    """Depth of something at 0.7 m before a wall at 1 m, from column ``edge`` on."""
    return np.where(np.arange(WIDTH) >= edge, 1.0, 0.7) * np.ones((HEIGHT, 1))


def test_is_never_averaged_across_a_jump_of_depth():
    estimator = DenseJacobian(**SIZE, order=1, measurement_noise=1e-6)
    flow, dq = np.full((HEIGHT, WIDTH, 2), 0.5, np.float32), np.array([0.1, 0.0, 0.0])
    for k in range(6):
        estimator.update(flow, dq, depth=None if k > 2 else two_surfaces(9))
    off = np.minimum(np.abs(estimator.depth - 0.7), np.abs(estimator.depth - 1.0))
    assert off.max() < 0.7 * JUMP
    between = estimator.at([[8.5, 5.0]], depth=True)
    assert between.shape == (1, 3, JOINTS)


def test_a_pixel_that_is_covered_takes_over_its_neighbors_state():
    """What is in front moves toward the camera; the wall does not. Its edge goes on by 2 px without any flow."""
    estimator = DenseJacobian(**SIZE, order=1)
    row, q = np.array([0.5, 0.0, 0.0]), np.zeros(JOINTS)
    front = np.arange(WIDTH) < 9
    for k in range(40):
        dq = np.array([0.04 * np.cos(0.3 * k), 0.01, 0.0])
        q = q + dq
        estimator.update(STILL, dq, depth=two_surfaces(9) + np.where(front, row @ q, 0.0))
    learned = estimator.depth_jacobian[:, 4, 0].mean()
    assert learned == pytest.approx(0.5, abs=0.05)
    estimator.predict(np.zeros(JOINTS), depth=two_surfaces(11) + np.where(np.arange(WIDTH) < 11, row @ q, 0.0))
    np.testing.assert_allclose(estimator.depth_jacobian[:, 9:11, 0], learned, rtol=0.1)
    estimator.predict(np.zeros(JOINTS), depth=two_surfaces(7) + np.where(np.arange(WIDTH) < 7, row @ q, 0.0))
    np.testing.assert_allclose(estimator.depth_jacobian[:, 7:11, 0], 0.0, atol=0.02)


def test_a_surface_that_nobody_expects_begins_anew():
    estimator = DenseJacobian(**SIZE, order=1)
    moved_by(estimator, np.array([0.4, 0.2, 0.1]), noise=0.0, frames=20)
    assert estimator.depth_jacobian.all()
    estimator.predict(np.zeros(JOINTS), depth=np.full((HEIGHT, WIDTH), 0.3))
    np.testing.assert_allclose(estimator.depth, 0.3)
    assert not estimator.depth_jacobian.any()


def test_what_is_not_known_is_nan():
    estimator = DenseJacobian(**SIZE)
    assert np.isnan(estimator.depth).all()
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[3, 4] = 0.8
    estimator.update(STILL, np.full(JOINTS, 0.01), depth=depth)
    assert np.isfinite(estimator.depth).sum() == 1
    estimator.reset()
    assert np.isnan(estimator.depth).all()
    assert not estimator.depth_jacobian.any()


def test_pixel_rows_are_the_same_with_and_without_depth():
    rng = np.random.default_rng(0)
    one = DenseJacobian(**SIZE)
    other = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, device="cpu")
    for _ in range(4):
        flow, dq = rng.normal(0, 1, (HEIGHT, WIDTH, 2)).astype(np.float32), rng.normal(0, 0.02, JOINTS)
        one.update(flow, dq, depth=slanted(rng))
        other.update(flow, dq)
    np.testing.assert_array_equal(one.jacobian, other.jacobian)
    points = [[3.2, 4.7], [10.0, 2.0]]
    np.testing.assert_array_equal(one.at(points, depth=True)[:, :2], other.at(points))


def test_several_worlds_are_as_single_ones():
    rng = np.random.default_rng(1)
    both = DenseJacobian(**SIZE, worlds=2)
    alone = [DenseJacobian(**SIZE) for _ in range(2)]
    for _ in range(5):
        flow = rng.normal(0, 1, (2, HEIGHT, WIDTH, 2)).astype(np.float32)
        dq = rng.normal(0, 0.02, (2, JOINTS))
        depth = np.stack([slanted(rng), slanted(rng)])
        both.update(flow, dq, depth=depth)
        for k, one in enumerate(alone):
            one.update(flow[k], dq[k], depth=depth[k])
    np.testing.assert_array_equal(both.depth, [one.depth for one in alone])
    np.testing.assert_array_equal(both.depth_jacobian, [one.depth_jacobian for one in alone])
    points = rng.uniform(0, 12, (2, 4, 2))
    np.testing.assert_array_equal(
        both.at(points, depth=True), [one.at(points[k], depth=True) for k, one in enumerate(alone)]
    )


def test_a_saved_estimate_goes_on_with_its_depth(tmp_path):
    estimator = DenseJacobian(**SIZE)
    moved_by(estimator, np.array([0.4, 0.2, 0.1]), noise=0.003, frames=5)
    estimator.save(tmp_path / "jacobian.npz")
    loaded = DenseJacobian.load(tmp_path / "jacobian.npz", device="cpu")
    for one in (estimator, loaded):
        one.update(STILL, np.full(JOINTS, 0.01), depth=slanted(np.random.default_rng(9)))
    np.testing.assert_array_equal(loaded.depth, estimator.depth)
    np.testing.assert_array_equal(loaded.depth_jacobian, estimator.depth_jacobian)
    with np.load(tmp_path / "jacobian.npz") as stored:
        content = dict(stored)
    for change in (
        {"depth_state": content["depth_state"][:, 1:]},
        {"depth_state": np.full_like(content["depth_state"], np.nan)},
        {"depth_covariance": -content["depth_covariance"]},
    ):
        np.savez(tmp_path / "changed.npz", **(content | change))
        with pytest.raises(DenseVSError, match="is damaged"):
            DenseJacobian.load(tmp_path / "changed.npz", device="cpu")


BAD = {
    "another size": (np.ones((HEIGHT, WIDTH + 1)), "depth has shape"),
    "two axes more": (np.ones((1, HEIGHT, WIDTH, 1)), "depth has shape"),
    "no depth at all": (np.full((HEIGHT, WIDTH), np.nan), "no pixel that is known"),
    "zeros": (np.zeros((HEIGHT, WIDTH)), "no pixel that is known"),
    "millimeters as whole numbers": (np.full((HEIGHT, WIDTH), 900, np.uint16), r"millimeters: divide by 1000"),
    "millimeters": (np.full((HEIGHT, WIDTH), 900.0), "median of 900"),
    "behind the camera": (np.full((HEIGHT, WIDTH), -1.0), "least value of -1"),
    "text": ("near", "depth has shape"),
    "complex": (np.ones((HEIGHT, WIDTH), complex), "dtype complex"),
}


def test_a_few_pixels_that_are_far_away_are_no_other_unit():
    """As the sky, or a wrong match of a stereo camera."""
    image = np.full((HEIGHT, WIDTH), 1.5)
    image[0, :3] = 900.0
    np.testing.assert_array_equal(depth_image(image, (HEIGHT, WIDTH)), image.astype(np.float32))


@pytest.mark.parametrize("case", BAD)
def test_a_bad_depth_image_leaves_the_estimate(case):
    image, said = BAD[case]
    estimator = DenseJacobian(**SIZE)
    estimator.update(STILL, np.full(JOINTS, 0.01), depth=np.ones((HEIGHT, WIDTH)))
    before = {name: np.array(value) for name, value in estimator.stored().items()}
    for call in (
        lambda: estimator.update(STILL + 1, np.full(JOINTS, 0.01), depth=image),
        lambda: estimator.predict(np.full(JOINTS, 0.01), depth=image),
    ):
        with pytest.raises(DenseVSError, match=said):
            call()
    for name, value in estimator.stored().items():
        np.testing.assert_array_equal(value, before[name])


def test_refuses_depth_where_there_is_none():
    plain = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, device="cpu")
    for call in (
        lambda: plain.depth,
        lambda: plain.depth_jacobian,
        lambda: plain.at([[1, 1]], depth=True),
        lambda: plain.predict(np.zeros(JOINTS), depth=np.ones((HEIGHT, WIDTH))),
    ):
        with pytest.raises(DenseVSError, match=r"expected DenseJacobian\(depth=True\)"):
            call()
    for options in ({"covariance": "diagonal"}, {"covariance": "fixed"}, {"prediction": "flow"}):
        with pytest.raises(DenseVSError, match="depth with covariance"):
            DenseJacobian(**SIZE, **options)
    for options in ({"depth": 1}, {"depth_noise": 0.0}, {"depth_noise": np.nan}):
        with pytest.raises(DenseVSError, match=r"depth(_noise)? is"):
            DenseJacobian(**(SIZE | options))


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_gpu_computes_the_same():
    rng = np.random.default_rng(2)
    host, gpu = (DenseJacobian(**(SIZE | {"device": device})) for device in ("cpu", "cuda:0"))
    for k in range(8):
        flow, dq = rng.normal(0, 1, (HEIGHT, WIDTH, 2)).astype(np.float32), rng.normal(0, 0.02, JOINTS)
        depth = np.where(rng.random((HEIGHT, WIDTH)) < 0.1, 0, slanted(rng)) if k % 3 else None
        for one in (host, gpu):
            one.update(flow, dq, depth=depth)
    np.testing.assert_allclose(gpu.depth, host.depth, rtol=1e-4)
    np.testing.assert_allclose(gpu.depth_jacobian, host.depth_jacobian, rtol=1e-2, atol=1e-3)
