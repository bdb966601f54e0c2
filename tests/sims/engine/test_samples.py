"""Several rays a pixel: the mean color of a finer image, and the truth of the pixel's center all the same."""

from contextlib import contextmanager

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine import world as world_module
from dense_vs.sims.engine.realism import Realism

SIZE = {"device": "cpu", "height": 24, "width": 32}
MESH = """
<mujoco>
  <asset><mesh name="roof" vertex="0 0 0.3  -0.3 -0.3 0  0.3 -0.3 0  0.3 0.3 0  -0.3 0.3 0"/></asset>
  <worldbody>
    <camera name="front" pos="0 -1 0.1" xyaxes="1 0 0 0 0 1" fovy="60"/>
    <geom name="plate" type="box" pos="0.35 0 0" size="0.1 0.1 0.3" rgba="0.9 0.2 0.1 1"/>
    <body><joint name="turn" axis="0 0 1"/><geom type="{kind}" {shape} mass="1" rgba="0.2 0.3 0.9 1"/></body>
  </worldbody>
  <actuator><position joint="turn" kp="100"/></actuator>
</mujoco>
"""


def finer_mean(world, samples):
    """Mean (H, W, 3) of the squares of an image ``samples`` times as fine."""
    height, width, channels = world.frame().rgb.shape
    squares = (height // samples, samples, width // samples, samples, channels)
    return world.frame().rgb.reshape(squares).mean(axis=(1, 3))


@pytest.mark.parametrize("samples", [2, 3])
def test_color_is_the_mean_of_a_finer_image(samples):
    world = SimWorld("planar", seed=4, samples=samples, **SIZE)
    fine = SimWorld("planar", seed=4, device="cpu", height=24 * samples, width=32 * samples)
    for each in (world, fine):
        each.step([0.05, -0.03, 0.02])
    np.testing.assert_allclose(world.frame().rgb, finer_mean(fine, samples), atol=0.5)


def test_truth_is_that_of_the_pixel_center():
    one, four = (SimWorld("planar", seed=4, samples=samples, **SIZE) for samples in (1, 2))
    for world in (one, four):
        world.step([0.05, -0.03, 0.02])
    assert np.any(one.frame().rgb != four.frame().rgb)
    np.testing.assert_array_equal(four.frame().ids, one.frame().ids)
    np.testing.assert_array_equal(four.frame().depth, one.frame().depth)
    np.testing.assert_array_equal(four.true_flow(), one.true_flow())


@pytest.mark.parametrize(("kind", "shape", "side"), [("mesh", 'mesh="roof"', 2), ("sphere", 'size="0.3"', 1)])
def test_meshes_are_sampled_finer_unless_told(tmp_path, kind, shape, side):
    path = tmp_path / "scene.xml"
    text = MESH.format(kind=kind, shape=shape)
    path.write_text(text if kind == "mesh" else text.split("<asset>")[0] + text.split("</asset>")[1])
    unasked = SimWorld(path, **SIZE).frame().rgb
    np.testing.assert_array_equal(unasked, SimWorld(path, samples=side, **SIZE).frame().rgb)
    assert np.any(unasked != SimWorld(path, samples=3 - side, **SIZE).frame().rgb)


@pytest.mark.parametrize("samples", [0, -1, 1.5, True])
def test_samples_are_a_whole_number(samples):
    with pytest.raises(DenseVSError, match="samples"):
        SimWorld("planar", samples=samples, **SIZE)


def test_memory_is_asked_for_as_rays_need_it(monkeypatch):
    """A ray takes 30 bytes beside its pixel's 24; one alone does where its color is not kept as it is."""
    asked = []

    @contextmanager
    def room(what, worlds, size, device):
        asked.append(size)
        yield

    monkeypatch.setattr(world_module, "room_for", room)
    for samples, realism in ((1, False), (2, False), (3, False), (1, Realism(flicker=0.1))):
        SimWorld("planar", samples=samples, realism=realism, **SIZE)
    more = np.subtract(asked[1:], asked[0]) / (24 * 32)
    np.testing.assert_array_equal(more, [30 * 4, 30 * 9, 30])
