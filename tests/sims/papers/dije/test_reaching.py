"""The reaching experiment's own bookkeeping: its pixels are those of the loop, whose images may be scaled."""

from pathlib import Path

import numpy as np
import pytest

from dense_vs import sims
from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.faults import FaultInjector
from dense_vs.sims.engine.targets import reachable_targets
from dense_vs.sims.papers.dije.reaching import ReachingExperiment


def test_truth_of_halved_images_is_that_of_a_camera_of_half_the_size():
    large, small = (SimWorld("planar", seed=5, device="cpu", height=h, width=w) for h, w in ((120, 160), (60, 80)))
    halved, plain = ReachingExperiment(large, scale=0.5, seed=5), ReachingExperiment(small, seed=5)
    for world in (large, small):
        world.step([0.02, 0.01, -0.02])
    np.testing.assert_allclose(halved.project("tip"), plain.project("tip"), atol=1e-9)
    (jacobian, mask), (expected, expected_mask) = halved.truth(), plain.truth()
    assert jacobian.shape == expected.shape
    assert (mask & ~expected_mask).sum() == 0
    assert mask.sum() > 0.8 * expected_mask.sum()
    close = np.abs(jacobian[mask] - expected[mask]) <= 0.02 * np.abs(expected).max()
    assert close.mean() > 0.98  # all but where one link ends and the next begins
    for experiment in (halved, plain):
        experiment.choose(experiment.project("tip"))
    np.testing.assert_allclose(halved.loop.point, plain.loop.point, atol=1e-9)
    targets = [experiment.targets(3, least_distance=4.0, border=4.0) for experiment in (halved, plain)]
    np.testing.assert_allclose(targets[0], targets[1], atol=1e-6)
    with pytest.raises(DenseVSError, match=r"scale is 0\.4"):
        ReachingExperiment(large, scale=0.4)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_truth_is_that_of_a_camera_that_was_bumped(scale):
    world = SimWorld("planar", seed=5, device="cpu", height=60, width=80)
    injector = FaultInjector(world)
    experiment = ReachingExperiment(world, scale=scale, seed=5, injector=injector)
    place, whole = experiment.project("tip"), (world.true_jacobian(), world.robot_mask())
    injector.begin("bump")
    injector.read()
    np.testing.assert_allclose(experiment.project("tip"), place + np.array([5 * scale, 0]))
    if scale == 1:
        for truth, usual in zip(experiment.truth(), whole, strict=True):
            np.testing.assert_array_equal(truth[:, 5:], usual[:, :-5])
    injector.end()
    injector.read()
    np.testing.assert_allclose(experiment.project("tip"), place)


def test_targets_near_home_come_from_postures_near_home():
    world = SimWorld("arm", seed=1, device="cpu", height=60, width=80)
    point = world.track_point(world.project("tip"))
    start = world.project(point)
    near = reachable_targets(world, point, 10, 3, reach=0.05, least_distance=0.0, border=2.0)
    far = reachable_targets(world, point, 10, 3, least_distance=0.0, border=2.0)
    distances = [np.linalg.norm(targets - start, axis=1).mean() for targets in (near, far)]
    assert distances[0] < 0.4 * distances[1]


def test_a_tip_that_has_left_the_image_is_chosen_where_the_robot_began(tmp_path):
    model = (Path(sims.__path__[0]) / "models" / "planar.xml").read_text(encoding="utf-8")
    (tmp_path / "wide.xml").write_text(model.replace("-0.6 0.6", "-1.8 1.8"), encoding="utf-8")
    world = SimWorld(str(tmp_path / "wide.xml"), seed=5, device="cpu", height=60, width=80)
    experiment = ReachingExperiment(world, seed=5, babble_seconds=0.2)
    experiment.learn()
    began = experiment._began
    for _ in range(60):
        experiment.loop.step(np.array([0.02, 0.01, 0.0]))
    assert experiment.project("tip")[1] > 60
    pixel = experiment.choose()
    assert np.abs(experiment.loop.frame.positions - began).max() < 0.02
    np.testing.assert_allclose(experiment.loop.point, pixel, atol=1e-6)
    np.testing.assert_allclose(pixel, experiment.project("tip"), atol=0.5)
    for _ in range(5):  # in sight it is chosen where it is
        experiment.loop.step(np.array([0.02, 0.0, 0.0]))
    assert np.abs(experiment.choose() - pixel).max() > 1
    experiment.world.viewpoint.shows = lambda name, world, size: False  # something covers it
    np.testing.assert_allclose(experiment.choose(), pixel, atol=0.5)
