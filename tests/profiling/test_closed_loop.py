"""What is counted and timed of many robots, with batches, filters and clocks made by hand."""

import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import closed_loop

from dense_vs.errors import DenseVSError
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
            restarts=np.array([0, 1]),
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


class Clock:
    """A call takes as long as it is told, the last of the durations from then on."""

    def __init__(self, *durations):
        self.now, self.calls, self.durations = 100.0, 0, list(durations)

    def __call__(self):
        self.now += self.durations[min(self.calls, len(self.durations) - 1)]
        self.calls += 1

    def perf_counter(self):
        return self.now


@pytest.mark.parametrize(
    ("durations", "calls", "seconds"),
    [
        ((9.0, 0.25), 4, 0.25),  # the first warms up; three rounds of one call
        ((9.0, 0.25, 0.25, 8.0), 4, 0.25),  # the median round
        ((9.0, 0.125), 5, 0.125),  # so many rounds as make half a second
        ((9.0, 0.0625), 9, 0.0625),  # not below a twentieth of a second: rounds stay of one call
        ((9.0, 2**-10), 2 + 6 * 102, 2**-10),  # rounds of a tenth of a second
    ],
)
def test_a_call_takes_the_median_of_rounds_that_are_long_enough(monkeypatch, durations, calls, seconds):
    clock, waits = Clock(*durations), []
    monkeypatch.setattr(closed_loop, "time", clock)
    monkeypatch.setattr(closed_loop.wp, "synchronize_device", waits.append)
    assert closed_loop.seconds_per_call(clock, "device") == pytest.approx(seconds)
    assert clock.calls == calls
    assert set(waits) == {"device"}


def test_a_loop_on_a_cpu_is_no_graph():
    assert closed_loop.captured(len, SimpleNamespace(is_cpu=True)) is len


def test_every_stage_is_timed_at_the_same_moment_of_the_filter(monkeypatch):
    """Stages take 1 to 4 ms; what lies between an image and the command leaves physics out."""
    ran, moments = [], []

    def stage(name):
        def run():
            moments.append(batch.filter.now)
            batch.filter.now += 1
            ran.append(name)

        return run

    def seconds_per_call(call, device, least_seconds=0.5):
        ran.clear()
        call()
        return 1e-3 * len(ran)

    names = ("physics", "flow", "update", "tracking", "command")
    batch = SimpleNamespace(
        device="cpu", world=SimpleNamespace(shape=(8, 24, 32)), filter=SimpleNamespace(now=5),
        stages={name: stage(name) for name in names}, frame=lambda: ran.extend(["whole"] * 4),
    )  # fmt: skip
    monkeypatch.setattr(closed_loop, "captured", lambda call, device: call)
    monkeypatch.setattr(closed_loop, "seconds_per_call", seconds_per_call)
    values = {metric.name: metric.value for metric in closed_loop.speed_metrics(batch, "here")}
    assert values == pytest.approx(
        {"closed loop, here": 8 / 4e-3, **{f"{name}, here": 1.0 for name in names}, "image to command, here": 4.0}
    )
    assert ran == ["flow", "update", "tracking", "command"]
    assert moments[:6] == [5] * 6
    assert batch.filter.now == 5


def test_processes_share_the_worlds(monkeypatch):
    """The rates of all are added, and compared with the first number of processes."""
    rates = {1: [100.0], 2: [90.0, 70.0], 4: [50.0] * 4}

    def run_ranks(rate, count, given):
        case, device, barrier = given
        assert (rate, case, device) == (closed_loop.shared_rate, ("case", 64), "auto")
        assert barrier.parties == count
        return rates[count]

    monkeypatch.setattr(closed_loop, "run_ranks", run_ranks)
    monkeypatch.setattr(closed_loop, "make_case", lambda arguments, worlds: ("case", worlds))
    metrics = closed_loop.shared_metrics(Namespace(gpus="1,2,4", worlds=64, device="auto"))
    assert [metric.value for metric in metrics] == pytest.approx([100, 1, 160, 1.6, 200, 2])
    assert metrics[2].name == "closed loop, 64 worlds, 2 processes, auto"
    with pytest.raises(DenseVSError, match="--gpus is '1,two'"):
        closed_loop.shared_metrics(Namespace(gpus="1,two", worlds=64, device="auto"))


@pytest.mark.parametrize(("per_frame", "frames"), [(0.25, 12), (9.0, 3)])
def test_a_process_s_rate_counts_the_frames_of_all_its_worlds_once_all_are_ready(monkeypatch, per_frame, frames):
    """Three seconds of frames, three at least, of five worlds each; they take 2.5 s here."""
    events, now = [], iter([100.0, 102.5])
    batch = SimpleNamespace(frame="a frame", device="cpu", world=SimpleNamespace(shape=(5, 9)), run=events.append)
    case = SimpleNamespace(batch=lambda rank, device: events.append(device) or batch)
    monkeypatch.setattr(closed_loop, "seconds_per_call", lambda call, device: per_frame)
    monkeypatch.setattr(closed_loop.time, "perf_counter", lambda: events.append("clock") or next(now))
    rank = SimpleNamespace(device=lambda device: "cpu")
    barrier = SimpleNamespace(wait=lambda seconds: events.append("ready"))
    assert closed_loop.shared_rate(rank, case, "cpu", barrier) == pytest.approx(5 * frames / 2.5)
    assert events == ["cpu", "ready", "clock", frames, "clock"]


@pytest.mark.parametrize(("randomize", "differs"), [(False, False), (True, True)])
def test_a_case_is_what_the_arguments_say(randomize, differs):
    told = Namespace(
        robot="planar", targets=3, seed=7, flow="dis", order=2, randomize=randomize, babble=4.0, worlds=64, device="cpu"
    )
    case = closed_loop.make_case(told, 5)
    assert (case.robot, case.worlds, case.targets, case.seed, case.flow, case.order) == ("planar", 5, 3, 7, "dis", 2)
    assert case.episode.babble_seconds == 4.0
    assert (case.randomization != closed_loop.DomainRandomization()) == differs


def test_the_deviation_is_that_of_a_filter_given_the_same(monkeypatch):
    """The largest entry of both is -8; they are 2 apart at another."""
    fed = []

    class Filter:
        def __init__(self, options, device, threads):
            assert (options, threads) == ("options", 3)

        def restore(self, stored):
            fed.append(stored)

        def stage(self, flow):
            fed.append(("flow", float(flow.numpy()[0, 0])))

        def advance(self, dq):
            fed.append(("dq", dq))

        def present(self):
            return SimpleNamespace(numpy=lambda: np.array([3.0, -8.0, 1.5]))

    class Given:
        frames = 0

        def __init__(self, value):
            self.numpy = lambda: value(Given.frames)

    def frame():
        Given.frames += 1

    batch = SimpleNamespace(
        world=SimpleNamespace(threads=3), frame=frame,
        flow=SimpleNamespace(flow=Given(lambda k: np.full((1, 2), k, np.float32))),
        filter=SimpleNamespace(options="options", stored=lambda: "stored", dq=Given(lambda k: 10 * k)),
        jacobian=SimpleNamespace(numpy=lambda: np.array([5.0, -8.0, 1.0])),
    )  # fmt: skip
    monkeypatch.setattr(closed_loop, "JacobianFilter", Filter)
    assert closed_loop.update_deviation(batch, frames=3) == pytest.approx(2 / 8)
    assert fed == ["stored", *(one for k in (1, 2, 3) for one in (("flow", k), ("dq", 10 * k)))]


@pytest.mark.parametrize(("good", "code"), [(True, 0), (False, 1)])
def test_the_gate_decides_where_there_is_one(monkeypatch, tmp_path, capsys, good, code):
    gate = tmp_path / "before.json"
    gate.write_text('{"metrics": [{"name": "figure", "value": 2.0}]}')
    metrics = [closed_loop.Metric("figure", 3.0, "ms", "lower")]
    asked = []

    def hold_to(ours, here, before, name):
        asked.append((ours, before["metrics"][0]["value"], name))
        return good, ["what the gate says"]

    monkeypatch.setattr(closed_loop, "report", lambda metrics, arguments: 0 if arguments.gate is None else 9)
    monkeypatch.setattr(closed_loop, "provenance", lambda arguments, leave_out: {})
    monkeypatch.setattr(closed_loop, "hold_to", hold_to)
    assert closed_loop.finish(metrics, Namespace(gate=gate)) == code
    assert asked == [(metrics, 2.0, "before.json")]
    told = capsys.readouterr()
    assert "what the gate says" in (told.out if good else told.err)
    assert "1.50" in told.out  # times what it was
    assert closed_loop.finish(metrics, Namespace(gate=None)) == 0
    assert len(asked) == 1
