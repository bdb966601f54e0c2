"""J and flow pass to and from other libraries without a copy, on the device that both are on."""

import numpy as np
import pytest
import warp as wp

from dense_vs import BatchFlow, DenseJacobian

HEIGHT, WIDTH, JOINTS = 17, 19, 3
gpu = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")


def learnt(device, worlds=1):
    rng = np.random.default_rng(0)
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=JOINTS, worlds=worlds, device=device)
    lead = () if worlds == 1 else (worlds,)
    flow = rng.normal(0, 1, (*lead, HEIGHT, WIDTH, 2)).astype(np.float32)
    estimator.update(flow, rng.normal(0, 0.03, (*lead, JOINTS)).astype(np.float32))
    return estimator


def test_j_on_a_cpu_is_shared_with_torch():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    estimator = learnt("cpu")
    shared = torch.from_dlpack(estimator.jacobian)
    assert shared.shape == (HEIGHT, WIDTH, 2, JOINTS)
    assert shared.data_ptr() == estimator.jacobian.__array_interface__["data"][0]


def test_j_on_a_cpu_is_shared_with_jax():
    jax = pytest.importorskip("jax", reason="jax is not installed")
    estimator = learnt("cpu")
    np.testing.assert_array_equal(np.asarray(jax.numpy.from_dlpack(estimator.jacobian)), estimator.jacobian)


def test_torch_tensors_on_a_cpu_are_taken_without_a_copy():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    flow = torch.zeros((HEIGHT, WIDTH, 2))
    from dense_vs.arrays import vec2_image

    image = vec2_image(flow, "flow", (1, HEIGHT, WIDTH), wp.get_device("cpu"))
    assert image.ptr == flow.data_ptr()


@pytest.mark.gpu
@gpu
@pytest.mark.parametrize("worlds", [1, 3])
def test_j_on_a_gpu_is_shared_with_torch(worlds):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    estimator = learnt("cuda:0", worlds)
    jacobian = estimator.jacobian
    shared = torch.from_dlpack(jacobian) if worlds == 1 else wp.to_torch(jacobian)
    lead = () if worlds == 1 else (worlds,)
    assert shared.shape == (*lead, HEIGHT, WIDTH, 2, JOINTS)
    assert shared.is_cuda
    assert shared.data_ptr() == jacobian.ptr
    np.testing.assert_array_equal(shared.cpu().numpy(), estimator.to_numpy())


@pytest.mark.gpu
@gpu
def test_j_on_a_gpu_is_shared_with_jax():
    jax = pytest.importorskip("jax", reason="jax is not installed")
    estimator = learnt("cuda:0")
    shared = jax.numpy.from_dlpack(estimator.jacobian)
    np.testing.assert_array_equal(np.asarray(shared), estimator.to_numpy())


@pytest.mark.gpu
@gpu
def test_torch_images_and_flow_stay_on_the_gpu():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    images = torch.randint(0, 255, (2, 2, 48, 64), dtype=torch.uint8, device="cuda:0")
    flow = BatchFlow(2, 48, 64, device="cuda:0")
    for image in images:
        u = flow.update(wp.from_torch(image))
    estimator = DenseJacobian(height=48, width=64, joints=2, worlds=2, device="cuda:0", on_bad_flow="skip")
    estimator.update(wp.to_torch(u), torch.full((2, 2), 0.01, device="cuda:0"))
    assert np.abs(estimator.to_numpy()).max() > 0
