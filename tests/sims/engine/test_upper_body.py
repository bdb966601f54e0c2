"""The humanoid upper body: joint names, camera, what passes by."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld

SMALL = {"device": "cpu", "height": 60, "width": 80}
LEFT_ARM = ("left-shoulder-p", "left-shoulder-r", "left-shoulder-y", "left-elbow-p")
ARM = ("shoulder-p", "shoulder-r", "shoulder-y", "elbow-p", "elbow-y", "wrist-p", "wrist-r")


def test_two_arms_of_seven_joints_named_as_in_the_paper():
    world = SimWorld("upper-body", **SMALL)
    assert world.joint_names == tuple(f"{side}-{name}" for side in ("left", "right") for name in ARM)


def test_the_camera_sees_60_by_49_5_degrees():
    for height, width in ((60, 80), (240, 320)):
        K = SimWorld("upper-body", device="cpu", height=height, width=width).intrinsics
        angles = 2 * np.rad2deg(np.arctan(np.array([width / K[0, 0], height / K[1, 1]]) / 2))
        np.testing.assert_allclose(angles, [60.0, 49.5], atol=1e-3)


def test_the_seed_paints_and_poses():
    first, second = (SimWorld("upper-body", joints=LEFT_ARM, seed=seed, **SMALL) for seed in (0, 1))
    assert np.mean(first.frame().rgb != second.frame().rgb) > 0.9
    assert np.all(first.joints()[0] != second.joints()[0])
    for world in (first, second):
        x, y = world.project("left-wrist")
        assert 20 < x < 60
        assert 10 < y < 45
        assert 0.1 < world.robot_mask().mean() < 0.3


def passing(kind):
    """Depth of passer-by and arm where either is seen over 8 s, and the share of the arm that it covers."""
    world = SimWorld("upper-body", joints=LEFT_ARM, distractor=kind, seed=2, **SMALL)
    body = world.scene.model.body(kind.split("-")[0]).id
    own = world.scene.model.geom_bodyid == body
    arm = world.robot_mask().sum()
    ahead, seen, least = [], 0, arm
    for _ in range(24):
        for _ in range(10):
            world.step()
        frame = world.frame()
        passer = (frame.ids >= 0) & own[np.maximum(frame.ids, 0)]
        assert not np.any(passer & world.robot_mask())
        np.testing.assert_array_equal(world.true_jacobian()[passer], 0.0)
        seen += passer.sum()
        ahead.append(frame.depth[passer])
        least = min(least, world.robot_mask().sum())
    return np.concatenate(ahead), seen, 1 - least / arm


@pytest.mark.parametrize("body", ["walker", "chair"])
def test_passers_by_are_behind_next_to_and_across_the_arm(body):
    shares = {}
    for place in ("behind", "next", "across"):
        depth, seen, covered = passing(f"{body}-{place}")
        assert seen > 500
        shares[place] = covered
        assert depth.min() > (0.1 if place == "across" else 0.6)
    assert shares["behind"] <= 0.01  # nothing of the arm is covered, but for rays along its outline
    assert shares["next"] <= 0.01
    assert shares["across"] > 0.1


def test_a_walker_needs_a_robot_that_has_one():
    with pytest.raises(
        DenseVSError, match=r"distractor is 'walker-behind'; expected one of 'none', 'behind', 'front'$"
    ):
        SimWorld("planar", distractor="walker-behind", **SMALL)
    with pytest.raises(DenseVSError, match=r"expected one of 'none', 'walker-behind', .*'chair-across'$"):
        SimWorld("upper-body", distractor="behind", **SMALL)
