"""Scores of the measuring programs on cases made by hand."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.jacobian.error import JacobianError

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import accuracy
import surfaces


def reach(true_error, believed=True, frames=10):
    return SimpleNamespace(true_error_px=true_error, reach=SimpleNamespace(reached=believed, frames=frames))


def result(name, images, median, overlap, reaches):
    error = JacobianError(median, 0.9, 0.1, 100)
    return surfaces.SurfaceResult(name, images, error, error, overlap, 0.5, 0.6, 0.0, reaches)


def test_a_reach_counts_below_two_pixels_by_the_truth():
    one = result("panda A", "clean", 0.3, 0.8, [reach(1.99), reach(2.0), reach(0.1, believed=False), reach(9.0, False)])
    assert one.reached == 2
    assert one.wrongly_reached == 1  # believed in, and exactly 2 px off


def test_figures_of_arms_and_their_means():
    results = [
        result("panda A", "clean", 0.2, 0.9, [reach(1.0), reach(5.0)]),
        result("ur5e B", "clean", 0.4, 0.5, [reach(1.0)]),
        result("arm", "clean", 0.05, 0.99, [reach(1.0)]),  # ours: in no mean
        result("panda A", "real", 0.6, 0.4, []),
    ]
    values = {metric.name: metric.value for metric in surfaces.metrics_of(results)}
    assert values["panda A, clean: reaches below 2 px"] == 1
    assert values["panda A, clean: wrongly reached"] == 1
    assert values["J error, clean: mean over arms"] == pytest.approx(0.3)
    assert values["J error, clean: worst arm"] == 0.4
    assert values["label IoU, clean: mean over arms"] == pytest.approx(0.7)
    assert values["reaches, clean"] == 3
    assert values["reaches below 2 px, clean"] == 2
    assert values["wrongly reached, clean"] == 1
    assert values["J error, real: mean over arms"] == 0.6
    assert values["arm, clean: J error"] == 0.05


def test_labels_against_the_true_robot():
    mask, labels = np.zeros((10, 10), bool), np.zeros((10, 10), bool)
    mask[:, :4] = True
    labels[:, 3:5] = True
    assert surfaces.label_quality(labels, mask) == pytest.approx((0.2, 0.5, 0.25))
    assert surfaces.label_quality(mask, mask) == (1.0, 1.0, 1.0)
    assert surfaces.label_quality(np.zeros_like(mask), mask) == (0.0, 0.0, 0.0)


def test_shares_of_reaches():
    found = accuracy.reach_metrics([reach(0.5, frames=20), reach(2.0, frames=30), reach(1.9, frames=90), reach(30.0)])
    values = {metric.name: metric.value for metric in found}
    assert values["reaches"] == 4
    assert values["reaches below 2 px"] == 0.5
    assert values["reach error, median"] == pytest.approx(1.95)
    assert values["reach error, worst"] == 30.0
    assert values["reach frames, median"] == 25
    assert accuracy.reach_metrics([]) == []
