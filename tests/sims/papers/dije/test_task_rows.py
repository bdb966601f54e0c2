"""Rows of the servo experiments of DIJE from runs made by hand."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.dije import rake, reach, vacuum
from dense_vs.sims.papers.dije.servo_experiment import EDGE, task_rows, well_inside
from dense_vs.sims.papers.dije.servo_record import TaskReach, TaskRun


def one_reach(point, error, frames=30, lost=False):
    return TaskReach(point, (0.0, 0.0), frames, error, lost, np.zeros((1, 1, 3)), (0, 1))


def run(seed, median, reaches, moved=0):
    return TaskRun(seed, SimpleNamespace(median=median), None, reaches, moved)


def test_targets_count_below_what_the_task_calls_close():
    runs = [
        run(1, 0.1, [one_reach("left-wrist", 1.9), one_reach("left-wrist", 2.0, 60, lost=True)], 1),
        run(2, 0.3, [one_reach("left-wrist", 0.5, 90), one_reach("left-elbow", 7.0)]),
        run(3, 0.9, [one_reach("left-wrist", 9.0, 300)]),
    ]
    arguments = Namespace(compliance=False, period=0.7, gain=0.5)
    found = {row.name: row for row in task_rows(reach.TASK, runs, arguments)}
    assert found["J error after learning, median"].ours == 0.3
    assert found["points near the border, taken farther inside"].ours == 1
    assert found["left-wrist: true error, median"].ours == pytest.approx(1.95)
    assert found["left-wrist: true error, worst"].ours == 9.0
    assert (found["left-wrist: targets within 2 px"].ours, found["left-wrist: targets within 2 px"].unit) == (2, "of 4")
    assert found["left-wrist: reaches given up as lost"].ours == 1
    assert found["left-wrist: time to a target, median"].ours == 2.5
    assert found["left-elbow: targets within 2 px"].ours == 0
    arguments.compliance = True
    soft = {row.name: row.ours for row in task_rows(reach.TASK, runs, arguments)}
    assert soft["left-wrist: targets within 5 px"] == 3


@pytest.mark.parametrize(
    ("task", "close", "soft", "apart"), [(reach, 2.0, 5.0, 25.0), (rake, 3.0, 5.0, 20.0), (vacuum, 3.0, 5.0, 12.0)]
)
def test_what_counts_as_close(task, close, soft, apart):
    assert (task.TASK.close_px, task.TASK.soft_px, task.TASK.least_distance) == (close, soft, apart)


def test_a_point_at_the_border_is_taken_farther_inside():
    shape, inside = (240, 320), np.array([160.0, 120.0])
    np.testing.assert_array_equal(well_inside(inside, np.zeros(2), shape), inside)
    low = np.array([EDGE - 10.0, 120.0])
    seen = well_inside(low, inside, shape)
    assert EDGE <= seen[0] < EDGE + 5
    high = np.array([160.0, 239.0 - EDGE + 10.0])
    seen = well_inside(high, inside, shape)
    assert 239 - EDGE - 5 < seen[1] <= 239 - EDGE
    np.testing.assert_array_equal(well_inside(low, low, shape), low)
