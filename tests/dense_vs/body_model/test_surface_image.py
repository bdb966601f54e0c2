"""The surface's image on the kernels beside the same in float64 NumPy."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from reference_splat import front_points

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.surface_image import SurfaceImage

SIZE, FOCAL, CENTER = (48, 64), 70.0, (30.5, 22.0)
LENS = Lens.of_center(np.array(CENTER))


def body(seed):
    """A hinge, a slide on it and a hinge on another branch, with points on all links and on none."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes[1] = 0.0
    travel = np.zeros((3, 3))
    travel[1] = [0.3, 0.9, -0.1]
    points = rng.normal(size=(3, 3)) * 0.3 + [0, 0, 2]
    chain = Chain(axes, points, rng.normal(size=3) * 0.1, np.array([-1, 0, -1]), travel)
    surface = rng.uniform([-0.9, -0.7, 1.4], [0.9, 0.7, 2.6], size=(1500, 3))
    surface[:3, 2] = -1.0  # behind the camera
    return chain, surface, rng.integers(-1, 3, size=len(surface))


def placed(chain, surface, links, q):
    rotation, translation = chain.link_poses(q[None])
    return np.einsum("pij,pj->pi", rotation[0, links], surface) + translation[0, links]


@pytest.mark.parametrize(("threads", "bend"), [("1", 0.0), ("3", 0.0), ("3", -0.1), ("1", 0.08)])
def test_front_and_jacobian_are_those_of_the_reference(threads, bend, monkeypatch):
    monkeypatch.setenv("DENSE_VS_THREADS", threads)
    lens = Lens.of_center(np.array(CENTER), bend)

    def seen(positions):
        return lens.bent(FOCAL * positions[:, :2] / positions[:, 2:] + CENTER)

    for seed in range(4):
        chain, surface, links = body(seed)
        q = chain.home + np.array([0.2, -0.15, 0.3])
        positions = placed(chain, surface, links, q)
        places = seen(positions)
        drawing = SurfaceImage(chain, surface, links, FOCAL, lens, SIZE)
        front = drawing.front(q)
        np.testing.assert_allclose(front.positions, positions, atol=2e-6)
        expected = front_points(places, positions[:, 2], SIZE)
        np.testing.assert_array_equal(front.index, expected)
        learned = np.array([True, True, seed % 2 == 0])
        J = drawing.jacobian(q, learned, front)
        on = expected >= 0
        assert 0.3 < on.mean() < 1
        assert not J[~on].any()
        # By finite differences of where the points fall, 1e-4 rad or m to both sides.
        for n in range(3):
            step = 1e-4 * np.eye(3)[n] * learned[n]
            after, before = (placed(chain, surface, links, q + s) for s in (step, -step))
            moved = (seen(after) - seen(before)) / 2e-4
            np.testing.assert_allclose(J[on][..., n], moved[expected[on]], atol=2e-3)


def test_a_body_without_points_is_nowhere():
    chain, surface, links = body(0)
    drawing = SurfaceImage(chain, surface[:0], links[:0], FOCAL, LENS, SIZE)
    front = drawing.front(chain.home)
    assert (front.index == -1).all()
    assert front.index.shape == SIZE
    assert front.positions.shape == (0, 3)
    assert not drawing.jacobian(chain.home, np.ones(3, bool), front).any()


def test_a_drawing_stays_as_it_is_while_others_are_drawn():
    """Also by several threads at once, as they share the memory that it is drawn in."""
    chain, surface, links = body(0)
    postures = [chain.home + 0.2 * k for k in range(6)]
    learned = np.ones(3, bool)
    alone = []
    for q in postures:
        drawing = SurfaceImage(chain, surface, links, FOCAL, LENS, SIZE)
        front = drawing.front(q)
        alone.append((front, drawing.jacobian(q, learned, front)))
    drawing = SurfaceImage(chain, surface, links, FOCAL, LENS, SIZE)

    def drawn(k):
        front = drawing.front(postures[k])
        return k, front, drawing.jacobian(postures[k], learned, front)

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(drawn, [*range(6)] * 20))
    for k, front, J in together:
        np.testing.assert_array_equal(front.index, alone[k][0].index)
        np.testing.assert_array_equal(front.positions, alone[k][0].positions)
        np.testing.assert_array_equal(J, alone[k][1])
