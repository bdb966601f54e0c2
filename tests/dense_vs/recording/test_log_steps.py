"""A log smoothed beside a sum over its readings, limits of what is smoothed, long logs, and readings that are kept."""

import numpy as np
import pytest

from dense_vs import DenseVSError, JointLog
from dense_vs.recording.joint_delay import even_joints
from dense_vs.recording.joint_log import JointBuffer


def uneven(count=120, seed=0):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 1.5, count) * 0.02)
    return JointLog(("a", "b"), times, np.stack([np.sin(3 * times), rng.normal(size=count)], axis=1))


@pytest.mark.parametrize("seconds", [0.01, 0.03, 0.2])
def test_smoothed_by_a_gaussian_over_time(seconds):
    """On ticks as fine as the readings, or a quarter of the width where that is coarser; the ends are held."""
    log = uneven()
    found = log.smoothed(seconds)
    assert found.names == log.names
    np.testing.assert_array_equal(found.times, log.times)
    span = log.times[-1] - log.times[0]
    step = max(min(np.median(np.diff(log.times)), seconds), seconds / 4)
    ticks = np.linspace(log.times[0], log.times[-1], round(span / step) + 1)
    pace = ticks[1] - ticks[0]
    reach = int(4 * seconds / pace + 0.5)
    near = pace * np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (near / seconds) ** 2)
    weights /= weights.sum()
    for n, q in enumerate(log.positions.T):
        even = np.interp(ticks, log.times, q)
        held = np.concatenate([np.full(reach, even[0]), even, np.full(reach, even[-1])])
        smooth = np.array([weights @ held[k : k + 2 * reach + 1] for k in range(len(ticks))])
        np.testing.assert_allclose(found.positions[:, n], np.interp(log.times, ticks, smooth), atol=1e-9)


@pytest.mark.parametrize(
    ("seconds", "changes"), [(0.0, False), (0.9e-4, False), (1.1e-4, True), (3.9, True), (4.1, False)]
)
def test_widths_that_change_nothing(seconds, changes):
    """Less than a hundredth of a period, or four times the whole log."""
    times = np.arange(101) / 100
    log = JointLog(("a",), times, np.random.default_rng(0).normal(size=(101, 1)))
    assert (log.smoothed(seconds) is not log) == changes
    with pytest.raises(DenseVSError, match="smoothing"):
        log.smoothed(-1e-9)


def test_a_long_log_is_held_in_two_million_places():
    times = np.array([0.0, 10000.0, 20000.0])
    fine, joints = even_joints(times, np.array([[0.0], [1.0], [3.0]]))
    assert len(fine) == len(joints) == 2_000_000
    assert fine[1] - fine[0] == pytest.approx(0.01)
    short, _ = even_joints(times / 1000, np.array([[0.0], [1.0], [3.0]]))
    assert short[1] - short[0] == pytest.approx(1 / 240)


def test_half_of_the_readings_are_kept_where_there_is_no_room():
    buffer = JointBuffer(2, capacity=5)
    for k in range(6):
        buffer.add(np.array([k, 10.0 * k]), 0.5 * k)
    times, positions = buffer.readings()
    assert times.tolist() == [1.5, 2.0, 2.5]
    assert (buffer.first_time, buffer.last_time) == (1.5, 2.5)
    np.testing.assert_array_equal(positions, [[3, 30], [4, 40], [5, 50]])
    np.testing.assert_allclose(buffer.at(2.25), [4.5, 45.0])
    np.testing.assert_allclose(buffer.at(0.0), [3, 30])
    np.testing.assert_allclose(buffer.at(9.0), [5, 50])
    buffer.add(np.zeros(2), 2.5)  # the same reading again
    assert len(buffer.readings()[0]) == 3
    buffer.add(np.zeros(2), 4.5)  # two seconds later
    for time in (4.4, 6.51, np.nan, -np.inf):
        with pytest.raises(DenseVSError, match="joint time stamp"):
            buffer.add(np.zeros(2), time)
    assert buffer.readings()[0].tolist() == [1.5, 2.0, 2.5, 4.5]
    buffer.clear()
    with pytest.raises(DenseVSError, match="no joint reading yet"):
        buffer.at(1.0)
    assert (buffer.first_time, buffer.last_time) == (np.inf, -np.inf)
    buffer.add(np.zeros(2), 0.0)
    assert JointBuffer(1)._times.size == 256


@pytest.mark.parametrize(
    ("text", "names", "rows"),
    [
        ("time,a,b\n0,1,2\n1,3,4\n", ("a", "b"), [[1, 2], [3, 4]]), ("t, a \n0,1\n\n , \n1,3\n", ("a",), [[1], [3]]),
        ("time,image,a\n0,x.png,1\n1,,3\n", ("a",), [[1], [3]]), ("time,a,image\n0,1,x\n1,3,y\n", ("a",), [[1], [3]]),
        ("image,a\n0,1\n1,3\n", ("a",), [[1], [3]]), ("0,a\n0,1\n1,3\n", ("a",), [[1], [3]]),
    ],
)  # fmt: skip
def test_a_table_is_read(tmp_path, text, names, rows):
    (tmp_path / "log.csv").write_text(text)
    log = JointLog.read_csv(tmp_path / "log.csv")
    assert log.names == names
    assert log.times.tolist() == [0, 1]
    assert log.positions.tolist() == rows


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is empty"), ("time\n0\n1\n", "expected a header naming"), ("0,1\n1,2\n", "expected a header naming"),
        ("time,a,a\n0,1,1\n", "names its joints"), ("time,a,\n0,1,1\n", "names its joints"),
        ("time,a\n0,1,2\n", "row 1 after the header, has 3 columns; expected 2"),
        ("time,a\n0,1\n1,inf\n", "row 2 after the header, column 'a' holds 'inf'"),
        ("time,a\n0,1\nx,2\n", "row 2 after the header, column 'time' holds 'x'"),
        ("time,image,a\n0,x.png\n", "row 1 after the header, has 2 columns; expected 3"),
    ],
)  # fmt: skip
def test_a_table_that_is_none(tmp_path, text, why):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(DenseVSError, match=why):
        JointLog.read_csv(tmp_path / "log.csv")
