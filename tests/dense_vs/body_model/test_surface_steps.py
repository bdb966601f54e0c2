"""Keyframes that look at each other's points, counted place by place, and what each of them is asked."""

import numpy as np
import pytest

from dense_vs.body_model import surface as surface_module
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.link_sweep import TRUNCATION, Hypotheses, depth_hypotheses
from dense_vs.body_model.surface import Surface, SurfaceOptions, _look, _View, _vote, find_surface, keyframe_indices

H, W, FOCAL, CENTER = 24, 32, 40.0, (15.5, 11.5)


def chain():
    """A joint about the vertical at 1.5 m, and one about the optical axis beyond it."""
    return Chain(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.5], [0.1, 0.0, 1.4]]),
                 np.zeros(2), np.array([-1, 0]))  # fmt: skip


def views(seed=0):
    """Keyframes that mostly see a slope on two links; some places are farther, nearer, or on another link."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:H, :W]
    found = []
    for index in (2, 5, 9):
        links = np.where(u < W // 2, 0, 1)
        links[(v < 3) | (v > 20)] = BACKGROUND
        depths = 1.4 + 0.004 * u + 0.05 * rng.normal(size=(H, W))
        links[rng.random((H, W)) < 0.1] = BACKGROUND
        other = rng.random((H, W)) < 0.1
        links[other & (links != BACKGROUND)] ^= 1
        depths[links == BACKGROUND] = np.inf
        found.append(_View(index, links, depths))
    return found


def counted(view, all_views, joints, same):
    """Points that no majority sees through or sees otherwise, by one pixel after another."""
    rotation, translation = chain().link_poses(joints)
    kept = []
    for y in range(H):
        for x in range(W):
            link = view.links[y, x]
            if link == BACKGROUND:
                continue
            here = view.depths[y, x] * np.array([(x - CENTER[0]) / FOCAL, (y - CENTER[1]) / FOCAL, 1.0])
            point = rotation[view.index, link].T @ (here - translation[view.index, link])
            agree, differ = 1, 0
            for other in all_views:
                if other is view:
                    continue
                there = rotation[other.index, link] @ point + translation[other.index, link]
                u, v = (round(FOCAL * there[k] / there[2] + CENTER[k]) for k in range(2))
                if there[2] <= 0 or not (0 <= u < W and 0 <= v < H):
                    continue
                depth = other.depths[v, u]
                if depth < (1 - same) * there[2]:
                    continue  # something else is in front
                if abs(depth / there[2] - 1) <= same and other.links[v, u] == link:
                    agree += 1
                else:
                    differ += 1
            if agree > differ:
                kept.append((*point, link, agree / (agree + differ), 10 * view.index + (x + y) % 7, view.index))
    return np.array(kept)


@pytest.mark.parametrize("same", [0.02, 0.08])
def test_keyframes_vote_on_each_other_s_points(same):
    all_views = views()
    joints = np.random.default_rng(1).uniform(-0.15, 0.15, (12, 2))
    joints[9, 0] = 1.2  # from there much of it is out of the image
    v, u = np.mgrid[:H, :W]
    images = [(10 * k + (u + v) % 7).astype(np.uint8) for k in range(12)]
    for view in all_views:
        found = _vote(chain(), FOCAL, CENTER, images, joints, view, all_views, same)
        expected = counted(view, all_views, joints, same)
        assert 20 < len(expected) < (view.links != BACKGROUND).sum()
        np.testing.assert_allclose(found.points, expected[:, :3], atol=1e-9)
        np.testing.assert_array_equal(found.links, expected[:, 3])
        np.testing.assert_allclose(found.support, expected[:, 4])
        np.testing.assert_array_equal(found.gray, expected[:, 5])
        np.testing.assert_array_equal(found.seen_at, expected[:, 6])
        some = found.some(np.array([3, 1]))
        np.testing.assert_array_equal(some.points, found.points[[3, 1]])
        assert some.seen_at.tolist() == [view.index] * 2


@pytest.mark.parametrize(
    ("index", "reach", "expected"), [(3, 40, (0, 9)), (5, 2, (3, 7)), (0, 3, (0, 3)), (9, 2, (7, 9))]
)
@pytest.mark.parametrize("compared", [3, 10])
def test_a_keyframe_is_compared_with_images_around_it(monkeypatch, index, reach, compared, expected):
    asked = {}
    joints = 0.05 * np.arange(20.0).reshape(10, 2)
    points, links = (
        np.array([[0.1, 0.0, 1.4], [0.0, 0.1, 1.5], [0.2, 0.0, 1.7], [0.0, 0.0, 2.0]]),
        np.array([0, 1, 1, 1]),
    )
    moving = np.zeros((H, W), bool)
    moving[8:12, 9:20] = True

    def costs(*given):
        asked["costs"] = given
        return "cost"

    def choose(cost, image, hypotheses):
        asked["chosen"] = cost, image, hypotheses
        best = np.zeros(image.shape, int)
        best[2:, 3:] = 1
        best[-1] = 2
        return hypotheses.links[best], hypotheses.inverse_depths[best]

    def hypothesized(depths, steps):
        asked["depths"] = depths, steps
        return Hypotheses(np.array([0, 1, BACKGROUND]), np.array([0.5, 0.8, 1.0]))

    monkeypatch.setattr(surface_module, "link_costs", costs)
    monkeypatch.setattr(surface_module, "choose_hypotheses", choose)
    monkeypatch.setattr(surface_module, "depth_hypotheses", hypothesized)
    images = [np.full((H, W), k, np.uint8) for k in range(10)]
    options = SurfaceOptions(reach=reach, compared=compared, depth_steps=7)
    view = _look(chain(), FOCAL, CENTER, images, joints, moving, (points, links), index, options)
    first, last = expected
    near = np.arange(first, last + 1)
    others = {int(near[int(np.rint(k))]) for k in np.linspace(0, len(near) - 1, compared)} - {index}
    *_, reference, compared_with, hypotheses, box = asked["costs"]
    assert reference == index
    assert compared_with == sorted(others)
    assert box == (slice(4, 16), slice(5, 24))
    assert asked["chosen"][0] == "cost"
    assert asked["chosen"][1].shape == (12, 19)
    assert asked["chosen"][2] is hypotheses
    rotation, translation = chain().link_poses(joints[index][None])
    for link in (0, 1):
        there = points[links == link] @ rotation[0, link].T + translation[0, link]
        np.testing.assert_allclose(asked["depths"][0][link], there[:, 2])
    assert asked["depths"][1] == 7
    assert view.index == index
    inside = np.full((12, 19), 0)
    inside[2:, 3:] = 1
    inside[-1] = BACKGROUND
    expected_links = np.full((H, W), BACKGROUND)
    expected_links[box] = inside
    np.testing.assert_array_equal(view.links, expected_links)
    depths = np.select([expected_links == 0, expected_links == 1], [2.0, 1.25], np.inf)
    np.testing.assert_allclose(view.depths, depths)


def test_a_known_background_is_compared_with_in_place_of_other_images(monkeypatch):
    """Its cost is that of the last hypothesis, no more than that of others can be."""
    cost, told = np.full((2, H, W), 3.0, np.float32), []
    monkeypatch.setattr(surface_module, "link_costs", lambda *given: cost)

    def choose(cost, image, hypotheses):
        told.append(cost.copy())
        return np.full(image.shape, BACKGROUND), np.ones(image.shape)

    monkeypatch.setattr(surface_module, "choose_hypotheses", choose)
    images, joints = [np.full((H, W), 100, np.uint8)] * 10, np.zeros((10, 2))
    background = np.full((H, W), 100.0, np.float32)
    background[:, :4], background[:, 4:7], background[:, 7] = 112.0, 160.0, np.nan
    anchors = np.array([[0.1, 0.0, 1.4]]), np.array([0])
    _look(chain(), FOCAL, CENTER, images, joints, np.ones((H, W), bool), anchors, 5, SurfaceOptions(), background)
    (given,) = told
    np.testing.assert_array_equal(given[0], 3.0)
    np.testing.assert_allclose(given[1][:, :4], 12.0)
    np.testing.assert_allclose(given[1][:, 4:7], TRUNCATION)
    np.testing.assert_allclose(given[1][:, 7:], 3.0)


def test_the_surface_is_of_all_keyframes(monkeypatch):
    asked = []
    all_views = {view.index: view for view in views()}
    monkeypatch.setattr(surface_module, "_look", lambda *given: asked.append(given[7]) or all_views[given[7]])
    monkeypatch.setattr(
        surface_module, "keyframe_indices", lambda count, keyframes: asked.append((count, keyframes)) or [2, 5, 9]
    )
    kept = []
    monkeypatch.setattr(surface_module, "_thinned", lambda found, focal: kept.append((found, focal)) or found)
    joints = np.random.default_rng(1).uniform(-0.1, 0.1, (12, 2))
    images = [np.zeros((H, W), np.uint8)] * 12
    found = find_surface(chain(), FOCAL, CENTER, images, joints, np.ones((H, W), bool), None)
    assert asked == [(12, 3), 2, 5, 9, (12, 21), 2, 5, 9]  # for the background first
    parts = [
        _vote(chain(), FOCAL, CENTER, images, joints, view, list(all_views.values()), 0.08)
        for view in all_views.values()
    ]
    np.testing.assert_allclose(found.points, np.concatenate([part.points for part in parts]))
    np.testing.assert_array_equal(found.seen_at, np.concatenate([part.seen_at for part in parts]))
    assert kept[0][1] == FOCAL


def test_defaults_and_keyframes_that_are_spread_over_the_images():
    options = SurfaceOptions()
    assert (options.keyframes, options.compared, options.reach) == (21, 10, 40)
    assert (options.depth_steps, options.same_depth) == (12, 0.08)
    assert keyframe_indices(13, 5).tolist() == [2, 4, 6, 8, 10]
    assert keyframe_indices(3, 1).tolist() == [1]
    assert keyframe_indices(2, 5).tolist() == [0, 1]
    assert Surface(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)).seen_at.size == 0


def test_hypotheses_of_a_link_reach_a_little_beyond_its_points():
    values = np.linspace(1.0, 2.0, 101)
    found = depth_hypotheses({3: values, 0: np.array([1.5])}, 4)
    assert found.links.tolist() == [3] * 4 + [0] * 4 + [BACKGROUND]
    np.testing.assert_allclose(found.inverse_depths[:4], np.linspace(0.9 / 1.97, 1.12 / 1.03, 4))
    np.testing.assert_allclose(found.inverse_depths[4:8], np.linspace(0.9 / 1.5, 1.12 / 1.5, 4))
    assert found.inverse_depths[8] == 1.0
