"""Scores of depth on cases made by hand."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

from depth_row import SeedResult, metrics_of, motion_in_space
from depth_scores import DepthScore, RowScore, SpaceReach, depth_score, reach_metrics, row_score

from dense_vs.sims import SimWorld

MASK = np.array([[True, True, True, False]])


def test_a_row_of_depth_is_compared_where_joints_move_the_robot():
    true = np.array([[[3.0, 4.0], [0.0, 0.0], [1.0, 0.0], [9.0, 9.0]]])
    off = np.array([[[0.0, 1.0], [7.0, 0.0], [0.0, 0.5], [9.0, 0.0]]])
    score = row_score(true + off, true, np.array([[10.0, 1.0, 2.0, 1.0]]), MASK)
    assert score.median == pytest.approx((0.2 + 0.5) / 2)  # neither what no joint moves nor what is not the robot
    assert score.p90 == pytest.approx(0.2 + 0.9 * 0.3)
    assert score.of_motion == pytest.approx((0.1 + 0.25) / 2)
    assert np.isnan(row_score(true, 0 * true, np.ones((1, 4)), MASK).median)


def test_depth_that_is_not_known_counts_as_infinitely_far_off():
    true = np.array([[1.0, 2.0, 4.0, 1.0]])
    score = depth_score(np.array([[1.01, 1.9, np.nan, 5.0]]), true, MASK)
    assert score.median == pytest.approx(0.05)
    assert score.p90 == np.inf
    assert score.unknown == pytest.approx(1 / 3)
    near = depth_score(np.array([[0.5, 1.0, 4.0, 5.0]]), true, MASK)  # less than a meter is known as well
    assert (near.median, near.p90, near.unknown) == (0.5, 0.5, 0.0)
    for value in (0.0, -0.5, np.inf):
        assert depth_score(np.array([[value] * 4]), true, MASK) == DepthScore(np.inf, np.inf, 1.0)
    assert np.isnan(depth_score(true, true, ~MASK & MASK).median)


def test_reaches_are_counted_by_the_truth_and_by_what_is_said():
    reaches = [
        SpaceReach("reached", 0.0079, 1.0, 0.001, 10),
        SpaceReach("reached", 0.008, 1.0, 0.003, 20),
        SpaceReach("missed", 0.002, 0.5, 0.001, 150),
        SpaceReach("lost", 0.5, 90.0, 0.2, 30),
        SpaceReach("lost", np.nan, np.nan, np.nan, 30),
    ]
    values = {metric.name: metric.value for metric in reach_metrics(reaches)}
    assert values["reaches"] == 5
    assert values["reaches below 8 mm"] == 2
    assert values["said reached"] == 2
    assert values["wrongly said reached"] == 1
    assert values["said lost"] == 2
    assert np.isnan(values["reach error in space, worst"])
    values = {metric.name: metric.value for metric in reach_metrics(reaches[:3])}
    assert values["reach error in space, median"] == pytest.approx(7.9)
    assert values["reach error in space, worst"] == pytest.approx(8.0)
    assert values["depth of the point, median error"] == pytest.approx(1.0)
    assert values["reach frames, median"] == 20


def test_seeds_are_averaged_and_their_reaches_taken_together():
    def seed(number, error, reaches):
        depth = DepthScore(error, 2 * error, 0.1)
        return SeedResult(number, error, RowScore(error, error, error), depth, depth, depth, reaches)

    reach = SpaceReach("reached", 0.001, 0.2, 0.001, 10)
    values = {m.name: m.value for m in metrics_of([seed(0, 0.1, [reach]), seed(1, 0.3, [reach, reach])])}
    assert values["J error, row of depth, median"] == pytest.approx(0.2)
    assert values["depth of robot pixels, filtered, 90 %"] == pytest.approx(0.4)
    assert values["reaches"] == 3
    assert len(values) == 4 + 9 + 10


def test_motion_in_space_is_that_of_the_points():
    """By the simulator's points, moved by a small joint step."""
    world = SimWorld("arm", seed=1, device="cpu", height=48, width=64)
    size = motion_in_space(world.true_jacobian(True), world, world.frame().depth)
    y, x = np.argwhere(world.robot_mask())[100]
    point = world.track_point([x, y])
    model, state = world.physics.models.host(0), world.physics.host_state(0)
    import mujoco

    jacobian = np.zeros((3, model.nv))
    position = world.viewpoint.located(point, 0)[1]
    mujoco.mj_jac(model, state, jacobian, None, position, model.geom_bodyid[point.geoms[0]])
    columns = model.jnt_dofadr[world.scene.joint_ids]
    assert size[y, x] == pytest.approx(np.linalg.norm(jacobian[:, columns]), rel=1e-3)
