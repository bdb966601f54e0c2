"""Launches with arguments packed for good: the same numbers as Warp's own, of all kinds of arguments."""

import gc

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.recorded import CpuLaunch, recorded, recorded_parts

wp.set_module_options({"enable_backward": False})


@wp.kernel
def mixed(
    begin: int,
    scale: float,
    turn: wp.mat22,
    shift: wp.vec2,
    flag: wp.uint8,
    by: wp.float64,
    values: wp.array(dtype=wp.vec2),
    out: wp.array2d(dtype=float),
):
    i, j = wp.tid()
    k = begin + i
    v = turn * values[k] + shift
    out[k, j] = scale * v[0] + float(flag) * v[1] + float(by) * float(j)


VALUES = np.random.default_rng(0).normal(size=(12, 2)).astype(np.float32)
TURN, SHIFT = np.float32([[1, 2], [-3, 4]]), np.float32([0.5, -0.25])


def arguments():
    values = wp.array(VALUES, dtype=wp.vec2, device="cpu")
    out = wp.zeros((12, 3), dtype=float, device="cpu")
    given = [2.0, wp.mat22(*TURN.ravel().tolist()), wp.vec2(*SHIFT.tolist()), wp.uint8(3), wp.float64(0.125)]
    return [*given, values, out], values, out


def expected(values, rows):
    turned = values @ TURN.T + SHIFT
    whole = 2 * turned[:, :1] + 3 * turned[:, 1:] + 0.125 * np.arange(3)
    return np.where(np.isin(np.arange(12), rows)[:, None], whole, 0)


def test_a_launch_reads_its_arrays_as_they_are_by_then():
    given, values, out = arguments()
    launch = recorded(mixed, (12, 3), [0, *given], "cpu")
    assert isinstance(launch, CpuLaunch)
    launch.launch()
    np.testing.assert_allclose(out.numpy(), expected(VALUES, range(12)), rtol=1e-6)
    values.numpy()[...] = -VALUES
    launch.launch()
    np.testing.assert_allclose(out.numpy(), expected(-VALUES, range(12)), rtol=1e-6)


@pytest.mark.parametrize("sizes", [(12,), (4, 4, 4), (5, 5, 2), (1, 11), (3, 6, 3)])
def test_parts_of_the_same_and_of_other_sizes(sizes):
    given, _, out = arguments()
    ends = np.cumsum(sizes)
    parts = [(int(end) - size, (size, 3)) for end, size in zip(ends, sizes, strict=True)]
    launches = recorded_parts(mixed, parts, given, "cpu")
    gc.collect()  # what a part needs is kept by itself
    done = []
    for (first, (size, _)), launch in [*zip(parts, launches, strict=True)][::-1]:
        launch.launch()
        done += range(first, first + size)
        np.testing.assert_allclose(out.numpy(), expected(VALUES, done), rtol=1e-6)


def test_a_part_of_a_part():
    given, _, out = arguments()
    (launch,) = recorded_parts(mixed, [(0, (4, 3))], given, "cpu")
    launch.part(4, (4, 3)).part(6, (2, 3)).launch()
    np.testing.assert_allclose(out.numpy(), expected(VALUES, [6, 7]), rtol=1e-6)
    launch.launch()
    np.testing.assert_allclose(out.numpy(), expected(VALUES, [0, 1, 2, 3, 6, 7]), rtol=1e-6)
