"""Grey conversion."""

import cv2
import numpy as np
import warp as wp

from dense_vs.kernels.image.gray_image import gray_image_kernel
from dense_vs.kernels.launch import launch_pixels


def test_equals_opencv_byte_for_byte():
    rgb = np.random.default_rng(0).integers(0, 256, (2, 301, 211, 3), dtype=np.uint8)
    rgb[0, 0, :3] = 0, 255, 128
    gray = wp.zeros(rgb.shape[:3], dtype=wp.uint8, device="cpu")
    launch_pixels(gray_image_kernel, rgb.shape[:3], [wp.array(rgb, dtype=wp.vec3ub, device="cpu"), gray], "cpu", 2)
    np.testing.assert_array_equal(gray.numpy(), [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in rgb])
