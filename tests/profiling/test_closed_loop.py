"""What is counted of the reaches of many robots, with a batch made by hand."""

import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import closed_loop

from dense_vs.point_servo import ReachEnd

ENDS = [ReachEnd.REACHED, ReachEnd.REACHED, ReachEnd.LOST, ReachEnd.MISSED]


class Batch:
    """Runs 300 frames by itself, or as many as asked for."""

    def __init__(self, worlds):
        self.worlds, self.frames, self.ran = worlds, 0, []

    def run(self, frames=None):
        self.ran.append(frames)
        self.frames += 300 if frames is None else frames

    def results(self):
        return SimpleNamespace(
            true_error_px=np.array([[1.0, 2.9], [3.0, np.nan]]),
            outcome=np.array(ENDS).reshape(2, 2),
            restarts=np.array([0, 3]),
        )

    def jacobian_errors(self):
        return [SimpleNamespace(median=median) for median in (0.1, 0.9, 0.2)]


@pytest.fixture
def made(monkeypatch):
    """The batches that were made."""
    batches = []

    def make_batch(arguments, worlds):
        batches.append(Batch(worlds))
        return batches[-1]

    times = iter([10.0, 14.0])
    monkeypatch.setattr(closed_loop, "make_batch", make_batch)
    monkeypatch.setattr(closed_loop, "update_deviation", lambda batch: 1e-6 * batch.worlds)
    monkeypatch.setattr(closed_loop, "time", SimpleNamespace(perf_counter=lambda: next(times)))
    return batches


def test_reaches_are_shares_of_all(made):
    """One of four is not a number, as the point is behind the camera: it is not there."""
    arguments = Namespace(worlds=2, babble=4.0)
    metrics = closed_loop.reach_metrics(arguments, SimpleNamespace(alias="cpu"))
    values = {metric.name.removesuffix(", 2 worlds, cpu").removesuffix(", cpu"): metric.value for metric in metrics}
    assert values == {
        "share of reaches within 3 px": 0.5,  # 3 px are not within
        "share reached": 0.5,
        "share lost": 0.25,
        "true error, median": 2.9,
        "true error, 95th percentile": pytest.approx(2.99),
        "worlds restarted": 1.0,
        "whole run with readings": pytest.approx(300 * 2 / 4.0),
        "J against the CPU's, same inputs": pytest.approx(2e-6),
        "J error after babbling, median": 0.2,
    }
    assert [metric.better for metric in metrics[:3]] == ["higher", "higher", "lower"]
    # The second batch has learned for the seconds of babbling when its J is compared.
    assert [(batch.worlds, batch.ran) for batch in made] == [(2, [None]), (2, [60, 60])]


def test_few_worlds_are_compared_with_a_cpu(made):
    closed_loop.reach_metrics(Namespace(worlds=1024, babble=1.0), SimpleNamespace(alias="cuda:0"))
    assert [(batch.worlds, batch.ran) for batch in made] == [(1024, [None]), (4, [60, 0])]
