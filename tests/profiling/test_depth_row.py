"""What is compared before a depth camera: sensor, filter, model and truth are told apart, by parts made by hand."""

import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import depth_row
from depth_row import SeedResult
from depth_scores import DepthScore, RowScore, SpaceReach

MASK = np.array([[True, True, False], [False, True, False]])
TRUE = np.full((2, 3), 2.0)  # m


def off_by(image, share, elsewhere=9.0):
    """An image that is off by a share of itself on the robot, and by more elsewhere."""
    by = np.where(MASK, share, elsewhere).reshape(MASK.shape + (1,) * (image.ndim - 2))
    return image * (1 + by)


class World:
    """Two joints; J's rows of pixels are 2 and its row of depth is 0.5."""

    def __init__(self, robot="arm", **options):
        self.made = {"robot": robot, **options}
        self.J = np.concatenate([np.full((2, 3, 2, 2), 2.0), np.full((2, 3, 1, 2), 0.5)], axis=2)

    def true_jacobian(self, depth):
        assert depth is True
        return self.J

    def robot_mask(self):
        return MASK

    def frame(self):
        return SimpleNamespace(depth=TRUE)


class Experiment:
    """Learns in 95 frames, the 60th without a depth image; sensor, filter and J are each off by a share of their own.

    The point is at 0.80 m; the loop takes it for 0.83 m.
    """

    made = None

    def __init__(self, world, **options):
        Experiment.made = options
        self.on_frame, self.surface_point = options["on_frame"], None
        self.asked = []
        estimator = SimpleNamespace(
            to_numpy=lambda: off_by(world.J[..., :2, :], 0.2),
            depth_jacobian=off_by(world.J[..., 2, :], 0.3),
            depth=off_by(TRUE, 0.05),
        )
        self.loop = SimpleNamespace(estimator=estimator, body_model=None, point_depth=0.83)

    def frames(self, numbers):
        for number in numbers:
            depth = None if number == 60 else f"depth {number}"
            self.loop.frame = SimpleNamespace(depth=depth, positions=[float(number)])
            self.on_frame(self)

    def learn(self):
        self.frames(range(1, 96))

    def choose(self):
        self.surface_point = "point"

    def targets(self, count, depth):
        assert depth is True
        return list(range(count))

    def reach(self, target):
        self.frames(range(100, 130))  # the camera's images of a reach are not kept
        self.asked.append(target)
        reach = SimpleNamespace(end=SimpleNamespace(value=("reached", "lost")[target % 2]), frames=20 + target)
        return SimpleNamespace(reach=reach, true_error_m=0.004 + target, true_error_px=1.5 + target)

    def in_camera(self, point):
        assert point == "point"
        return np.array([0.1, 0.2, 0.80])


@pytest.fixture
def made(monkeypatch):
    """The parts that were made, by name."""
    parts = {}

    def camera(world, sensor, seed):
        parts["camera"] = world, sensor.noise, seed
        return SimpleNamespace(depth=lambda: off_by(TRUE, -0.1))

    def motion(J, world, depth):
        np.testing.assert_array_equal(J, world.J)
        np.testing.assert_array_equal(depth, TRUE)
        return np.full((2, 3), 4.0)

    monkeypatch.setattr(depth_row, "SimWorld", World)
    monkeypatch.setattr(depth_row, "SimDepthCamera", camera)
    monkeypatch.setattr(depth_row, "ReachingExperiment", Experiment)
    monkeypatch.setattr(depth_row, "motion_in_space", motion)
    return parts


def options(**changed):
    told = {"robot": "arm", "device": "cpu", "images": "clean", "noise": 0.004, "seconds": 7.0, "targets": 2}
    return Namespace(**{**told, **changed})


@pytest.mark.parametrize(("images", "realism"), [("clean", False), ("realistic", "realistic")])
def test_every_figure_is_of_its_own_source(made, images, realism):
    found = depth_row.measure(3, options(images=images))
    assert found.seed == 3
    assert found.pixel_rows == pytest.approx(0.2)
    assert (found.row.median, found.row.p90) == pytest.approx((0.3, 0.3))
    assert found.row.of_motion == pytest.approx(0.3 * np.hypot(0.5, 0.5) / 4)
    for part, off in (("sensor", 0.1), ("filtered", 0.05)):
        score = getattr(found, part)
        assert (score.median, score.p90, score.unknown) == pytest.approx((off, off, 0.0))
    assert np.isnan([found.model.median, found.model.p90, found.model.unknown]).all()
    assert [reach.end for reach in found.reaches] == ["reached", "lost"]
    world, noise, seed = made["camera"]
    assert (noise, seed) == (0.004, 3)
    assert world.made == {"robot": "arm", "seed": 3, "device": "cpu", "realism": realism}
    assert (Experiment.made["seed"], Experiment.made["babble_seconds"], Experiment.made["depth"]) == (3, 7.0, True)


def test_a_model_is_brought_to_meters_by_noisy_images_of_the_babbling(made, monkeypatch):
    given = []

    def in_meters(depths, postures):
        given.append((depths, postures.tolist()))
        return "model in meters"

    def ask(world, model, seed):
        assert (world is made["camera"][0], model, seed) == (True, "model in meters", 3)
        return DepthScore(0.01, 0.02, 0.03)

    class WithModel(Experiment):
        def learn(self):
            super().learn()
            self.loop.body_model = SimpleNamespace(in_meters=in_meters)

    monkeypatch.setattr(depth_row, "ReachingExperiment", WithModel)
    monkeypatch.setattr(depth_row, "ask", ask)
    found = depth_row.measure(3, options())
    assert given == [(["depth 30", "depth 90"], [[30.0], [90.0]])]
    assert found.model == DepthScore(0.01, 0.02, 0.03)
    assert (found.seed, found.filtered.median, len(found.reaches)) == (3, pytest.approx(0.05), 2)  # what it was


def test_reaches_are_scored_by_the_truth(capsys):
    experiment = Experiment(World(), on_frame=lambda _: None)
    found = depth_row.reach_all(experiment, 3)
    assert experiment.asked == [0, 1, 2]
    assert found == [
        SpaceReach(end, 0.004 + k, 1.5 + k, pytest.approx(0.03), 20 + k)
        for k, end in enumerate(["reached", "lost", "reached"])
    ]
    experiment.loop.point_depth = 0.77  # too near is as wrong as too far
    assert depth_row.reach_all(experiment, 1)[0].depth_m == pytest.approx(0.03)
    assert len(capsys.readouterr().out.splitlines()) == 4


def test_without_targets_no_point_is_chosen():
    experiment = Experiment(World(), on_frame=lambda _: None)
    assert depth_row.reach_all(experiment, 0) == []
    assert experiment.surface_point is None


def test_a_model_is_asked_at_postures_of_the_range_that_the_babbling_covered(monkeypatch):
    """The model is off by a hundredth at the first posture, by two at the second, and so on."""
    joint_range = np.array([[-0.5, -0.3], [0.1, 0.9]])
    at, asked = [np.zeros(2)], []

    def go_to(world, q):
        at.append(q)

    def image(q):
        asked.append(q)
        return SimpleNamespace(depths=off_by(TRUE * len(asked), 0.01 * len(asked)))

    world = SimpleNamespace(
        joints=lambda: (at[-1] + 0.001, 0.0),  # it does not quite get there
        frame=lambda: SimpleNamespace(depth=TRUE * len(asked)),
        robot_mask=lambda: MASK if len(asked) < 8 else MASK & (np.arange(3) < 1),
    )
    monkeypatch.setattr(depth_row, "go_to", go_to)
    model = SimpleNamespace(joint_range=joint_range, image=image)
    score = depth_row.ask(world, model, 5)
    went = np.array(at[1:])
    assert went.shape == (8, 2)
    assert ((went > joint_range[:, 0]) & (went < joint_range[:, 1])).all()
    assert (np.ptp(went, axis=0) > 0.4 * np.ptp(joint_range, axis=1)).all()
    np.testing.assert_allclose(asked, went + 0.001)  # where it is by its joints
    # Three pixels of each but the last, which has one: the twelfth of 22 is of the fourth posture.
    assert score == DepthScore(pytest.approx(0.04), pytest.approx(0.07), 0.0)
    at[1:], asked[:] = [], []
    depth_row.ask(world, model, 6)
    assert np.abs(np.array(at[1:]) - went).max() > 0.01  # other seeds, other postures


def test_every_figure_of_the_seeds_has_its_own_metric(capsys):
    """Of the second seed every figure is larger by 1."""

    def seed(number):
        figures = iter(number + np.arange(1, 14) / 100)
        parts = [RowScore(*(next(figures) for _ in range(3)))]
        parts += [DepthScore(*(next(figures) for _ in range(3))) for _ in range(3)]
        return SeedResult(number, next(figures), *parts, [SpaceReach("reached", 0.001 + number, 0.2, 0.001, 10)])

    results = [seed(0), seed(1)]
    metrics = depth_row.metrics_of(results)
    values = {metric.name: metric.value for metric in metrics}
    assert list(values.values())[:13] == pytest.approx([0.63, *np.arange(0.51, 0.625, 0.01)])
    assert list(values)[:6] == [
        "J error, pixel rows",
        "J error, row of depth, median",
        "J error, row of depth, 90 %",
        "J error, row of depth by the whole motion",
        "depth of robot pixels, as measured, median",
        "depth of robot pixels, as measured, 90 %",
    ]
    assert list(values)[9:13:3] == [
        "depth of robot pixels, filtered, share not known",
        "depth of robot pixels, body model at unseen postures, share not known",
    ]
    assert all(metric.better == "lower" for metric in metrics[:13])
    assert values["reaches below 8 mm"] == 1
    depth_row.print_results(results)
    first, second = capsys.readouterr().out.splitlines()[-2:]
    assert first.split() == ["0", "0.130", "0.010", "0.02", "0.030", "0.0400", "0.0700", "0.090", "0.1000", "1.0"]
    assert second.split()[-1] == "1001.0"
