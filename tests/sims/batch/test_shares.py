"""What a process does with its share of a batch, and what all shares come to, on worlds made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.point_servo import ReachEnd
from dense_vs.sims.batch import case as case_module
from dense_vs.sims.batch import parts, run
from dense_vs.sims.batch.case import RANDOMIZED, BatchCase
from dense_vs.sims.batch.episode import BatchResults, EpisodeOptions
from dense_vs.sims.batch.rank import Rank
from dense_vs.sims.engine.randomization import DomainRandomization

LOST, THERE, MISSED, PENDING = ReachEnd.LOST, ReachEnd.REACHED, ReachEnd.MISSED, ReachEnd.PENDING


def results():
    return BatchResults(
        outcome=np.array([[THERE, LOST], [THERE, MISSED], [THERE, PENDING]], dtype=object),
        frames=np.array([[10, 20], [30, 150], [5, 0]]),
        error_px=np.array([[0.1, 9.0], [0.2, 4.0], [0.3, np.nan]]),
        true_error_px=np.array([[1.0, 21.0], [2.0, 4.0], [3.0, np.nan]]),
        restarts=np.array([0, 2, 0]),
    )


def test_a_summary_counts_every_end_by_its_name():
    assert results().summary() == {
        "worlds": 3,
        "reaches": 6,
        "share pending": pytest.approx(1 / 6),
        "share reached": pytest.approx(1 / 2),
        "share missed": pytest.approx(1 / 6),
        "share lost": pytest.approx(1 / 6),
        "true error, median [px]": 3.0,
        "true error, 95th percentile [px]": pytest.approx(17.6),
        "worlds that began anew": 1,
    }
    nothing = np.full((1, 1), np.nan)
    none = BatchResults(np.array([[PENDING]], dtype=object), np.zeros((1, 1)), nothing, nothing, np.zeros(1))
    assert np.isnan(none.summary()["true error, median [px]"])
    assert np.isnan(none.summary()["true error, 95th percentile [px]"])


def test_of_each_world_the_latest_part_counts(tmp_path):
    """Worlds 0 and 1 after 10 frames, 1 to 3 after 20, 2 alone after 20 once more and 3 after 5."""
    case = BatchCase(worlds=5)
    for first, frames, values in ((0, 10, [1, 2]), (1, 20, [3, 4, 5]), (2, 20, [6]), (3, 5, [7])):
        arrays = {parts.FRAMES: np.full(len(values), frames), "value": np.array(values)}
        parts.write_part(tmp_path, "kind", case, first, arrays)
    for worlds, expected in (([0, 1, 2, 3], [1, 3, 4, 5]), ([3, 0], [5, 1]), ([1], [3])):
        found = parts.read_worlds(tmp_path, "kind", case, worlds)
        assert found["value"].tolist() == expected
        assert found[parts.FRAMES].tolist() == [10 if world == 0 else 20 for world in worlds]
    assert parts.read_worlds(tmp_path, "kind", case, [3, 4]) is None  # one is in no file
    assert parts.read_worlds(tmp_path, "other", case, [0]) is None
    with pytest.raises(DenseVSError, match="with worlds 5 in place of 6; expected one of the same case"):
        parts.read_worlds(tmp_path, "kind", BatchCase(worlds=6), [0])


def test_parts_that_do_not_go_together(tmp_path):
    case = BatchCase(worlds=4)

    def write(first, **arrays):
        parts.write_part(tmp_path, "kind", case, first, {parts.FRAMES: np.full(2, 10), **arrays})

    write(0, value=np.zeros((2, 3)))
    write(2, value=np.zeros((2, 4)))
    assert parts.read_worlds(tmp_path, "kind", case, [0, 1]) is not None
    with pytest.raises(DenseVSError, match=r"holds value of shape \(2, 4\), unlike the files beside it"):
        parts.read_worlds(tmp_path, "kind", case, [0, 2])
    write(2, value=np.zeros((3, 3)))
    with pytest.raises(DenseVSError, match=r"holds value of shape \(3, 3\), unlike"):
        parts.read_worlds(tmp_path, "kind", case, [2, 3])
    path = tmp_path / "kind" / "0000002-0000004.npz"
    path.rename(path.with_name("0000001-0000004.npz"))
    with pytest.raises(DenseVSError, match=r"of shape \(2,\); expected \(3,\)"):
        parts.read_worlds(tmp_path, "kind", case, [2])


@pytest.mark.parametrize("order", [1, 2])
def test_a_process_makes_its_own_worlds(monkeypatch, order):
    made = []

    def servo(world, **options):
        made.append(options)
        return "batch"

    monkeypatch.setattr(case_module, "SimWorld", lambda robot, **options: made.append({"robot": robot, **options}))
    monkeypatch.setattr(case_module, "BatchServo", servo)
    case = BatchCase(worlds=6, order=order, seed=4, targets=3, height=60, width=80)
    assert case.batch(Rank(1, 2), "cpu", threads=5) == "batch"
    world, options = made
    assert (world["worlds"], world["first_world"]) == (3, 3)
    assert (world["robot"], world["height"], world["width"], world["seed"], world["threads"]) == ("arm", 60, 80, 4, 5)
    assert world["physics_on_device"] is True
    assert (world["device"], world["randomization"]) == ("cpu", case.randomization)
    expected = {"point": "tip", "targets": 3, "seed": 4, "flow": case.flow, "estimator": {"order": order}}
    assert options == {**expected, "episode": case.episode}


def test_results_come_back_from_their_arrays():
    arrays = parts.result_arrays(results(), 77)
    assert arrays[parts.FRAMES].tolist() == [77] * 3
    back = parts.results_of(arrays)
    assert back.outcome.tolist() == results().outcome.tolist()
    for name in ("frames", "error_px", "true_error_px", "restarts"):
        np.testing.assert_array_equal(getattr(back, name), getattr(results(), name))
    for wrong in (4, -1):
        outcome = arrays["outcome"].copy()
        outcome[0, 0] = wrong
        with pytest.raises(DenseVSError, match=f"outcome holds {min(wrong, 0)} to {max(wrong, 3)}; expected 0 to 3"):
            parts.results_of({**arrays, "outcome": outcome})


@pytest.mark.parametrize("options", [{"babble_seconds": 0}, {"tolerance": 0}, {"settle_frames": 0}, {"max_frames": 0}])
def test_courses_that_say_nothing(options):
    with pytest.raises(DenseVSError, match=next(iter(options))):
        EpisodeOptions(**options)
    assert EpisodeOptions(settle_frames=1, max_frames=1)


def test_a_course_is_that_of_the_loop_unless_told():
    """As one robot babbles and reaches: ten seconds, a pixel for five frames, five seconds of tries."""
    course = EpisodeOptions()
    assert (course.babble_seconds, course.tolerance, course.settle_frames, course.max_frames) == (10.0, 1.0, 5, 150)
    case = BatchCase()
    assert (case.worlds, case.targets, case.order, case.height, case.width) == (1024, 1, 1, 240, 320)
    assert (case.robot, case.point, case.seed, case.flow) == ("arm", "tip", 0, "farneback-guided-warp")
    assert case.randomization == DomainRandomization()
    assert vars(RANDOMIZED) == {
        "link_size": 0.1,
        "texture_sets": 4,
        "light": 0.3,
        "light_angle": 0.3,
        "camera_position": 0.03,
        "camera_angle": 0.03,
    }


class Batch:
    """Worlds that rest after a number of frames."""

    def __init__(self, rest, longest=1000):
        self.frames, self.rest, self.longest_run, self.runs = 0, rest, longest, []

    @property
    def resting(self):
        return np.array([self.frames >= self.rest, self.frames >= 10])

    def run(self, frames):
        self.runs.append(frames)
        self.frames += frames

    def results(self):
        return results()


@pytest.fixture
def shared(monkeypatch):
    """Runs a share of worlds; gives the batch, what was written and how many frames it took."""

    def go(rest=45, checkpoint=0, stored=None, done=None, rank=None, longest=1000):
        batch, written = Batch(rest, longest), []

        def restore(one, kept):
            one.frames = kept

        case = SimpleNamespace(worlds=6, batch=lambda *_: batch)
        kept = {run.RESULTS: done, run.CHECKPOINT: stored}
        monkeypatch.setattr(run, "read_worlds", lambda folder, kind, case, worlds: kept[kind])
        monkeypatch.setattr(
            run,
            "write_part",
            lambda folder, kind, case, first, arrays: written.append((kind, first, batch.frames, arrays)),
        )
        monkeypatch.setattr(run, "restore_worlds", restore)
        monkeypatch.setattr(run, "stored_worlds", lambda batch: "state")
        monkeypatch.setattr(run.wp, "set_device", lambda device: written.append("device"))
        frames = run.run_share(rank or Rank(), case, None, "cpu", None, checkpoint)
        return batch, written, frames

    return go


def test_a_share_runs_until_all_its_worlds_rest(shared):
    batch, ((kind, first, frames, arrays),), count = shared()
    assert batch.runs == [30, 30]
    assert (kind, first, frames, count) == ("results", 0, 60, 60)
    assert arrays[parts.FRAMES].tolist() == [60] * 3
    assert shared(rest=10**9, longest=90)[0].runs == [30, 30, 30]
    assert shared(rest=30)[0].runs == [30]


def test_a_share_that_is_done_is_not_run_again(shared):
    batch, written, count = shared(done={"some": "arrays"})
    assert (batch.runs, written, count) == ([], [], 0)


def test_checkpoints_come_at_their_frames(shared):
    batch, written, _ = shared(rest=70, checkpoint=20)
    assert batch.runs == [20, 10, 10, 20, 20]
    kept = [(kind, frames, arrays) for kind, _, frames, arrays in written if kind == "checkpoint"]
    assert kept == [("checkpoint", frames, "state") for frames in (20, 40, 60, 80)]
    assert written[-1][0] == "results"


def test_a_share_goes_on_where_it_was_stored(shared):
    batch, _, count = shared(rest=90, stored=50)
    assert batch.runs == [10, 30]
    assert count == 40


def test_the_second_process_computes_the_second_half(shared):
    _, written, _ = shared(rank=Rank(1, 2))
    assert written[0] == "device"
    assert written[-1][:2] == ("results", 3)


def test_one_process_or_several(monkeypatch, tmp_path):
    ran = []
    monkeypatch.setattr(run, "run_share", lambda rank, *options: ran.append((rank, *options)))
    monkeypatch.setattr(run, "run_ranks", lambda work, count, options: ran.append((count, *options)))
    monkeypatch.setattr(run, "gather", lambda case, folder, seconds: ("all", seconds))
    case = BatchCase(worlds=4)
    assert run.run_case(case, tmp_path, device="cpu", checkpoint_frames=7) == ("all", 0.0)
    assert ran.pop() == (Rank(), case, tmp_path, "cpu", None, 7)
    run.run_case(case, tmp_path, processes=2)
    assert ran.pop() == (2, case, tmp_path, "auto", None, 0)
    for wrong in ({"checkpoint_frames": -1}, {"processes": 5}):
        with pytest.raises(DenseVSError):
            run.run_case(case, tmp_path, **wrong)


def test_gathering_waits_for_what_others_compute(monkeypatch, tmp_path):
    found = [None, None, {"some": "arrays"}]
    slept = []
    clock = SimpleNamespace(monotonic=lambda: float(sum(slept)), sleep=slept.append)
    monkeypatch.setattr(run, "time", clock)
    monkeypatch.setattr(run, "read_worlds", lambda *_: found.pop(0) if found else None)
    monkeypatch.setattr(run, "results_of", lambda arrays: "results")
    assert run.gather(BatchCase(worlds=4), tmp_path, seconds=1.0) == "results"
    assert slept == [0.2, 0.2]
    with pytest.raises(DenseVSError, match="lacks results of some of the 4 worlds after 0 s"):
        run.gather(BatchCase(worlds=4), tmp_path, seconds=0.0)
    assert len(slept) == 2


@pytest.mark.parametrize("options", [{"worlds": 0}, {"targets": 0}, {"order": 0}, {"order": 3}, {"seed": -1}])
def test_cases_that_are_none(options):
    with pytest.raises(DenseVSError, match=next(iter(options))):
        BatchCase(**options)
    assert BatchCase(order=2, worlds=1).key() != BatchCase(order=1, worlds=1).key()
