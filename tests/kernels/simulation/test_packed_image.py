"""Unpacking of a ray tracer's pixels."""

import numpy as np
import warp as wp

from dense_vs.kernels.launch import launch_pixels
from dense_vs.kernels.simulation.packed_image import unpack_image_kernel


def test_colours_and_ids_come_apart():
    rng = np.random.default_rng(0)
    shape = (2, 5, 7)
    rgb = rng.integers(0, 256, (*shape, 3)).astype(np.uint32)
    packed = (255 << 24 | rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]).astype(np.uint32).reshape(2, 35)
    segment = rng.integers(0, 3, (2, 35, 2)).astype(np.int32)
    rgb_out = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
    ids_out = wp.full(shape, 99, dtype=int, device="cpu")
    arguments = [wp.array(packed, device="cpu"), wp.array(segment, dtype=wp.vec2i, device="cpu"), 2, rgb_out, ids_out]
    launch_pixels(unpack_image_kernel, shape, arguments, "cpu", 2)
    np.testing.assert_array_equal(rgb_out.numpy(), rgb)
    expected = np.where(segment[..., 1] == 2, segment[..., 0], -1).reshape(shape)
    np.testing.assert_array_equal(ids_out.numpy(), expected)
