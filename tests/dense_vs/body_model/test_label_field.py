"""Links and depths of pixels: path costs against every path tried, the filter against plain sums, prices by hand."""

from itertools import product

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from dense_vs.body_model.label_field import _along_lines, _guided, _one_way, choose_hypotheses
from dense_vs.body_model.link_sweep import Hypotheses, depth_hypotheses

LINKS = np.array([0, 0, 0, 1, 1, -1])
SAME = np.array([False, True, True, False, True, False])


def change(before, after, edge):
    """What a line of pixels pays from one to the next: half a gray level for the next depth of the same link, and for
    any other change that and 4, which falls to 1 / e at an edge of 12 gray levels."""
    if before == after:
        return 0.0
    if abs(before - after) == 1 and LINKS[before] == LINKS[after]:
        return 0.5
    return 0.5 + 4.0 * np.exp(-edge / 12.0)


def test_a_path_s_cost_is_the_least_of_all_paths():
    """Less the least cost of the pixel before, which is no part of any choice (Hirschmüller 2008)."""
    rng = np.random.default_rng(0)
    cost, edges = rng.uniform(0, 6, (4, 6)), np.array([0.0, 0.0, 9.0, 40.0])
    price = 0.5 + 4.0 * np.exp(-edges / 12.0)
    found = _one_way(cost[:, :, None], price[:, None], SAME)[:, :, 0]
    least = np.zeros(4)
    for pixel in range(4):
        for last in range(6):
            totals = []
            for path in product(range(6), repeat=pixel):
                whole = (*path, last)
                total = sum(cost[s, one] for s, one in enumerate(whole))
                total += sum(change(whole[s - 1], whole[s], edges[s]) for s in range(1, len(whole)))
                totals.append(total)
            before = 0.0 if pixel == 0 else least[pixel - 1]
            assert found[pixel, last] == pytest.approx(min(totals) - before, abs=1e-9)
            least[pixel] = min(totals) if last == 0 else min(least[pixel], *totals)


def test_lines_run_in_four_directions_and_pay_less_at_edges():
    rng = np.random.default_rng(1)
    cost = rng.uniform(0, 6, (6, 5, 7)).astype(np.float32)
    guide = rng.uniform(0, 60, (5, 7)).astype(np.float32)
    found = _along_lines(cost, guide, SAME)
    expected = np.zeros_like(cost)
    for turned in (False, True):
        c, g = (cost.transpose(0, 2, 1), guide.T) if turned else (cost, guide)
        for backward in (False, True):
            lines, gray = (c[:, ::-1], g[::-1]) if backward else (c, g)
            edges = np.abs(np.diff(gray, axis=0, prepend=gray[:1]))
            paths = _one_way(np.ascontiguousarray(lines.transpose(1, 0, 2)), 0.5 + 4 * np.exp(-edges / 12), SAME)
            whole = paths.transpose(1, 0, 2)
            whole = whole[:, ::-1] if backward else whole
            expected += whole.transpose(0, 2, 1) if turned else whole
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_costs_are_filtered_along_the_edges_of_the_image():
    """He et al. (2010): in every window of 17 px a line through cost over gray value, with 30 added to the variance."""
    rng = np.random.default_rng(2)
    guide = rng.uniform(0, 50, (40, 44)).astype(np.float32)
    cost = rng.uniform(0, 10, (2, 40, 44)).astype(np.float32)
    found = _guided(cost, guide)

    def mean(values):
        return sliding_window_view(values.astype(float), (17, 17)).mean(axis=(2, 3))

    for one, filtered in zip(cost, found, strict=True):
        middle, average = mean(guide), mean(one)
        slope = (mean(guide * one) - middle * average) / (mean(guide * guide) - middle**2 + 30.0)
        offset = average - slope * middle
        inner = mean(slope) * guide[16:-16, 16:-16] + mean(offset)
        np.testing.assert_allclose(filtered[16:-16, 16:-16], inner, atol=2e-3)


@pytest.mark.parametrize(("better", "on_body"), [(0.15, False), (0.25, True)])
def test_a_link_must_explain_a_plain_pixel_somewhat_better_than_rest(better, on_body):
    hypotheses = Hypotheses(np.array([0, -1]), np.array([1.0, 1.0]))
    cost = np.full((2, 20, 20), 5.0, np.float32)
    cost[0] -= better
    links, inverse = choose_hypotheses(cost, np.full((20, 20), 90, np.uint8), hypotheses)
    assert (links == (0 if on_body else -1)).all()
    assert (inverse == 1.0).all()


def test_depth_is_found_between_hypotheses():
    """Costs that are a parabola of the inverse depth are lowest there, which filters and sums hardly change."""
    inverse = np.array([*np.linspace(0.5, 1.5, 6), *np.linspace(0.2, 1.2, 6), 1.0])
    hypotheses = Hypotheses(np.array([3] * 6 + [1] * 6 + [-1]), inverse)
    for true, found in ((1.04, 1.04), (0.83, 0.83), (0.5, 0.5), (1.7, 1.5)):
        cost = np.full((13, 20, 20), 15.0, np.float32)
        cost[:6] = (1 + 30 * (inverse[:6] - true) ** 2)[:, None, None]
        links, depths = choose_hypotheses(cost, np.full((20, 20), 90, np.uint8), hypotheses)
        assert (links == 3).all()
        np.testing.assert_allclose(depths, found, atol=0.03)
    cost[5] = cost[4] = 0.0  # two that are as good: in the middle, but not beyond the last
    np.testing.assert_allclose(choose_hypotheses(cost, np.full((20, 20), 90, np.uint8), hypotheses)[1], 1.4, atol=1e-6)


def test_hypotheses_span_the_depths_of_each_link_and_somewhat_beyond():
    depths = {2: np.linspace(1.0, 2.0, 101), 0: np.array([4.0, 4.0, 4.0])}
    found = depth_hypotheses(depths, 5)
    assert found.links.tolist() == [2] * 5 + [0] * 5 + [-1]
    np.testing.assert_allclose(found.inverse_depths[:5], np.linspace(0.9 / 1.97, 1.12 / 1.03, 5))
    np.testing.assert_allclose(found.inverse_depths[5:10], np.linspace(0.9 / 4, 1.12 / 4, 5))
    assert found.same_link.tolist() == [False, True, True, True, True, False, True, True, True, True, False]
