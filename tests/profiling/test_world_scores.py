"""What is measured in a simulated world, with worlds and loops made by hand."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import accuracy
import body_model
import surface_view
from surface_scores import ReachScore, ViewScore
from surface_view import moved_place

from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.errors import DenseVSError


def error(median, p90=0.0):
    return SimpleNamespace(median=median, p90=p90, inner_median=median / 2)


def measured(end="reached", true_error=0.5, frames=20):
    reach = SimpleNamespace(end=SimpleNamespace(value=end), frames=frames, uncertainty_px=0.75)
    return SimpleNamespace(reach=reach, true_error_px=true_error)


class Experiment:
    """A view that has learned with J off by 0.25; its reaches end 3 and 0 px from the true point."""

    made = None

    def __init__(self, world, **options):
        Experiment.made = options
        self.on_frame, self.surface_point = options["on_frame"], None
        labels = np.array([[1, 0], [2, 2]])
        pipeline = SimpleNamespace(labels=lambda: labels)
        self.loop = SimpleNamespace(pipeline=pipeline, joint_delay=-0.05, point=np.zeros(2))
        self.results = [(measured("reached", 2.5), (3.0, 4.0)), (measured("lost", 0.5, 9), (0.0, 0.0))]

    def learn(self):
        self.on_frame(self)
        self.on_frame(self)
        return error(0.25, 0.75)

    def truth(self):
        return np.zeros((2, 2, 2, 1)), np.array([[True, True], [False, False]])

    def choose(self):
        self.surface_point = "point"
        self.on_frame(self)
        return np.zeros(2)

    def targets(self, count):
        return list(range(count))

    def reach(self, target):
        self.on_frame(self)
        result, self.true = self.results[target]
        return result

    def project(self, _):
        return -np.array(self.true)


@pytest.fixture
def view(monkeypatch):
    """Measures a view by hand-made parts: what was told, and how often the exact estimator was fed."""

    class Exact:
        updates = 0

        def __init__(self, world):
            self.estimator = SimpleNamespace(jacobian="exact J")
            Exact.updates = 0

        def update(self):
            Exact.updates += 1

    class Body:
        def __init__(self, device):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    def j_error(J, true, mask):
        assert (J, true.shape) == ("exact J", (2, 2, 2, 1))
        assert mask.sum() == 2
        return error(0.125)

    monkeypatch.setattr(surface_view, "make_world", lambda view, options: SimpleNamespace(joint_names=["a", "b"]))
    monkeypatch.setattr(surface_view, "ExactFlow", Exact)
    monkeypatch.setattr(surface_view, "SelfBody", Body)
    monkeypatch.setattr(surface_view, "ReachingExperiment", Experiment)
    monkeypatch.setattr(surface_view, "jacobian_error", j_error)

    def run(targets=2, exact=True):
        told = []
        options = SimpleNamespace(exact=exact, device="cpu", seconds=7.0)
        surface_view.measure(ViewScore("panda", "A", "clean", 3, 4, targets), options, told.append)
        return told, Exact.updates

    return run


def test_a_view_is_told_when_learned_and_after_every_reach(view):
    told, fed = view()
    learned, first, second, done = told
    assert (learned.joints, learned.j_median, learned.j_p90, learned.exact_median) == (2, 0.25, 0.75, 0.125)
    # Labeled as the robot's: one of four pixels, which is; the true robot has two.
    assert (learned.overlap, learned.precision, learned.recall) == pytest.approx((0.5, 1.0, 0.5))
    assert learned.delay_frames == pytest.approx(-1.5)
    assert fed == 2  # while it babbles, not while it reaches
    assert first.reaches == [ReachScore("reached", 2.5, 5.0, 20, 0.75)]
    assert second.reaches == done.reaches == [*first.reaches, ReachScore("lost", 0.5, 0.0, 9, 0.75)]
    assert [one.finished for one in told] == [False, False, False, True]
    assert not done.failure
    assert 0 < learned.seconds <= done.seconds < 60
    assert (Experiment.made["seed"], Experiment.made["babble_seconds"], Experiment.made["traced"]) == (3, 7.0, False)


def test_a_view_without_targets_or_exact_flow(view):
    told, fed = view(targets=0, exact=False)
    assert len(told) == 2
    assert told[-1].finished
    assert np.isnan(told[0].exact_median)
    assert fed == 0


def test_a_view_that_fails_says_why(view, monkeypatch):
    def fail(*_):
        raise DenseVSError("no tip in view")

    monkeypatch.setattr(Experiment, "choose", fail)
    told, _ = view()
    assert told[-1].failure == "no tip in view"
    assert not told[-1].finished
    assert told[-1].j_median == 0.25


def test_a_tip_that_is_covered_gives_way_to_the_nearest_place_that_the_last_joint_moves():
    true, mask = np.zeros((40, 60, 2, 3)), np.zeros((40, 60), bool)
    mask[5:35, 5:55] = True
    true[..., 0] = 50.0  # another joint moves all of it
    true[10:20, 30:45, 1, -1] = -1.5
    true[10:20, 5:12, 1, -1] = 0.9  # hardly
    true[36:, :, 0, -1] = 9.0  # not the robot
    assert moved_place(true, mask, np.array([30.4, 10.0])) is None  # it is there
    np.testing.assert_array_equal(moved_place(true, mask, np.array([28.0, 15.0])), [32, 15])  # two px inside
    np.testing.assert_array_equal(moved_place(true, mask, np.array([90.0, -7.0])), [42, 12])
    # What is hardly moved is no place to click, for one who points at it too.
    np.testing.assert_array_equal(moved_place(true, mask, np.array([8.0, 15.0])), [32, 15])
    assert moved_place(0 * true, mask, np.array([30.0, 10.0])) is None
    # A place that the last joint moves by just a pixel for a radian is not moved.
    true[10:20, 30:45, 1, -1] = 1.0
    assert moved_place(true, mask, np.array([28.0, 15.0])) is None


@pytest.mark.parametrize(("images", "realism"), [("clean", False), ("sensor", "sensor")])
def test_a_commercial_arm_uses_its_first_joints_and_ours_all(monkeypatch, images, realism):
    made = []

    def world(arm, **options):
        made.append((arm, options))
        return SimpleNamespace(joint_names=["a", "b", "c"])

    monkeypatch.setattr(surface_view, "SimWorld", world)
    options = SimpleNamespace(device="cpu", world_device="")
    common = {"seed": 5, "realism": realism, "device": "cpu"}
    surface_view.make_world(ViewScore("arm", "", images, 5, 2, 0), options)
    assert made.pop() == ("arm", common)
    surface_view.make_world(ViewScore("panda", "B", images, 5, 2, 0), options)
    assert made[-1] == ("panda", {"joints": ["a", "b"], "camera": "B", **common})


def test_exact_flow_goes_with_exact_joint_steps(monkeypatch):
    given = []
    positions = [np.array([0.5, 1.0]), np.array([0.7, 0.9]), np.array([0.6, 0.9])]
    world = SimpleNamespace(
        shape=(1, 4, 6), joint_names=["a", "b"], device="cpu", true_flow=lambda: "flow",
        physics=SimpleNamespace(joint_positions=lambda: [positions.pop(0)]),
    )  # fmt: skip
    estimator = SimpleNamespace(update=lambda flow, dq: given.append(dq))
    monkeypatch.setattr(surface_view, "DenseJacobian", lambda **options: estimator)
    exact = surface_view.ExactFlow(world)
    exact.update()
    exact.update()
    np.testing.assert_allclose(given, [[0.2, -0.1], [-0.1, 0.0]])


def test_accuracy_means_and_worst_are_over_all_worlds(monkeypatch):
    shown = {}
    errors = {("arm", 0): 0.1, ("arm", 1): 0.3, ("planar", 0): 0.2, ("planar", 1): 0.2}

    def run_world(robot, seed, targets, distractor):
        assert (targets, distractor) == (2, "none")
        median = errors[robot, seed]
        return {"default, estimated flow": error(median), "default, exact flow": error(median / 10)}, [
            measured(true_error=seed + 0.5), measured(true_error=2.0)]  # fmt: skip

    monkeypatch.setattr(accuracy, "run_world", run_world)
    monkeypatch.setattr(accuracy, "report", lambda found, _: shown.update({m.name: m.value for m in found}) or 0)
    monkeypatch.setattr(sys, "argv", ["accuracy.py", "--seeds", "0,1", "--targets", "2"])
    assert accuracy.main() == 0
    assert shown["J error, default, estimated flow, median: mean"] == pytest.approx(0.2)
    assert shown["J error, default, estimated flow, median: worst"] == 0.3
    assert shown["J error, default, estimated flow, inner_median: mean"] == pytest.approx(0.1)
    assert shown["J error, default, exact flow, median: mean"] == pytest.approx(0.02)
    assert shown["reaches"] == 8
    assert shown["reaches below 2 px"] == 0.5


def test_every_mode_is_fed_its_own_flow_and_only_while_babbling(monkeypatch):
    fed, made = {}, {}

    class Estimator:
        def __init__(self, **options):
            self.name = len(made)
            made[self.name] = options
            fed[self.name] = []
            self.jacobian = self.name

        def update(self, flow, dq):
            fed[self.name].append((flow, dq))

    class Loop:
        def __init__(self, world, seed, on_frame):
            self.loop, self.surface_point, self.on_frame = SimpleNamespace(), None, on_frame

        def frame(self, flow):
            self.loop.frame = SimpleNamespace(flow=flow, dq="dq")
            self.on_frame(self)

        def learn(self):
            self.frame(None)
            self.frame("estimated")
            self.frame("estimated")
            return "own error"

        def choose(self):
            self.surface_point = "point"
            self.frame("of the reach")

        def targets(self, count):
            return range(count)

        def reach(self, target):
            return target

    world = SimpleNamespace(shape=(1, 4, 6), joint_names=["a", "b"], true_flow=lambda: "exact",
                            true_jacobian=lambda: "true", robot_mask=lambda: "mask")  # fmt: skip
    monkeypatch.setattr(accuracy, "SimWorld", lambda robot, seed, distractor: world)
    monkeypatch.setattr(accuracy, "DenseJacobian", Estimator)
    monkeypatch.setattr(accuracy, "ReachingExperiment", Loop)
    monkeypatch.setattr(accuracy, "jacobian_error", lambda J, true, mask: (J, true, mask))
    errors, reaches = accuracy.run_world("arm", 0, 3, "none")
    assert reaches == [0, 1, 2]
    assert len(errors) == 2 * len(accuracy.MODES)
    assert errors.pop("default, estimated flow") == "own error"  # the loop's own estimator
    for name, (J, *truth) in errors.items():
        assert truth == ["true", "mask"]
        assert fed[J] == [("exact" if name.endswith("exact flow") else "estimated", "dq")] * 2
    printed = {"covariance": "diagonal", "prediction_iterations": 1}
    assert {name: made[J] for name, (J, *_) in errors.items() if name.endswith("exact flow")} == {
        f"{name}, exact flow": {"height": 4, "width": 6, "joints": 2, "on_bad_flow": "skip", **options}
        for name, options in {
            "default": {},
            "default, order 1": {"order": 1},
            "diagonal (9)-(11), model (14)": printed,
            "diagonal (9)-(11), flow (13)": {**printed, "prediction": "flow"},
            "Hosoda (12), model (14)": {"covariance": "fixed", "prediction_iterations": 1},
        }.items()
    }
    assert accuracy.run_world("arm", 0, 0, "none")[1] == []


def test_a_babbling_is_paced_by_the_estimated_flow_inside_the_limits(monkeypatch):
    class World:
        joint_names, shape = ("a", "b"), (1, 4, 5)
        joint_limits = np.array([[-0.1, 0.1], [-1.0, 1.0]])

        def __init__(self):
            self.q, self.steps, self.frames = np.zeros(2), [], 0

        def frame(self):
            self.frames += 1
            return SimpleNamespace(rgb=self.frames)

        def joints(self):
            return self.q.copy(), 0.0

        def step(self, dq):
            self.steps.append(dq)
            self.q = self.q + dq

    told = []

    class Babbling:
        def __init__(self, joints, seed):
            assert (joints, seed) == (2, 7)

        def step(self, flow):
            told.append(flow)
            return np.array([0.03, -0.02])

    monkeypatch.setattr(body_model, "Babbling", Babbling)
    monkeypatch.setattr(
        body_model, "FlowEstimator", lambda height, width, device: lambda before, now: (height, width, before, now)
    )
    monkeypatch.setattr(body_model, "on_the_camera_clock", lambda images, joints: joints)
    monkeypatch.setattr(body_model, "to_gray", lambda rgb: rgb)
    monkeypatch.setattr(body_model, "true_links", lambda world: f"links {world.frames}")
    monkeypatch.setattr(body_model, "some_points", lambda world, seed: f"points {world.frames} {seed}")
    world = World()
    seen = body_model.babble(world, 7, 4.0)
    assert seen.images == list(range(1, 121))
    assert told == [None, *((4, 5, k, k + 1) for k in range(1, 119))]
    expected = np.array([[min(0.03 * k, 0.1), max(-0.02 * k, -1.0)] for k in range(120)])
    np.testing.assert_allclose(seen.joints, expected)
    every = body_model.REFERENCE_FRAMES
    assert seen.links == {0: "links 1", **{k: f"links {k + 1}" for k in range(every, 120, every)}}
    stride = body_model.PointTrackOptions().stride
    looked = len(range(0, 120, stride))
    spread = np.linspace(0, looked - 1, SurfaceOptions().keyframes + 2)[1:-1]
    surfaces = stride * np.unique(spread.round().astype(int))
    assert seen.anchors == {int(k): f"points {k + 1} 7" for k in surfaces}
