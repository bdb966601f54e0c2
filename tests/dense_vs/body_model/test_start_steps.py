"""What is chosen to start from, counted by hand: tracks of every link, candidates that differ, those that are kept."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.body_model import start
from dense_vs.body_model.axes_from_jacobian import AxesState
from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.dense_motion import DenseMotion
from dense_vs.body_model.start import Start, core, dense_core, distinct, find_starts, reflected
from dense_vs.body_model.track_jacobian import TrackJacobians
from dense_vs.errors import DenseVSError

PARENTS, LEARNED = np.array([-1, 0, 1]), np.array([True, True, False])
WIDTH = 100


def measured(count, seed=0):
    """J of tracks inside the image that are known, each to another deviation."""
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.5, 9.0, (count, 3))
    return TrackJacobians(
        np.zeros(3), rng.uniform(0, 99, (count, 2)), rng.normal(0, 40, (count, 2, 3)),
        np.stack([np.diag(row) for row in variances]), np.ones((count, 3), bool), np.zeros(count), np.ones(count, bool),
    )  # fmt: skip


def tracked(count, images=30):
    return SimpleNamespace(size=(80, WIDTH), seen=np.ones((images, count), bool))


def chosen_of(monkeypatch, evidence, found, tracks):
    monkeypatch.setattr(start, "joint_set_evidence", lambda tracks, measured, sets, noise: evidence)
    return core(tracks, found, PARENTS, LEARNED, 0.5)


def test_of_every_link_twenty_tracks_that_say_most(monkeypatch):
    """By J over its deviation times the odds of the link, neither above 20."""
    found, rng = measured(90), np.random.default_rng(1)
    evidence = rng.uniform(0, 30, (90, 3))  # of link 0, link 1 and the background
    chosen, links = chosen_of(monkeypatch, evidence, found, tracked(90))
    expected = {}
    for link in (0, 1):
        on = []
        for m in range(90):
            order = np.argsort(evidence[m])
            if order[-1] != link:
                continue
            odds = evidence[m, order[-1]] - evidence[m, order[-2]]
            sure = np.sqrt(np.sum(found.jacobians[m] ** 2)) / np.sqrt(np.trace(found.covariances[m]) + 1)
            on.append((-min(sure, 20.0) * min(odds, 20.0), m))
        expected |= {m: link for _, m in sorted(on)[:20]}
    assert chosen.tolist() == sorted(expected)
    assert links.tolist() == [expected[m] for m in sorted(expected)]
    assert (np.bincount(links) == 20).all()


def test_more_than_twenty_deviations_or_odds_say_no_more(monkeypatch):
    found = measured(30)
    found.jacobians[:] = 0.0
    found.covariances[:] = 0.0
    found.jacobians[:, 0, 0] = 19.0
    found.jacobians[:10, 0, 0] = 21.0
    found.jacobians[10:15, 0, 0] = 9000.0  # as good as 21
    evidence = np.tile([21.0, 0.0, 0.0], (30, 1))
    evidence[3] = [900.0, 0.0, 0.0]
    chosen, _ = chosen_of(monkeypatch, evidence, found, tracked(30))
    assert chosen.tolist() == list(range(20))
    evidence[29] = [20.0, 0.0, 0.0]
    evidence[0] = [17.0, 0.0, 0.0]  # 20 x 17 is less than 19 x 20
    chosen, _ = chosen_of(monkeypatch, evidence, found, tracked(30))
    assert chosen.tolist() == list(range(1, 21))


@pytest.mark.parametrize(
    ("place", "images", "usable", "taken"),
    [
        ((50.0, 50.0), 12, True, True), ((50.0, 50.0), 11, True, False), ((50.0, 50.0), 12, False, False),
        ((-49.0, 50.0), 12, True, True), ((-51.0, 50.0), 12, True, False), ((50.0, -51.0), 12, True, False),
        ((149.0, 50.0), 12, True, True), ((151.0, 50.0), 12, True, False), ((50.0, 151.0), 12, True, False),
    ],
)  # fmt: skip
def test_tracks_that_take_part(monkeypatch, place, images, usable, taken):
    """Seen in twelve images, explained, and at most half a width outside."""
    found, tracks = measured(14), tracked(14)
    found.places[5], found.usable[5] = place, usable
    tracks.seen[images:, 5] = False
    chosen, _ = chosen_of(monkeypatch, np.tile([9.0, 0.0, 0.0], (14, 1)), found, tracks)
    assert (5 in chosen) == taken


@pytest.mark.parametrize(("count", "enough"), [(12, True), (11, False)])
def test_twelve_tracks_are_enough(monkeypatch, count, enough):
    evidence = np.tile([0.0, 9.0, 0.0], (count + 5, 1))
    evidence[count:] = [0.0, 0.0, 9.0]  # the background says nothing of lines
    if enough:
        assert chosen_of(monkeypatch, evidence, measured(count + 5), tracked(count + 5))[1].tolist() == [1] * count
        return
    with pytest.raises(DenseVSError, match="11 tracks are seen long enough to start from; expected 12"):
        chosen_of(monkeypatch, evidence, measured(count + 5), tracked(count + 5))


def test_pixels_are_on_the_link_whose_joints_move_them():
    """A joint moves a pixel from 3 % of the width a radian on; one that is not learned does not count."""
    rng = np.random.default_rng(3)
    J = np.zeros((120, 2, 3))
    J[:40, 0, 0] = 3.5
    J[40:80, 1] = [3.5, -4.0, 0.0]
    J[80:, 0] = [2.5, 2.9, 50.0]
    J[0, 0, 1] = 2.9
    dense = DenseMotion(np.array([0.1, 0.2, 0.3]), rng.uniform(0, 99, (120, 2)), J)
    part, links = dense_core(dense, PARENTS, LEARNED, WIDTH, 5)
    assert np.bincount(links).tolist() == [20, 20]
    order = np.random.default_rng(5).permutation(120)
    expected = np.sort([*[k for k in order if k < 40][:20], *[k for k in order if 40 <= k < 80][:20]])
    np.testing.assert_array_equal(part.places, dense.pixels[expected])
    np.testing.assert_array_equal(part.jacobians, J[expected])
    np.testing.assert_array_equal(links, expected >= 40)
    moved = np.linalg.norm(np.where(LEARNED, J, 0.0), axis=1)[expected] > 3.0
    np.testing.assert_array_equal(part.moved_by, moved)
    assert (part.covariances == 25.0 * np.eye(3)).all()
    assert part.noise.tolist() == [0.0] * 40
    assert part.usable.all()
    assert part.posture.tolist() == [0.1, 0.2, 0.3]


def lines(first, seed=0):
    """Two lines, the first of them given; five points."""
    second = np.array([0.0, 1.0, 0.0])
    points = np.random.default_rng(seed).normal((0, 0, 2), 1, (2, 3))
    chain = Chain(np.array([first, second]), points, np.zeros(2), np.array([-1, 0]))
    return AxesState(chain, np.random.default_rng(seed + 1).uniform(0.5, 1.5, 5))


@pytest.mark.parametrize(("cosine", "count"), [(0.971, 1), (0.969, 2), (-0.971, 1), (-0.969, 2)])
def test_lines_are_the_same_from_a_cosine_on(cosine, count):
    """Of each pair of lines: one other line makes another candidate."""
    turned = np.array([cosine, 0.0, np.sqrt(1 - cosine**2)])
    states = [lines(np.array([1.0, 0.0, 0.0])), lines(turned)]
    kept = distinct(states, 9)
    assert len(kept) == count
    np.testing.assert_allclose(np.median(kept[0].inverse_depths), 1.0)
    factor = np.median(states[0].inverse_depths)
    before, after = (np.cross(one.chain.points, one.chain.axes) for one in (states[0], kept[0]))
    np.testing.assert_allclose(after, before * factor)  # wherever on a line its point is
    assert len(distinct(states[:1] * 3 + [lines(np.array([0.0, 0.0, 1.0]))], 1)) == 1


def test_a_reflection_in_depth():
    state = lines(np.array([0.6, 0.0, 0.8]))
    state = replace(state, inverse_depths=np.array([1.0, 0.8, 0.6, 1.25, 10.0]))
    found = reflected(state)
    depths = 1 / state.inverse_depths
    np.testing.assert_allclose(1 / found.inverse_depths, np.maximum(2 - depths, 0.4))
    np.testing.assert_allclose(found.chain.axes, [[-0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
    points = state.chain.points.copy()
    points[:, 2] = 2 - points[:, 2]
    np.testing.assert_allclose(found.chain.points, points)
    np.testing.assert_allclose(found.chain.travel, state.chain.travel * [1, 1, -1])


@pytest.mark.parametrize("dense", [False, True])
def test_of_each_tree_the_six_best_candidates_are_kept(monkeypatch, dense):
    asked, costs = [], {}
    tracks = SimpleNamespace(size=(80, WIDTH))
    few = SimpleNamespace(joints="joints", pixels="pixels", directions="directions")
    tracks.select = lambda chosen: SimpleNamespace(in_images=lambda most: asked.append((chosen, most)) or few)
    monkeypatch.setattr(
        start, "core", lambda tracks, measured, parents, learned, noise: (f"core of {parents}", "links")
    )
    monkeypatch.setattr(
        start, "dense_core", lambda dense, parents, learned, width, seed: (f"{dense} {width} {seed}", "l")
    )
    rng = np.random.default_rng(0)

    def candidates(part, links, parents, slides, focal, center, starts, seed):
        assert (slides, focal, center, starts, seed) == ("slides", 300.0, "center", 9, 4)
        found = [f"{part}/{links}/{parents}/{k}" for k in range(8)]
        costs.update({one: float(rng.random()) for one in found})
        return found

    def adjust(begun, joints, pixels, links, center, prior, noise, *rounds, directions):
        assert (joints, pixels, links, center, prior, noise) == (
            "joints",
            "pixels",
            "links",
            "center",
            (300.0, 0.03),
            0.5,
        )
        assert (*rounds, directions) == (2, 8, "directions")
        return f"{begun} adjusted", costs[begun], None

    monkeypatch.setattr(start, "_candidates", candidates)
    monkeypatch.setattr(start, "adjust", adjust)
    given = SimpleNamespace(select=lambda chosen: f"J of {chosen}")
    found = find_starts(tracks, given, ["A", "B"], "slides", "learned", 300.0, "center", noise=0.5, starts=9, seed=4,
                        dense="filter" if dense else None)  # fmt: skip
    expected = []
    for tree in "AB":
        own = sorted((one for one in costs if f"core of {tree}" in one), key=costs.get)[:6]
        expected += [(f"{one} adjusted", f"core of {tree}") for one in own]
        if dense:
            expected += [(f"filter 100 4/l/{tree}/{k}", None) for k in range(8)]
    assert [(one.state, one.chosen if isinstance(one.chosen, str) else None) for one in found] == expected
    assert all(isinstance(one, Start) for one in found)
    assert asked == [("core of A", 20), ("core of B", 20)]
    assert all(one.chosen.size == 0 for one in found if not isinstance(one.chosen, str))


def test_each_candidate_is_tried_with_its_reflection(monkeypatch):
    asked = {}
    states = [lines(np.array([1.0, 0, 0])), lines(np.array([0.8, 0, 0.6])), lines(np.array([0, 0, 1.0]))]

    def found(part, moved, parents, focal, center, **options):
        asked.update(moved=moved, options=options)
        return [(0.1 * k, one) for k, one in enumerate(states)]

    monkeypatch.setattr(start, "axes_from_jacobian", found)
    part = SimpleNamespace(places=np.random.default_rng(0).uniform(0, 99, (5, 2)))
    links = np.array([0, 1, 1, 0, BACKGROUND])
    center = np.array([49.5, 39.5])
    made = start._candidates(part, links, np.array([-1, 0]), "slides", 300.0, center, 9, 4)
    assert asked["options"] == {"slides": "slides", "starts": 9, "keep": 20, "seed": 4}
    np.testing.assert_array_equal(asked["moved"], [[1, 0], [1, 1], [1, 1], [1, 0], [0, 0]])
    both = [one for state in distinct(states, 16) for one in (state, reflected(state))]
    assert len(made) == 6
    for one, state in zip(made, both, strict=True):
        rays = np.column_stack([(part.places - center) / 300.0, np.ones(5)])
        np.testing.assert_allclose(one.points, rays / state.inverse_depths[:, None])
        np.testing.assert_allclose(one.chain.axes, state.chain.axes)
        assert one.focal == 300.0
