"""Targets that a robot can reach: where they may lie, how far apart, and what is said where there are none."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine import targets
from dense_vs.sims.engine.targets import reachable_targets


@pytest.fixture(scope="module")
def world():
    return SimWorld("arm", seed=1, device="cpu", height=60, width=80)


@pytest.fixture(scope="module")
def point(world):
    return world.track_point(world.project("tip"))


def test_targets_lie_inside_the_image_and_apart_from_the_one_before(world, point):
    start = world.project(point)
    found = reachable_targets(world, point, 60, 3, least_distance=9.0, border=7.0)
    assert found.shape == (60, 2)
    assert (found >= 7.0).all()
    assert (found <= [72.0, 52.0]).all()
    apart = np.linalg.norm(np.diff(np.vstack([start, found]), axis=0), axis=1)
    assert apart.min() >= 9.0
    assert apart.min() < 12.0  # no farther than it was asked for
    # Each is kept from the one before alone: another may be as near as it likes.
    assert min(np.linalg.norm(a - b) for k, a in enumerate(found) for b in found[k + 2 :]) < 9.0
    wide = reachable_targets(world, point, 60, 3, least_distance=0.0, border=0.0)
    assert ((wide < 7.0) | (wide > [72.0, 52.0])).any()
    np.testing.assert_array_equal(reachable_targets(world, point, 60, 3, least_distance=9.0, border=7.0), found)
    assert np.abs(reachable_targets(world, point, 60, 4, least_distance=9.0, border=7.0) - found).max() > 5.0


class Fixed:
    """Draws the given shares of the range one after the other, the same for all joints."""

    def __init__(self, *shares):
        self.shares = list(shares)

    def uniform(self, low, high, count):
        assert (low, high) == (-1, 1)
        return np.full(count, self.shares.pop(0))


def asked(world, point, monkeypatch, *shares, **options):
    monkeypatch.setattr(targets, "np", SimpleNamespace(**{**vars(np), "random": SimpleNamespace(
        default_rng=lambda seed: Fixed(*shares))}))  # fmt: skip
    found = reachable_targets(world, point, len(shares), 0, least_distance=0.0, border=-1e3, depth=True, **options)
    monkeypatch.undo()
    return found


@pytest.mark.parametrize(("share", "drawn"), [(0.8, -0.5), (0.8, 0.25), (0.3, 1.0)])
def test_a_target_is_where_the_point_is_seen_in_that_posture(monkeypatch, share, drawn):
    """The robot goes to the middle of its range and so much of the half of it; then it is looked where the point is."""
    world = SimWorld("arm", seed=1, device="cpu", height=60, width=80)
    point = world.track_point(world.project("tip"))
    monkeypatch.setattr(targets.surface_points, "is_seen", lambda *_: True)
    with monkeypatch.context() as patch:
        ((x, y, depth),) = asked(world, point, patch, drawn, share_of_range=share)
    low, high = world.joint_limits.T
    go_to(world, (low + high) / 2 + share * drawn * (high - low) / 2)
    assert (x, y) == pytest.approx(world.project(point), abs=0.05)
    position, pose = world.viewpoint.located(point, 0)[1], world.viewpoint.pose(world.physics.host_state(0), 0)
    assert depth == pytest.approx(pose[:3, 2] @ (position - pose[:3, 3]), abs=1e-3)
    assert 0.1 < depth < 5.0


@pytest.mark.parametrize(("reach", "drawn", "off"), [(0.2, 0.5, 0.1), (0.2, -1.0, -0.2), (0.8, 1.0, 0.5)])
def test_near_home_a_posture_is_drawn_from_so_much_about_home(monkeypatch, reach, drawn, off):
    """Home is 0 rad, about where the robot begins; the joints' limits are 0.5 rad, which are kept."""
    world = SimWorld("arm", seed=1, device="cpu", height=60, width=80)
    point = world.track_point(world.project("tip"))
    monkeypatch.setattr(targets.surface_points, "is_seen", lambda *_: True)
    with monkeypatch.context() as patch:
        ((x, y, _),) = asked(world, point, patch, drawn, reach=reach)
    go_to(world, np.full(len(world.joint_names), off))
    assert (x, y) == pytest.approx(world.project(point), abs=0.05)


def go_to(world, q):
    for _ in range(300):
        off = q - world.joints()[0]
        if np.abs(off).max() < 1e-5:
            return
        world.step(np.clip(off, -0.03, 0.03))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"border": 29.6}, "less than 29.6 px from its border; expected a camera that sees more"),
        ({"least_distance": 500.0}, "less than 500 px from the target before"),
    ],
)
def test_what_refuses_postures_is_counted(world, point, options, words):
    with pytest.raises(DenseVSError, match=words) as error:
        reachable_targets(world, point, 1, 0, **{"least_distance": 0.0, "border": 0.0, **options})
    assert "found 0 targets in 2000 random postures in world 0; expected 1" in str(error.value)


def test_a_point_that_is_covered_is_no_target(world, point, monkeypatch):
    monkeypatch.setattr(targets.surface_points, "is_seen", lambda *_: False)
    with pytest.raises(DenseVSError, match="something covers it, or it is turned away; expected a point on a side"):
        reachable_targets(world, point, 1, 0, least_distance=0.0, border=0.0)


def test_targets_of_several_worlds_are_their_own(monkeypatch):
    """The first world's are those of a single one; each of the others draws postures of its own."""
    worlds = SimWorld("planar", worlds=2, seed=1, device="cpu", height=60, width=80)
    one = SimWorld("planar", seed=1, device="cpu", height=60, width=80)
    seeds, begin = [], np.random.default_rng
    monkeypatch.setattr(np.random, "default_rng", lambda seed: seeds.append(seed) or begin(seed))
    both = reachable_targets(worlds, worlds.track_point(worlds.project("tip")), 3, 5, least_distance=4, border=4)
    assert seeds == [[5, 7], [5, 7, 1]]
    single = reachable_targets(one, one.track_point(one.project("tip")), 3, 5, least_distance=4, border=4)
    assert both.shape == (2, 3, 2)
    np.testing.assert_allclose(both[0], single)
    assert np.abs(both[1] - both[0]).max() > 1.0
