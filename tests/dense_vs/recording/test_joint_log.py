"""Joint logs: interpolation against NumPy, and every way in which a file or a reading can be wrong."""

import numpy as np
import pytest

from dense_vs import DenseVSError, JointLog
from dense_vs.recording.joint_log import JointBuffer

# Interpolation in float64.
TOLERANCE = 1e-12


@pytest.fixture
def log():
    rng = np.random.default_rng(0)
    return JointLog(("a", "b", "c"), np.cumsum(rng.uniform(0.005, 0.02, 50)), rng.normal(size=(50, 3)))


@pytest.fixture
def written(tmp_path):
    def write(text, encoding="utf-8"):
        path = tmp_path / "joints.csv"
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_positions_between_the_readings(log):
    times = np.concatenate([np.linspace(log.times[0], log.times[-1], 101), log.times])
    expected = np.stack([np.interp(times, log.times, log.positions[:, n]) for n in range(3)], axis=1)
    np.testing.assert_allclose(log.at(times), expected, rtol=TOLERANCE)
    np.testing.assert_allclose(log.at(log.times), log.positions, rtol=TOLERANCE)
    middle = log.at((log.times[:-1] + log.times[1:]) / 2)
    np.testing.assert_allclose(middle, (log.positions[:-1] + log.positions[1:]) / 2, atol=TOLERANCE)
    assert log.at(np.zeros(0)).shape == (0, 3)


def test_refuses_times_outside(log):
    for times in ([0.0], [log.times[0], log.times[-1] + 0.01]):
        with pytest.raises(DenseVSError, match=r"are not all in the joint log, which covers .* to .* s"):
            log.at(np.array(times))


def test_smoothed_keeps_lines_and_lowers_noise_at_any_rate():
    rng = np.random.default_rng(0)
    for rate in (30, 200, 1000):
        times = np.cumsum(rng.uniform(0.8, 1.2, 20 * rate)) / rate
        positions = np.stack([times, rng.normal(size=len(times))], axis=1)
        smooth = JointLog(("line", "noise"), times, positions).smoothed(0.05)
        np.testing.assert_array_equal(smooth.times, times)
        inside = (times > times[0] + 0.3) & (times < times[-1] - 0.3)
        np.testing.assert_allclose(smooth.positions[inside, 0], times[inside], atol=2e-3)
        # White noise through a Gaussian of s readings keeps 1 / sqrt(2 sqrt(pi) s) of its deviation.
        assert smooth.positions[inside, 1].std() < 1.6 / np.sqrt(2 * np.sqrt(np.pi) * min(0.05 * rate, 4))


def test_smoothed_is_the_gaussian_of_evenly_stamped_readings():
    q = np.random.default_rng(1).normal(size=(60, 2))
    times = np.arange(60) / 30
    weights = np.exp(-0.5 * ((times[:, None] - times[None, :]) / 0.05) ** 2)
    expected = (weights / weights.sum(axis=1, keepdims=True)) @ q
    found = JointLog(("a", "b"), times, q).smoothed(0.05).positions
    np.testing.assert_allclose(found[9:-9], expected[9:-9], atol=2e-3)


def test_smoothed_by_nothing_or_wrongly(log):
    np.testing.assert_array_equal(log.smoothed(0.0).positions, log.positions)
    for width in (-0.1, np.nan, np.inf):
        with pytest.raises(DenseVSError, match="smoothing is"):
            log.smoothed(width)


def test_select(log):
    chosen = log.select(["c", "a"])
    assert chosen.names == ("c", "a")
    np.testing.assert_array_equal(chosen.positions, log.positions[:, [2, 0]])
    with pytest.raises(DenseVSError, match="joint 'd' is not in the log; expected one of a, b, c"):
        log.select(["a", "d"])
    for names in (["a", "a"], []):
        with pytest.raises(DenseVSError, match=r"named twice|expected a sequence of names"):
            log.select(names)


def test_shifted(log):
    later = log.shifted(0.25)
    np.testing.assert_allclose(later.at(log.times + 0.25), log.positions, atol=1e-9)
    np.testing.assert_array_equal(later.times, log.times + 0.25)


@pytest.mark.parametrize(
    ("times", "positions", "message"),
    [
        (np.arange(3.0), np.zeros((4, 2)), r"times of shape \(3,\) and positions of shape \(4, 2\)"),
        (np.arange(3.0), np.zeros((3, 3)), r"expected \(T,\) and \(T, 2\)"),
        (np.zeros((3, 1)), np.zeros((3, 2)), r"times of shape \(3, 1\)"),
        (np.zeros(1), np.zeros((1, 2)), "has 1 rows; expected at least 2"),
        (np.array([0.0, 1.0, 1.0]), np.zeros((3, 2)), "times do not increase: row 3 has 1.0 s after 1.0 s in row 2"),
        (np.array([0.0, np.nan, 1.0]), np.zeros((3, 2)), "not finite"),
        (np.arange(3.0), np.full((3, 2), np.inf), "not finite"),
    ],
)
def test_refuses_arrays(times, positions, message):
    with pytest.raises(DenseVSError, match=message):
        JointLog(("a", "b"), times, positions)


GOOD = "time,a,b\n0.0,1,-1\n0.1,2,-2\n0.25,3,1e-1\n"


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\n\n") + " , ,\n\n",
        '"time" , "a","b"\n'.replace(" ", "") + GOOD.split("\n", 1)[1].replace("0.1,", " 0.1 , "),
        GOOD.rstrip("\n"),
    ],
    ids=["plain", "byte order mark", "windows", "blank lines", "quotes and blanks", "no last newline"],
)
def test_reads_csv(written, text):
    log = JointLog.read_csv(written(text))
    assert log.names == ("a", "b")
    np.testing.assert_array_equal(log.times, [0, 0.1, 0.25])
    np.testing.assert_array_equal(log.positions, [[1, -1], [2, -2], [3, 0.1]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; expected a header and rows of numbers"),
        ("\n \n", "is empty; expected a header"),
        ("0.0,1,2\n0.1,2,3\n", "starts with '0.0,1,2'; expected a header naming the time column"),
        ("\ufeff0.0,1,2\n0.1,2,3\n", "starts with '0.0,1,2'; expected a header naming the time column"),
        ("time\n0.0\n0.1\n", "starts with 'time'; expected a header naming the time column and at least one joint"),
        ("time,a,a\n0,1,2\n1,2,3\n", "names its joints .*expected each column a name of its own"),
        ("time,a,\n0,1,2\n1,2,3\n", "names its joints .*expected each column a name of its own"),
        ("time,a,b\n", "has 0 rows; expected at least 2"),
        ("time,a,b\n0,1,2\n", "has 1 rows; expected at least 2"),
        ("time,a,b\n0,1,2\n0.1,2\n0.2,1,2\n", "row 2 after the header, has 2 columns; expected 3"),
        ("time,a,b\n0,1,2\n0.1,2,3,4\n", "row 2 after the header, has 4 columns; expected 3"),
        ("time,a,b\n0,1,2\n0.1,fast,3\n", "row 2 after the header, column 'a' holds 'fast'; expected a finite number"),
        ("time,a,b\n0,1,2\n0.1,,3\n", "row 2 after the header, column 'a' holds ''; expected a finite number"),
        ("time,a,b\n0,1,nan\n0.1,2,3\n", "row 1 after the header, column 'b' holds 'nan'; expected a finite number"),
        ("time,a,b\n0,1,2\n0.1,inf,3\n", "column 'a' holds 'inf'; expected a finite number"),
        ("time,a,b\nnow,1,2\n0.1,2,3\n", "column 'time' holds 'now'; expected a finite number"),
        ("time,a,b\n0,1,2\n0.2,2,3\n0.1,2,3\n", "row 3 has 0.1 s after 0.2 s in row 2"),
        ("time,a,b\n0,1,2\n0.2,2,3\n0.2,2,3\n", "row 3 has 0.2 s after 0.2 s in row 2"),
        ("time;a;b\n0;1;2\n1;1;2\n", "starts with 'time;a;b'; expected a header"),
    ],
)
def test_refuses_csv(written, text, message):
    path = written(text)
    with pytest.raises(DenseVSError, match=message) as caught:
        JointLog.read_csv(path)
    assert str(path) in str(caught.value)


def test_refuses_files_it_cannot_read(written, tmp_path):
    with pytest.raises(DenseVSError, match=r"cannot read joint log .*missing.csv: No such file or directory"):
        JointLog.read_csv(tmp_path / "missing.csv")
    with pytest.raises(DenseVSError, match=r"cannot read joint log .*: Is a directory"):
        JointLog.read_csv(tmp_path)
    with pytest.raises(DenseVSError, match="cannot read joint log"):
        JointLog.read_csv(written(GOOD, encoding="utf-16"))


@pytest.mark.parametrize("capacity", [2, 5, 64])
def test_buffer_interpolates_the_last_readings(capacity):
    rng = np.random.default_rng(1)
    buffer = JointBuffer(3, capacity=capacity)
    times, positions = np.cumsum(rng.uniform(0.01, 0.02, 40)), rng.normal(size=(40, 3))
    for k, (time, q) in enumerate(zip(times, positions, strict=True)):
        buffer.add(q, time)
        kept = slice(max(0, k + 1 - max(capacity // 2, 1)), k + 1)  # at least the newer half is there
        for at in np.linspace(times[kept][0], time, 5):
            expected = [np.interp(at, times[: k + 1], positions[: k + 1, n]) for n in range(3)]
            np.testing.assert_allclose(buffer.at(at), expected, atol=1e-9)
        np.testing.assert_array_equal(buffer.at(time + 1), q)
    assert np.isfinite(buffer.at(times[0] - 1)).all()


def test_buffer_takes_a_reading_once():
    buffer = JointBuffer(1)
    buffer.add(np.array([1.0]), 0.5)
    buffer.add(np.array([7.0]), 0.5)
    buffer.add(np.array([2.0]), 0.6)
    np.testing.assert_allclose([buffer.at(t)[0] for t in (0.0, 0.5, 0.55, 0.6, 9.0)], [1, 1, 1.5, 2, 2])


@pytest.mark.parametrize("stamp", [0.4, -3.0, 3.0, 1e9])
def test_buffer_says_that_a_stamp_is_of_another_clock(stamp):
    buffer = JointBuffer(1)
    buffer.add(np.array([1.0]), 0.5)
    with pytest.raises(DenseVSError, match=r"joint time stamp is .* s after 0.5 s; expected increasing stamps"):
        buffer.add(np.array([7.0]), stamp)
    buffer.add(np.array([2.0]), 0.6)
    np.testing.assert_allclose([buffer.at(t)[0] for t in (0.5, 0.55, 0.6)], [1, 1.5, 2])
    buffer.clear()
    buffer.add(np.array([4.0]), stamp)
    assert buffer.at(0.5) == 4.0


def test_buffer_does_not_keep_hold_of_its_input():
    buffer, q = JointBuffer(2), np.array([1.0, 2.0])
    buffer.add(q, 0.0)
    q[...] = 9
    np.testing.assert_array_equal(buffer.at(0.0), [1, 2])


def test_buffer_refuses():
    buffer = JointBuffer(2)
    with pytest.raises(DenseVSError, match=r"no joint reading yet; expected add\(\) first"):
        buffer.at(0.0)
    for q, time, message in (
        (np.zeros(3), 0.0, r"joint positions has shape \(3,\)"),
        (np.array([0, np.nan]), 0.0, "joint positions is .*expected finite"),
        (np.zeros(2), np.nan, "joint time stamp is nan; expected a finite number"),
        (np.zeros(2), np.inf, "joint time stamp is inf; expected a finite number"),
    ):
        with pytest.raises(DenseVSError, match=message):
            buffer.add(q, time)
    with pytest.raises(DenseVSError, match="no joint reading yet"):
        buffer.at(0.0)


def test_buffer_stretches_a_joints_motion_from_a_time_on():
    buffer = JointBuffer(2)
    for k in range(5):
        buffer.add(np.array([float(k), 10.0 * k]), 0.1 * k)
    buffer.stretch(1, 0.5, 0.25)  # between two readings: it was at 25
    times, positions = buffer.readings()
    np.testing.assert_allclose(times, 0.1 * np.arange(5))
    np.testing.assert_allclose(positions, [[0, 0], [1, 10], [2, 20], [3, 27.5], [4, 32.5]])
    buffer.stretch(0, 2.0, 0.4)  # nothing is later
    np.testing.assert_allclose(buffer.readings()[1], positions)
    JointBuffer(1).stretch(0, 2.0, 0.0)  # nor in an empty one
