"""The simulator's truths that figures are held against, on worlds whose answers are known."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.papers.dije.transport import Transport
from dense_vs.sims.papers.vosvs import depth_log, trial, true_jacobian
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ServoScore


class Straight:
    """A world in which every joint moves the centroid by 500 px per unit along both axes."""

    def __init__(self):
        self.q = np.linspace(0.1, 0.2, len(JOINTS))
        self.joint_units = ("rad",) * len(JOINTS)

    def true_joints(self):
        return self.q.copy()

    def set_posture(self, q, forget_odometry):
        assert not forget_odometry
        self.q = q.copy()


@pytest.mark.parametrize("one", CONFIGURATIONS, ids=lambda one: one.name)
def test_true_pseudoinverse_by_differences(one, monkeypatch):
    world = Straight()
    start = world.q.copy()
    monkeypatch.setattr(true_jacobian, "true_centroid", lambda w, *_: np.full(2, 300 + 500 * w.q.sum()))
    pinv = true_jacobian.true_pinv(world, one, "Mug")
    np.testing.assert_allclose(pinv, one.coupling / 500.0, rtol=1e-9)
    np.testing.assert_array_equal(world.q, start)


def test_depth_errors_of_both_methods_count_by_their_size():
    yes = ServoScore(True)
    ones = [ObjectTrial("Mug", 0.0, yes, yes, DepthScore(True, -0.03, -0.05), DepthScore(True, -0.04, -0.02))]
    rows = {row.name: row.ours for row in trial.table_rows({1: ones}, {1: True}, "robust")}
    assert rows["depth error by robust, median, against the outline's depth"] == pytest.approx(3.0)
    assert rows["  the same against the mean surface depth, median"] == pytest.approx(5.0)
    assert rows["depth error by (20) as printed, median"] == pytest.approx(4.0)


def test_distance_of_a_recorded_approach(tmp_path):
    camera_z, z_object = np.linspace(0.8, 0.4, 9), 0.15
    areas = (40.0 / (camera_z - z_object)) ** 2
    rows = "".join(f"{a},{z}\n" for a, z in zip(areas, camera_z, strict=True))
    (tmp_path / "log.csv").write_text(f"{','.join(depth_log.COLUMNS)}\n{rows}")
    found = {row.name: row for row in depth_log.run(Namespace(log=tmp_path / "log.csv", out=tmp_path, seeds=[0]))}
    assert found["z_object"].ours == pytest.approx(0.15)
    assert found["z_object"].paper is None  # another log than the published one
    assert found["c_object"].ours == pytest.approx(40.0)
    assert found["distance at the last view"].ours == pytest.approx(0.25)
    assert found["views"].ours == 9


def test_a_transported_body_leaks_as_far_as_it_covers_the_walker():
    jacobian = np.full((20, 40, 2, 1), 50.0, np.float32)
    own, walker = np.zeros((20, 40), bool), np.zeros((20, 40), bool)
    own[:, 5:15] = True
    walker[:, 10:18] = True
    transport = Transport(jacobian, own, "model", "cpu", 1)
    view = SimpleNamespace(flow=np.zeros((20, 40, 2), np.float32), dq=np.zeros(1), walker=walker)
    transport.take(view)
    assert transport.leak() == pytest.approx(5 / 8)
    hardly = SimpleNamespace(flow=view.flow, dq=view.dq, walker=np.zeros_like(walker))
    transport.take(hardly)
    assert transport.leak() == pytest.approx(5 / 8)  # too little was seen to say anything
