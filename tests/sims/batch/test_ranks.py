"""A batch in one process and in several: the same worlds to the last bit, and a run that others go on with."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.cli.main import main
from dense_vs.sims import SimWorld
from dense_vs.sims.batch.batch_state import FRAMES, restore_worlds, stored_worlds
from dense_vs.sims.batch.case import RANDOMIZED, BatchCase
from dense_vs.sims.batch.episode import EpisodeOptions
from dense_vs.sims.batch.parts import CHECKPOINT, RESULTS, read_worlds, result_arrays, write_part
from dense_vs.sims.batch.rank import Rank, _answer, run_ranks
from dense_vs.sims.batch.run import gather, run_case, run_share
from tests.support import rank_work

CASE = BatchCase(
    robot="planar",
    worlds=3,
    seed=4,
    height=90,
    width=120,
    randomization=RANDOMIZED,
    episode=EpisodeOptions(babble_seconds=0.5, tolerance=4.0, settle_frames=2, max_frames=20),
)
HERE = ("cpu", 1, 0)  # device, threads, frames between checkpoints


def batch(rank=None, case=CASE):
    return case.batch(rank or Rank(), "cpu", 1)


def assert_same(ours, theirs):
    assert ours.keys() == theirs.keys()
    for name, array in ours.items():
        np.testing.assert_array_equal(array, theirs[name], err_msg=name)


@pytest.fixture(scope="module")
def alone():
    """States of all worlds in one process after 4, 8 and 12 frames."""
    whole, states = batch(), {}
    for frames in (4, 8, 12):
        whole.run(4)
        states[frames] = stored_worlds(whole)
    return states


@pytest.mark.parametrize("count", [2, 3])
def test_worlds_are_the_same_to_the_last_bit_whoever_computes_them(alone, count):
    for number in range(count):
        rank = Rank(number, count)
        share = rank.share(CASE.worlds)
        part = batch(rank)
        part.run(12)
        assert_same(stored_worlds(part), {name: array[share.start : share.stop] for name, array in alone[12].items()})


def test_worlds_of_a_run_differ(alone):
    q = alone[12]["joint_positions"]
    assert np.abs(q[0] - q[1]).max() > 1e-3
    assert np.abs(alone[12]["filter.state"]).max() > 1


@pytest.mark.parametrize(("before", "after"), [(2, 1), (1, 3)])
def test_any_number_of_processes_goes_on(alone, tmp_path, before, after):
    for number in range(before):
        rank = Rank(number, before)
        share = rank.share(CASE.worlds)
        first = batch(rank)
        first.run(8)
        write_part(tmp_path, CHECKPOINT, CASE, share.start, stored_worlds(first))
    for number in range(after):
        rank = Rank(number, after)
        share = rank.share(CASE.worlds)
        later = batch(rank)
        restore_worlds(later, read_worlds(tmp_path, CHECKPOINT, CASE, share))
        assert later.frames == 8
        later.run(4)
        assert_same(stored_worlds(later), {name: array[share.start : share.stop] for name, array in alone[12].items()})


def test_of_each_world_the_latest_part_counts(alone, tmp_path):
    write_part(tmp_path, CHECKPOINT, CASE, 0, alone[4])
    write_part(tmp_path, CHECKPOINT, CASE, 1, {name: array[1:2] for name, array in alone[8].items()})
    found = read_worlds(tmp_path, CHECKPOINT, CASE, range(3))
    np.testing.assert_array_equal(found[FRAMES], [4, 8, 4])
    np.testing.assert_array_equal(found["joint_positions"][1], alone[8]["joint_positions"][1])
    np.testing.assert_array_equal(found["joint_positions"][2], alone[4]["joint_positions"][2])
    later = batch()
    restore_worlds(later, found)
    assert later.frames == 4
    later.run(4)
    q = stored_worlds(later)["joint_positions"]
    np.testing.assert_array_equal(q[0], alone[8]["joint_positions"][0])
    np.testing.assert_array_equal(q[1], alone[12]["joint_positions"][1])


def test_a_run_goes_on_from_before_its_first_frame(alone):
    stored = stored_worlds(batch())
    assert (stored[FRAMES] == 0).all()
    later = batch()
    later.run(3)
    restore_worlds(later, stored)
    assert later.frames == 0
    assert_same(stored_worlds(later), stored)
    later.run(4)
    assert_same(stored_worlds(later), alone[4])


@pytest.mark.slow
def test_processes_come_to_the_results_of_one(tmp_path):
    one = run_case(CASE, tmp_path / "one", device="cpu", threads=1)
    two = run_case(CASE, tmp_path / "two", processes=2, device="cpu", threads=1, checkpoint_frames=10)
    for name, array in vars(one).items():
        np.testing.assert_array_equal(array, vars(two)[name], err_msg=name)
    assert one.summary() == pytest.approx(two.summary(), nan_ok=True)
    assert sorted(path.name for path in (tmp_path / "two" / RESULTS).iterdir()) == [
        "0000000-0000001.npz",
        "0000001-0000003.npz",
    ]
    # Finished is finished: nothing is computed again, by any number of processes.
    assert run_share(Rank(2, 3), CASE, tmp_path / "two", *HERE) == 0
    # An interrupted process goes on from its last checkpoint.
    for path in (tmp_path / "two" / RESULTS).iterdir():
        path.unlink()
    checkpoint = read_worlds(tmp_path / "two", CHECKPOINT, CASE, range(3))
    left = run_share(Rank(), CASE, tmp_path / "two", *HERE)
    assert left <= 60 - checkpoint[FRAMES].min()
    again = gather(CASE, tmp_path / "two", seconds=0)
    np.testing.assert_array_equal(again.true_error_px, one.true_error_px)


def test_a_part_of_other_options_is_refused(alone, tmp_path):
    write_part(tmp_path, CHECKPOINT, CASE, 0, alone[8])
    other = BatchCase(**{**vars(CASE), "seed": 5})
    with pytest.raises(DenseVSError, match="of another run with seed 4 in place of 5"):
        read_worlds(tmp_path, CHECKPOINT, other, range(3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda stored: stored.pop("image"), "it has no image"),
        (lambda stored: stored.update(joint_positions=np.zeros((3, 2), np.float32)), "joint_positions has shape"),
        (lambda stored: stored["filter.state"].fill(np.nan), "filter.state holds values that are not finite"),
        (lambda stored: stored[FRAMES].fill(-1), "world_frames holds -1; expected at least 0"),
    ],
)
def test_a_damaged_state_leaves_the_batch_as_it_was(alone, change, message):
    stored = {name: array.copy() for name, array in alone[8].items()}
    change(stored)
    fresh = batch()
    before = stored_worlds(fresh)
    with pytest.raises(DenseVSError, match=message):
        restore_worlds(fresh, stored)
    assert_same(stored_worlds(fresh), before)


def test_missing_results_are_waited_for_and_then_named(tmp_path):
    results = batch(Rank(0, 3)).results()
    write_part(tmp_path, RESULTS, CASE, 0, result_arrays(results, 5))
    assert read_worlds(tmp_path, RESULTS, CASE, range(1)) is not None
    with pytest.raises(DenseVSError, match=r"lacks results of some of the 3 worlds after 0\.3 s"):
        gather(CASE, tmp_path, seconds=0.3)


def test_a_single_world_is_the_world_of_that_number():
    options = {"device": "cpu", "height": 48, "width": 64, "seed": 2, "randomization": RANDOMIZED}
    many = SimWorld("arm", worlds=3, **options)
    one = SimWorld("arm", worlds=1, first_world=2, physics_on_device=True, **options)
    np.testing.assert_array_equal(one.frame().rgb, many.frame().rgb[2])
    np.testing.assert_array_equal(one.joints()[0], many.joints()[0][2])


def test_rank_of_the_environment(monkeypatch):
    for name in ("RANK", "WORLD_SIZE", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    assert Rank.from_environment() == Rank(0, 1, 0)
    monkeypatch.setenv("RANK", "5")
    monkeypatch.setenv("WORLD_SIZE", "8")
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert Rank.from_environment() == Rank(5, 8, 1)
    monkeypatch.setenv("WORLD_SIZE", "5")
    with pytest.raises(DenseVSError, match="rank is 5; expected a whole number of at least 0 and at most 4"):
        Rank.from_environment()
    monkeypatch.setenv("RANK", "-1")
    with pytest.raises(DenseVSError, match="RANK is '-1'; expected a whole number"):
        Rank.from_environment()


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_shares_cover_all_worlds_once(count):
    shares = [list(Rank(number, count).share(7)) for number in range(count)]
    assert [world for share in shares for world in share] == list(range(7))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1
    with pytest.raises(DenseVSError, match="worlds is 0; expected at least one for each"):
        Rank(0, count).share(0)


def test_processes_answer_in_order():
    assert run_ranks(rank_work.number, 2, (10,)) == [10, 11]


@pytest.mark.parametrize(
    ("work", "message"),
    [
        (rank_work.fail, "process 1 of 2 failed: ValueError: no such thing"),
        (rank_work.die, "process 1 of 2 ended without a result"),
    ],
)
def test_a_process_that_fails_ends_the_others(work, message):
    with pytest.raises(DenseVSError, match=message):
        run_ranks(work, 2, ())


@pytest.mark.slow
def test_the_command_is_one_process_of_another_launcher(tmp_path, monkeypatch, capsys):
    words = ["batch", "--robot", "planar", "--worlds", "2", "--height", "90", "--width", "120", "--babble", "0.3"]
    words += ["--device", "cpu", "--threads", "1", "--wait", "0.1", "--out", str(tmp_path)]
    monkeypatch.setenv("WORLD_SIZE", "2")
    for number in (1, 0):
        monkeypatch.setenv("RANK", str(number))
        assert not (tmp_path / "summary.json").exists()
        assert main(words) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["worlds"] == summary["reaches"] == 2
    assert summary["case"]["robot"] == "planar"
    assert "share reached" in capsys.readouterr().out
    assert main([*words, "--gpus", "2"]) != 0
    assert "--gpus is 2, but WORLD_SIZE is 2" in capsys.readouterr().err


def test_a_process_sends_its_result_or_why_there_is_none(monkeypatch):
    """By the same way; what has failed does not come as a result."""
    monkeypatch.setenv("DENSE_VS_THREADS", "1")

    def work(rank, number):
        if number < 0:
            raise ValueError(f"{number} in {rank.number}")
        return 2 * number

    sent = []
    pipe = SimpleNamespace(send=sent.append)
    for number in (3, -1):
        _answer(pipe, Rank(1, 2), "1", work, (number,))
    assert sent == [(True, 6), (False, "ValueError: -1 in 1")]
