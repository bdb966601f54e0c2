"""Gray images: what the color images show, whatever order the rays are traced in."""

import numpy as np
import pytest
import warp as wp

from dense_vs.flow.estimator import to_gray
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.renderer import TILE, GrayRenderer, tile_order


@pytest.mark.parametrize(("height", "width", "threads"), [(24, 32, 1), (23, 37, 2), (8, 9, 3)])
def test_gray_images_are_the_color_images(height, width, threads):
    world = SimWorld("arm", worlds=2, device="cpu", height=height, width=width, physics_on_device=True, seed=1)
    world.step(np.full((2, 4), 0.1))
    gray = wp.full((2, height, width), wp.uint8(255), dtype=wp.uint8, device="cpu")
    data = world.physics.data
    GrayRenderer(gray, world.scene.model, world.physics.model, data, world.scene.camera, threads).render()
    expected = np.stack([to_gray(np.ascontiguousarray(rgb)) for rgb in world.frame().rgb])
    assert expected.std() > 10
    assert np.abs(gray.numpy().astype(int) - expected).max() <= 1  # OpenCV rounds in another way


@pytest.mark.parametrize("size", [(240, 320), (23, 37), (3, 5)])
def test_tiles_hold_each_pixel_once_and_lie_together(size):
    order = tile_order(*size)
    np.testing.assert_array_equal(np.sort(order), np.arange(size[0] * size[1]))
    if size[0] >= TILE[0] and size[1] >= TILE[1]:
        y, x = np.divmod(order[: TILE[0] * TILE[1]], size[1])
        assert (np.ptp(y), np.ptp(x)) == (TILE[0] - 1, TILE[1] - 1)
