"""Assignment and k-means sums against float64; the same bits for any number of threads."""

import numpy as np
import pytest
import warp as wp
from reference_self_body import cluster_sums, nearest, squared_distances

from dense_vs.kernels.body.kmeans import kmeans_kernels
from dense_vs.kernels.launch import launch_pixels

HEIGHT, WIDTH = 23, 31
GPU = pytest.param(
    "cuda:0", marks=[pytest.mark.gpu, pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")]
)


@pytest.fixture(params=[1, 4])
def case(request):
    """Two worlds of Jacobians, centres of which 4 and 2 are in use, and members."""
    joints = request.param
    rng = np.random.default_rng(joints)
    J = rng.normal(0, 60, (2, HEIGHT, WIDTH, 2, joints)).astype(np.float32)
    J[0, 3, 5, 0, 0], J[0, 7, 1, 1, joints - 1], J[1, 0, 0] = np.nan, np.inf, -np.inf
    centres = rng.normal(0, 60, (2, 5, 2, joints)).astype(np.float32)
    members = (rng.random((2, HEIGHT, WIDTH)) < 0.7).astype(np.int8)
    return J, members, centres, np.array([4, 2], np.int32)


def on(device, J, members, centres, counts):
    kernels = kmeans_kernels(J.shape[-1])
    return (
        wp.array(J, dtype=kernels.Jacobian, device=device),
        wp.array(members, dtype=wp.int8, device=device),
        wp.array(centres, dtype=kernels.Jacobian, device=device),
        wp.array(counts, dtype=int, device=device),
    )


def assign(case, device="cpu", threads=1, own=None, least=0.0):
    J, _, centres, _ = case
    jacobian, _, centre_array, count = on(device, *case)
    own = np.zeros(centres.shape[:2], np.int8) if own is None else own
    outputs = [wp.full(J.shape[:3], wp.int8(77), dtype=wp.int8, device=device) for _ in range(2)]
    arguments = [jacobian, centre_array, count, wp.array(own, dtype=wp.int8, device=device), least**2, *outputs]
    launch_pixels(kmeans_kernels(J.shape[-1]).assign, J.shape[:3], arguments, device, threads)
    return [output.numpy() for output in outputs]


def sums(case, device="cpu", threads=1):
    J, _, centres, _ = case
    jacobian, members, centre_array, count = on(device, *case)
    kernels = kmeans_kernels(J.shape[-1])
    worlds, height, _ = J.shape[:3]
    size = 2 * J.shape[-1] + 1
    rows = wp.full((worlds, height, centres.shape[1], size), wp.float64(np.nan), dtype=wp.float64, device=device)
    farthest = wp.full((worlds, height), wp.vec2(np.nan, np.nan), dtype=wp.vec2, device=device)
    total = wp.full((worlds, centres.shape[1], size), wp.float64(np.nan), dtype=wp.float64, device=device)
    spread = wp.full((worlds, height), wp.float64(np.nan), dtype=wp.float64, device=device)
    image = [jacobian, members, centre_array, count]
    launch_pixels(kernels.sum_rows, (worlds, height, 1), [*image, rows, farthest], device, threads)
    wp.launch(kernels.add_rows, dim=total.shape, inputs=[rows], outputs=[total], device=device)
    launch_pixels(kernels.spread_rows, (worlds, height, 1), [*image, spread], device, threads)
    return [array.numpy() for array in (total, farthest, spread)]


@pytest.mark.parametrize("device", ["cpu", GPU])
def test_assignment_is_the_nearest_centre(case, device):
    J, _, centres, counts = case
    own = np.array([[1, 0, 1, 0, 1], [0, 1, 1, 1, 1]], np.int8)
    cluster, label = assign(case, device, own=own, least=70.0)
    for world in range(2):
        expected = nearest(J[world], centres[world, : counts[world]])
        np.testing.assert_array_equal(cluster[world], expected)
        with np.errstate(invalid="ignore"):
            small = np.sqrt(np.sum(J[world].astype(float) ** 2, axis=(2, 3))) <= 70.0
        assert 0 < small.mean() < 1
        np.testing.assert_array_equal(label[world], np.where(small | (expected < 0), -1, own[world][expected]))


def test_of_equally_near_centres_the_first_has_the_pixel():
    """Whole numbers, exact in float32: pixel x lies at x, centres at 1, 5, 5, 3."""
    J = np.zeros((1, 1, 7, 2, 1), np.float32)
    J[0, 0, :, 0, 0] = np.arange(7)
    centres = np.zeros((1, 4, 2, 1), np.float32)
    centres[0, :, 0, 0] = 1, 5, 5, 3
    case = J, np.ones((1, 1, 7), np.int8), centres, np.array([4], np.int32)
    cluster, label = assign(case, own=np.ones((1, 4), np.int8))
    np.testing.assert_array_equal(cluster[0, 0], [0, 0, 0, 3, 1, 1, 1])
    np.testing.assert_array_equal(label[0, 0], [-1, 1, 1, 1, 1, 1, 1])  # a J of zero says that nothing has moved


def test_without_centres_nothing_is_assigned(case):
    J, members, centres, _ = case
    for output in assign((J, members, centres, np.zeros(2, np.int32))):
        assert (output == -1).all()


@pytest.mark.parametrize("device", ["cpu", GPU])
def test_sums(case, device):
    J, members, centres, counts = case
    total, farthest, spread = sums(case, device)
    for world in range(2):
        used = centres[world, : counts[world]]
        vectors, sizes = cluster_sums(J[world], members[world] > 0, used)
        np.testing.assert_array_equal(total[world, : counts[world], -1], sizes)
        np.testing.assert_allclose(
            total[world, : counts[world], :-1], vectors.reshape(len(used), -1), rtol=1e-12, atol=1e-9
        )
        assert not total[world, counts[world] :].any()
        counted = (members[world] > 0) & np.isfinite(J[world]).all(axis=(2, 3))
        least = squared_distances(np.where(counted[..., None, None], J[world], 0), used).min(axis=2)
        np.testing.assert_allclose(spread[world], np.where(counted, least, 0).sum(axis=1), rtol=1e-5)
        columns = np.argmax(np.where(counted, least, -1), axis=1)
        np.testing.assert_array_equal(farthest[world, :, 1], columns)
        np.testing.assert_allclose(farthest[world, :, 0], least[np.arange(HEIGHT), columns], rtol=1e-5)


@pytest.mark.parametrize("threads", [2, 7, 64])
def test_any_number_of_threads_gives_the_same_bits(case, threads):
    alone, together = (assign(case, threads=n) + sums(case, threads=n) for n in (1, threads))
    for one, many in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, many)


def test_a_row_without_members_has_no_farthest_pixel(case):
    J, members, centres, counts = case
    members[:, 4] = 0
    _, farthest, spread = sums((J, members, centres, counts))
    np.testing.assert_array_equal(farthest[:, 4], [[-1, -1], [-1, -1]])
    assert not spread[:, 4].any()


def test_without_centres_the_spread_counts_pixels(case):
    J, members, centres, _ = case
    _, _, spread = sums((J, members, centres, np.zeros(2, np.int32)))
    np.testing.assert_array_equal(spread, ((members > 0) & np.isfinite(J).all(axis=(3, 4))).sum(axis=2))
