"""A servo task and a reach with worlds and loops made by hand: what is chosen, asked for, measured and told."""

from argparse import ArgumentParser, Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.dije import rake, reaching, servo_experiment, vacuum
from dense_vs.sims.papers.dije import reach as reach_task
from dense_vs.sims.papers.dije.reaching import ReachingExperiment, Trace
from dense_vs.sims.papers.dije.servo_experiment import PAPER_GAIN, parse_targets, run_seed, task_rows, well_inside


@pytest.mark.parametrize(
    ("place", "share"),
    [
        ((160.0, 120.0), 0.0),
        ((8.0, 120.0), None),
        ((-10.0, 120.0), None),
        ((330.0, 120.0), None),
        ((160.0, 250.0), None),
    ],
)
def test_a_point_near_the_border_is_taken_farther_inside(place, share):
    """By steps of a fiftieth of the way to the other point, up to six tenths."""
    edge, other = servo_experiment.EDGE, np.array([160.0, 120.0])
    found = well_inside(np.array(place), other, (240, 320))
    low, high = np.full(2, edge), np.array([319 - edge, 239 - edge])
    steps = np.linspace(0, 0.6, 31)[:, None] * (other - place) + place
    good = ((steps >= low) & (steps <= high)).all(axis=1)
    np.testing.assert_allclose(found, steps[np.argmax(good)])
    if share is not None:
        np.testing.assert_array_equal(found, place)


def test_a_point_that_another_is_no_help_for_stays():
    far = np.array([-500.0, 120.0])
    np.testing.assert_array_equal(well_inside(far, np.array([160.0, 120.0]), (240, 320)), far)
    edge = float(servo_experiment.EDGE)
    for border in ([edge, 120.0], [319 - edge, 120.0], [160.0, edge], [160.0, 239 - edge]):
        np.testing.assert_array_equal(well_inside(np.array(border), np.array([160.0, 120.0]), (240, 320)), border)


@pytest.mark.parametrize(
    ("texts", "targets"), [(["3"], 3), (["1"], 1), (["10,20"], [[10, 20]]), (["1.5,2", "3,4"], [[1.5, 2], [3, 4]])]
)
def test_targets_are_a_number_or_places(texts, targets):
    np.testing.assert_array_equal(parse_targets(texts), targets)


@pytest.mark.parametrize("texts", [["0"], ["-1"], ["1", "2"], ["1,2,3"], ["x"], ["1,nan"], ["1,2", "3"]])
def test_targets_that_are_none(texts):
    with pytest.raises(DenseVSError, match="--targets is"):
        parse_targets(texts)


def reach(point, error, frames=60, lost=False):
    return SimpleNamespace(point=point, true_error_px=error, frames=frames, lost=lost)


@pytest.mark.parametrize(("compliance", "within"), [(False, 2), (True, 3)])
def test_rows_of_a_task(compliance, within):
    task = SimpleNamespace(points=("tip", "elbow"), close_px=2.0, soft_px=5.0)
    runs = [
        SimpleNamespace(seed=3, learned=SimpleNamespace(median=0.1), moved_into_view=1,
                        reaches=[reach("tip", 1.0, 30), reach("tip", 2.0, 60, True), reach("elbow", 9.0)]),
        SimpleNamespace(seed=5, learned=SimpleNamespace(median=0.3), moved_into_view=2,
                        reaches=[reach("tip", 0.5, 90), reach("tip", 30.0, 300, True), reach("elbow", 5.0)]),
    ]  # fmt: skip
    arguments = Namespace(compliance=compliance, period=0.7, gain=0.5)
    rows = {row.name: row for row in task_rows(task, runs, arguments)}
    ours = {name: row.ours for name, row in rows.items()}
    assert ours["seconds between commands"] == 0.7
    assert ours["gain of a command"] == 0.5
    assert ours["J error after learning, median"] == pytest.approx(0.2)
    assert ours["points near the border, taken farther inside"] == 3
    assert ours["tip: true error, median"] == 1.5
    assert ours["tip: true error, worst"] == 30.0
    assert ours[f"tip: targets within {5 if compliance else 2} px"] == within
    assert ours["tip: reaches given up as lost"] == 2
    assert ours["tip: time to a target, median"] == pytest.approx(75 / 30)
    assert ours["elbow: true error, median"] == 7.0
    assert ours[f"elbow: targets within {5 if compliance else 2} px"] == 0
    assert rows["tip: true error, worst"].seeds == (3, 5)
    assert rows["tip: true error, worst"].unit == "px"
    alone = SimpleNamespace(points=("tip",), close_px=2.0, soft_px=5.0)
    assert "points near the border, taken farther inside" not in {row.name for row in task_rows(alone, runs, arguments)}


class Experiment:
    made = None

    def __init__(self, world, **options):
        Experiment.made = options
        self.trace = SimpleNamespace(times=[0.0] * 10)
        self.events = []
        Experiment.one = self
        image = np.zeros((2, 2, 3))
        self.loop = SimpleNamespace(
            frame=SimpleNamespace(image=image), estimator=SimpleNamespace(to_numpy=lambda: np.ones(3))
        )

    def learn(self):
        return "error"

    def project(self, point):
        return np.array([160.0, 120.0]) if point == "tip" else np.array([-5.0, 120.0])

    def choose(self, seen):
        self.events.append(("choose", *seen))

    def targets(self, count, **options):
        self.events.append(("targets", count, options))
        return np.arange(2.0 * count).reshape(count, 2)

    def reach(self, target, **options):
        self.events.append(("reach", *target, options))
        self.trace.times += [0.0] * 5
        done = SimpleNamespace(target=tuple(target), frames=5, error_px=0.5, lost=False)
        return SimpleNamespace(reach=done, true_error_px=float(target[0]))

    def truth(self):
        return "true J", "mask"


@pytest.mark.parametrize(
    ("targets", "halve", "compliance"), [(2, False, False), (np.array([[50.0, 60.0]]), True, True)]
)
def test_every_point_goes_to_its_targets(monkeypatch, targets, halve, compliance):
    made = {}

    def keeps(name):
        return lambda *given, **options: made.update({name: (given, options)}) or SimpleNamespace(joint_limits="limits")

    monkeypatch.setattr("dense_vs.sims.engine.world.SimWorld", keeps("world"))
    monkeypatch.setattr("dense_vs.jacobian.estimator.DenseJacobian", keeps("estimator"))
    monkeypatch.setattr("dense_vs.point_servo.law.VisualServo", keeps("servo"))
    monkeypatch.setattr("dense_vs.sims.papers.dije.reaching.ReachingExperiment", Experiment)
    task = SimpleNamespace(points=("tip", "elbow"), joints=("a", "b", "c"), robot="robot", least_distance=33.0)
    arguments = Namespace(compliance=compliance, distractor="none", device="cpu", threads=1, halve=halve, period=0.7,
                          babble=60.0, prediction=None, gain=0.5, commands=40)  # fmt: skip
    run = run_seed(task, 4, targets, arguments)
    (robot,), world = made["world"]
    assert (robot, world["seed"], world["compliance"]) == ("robot", 4, compliance)
    assert (world["height"], world["width"]) == ((480, 640) if halve else (240, 320))
    assert made["estimator"][1]["prediction"] == ("flow" if compliance else "model")
    assert (made["estimator"][1]["height"], made["estimator"][1]["joints"]) == (240, 3)
    assert made["servo"][1]["max_step"] == 0.12
    assert made["servo"][1]["gain"] == 0.5
    assert made["servo"][1]["joint_limits"] == "limits"
    options = Experiment.made
    assert (options["scale"], options["babble_seconds"], options["command_period"]) == (
        0.5 if halve else 1.0,
        60.0,
        0.7,
    )
    events = Experiment.one.events
    count = 2 if isinstance(targets, int) else 1
    assert [event[0] for event in events].count("reach") == 2 * count
    asked = [event for event in events if event[0] == "targets"]
    if isinstance(targets, int):
        assert asked[0][1:] == (2, {"reach": 0.35, "least_distance": 33.0, "border": 25.0})
    else:
        assert asked == []
    (ways,) = {tuple(event[3].items()) for event in events if event[0] == "reach"}
    assert dict(ways) == {"settle_frames": 21 + 5, "max_frames": 40 * 21}
    assert run.moved_into_view == 1  # the elbow is beside the image
    assert [one.point for one in run.reaches] == ["tip"] * count + ["elbow"] * count
    assert run.reaches[0].frames == 5
    assert [vars(one).get("trace", vars(one)) is not None for one in run.reaches]
    spans = [list(vars(one).values())[-1] for one in run.reaches]
    assert spans == [(10 + 5 * k, 14 + 5 * k) for k in range(2 * count)]
    assert (run.true, run.mask, run.learned) == ("true J", "mask", "error")
    np.testing.assert_array_equal(run.estimated, 1.0)


def experiment_of(scale=1.0):
    one = ReachingExperiment.__new__(ReachingExperiment)
    one.scale, one._point, one._seed, one.trace = scale, "tip", 3, Trace()
    one.surface_point, one._on_frame, one._traced, one._injector = None, None, True, None
    one.events = []
    one.world = SimpleNamespace(
        project=lambda point: np.array([101.0, 51.0]),
        viewpoint=SimpleNamespace(shows=lambda point, world, size: True),
        shape=(1, 60, 110),
        track_point=lambda pixel: one.events.append(("track", *pixel)) or "surface",
    )
    one.steps = iter([])  # of the joints in the frames to come

    def step(delta):
        one.events.append("step")
        np.testing.assert_array_equal(delta, np.zeros(2))
        return SimpleNamespace(dq=next(one.steps, np.zeros(2)))

    group, frame = SimpleNamespace(names=("a", "b")), SimpleNamespace(gray=np.zeros((60, 110)))
    one.loop = SimpleNamespace(
        define_point=lambda pixel, **options: one.events.append(("define", *pixel, options)),
        step=step, group=group, frame=frame,
    )  # fmt: skip
    return one


@pytest.mark.parametrize(("scale", "place"), [(1.0, (101.0, 51.0)), (0.5, (50.25, 25.25)), (0.25, (24.875, 12.375))])
def test_pixels_are_those_of_the_loop_s_images(scale, place):
    one = experiment_of(scale)
    np.testing.assert_allclose(one.project("tip"), place)
    np.testing.assert_allclose(one.choose(window=9), place)
    # The surface is that of the full image; pixel centers are whole numbers in both.
    assert one.events == ["step"] * 3 + [("track", 101.0, 51.0), ("define", *place, {"window": 9})]
    assert one.surface_point == "surface"
    one.events.clear()
    np.testing.assert_allclose(one.choose(np.array([3, 4])), [3.0, 4.0])
    assert one.events[0] == ("track", 3.5 / scale - 0.5, 4.5 / scale - 0.5)
    assert one._point.tolist() == [3, 4]


@pytest.mark.parametrize(
    ("dq", "frames"),
    [
        ([[0.01, 0.0], [0.0, -0.0011], [0.0009, 0.0], [0.0, 0.0011]], 7),  # three still ones after the last
        ([[0.0009, -0.0009]] * 3, 3),
        ([[0.0, -0.0011]] * 2, 5),  # either way is a motion
        ([None, None], 5),
        ([[0.01, 0.0]] * 99, 45),
    ],
)
def test_a_point_is_chosen_where_the_robot_has_come_to_rest(dq, frames):
    one = experiment_of()
    one.steps = iter([None if step is None else np.array(step) for step in dq])
    one.choose()
    assert one.events.index(("track", 101.0, 51.0)) == frames == one.events.count("step")
    one.events.clear()
    one.choose(np.array([3, 4]))  # as it is seen now
    assert "step" not in one.events
    one.choose("elbow")
    assert "step" in one.events


@pytest.mark.parametrize("scale", [0.0, -1.0, 1.5, 0.4, 2.0])
def test_scales_that_are_no_fraction(scale):
    with pytest.raises(DenseVSError, match="expected one over a whole number"):
        ReachingExperiment(SimpleNamespace(), scale=scale)


def test_targets_are_as_far_in_the_loop_s_images(monkeypatch):
    asked = []

    def targets(world, surface, count, seed, **options):
        asked.append((surface, count, seed, options))
        return np.array([[100.5, 50.5]])

    monkeypatch.setattr(reaching, "reachable_targets", targets)
    one = experiment_of(0.5)
    one.surface_point = "surface"
    np.testing.assert_allclose(one.targets(7, border=30.0), [[50.0, 25.0]])
    assert asked == [("surface", 7, 3, {"least_distance": 40.0, "border": 60.0})]


def test_a_reach_is_measured_at_the_true_point():
    one = experiment_of()
    one.surface_point = "surface"
    one.loop.reach = lambda target, **options: SimpleNamespace(target=tuple(target), options=options)
    one.jacobian_error = lambda: "error"
    measured = one.reach((98.0, 55.0), max_frames=9)
    assert measured.true_error_px == pytest.approx(5.0)
    assert (measured.jacobian, measured.reach.options) == ("error", {"max_frames": 9})


def test_the_truth_of_a_scaled_image_is_that_of_whole_squares():
    one = experiment_of(0.5)
    J = np.arange(5 * 7 * 2 * 1, dtype=np.float32).reshape(5, 7, 2, 1)
    mask = np.ones((5, 7), bool)
    mask[0, 0] = mask[3, 5] = False
    one.world.true_jacobian, one.world.robot_mask = lambda: J, lambda: mask
    mean, own = one.truth()
    assert mean.shape == (2, 3, 2, 1)
    np.testing.assert_allclose(mean[1, 2], 0.5 * J[2:4, 4:6].mean(axis=(0, 1)))
    np.testing.assert_array_equal(own, [[False, True, True], [True, True, False]])
    one.scale = 1.0
    assert one.truth()[0] is J


def test_every_frame_is_noted_from_the_first():
    one = experiment_of()
    J = np.zeros((60, 120, 2, 3))
    J[51, 101] = 7.0
    J[20, 10] = 3.0
    one.world.true_jacobian, one.world.robot_mask = lambda: J, lambda: None
    told = []
    one._on_frame = told.append
    loop = SimpleNamespace(frame=SimpleNamespace(time=1.5), tracker=None, target=None, point=np.array([9.0, 8.0]),
                           estimator=SimpleNamespace(at=lambda place: [place.copy()]))  # fmt: skip
    one._after_frame(loop)
    assert told == [one]
    trace = one.trace
    assert trace.times == [1.5]
    assert np.isnan([trace.points[0], trace.true_points[0], trace.targets[0]]).all()
    np.testing.assert_array_equal(trace.true[0], np.full((2, 3), 7.0))  # where the point to come is
    np.testing.assert_array_equal(trace.estimated[0], [101.0, 51.0])
    one._point = (10.0, 20.0)
    one._after_frame(loop)
    np.testing.assert_array_equal(trace.true[1], np.full((2, 3), 3.0))
    one.surface_point, loop.tracker, loop.target = "surface", object(), np.array([1.0, 2.0])
    one._after_frame(loop)
    np.testing.assert_array_equal(trace.points[2], [9.0, 8.0])
    np.testing.assert_array_equal(trace.true_points[2], [101.0, 51.0])
    np.testing.assert_array_equal(trace.targets[2], [1.0, 2.0])
    np.testing.assert_array_equal(trace.true[2], np.full((2, 3), 7.0))
    one._traced = False
    one._after_frame(loop)
    assert len(trace.times) == 3


def test_the_published_tasks():
    """Joints and points of Fig. 7 to 9; what counts as reached is ours: 2 to 5 px, beside 12 px and more of way."""
    parser = ArgumentParser()
    tasks = {}
    for experiment in (reach_task, rake, vacuum):
        parser = ArgumentParser()
        experiment.add_arguments(parser)
        arguments = parser.parse_args([])
        tasks[arguments.task.figure] = arguments.task
        assert (arguments.targets, arguments.babble, arguments.period) == (["2"], 20.0, 0.7)
        assert (arguments.gain, arguments.commands, arguments.compliance) == (0.5, 20, False)
        assert (arguments.prediction, arguments.distractor, arguments.halve) == (None, "none", False)
    left = ("left-shoulder-p", "left-shoulder-r", "left-shoulder-y", "left-elbow-p")
    assert tasks["Fig. 7"].joints == left
    assert tasks["Fig. 7"].points == ("left-wrist", "left-elbow")
    assert tasks["Fig. 8"].joints == ("left-shoulder-p", "left-elbow-p", "right-elbow-p")
    assert tasks["Fig. 9"].joints == ("left-shoulder-p", "left-elbow-p", "left-wrist-p")
    limits = {figure: (one.close_px, one.soft_px, one.least_distance) for figure, one in tasks.items()}
    assert limits == {"Fig. 7": (2.0, 5.0, 25.0), "Fig. 8": (3.0, 5.0, 20.0), "Fig. 9": (3.0, 5.0, 12.0)}
    assert PAPER_GAIN == 0.034


@pytest.mark.parametrize(
    "wrong",
    [{"babble": 0.0}, {"period": 0.0}, {"commands": 0}, {"babble": float("nan")}, {"babble": 2e5}, {"commands": 10**9}],
)
def test_times_and_commands_that_cannot_be(wrong):
    parser = ArgumentParser()
    vacuum.add_arguments(parser)
    arguments = Namespace(**{**vars(parser.parse_args([])), "seeds": [0], **wrong})
    with pytest.raises(DenseVSError, match=f"--{next(iter(wrong))} is .*expected"):
        vacuum.run(arguments)
