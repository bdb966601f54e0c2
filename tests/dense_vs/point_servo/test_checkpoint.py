"""A checkpoint holds what was learned, at any moment that its writer may be killed at, and is taken up from there."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from sliding_scene import HEIGHT, WIDTH, J, SlidingRobot, wait_for

from dense_vs import DenseJacobian, DenseVSError, ServoLoop
from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import NAMES as BODY_NAMES
from dense_vs.body_model.model_file import ModelContent, body_arrays
from dense_vs.body_model.precision import Precision
from dense_vs.body_model.surface import Surface
from dense_vs.point_servo.checkpoint import Checkpoint

NAMES = ("left", "right")
SUPPORT = Path(__file__).parents[2] / "support"
BABBLER = """
import sys
from sliding_scene import SlidingRobot
from dense_vs import ServoLoop
from dense_vs.point_servo.checkpoint import Checkpoint

robot = SlidingRobot(pace=False)
checkpoint = Checkpoint(sys.argv[1], robot.joint_names, period=0.02)
kept = checkpoint.resume((120, 160), device="cpu", threads=1)
loop = ServoLoop(robot, robot, device="cpu", threads=1, seed=1, estimator=kept and kept.estimator)
before = kept.seconds if kept else 0.0
print("before", before, flush=True)
while True:
    loop.babble_once()
    checkpoint.keep(loop, before + loop.frame.time)
"""


def estimator_of(rng, height=24, width=32, joints=2):
    made = DenseJacobian(height=height, width=width, joints=joints, device="cpu", threads=1)
    for _ in range(5):
        made.update(rng.normal(0, 1, (height, width, 2)).astype(np.float32), rng.normal(0, 0.02, joints))
    return made


def loop_of(estimator, posture=(0.1, -0.2), body=None):
    known = SimpleNamespace(estimator=estimator, posture=np.array(posture))
    return SimpleNamespace(estimator=estimator, pipeline=known, learned_body=SimpleNamespace(believed=body))


def written(path, estimator, **options):
    checkpoint = Checkpoint(path, NAMES, **options)
    checkpoint.keep(loop_of(estimator), 4.5)
    checkpoint.end()
    return checkpoint


def test_what_was_kept_comes_back_bit_by_bit(tmp_path):
    rng = np.random.default_rng(0)
    estimator = estimator_of(rng)
    kept = written(tmp_path / "c.npz", estimator).resume((24, 32), device="cpu", threads=1)
    assert kept.seconds == 4.5
    np.testing.assert_array_equal(kept.positions, [0.1, -0.2])
    np.testing.assert_array_equal(kept.estimator.to_numpy(), estimator.to_numpy())
    assert kept.estimator.options == estimator.options
    flow, dq = rng.normal(0, 1, (24, 32, 2)).astype(np.float32), np.array([0.01, 0.02])
    for one in (estimator, kept.estimator):
        one.update(flow, dq)
    np.testing.assert_array_equal(kept.estimator.to_numpy(), estimator.to_numpy())
    # It is a saved Jacobian, too.
    assert DenseJacobian.load(tmp_path / "c.npz", device="cpu").updates == 5


@pytest.fixture(scope="module")
def model():
    """Of two links that look alike from everywhere, before a camera of 32 x 24 pixels."""
    rng = np.random.default_rng(0)
    chain = Chain(np.array([[0, 0, 1.0], [0, 1.0, 0]]), np.array([[0, 0, 1.0], [0.1, 0, 1.0]]), np.zeros(2), [-1, 0])
    places = rng.uniform([-0.4, -0.3, 0.9], [0.4, 0.3, 1.1], (200, 3)).astype(np.float32).astype(float)
    surface = Surface(
        places, (places[:, 0] > 0.1).astype(int), np.ones(200), rng.integers(0, 255, 200).astype(np.uint8)
    )
    limits = np.array([[-1.0, 1.0]] * 2)
    return BodyModel(ModelContent(chain, 40.0, (16, 12), (24, 32), surface, np.ones(2, bool), limits, 0.4))


def test_a_body_that_is_believed_is_kept_too(tmp_path, model):
    q, checkpoint = np.array([0.1, -0.2]), Checkpoint(tmp_path / "c.npz", NAMES, period=1e-9)
    estimator = estimator_of(np.random.default_rng(0))
    checkpoint.keep(loop_of(estimator, body=model), 4.5)
    checkpoint.end()
    kept = checkpoint.resume((24, 32), device="cpu", threads=1)
    np.testing.assert_array_equal(kept.body.jacobian(q), model.jacobian(q))
    np.testing.assert_array_equal(kept.body.image(q).body, model.image(q).body)
    np.testing.assert_array_equal(kept.estimator.to_numpy(), estimator.to_numpy())
    checkpoint.keep(loop_of(estimator), 5.0)  # something speaks against it meanwhile
    checkpoint.end()
    assert checkpoint.resume((24, 32), device="cpu", threads=1).body is None


def test_all_that_a_body_may_hold_is_read_again():
    chain = Chain(np.eye(3)[:2], np.zeros((2, 3)), np.zeros(2), [-1, 0], np.eye(3)[:2])
    surface = Surface(np.ones((4, 3)), np.zeros(4, int), np.ones(4), np.zeros(4, np.uint8))
    known = Precision(np.zeros((3, 9)), np.zeros((4, 3)), np.ones(4), np.zeros((5, 2)), np.zeros(4, int), 0.5)
    limits = np.array([[-1.0, 1.0]] * 2)
    content = ModelContent(chain, 40.0, (16, 12), (24, 32), surface, np.ones(2, bool), limits, 0.4, known, 0.1)
    assert set(body_arrays(content)) == set(BODY_NAMES)


def test_a_damaged_body_or_one_of_another_camera_is_refused(tmp_path, model):
    estimator = estimator_of(np.random.default_rng(0), height=48, width=64)
    checkpoint = Checkpoint(tmp_path / "c.npz", NAMES, period=1e-9)
    checkpoint.keep(loop_of(estimator, body=model), 4.5)
    checkpoint.end()
    expected = r"its body has 2 joints and images of \(24, 32\); expected 2 and \(48, 64\)"
    with pytest.raises(DenseVSError, match=expected):
        checkpoint.resume((48, 64), device="cpu", threads=1)
    with np.load(tmp_path / "c.npz") as stored:
        arrays = dict(stored)
    for name, value, message in (
        ("body_axes", np.zeros((2, 4)), "is damaged: axes has shape"),
        ("body_format", np.array("x"), "is not a saved body model"),
        ("body_format_version", np.array(9), "has format version 9; expected 1 or 2 or 3"),
    ):
        np.savez(tmp_path / "c.npz", **{**arrays, name: value})
        with pytest.raises(DenseVSError, match=message):
            checkpoint.resume((48, 64), device="cpu", threads=1)


def test_what_is_written_is_of_when_it_was_kept(tmp_path, monkeypatch):
    """The disk is slow, and the estimator goes on meanwhile."""
    rng, go_on, write = np.random.default_rng(0), Event(), Checkpoint._write

    def slow(checkpoint, *given):
        go_on.wait(60)
        write(checkpoint, *given)

    monkeypatch.setattr(Checkpoint, "_write", slow)
    estimator = estimator_of(rng)
    J = estimator.to_numpy().copy()
    checkpoint = Checkpoint(tmp_path / "c.npz", NAMES)
    checkpoint.keep(loop_of(estimator), 4.5)
    try:
        for _ in range(4):
            estimator.update(rng.normal(0, 1, (24, 32, 2)).astype(np.float32), rng.normal(0, 0.02, 2))
        assert not (tmp_path / "c.npz").exists()
    finally:
        go_on.set()
        checkpoint.end()
    kept = checkpoint.resume((24, 32), device="cpu", threads=1)
    assert kept.estimator.updates == 5
    np.testing.assert_array_equal(kept.estimator.to_numpy(), J)
    assert np.abs(estimator.to_numpy() - J).max() > 0


def test_no_file_is_no_checkpoint_yet(tmp_path):
    assert Checkpoint(tmp_path / "c.npz", NAMES).resume((24, 32)) is None


def test_it_is_written_when_it_is_time(tmp_path):
    estimator = estimator_of(np.random.default_rng(0))
    checkpoint = written(tmp_path / "c.npz", estimator, period=1000.0)
    before = (tmp_path / "c.npz").stat().st_ino
    checkpoint.keep(loop_of(estimator), 9.0)
    checkpoint.end()
    assert (tmp_path / "c.npz").stat().st_ino == before
    assert checkpoint.resume((24, 32)).seconds == 4.5


def test_a_checkpoint_of_something_else_is_refused_and_stays(tmp_path):
    path = tmp_path / "c.npz"
    written(path, estimator_of(np.random.default_rng(0)))
    content = path.read_bytes()
    with pytest.raises(DenseVSError, match="is of the joints left, right; expected left, elbow"):
        Checkpoint(path, ("left", "elbow")).resume((24, 32))
    with pytest.raises(DenseVSError, match=r"\(24, 32, 2, 1\); expected \(48, 64, 2, 1\)"):
        Checkpoint(path, NAMES).resume((48, 64))
    assert path.read_bytes() == content
    estimator_of(np.random.default_rng(0)).save(path)
    with pytest.raises(DenseVSError, match="is not a checkpoint: it has no joint_names"):
        Checkpoint(path, NAMES).resume((24, 32))
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(DenseVSError, match=r"cannot read .* as a checkpoint"):
        Checkpoint(path, NAMES).resume((24, 32))
    with pytest.raises(DenseVSError, match="cannot write"):
        Checkpoint(tmp_path / "nowhere" / "c.npz", NAMES)
    with pytest.raises(DenseVSError, match="period is 0"):
        Checkpoint(path, NAMES, period=0)


def test_a_writing_that_failed_is_said_at_the_next(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    estimator = estimator_of(np.random.default_rng(0))
    checkpoint = Checkpoint(folder / "c.npz", NAMES, period=1e-9)
    folder.rmdir()
    checkpoint.keep(loop_of(estimator), 1.0)
    checkpoint.end()
    with pytest.raises(DenseVSError, match="cannot write"):
        checkpoint.keep(loop_of(estimator), 1.0)


def test_a_writing_that_failed_is_said_at_the_end(tmp_path, monkeypatch):
    """Whatever the error is: nobody hears of one in a thread."""
    estimator = estimator_of(np.random.default_rng(0))
    checkpoint = written(tmp_path / "c.npz", estimator, period=1e-9)
    checkpoint.finish()
    before = (tmp_path / "c.npz").read_bytes()

    def fail(*_, **__):
        raise RuntimeError("no room")

    monkeypatch.setattr("dense_vs.point_servo.checkpoint.np.savez", fail)
    for end in (checkpoint.finish, lambda: checkpoint.keep(loop_of(estimator), 9.0)):
        checkpoint.keep(loop_of(estimator), 9.0)
        checkpoint.end()
        with pytest.raises(DenseVSError, match=r"cannot write .*RuntimeError: no room"):
            end()
    checkpoint.finish()
    assert (tmp_path / "c.npz").read_bytes() == before


def other(estimator=None, **changes):
    return loop_of(estimator or estimator_of(np.random.default_rng(0)), **changes)


@pytest.mark.parametrize(
    ("loop", "seconds", "message"),
    [
        (other(), np.nan, "seconds is nan"),
        (other(), -1.0, "seconds is -1.0"),
        (other(), "x", "seconds is 'x'"),
        (other(), None, "seconds is None"),
        (other(), 1j, "seconds is 1j"),
        (other(), True, "seconds is True"),
        (other(), 10**400, "seconds is"),
        ("x", 1.0, "loop is a str"),
        (loop_of(None), 1.0, "loop is a SimpleNamespace"),
        (other(posture=np.zeros(3)), 1.0, "posture has shape"),
        (other(posture=np.array([0.0, np.nan])), 1.0, "posture is"),
        (other(estimator=estimator_of(np.random.default_rng(0), joints=3)), 1.0, "has 3 joints in 1 worlds"),
    ],
)
def test_what_it_would_refuse_is_not_kept(tmp_path, loop, seconds, message):
    checkpoint = written(tmp_path / "c.npz", estimator_of(np.random.default_rng(0)), period=1e-9)
    before = (tmp_path / "c.npz").read_bytes()
    with pytest.raises(DenseVSError, match=message):
        checkpoint.keep(loop, seconds)
    checkpoint.finish()
    assert (tmp_path / "c.npz").read_bytes() == before
    assert checkpoint.resume((24, 32), device="cpu", threads=1).seconds == 4.5


def test_names_that_a_checkpoint_cannot_hold(tmp_path):
    with pytest.raises(DenseVSError, match=r"joint_names is .*; expected names that a file can hold"):
        Checkpoint(tmp_path / "c.npz", ("a", "b\0"))


def test_j_is_brought_to_where_the_joints_are_now(tmp_path):
    """A surface whose J grows to the right, moved by its joint while nothing was running."""
    estimator = DenseJacobian(height=8, width=200, joints=2, order=1, device="cpu", threads=1)
    x = np.arange(200.0)
    known = np.zeros((8, 200, 2, 2), np.float32)
    known[..., 0, 0] = 50.0 + 0.2 * x
    estimator.blend(known, np.ones((8, 200)))
    kept = written(tmp_path / "c.npz", estimator).resume((8, 200), device="cpu", threads=1)
    kept.bring_to([0.3, 0.6])
    # Every surface point keeps its J and moves by it: x0 + (50 + 0.2 x0) 0.2 is where it is now.
    start = (x - 0.2 * 50.0) / (1 + 0.2 * 0.2)
    moved = kept.estimator.to_numpy()[4, :, 0, 0]
    np.testing.assert_allclose(moved[30:], 50.0 + 0.2 * start[30:], rtol=2e-3)
    assert np.abs(moved - known[4, :, 0, 0])[30:].min() > 1.0
    with pytest.raises(DenseVSError, match="positions"):
        kept.bring_to([0.2])


def test_a_robot_that_is_where_it_was_keeps_its_bits(tmp_path):
    estimator = estimator_of(np.random.default_rng(0))
    kept = written(tmp_path / "c.npz", estimator).resume((24, 32), device="cpu", threads=1)
    kept.bring_to(kept.positions)
    np.testing.assert_array_equal(kept.estimator.to_numpy(), estimator.to_numpy())


def test_killed_again_and_again_it_goes_on(tmp_path):
    path = tmp_path / "c.npz"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])}
    begun = []
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, "-c", BABBLER, str(path)], stdout=subprocess.PIPE, text=True, env=environment
        )
        try:
            begun.append(next(float(line.split()[1]) for line in process.stdout if line.startswith("before")))
            goal = begun[-1] + 3.0  # s of motion
            reader = Checkpoint(path, NAMES)

            def enough(reader=reader, goal=goal):
                kept = reader.resume((HEIGHT, WIDTH), device="cpu", threads=1)  # whole, whenever it is read
                return kept is not None and kept.seconds >= goal

            assert wait_for(enough, 60)
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait(timeout=10)
            process.stdout.close()
    assert begun[0] == 0.0
    assert begun[1] >= 3.0
    kept = reader.resume((HEIGHT, WIDTH), device="cpu", threads=1)
    assert kept.seconds >= 6.0
    np.testing.assert_allclose(kept.estimator.at([[WIDTH / 2, HEIGHT / 2]])[0], J, atol=6.0)
    robot = SlidingRobot(pace=False)
    robot.q = kept.positions.copy()
    loop = ServoLoop(robot, robot, device="cpu", threads=1, seed=1, estimator=kept.estimator)
    center = np.array([WIDTH / 2, HEIGHT / 2])
    start = center - J @ robot.q
    loop.define_point(center, method="aligned")
    target = center + np.array([9.0, -7.0])
    assert loop.reach(target).reached
    assert np.hypot(*(robot.place(start) - target)) < 2.0
    last = Checkpoint(path, NAMES)
    last.keep(loop, 0.0)  # a new writing takes away what the killed ones left
    last.end()
    assert [file.name for file in tmp_path.iterdir()] == ["c.npz"]
