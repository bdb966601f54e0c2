"""What a recording's joints say before its first image, and which frames get which joints, on a log made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs import DenseJacobian, JointLog
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.excitation import excitation
from dense_vs.pipeline import recorded
from dense_vs.pipeline.recorded import RecordedEstimate, _recorded_defaults, recorded_excitation
from dense_vs.recording.survey import joint_motions

FPS = 25.0
TIMES = np.arange(0.0, 6.005, 0.01)


def log(joints=3):
    rng = np.random.default_rng(0)
    columns = [np.sin((0.7 + 0.4 * k) * TIMES + k) + 1e-3 * rng.normal(size=TIMES.size) for k in range(joints)]
    columns[1] = 0.2 + 1e-4 * rng.normal(size=TIMES.size)  # at rest
    return JointLog(tuple(f"j{k}" for k in range(joints)), TIMES, np.stack(columns, axis=1))


class Recorded:
    """An episode of plain images."""

    def __init__(self, joints=3, size=(48, 64), images=()):
        self.log, self.size, self.stamped = log(joints), size, images

    def images(self):
        return SimpleNamespace(height=self.size[0], width=self.size[1], frame_count=7, fps=FPS)

    def check_overlap(self, images):
        assert images.fps == FPS

    def __iter__(self):
        return iter([SimpleNamespace(image=image, time=time) for image, time in self.stamped])


@pytest.fixture
def made(monkeypatch):
    """A pipeline that keeps what it was made with, and what it is given."""
    kept = {}

    class Pipeline:
        def __init__(self, estimator, flow, **options):
            kept.update(estimator=estimator, flow=flow, events=[], **options)
            self.camera_sway = "sway"

        def restart(self):
            kept["events"].append("restart")

        def process(self, image, time, joints):
            kept["events"].append((int(image[0, 0, 0]), time, joints))
            return SimpleNamespace(time=time)

        def labels(self):
            return "labels"

    monkeypatch.setattr(recorded, "FramePipeline", Pipeline)
    return kept


def test_joints_are_judged_at_the_rate_of_the_images():
    episode = Recorded()
    found = recorded_excitation(episode, FPS)
    at = np.linspace(0.0, TIMES[-1], int(TIMES[-1] * FPS) + 1)
    expected = excitation(
        np.stack([np.interp(at, TIMES, q) for q in episode.log.positions.T], axis=1), episode.log.names
    )
    np.testing.assert_allclose(found.scale, expected.scale)
    assert found.learned.tolist() == [True, False, True]
    assert found.names == ("j0", "j1", "j2")
    slow = recorded_excitation(episode, 0.01)  # three positions at least
    np.testing.assert_allclose(slow.range, np.ptp(episode.log.at(np.array([0.0, TIMES[-1] / 2, TIMES[-1]])), axis=0))


@pytest.mark.parametrize("joints", [3, 7])
def test_an_estimator_for_a_recording(made, joints):
    """Up to six joints: steps of the standard babbling over as wide a range; more: the log's own, and real noise."""
    episode = Recorded(joints)
    one = RecordedEstimate(episode, device="cpu", threads=1)
    options, seen = one.estimator.options, one.excitation
    assert (options.height, options.width, options.joints, options.on_bad_flow) == (48, 64, joints, "skip")
    typical = seen.scale if joints == 7 else np.where(seen.learned, 0.1 * seen.spread, 0.0)
    np.testing.assert_allclose(options.joint_scale, typical)
    assert options.order == (1 if joints == 7 else 2)
    assert options.measurement_noise == (0.3 if joints == 7 else 0.01)
    assert options.rest == (0.2 if joints == 7 else 0.0)
    noise = np.array([joint.noise for joint in joint_motions(episode.log)])
    np.testing.assert_allclose(made["still"][seen.learned], 5 * noise[seen.learned])
    assert (made["still"][~seen.learned] == np.finfo(float).max).all()
    assert (made["scale"], made["baseline"], made["body"], made["prior"], made["sway"]) == (1.0, 0.0, None, None, False)
    assert (one.frame_count, one.fps, one.labeled, one.last_frame) == (7, FPS, False, None)
    assert (one.images, one.repeated, one.gaps) == (0, 0, 0)
    assert one.usual_step.tolist() == [0.0] * joints
    assert one.camera_sway == "sway"


@pytest.mark.parametrize(("width", "step"), [(64, 1), (479, 1), (481, 2), (640, 2), (960, 3)])
def test_labels_are_found_in_images_about_320_wide(made, width, step):
    one = RecordedEstimate(Recorded(size=(48, width)), device="cpu", threads=1, label=True)
    assert made["body_step"] == step
    spread = one.excitation.spread
    np.testing.assert_allclose(made["body"]._joint_scale, np.where(one.excitation.learned, 0.1 * spread, 0.0))
    assert one.labeled
    assert one.labels() == "labels"


def test_what_is_given_stays():
    seen = excitation(log().positions, ("a", "b", "c"))
    assert _recorded_defaults(3, seen, {"covariance": "full"}) == {"on_bad_flow": "skip", "covariance": "full"}
    given = _recorded_defaults(7, seen, {"rest": 0.5, "joint_scale": None, "on_bad_flow": "error"})
    assert (given["rest"], given["joint_scale"], given["on_bad_flow"]) == (0.5, None, "error")
    assert given["measurement_noise"] == 0.3


def test_a_start_of_another_kind_is_refused(made):
    def start(**changes):
        return DenseJacobian(**{"height": 48, "width": 64, "joints": 3, "device": "cpu", "threads": 1, **changes})

    assert RecordedEstimate(Recorded(), start=start(), device="cpu").estimator.options.joints == 3
    for changes in ({"height": 49}, {"width": 63}, {"joints": 4}, {"worlds": 2}):
        with pytest.raises(DenseVSError, match=r"start is of .* expected 64 x 48 px and 3 joints"):
            RecordedEstimate(Recorded(), start=start(**changes), device="cpu")
    half = RecordedEstimate(Recorded(), start=start(height=24, width=32), device="cpu", scale=0.5)
    assert half.estimator.options.width == 32
    for wrong in ({"scale": 0.0}, {"scale": 1.01}, {"smoothing": -0.1}):
        with pytest.raises(DenseVSError, match=next(iter(wrong))):
            RecordedEstimate(Recorded(), device="cpu", **wrong)


@pytest.mark.parametrize("evened", [False, True])
def test_each_frame_gets_the_joints_of_its_time(monkeypatch, made, evened):
    """Those as logged, or smoothed where stamps are the recorder's; a time outside the log is its nearest end."""
    found = [
        SimpleNamespace(image=np.full((48, 64, 3), k, np.uint8), time=time, after_gap=gap, evened=evened)
        for k, (time, gap) in enumerate(((-0.01, False), (1.0, False), (2.005, True), (6.1, False)))
    ]
    distinct = SimpleNamespace(images=9, repeated=4, gaps=[1.0, 2.0])
    asked = []
    monkeypatch.setattr(recorded, "DistinctImages", lambda stamped, fps: asked.append(fps) or distinct)
    monkeypatch.setattr(recorded, "prefetch", lambda source: iter(found if source is distinct else ()))
    one = RecordedEstimate(Recorded(), device="cpu", threads=1, smoothing=0.2)
    frames = [frame.time for frame, estimator in one if estimator is one.estimator]
    assert frames == [-0.01, 1.0, 2.005, 6.1]
    assert one.last_frame.time == 6.1
    used = one.episode.log.smoothed(0.2) if evened else one.episode.log
    events = made["events"]
    assert events[2] == "restart"
    for event, time in zip([events[0], events[1], events[3], events[4]], (0.0, 1.0, 2.005, TIMES[-1]), strict=True):
        np.testing.assert_allclose(event[2], used.at(np.array([time]))[0])
    assert (one.images, one.repeated, one.gaps) == (9, 4, 2)
    assert asked == [FPS, FPS]


def test_a_judge_comes_before_the_figures(made):
    judged = []
    one = RecordedEstimate(Recorded(), device="cpu", threads=1, before_update=lambda *given: judged.append(given))
    observed = []
    one.explained = SimpleNamespace(observe=lambda *given: observed.append((len(judged), *given)))
    for dq in ([0.1, 0.0, -0.2], [0.3, 0.0, 0.0]):
        one._judge(1.5, "flow", np.array(dq))
    assert [given[0] for given in observed] == [1, 2]
    assert observed[0][1:3] == (1.5, "flow")
    assert judged[0][0] == 1.5
    np.testing.assert_allclose(one.usual_step, [np.sqrt(0.05), 0.0, np.sqrt(0.02)])
    assert made["before_update"] == one._judge
