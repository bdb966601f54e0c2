"""What an episode's survey says and which images count as new, on recordings and changes made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs import JointLog
from dense_vs.recording import survey
from dense_vs.recording.clock_offset import ClockOffset
from dense_vs.recording.distinct_images import DistinctImages, even_time
from dense_vs.recording.repeated_images import ImageChange, RepetitionFilter
from dense_vs.recording.survey import joint_motions, moved_together, survey_episode

FPS = 30.0


class Stream:
    """Images that say which they are, at given stamps."""

    fps, height, width = FPS, 4, 6

    def __init__(self, images, times):
        self._images, self._times = images, times

    def __iter__(self):
        return iter(
            [(np.full((4, 6, 3), value, np.uint8), time) for value, time in zip(self._images, self._times, strict=True)]
        )


class Motion:
    """Keeps the images and restarts that it was told of."""

    last = None

    def __init__(self):
        self.events, Motion.last = [], self

    def add(self, gray, time):
        self.events.append((int(gray[0, 0]), round(time * FPS)))

    def restart(self):
        self.events.append("restart")


@pytest.fixture
def surveyed(monkeypatch):
    def run(images, frames, positions=None, offset="offset"):
        times = np.array(frames) / FPS
        log_times = np.arange(0, 10, 0.01)
        if positions is None:
            positions = np.stack([np.sin(3 * log_times), np.full(1000, 0.3)], axis=1)
        log = JointLog(("a", "b")[: positions.shape[1]], log_times, positions)
        monkeypatch.setattr(survey, "MotionSamples", Motion)
        asked = []
        monkeypatch.setattr(survey, "find_clock_offset", lambda motion, log: asked.append(log.names) or offset)
        # The images repeat that say the same, for this test.
        monkeypatch.setattr(RepetitionFilter, "keep", lambda self, gray: _keep(self, int(gray[0, 0])), raising=True)
        counted = []
        episode = SimpleNamespace(images=lambda: Stream(images, times), log=log)
        return survey_episode(episode, lambda: counted.append(1)), asked, len(counted)

    def _keep(one, value):
        new = getattr(one, "value", None) != value
        one.value = value
        one.repeated += not new
        return new

    return run


def test_a_survey_by_hand(surveyed):
    found, asked, counted = surveyed([1, 2, 2, 3, 4, 5, 6, 7], [0, 1, 2, 3, 6, 7, 8, 10])
    assert counted == found.images == 8
    assert found.seconds == pytest.approx(10 / FPS)
    assert found.fps == pytest.approx(FPS)
    assert found.repeated == 1
    assert found.distinct_fps == pytest.approx((8 - 1 - 1) / (10 / FPS))
    assert found.missing == 2 + 1
    assert found.gaps == pytest.approx((3 / FPS,))  # of three frames; one of two is none
    assert (found.height, found.width) == (4, 6)
    assert found.joint_rate == pytest.approx(100.0)
    assert asked == [("a",)]  # the joints that move
    assert found.offset == "offset"
    assert [event if event == "restart" else event[0] for event in Motion.last.events] == [
        1,
        2,
        3,
        "restart",
        4,
        5,
        6,
        7,
    ]
    assert found.together == ()


def test_joints_at_rest_and_too_few_images(surveyed):
    found, asked, _ = surveyed([1], [0], positions=np.full((1000, 2), 0.3))
    assert asked == []
    assert (
        found.offset == ClockOffset(0.0, 0.0, float("nan"), reason="no joint moves")
        or found.offset.reason == "no joint moves"
    )
    assert (found.images, found.seconds, found.fps, found.distinct_fps, found.missing) == (1, 0.0, FPS, 0.0, 0)
    same, _, _ = surveyed([1, 2, 3], [5, 5, 5])
    assert (same.fps, same.distinct_fps, same.missing) == (FPS, 0.0, 0)


TIMES = np.arange(0, 10, 0.01)


def log_of(*columns):
    return JointLog(tuple("abcdef"[: len(columns)]), TIMES, np.stack(columns, axis=1))


def test_noise_and_excitation_by_hand():
    """White noise of 0.01 on a sine of 1 rad: over 0.2 s it changes by its amplitude times 2 sin(0.1 w) / sqrt(2)."""
    noise = 0.01 * np.random.default_rng(0).normal(size=1000)
    swing = np.sin(3.0 * TIMES)
    moving, still = joint_motions(log_of(swing + noise, noise))
    assert moving.noise == pytest.approx(0.01, rel=0.15)
    assert still.noise == pytest.approx(0.01, rel=0.15)
    change = np.sqrt(np.mean((swing[20:] - swing[:-20]) ** 2) + 2 * 0.01**2)
    assert moving.excitation == pytest.approx(change / (np.sqrt(2) * 0.01), rel=0.15)
    assert still.excitation == pytest.approx(1.0, rel=0.15)
    assert (moving.moves, still.moves) == (True, False)
    assert moving.high == pytest.approx((swing + noise).max())
    assert moving.low == pytest.approx((swing + noise).min())
    assert joint_motions(log_of(swing))[0].excitation == 9999.0  # a simulated joint has no noise


@pytest.mark.parametrize(("factor", "moves"), [(17.0, False), (24.0, True)])
def test_a_joint_moves_from_twenty_times_its_noise_on(factor, moves):
    noise = 0.01 * np.random.default_rng(1).normal(size=1000)
    ramp = np.where(TIMES % 2 < 1, TIMES % 2, 2 - TIMES % 2)  # 0.2 in 0.2 s
    motion = factor * 0.01 * np.sqrt(2) * ramp / np.sqrt(np.mean((ramp[20:] - ramp[:-20]) ** 2))
    assert joint_motions(log_of(motion + noise))[0].moves == moves


@pytest.mark.parametrize(("values", "moves"), [(4, False), (5, True)])
def test_an_encoder_at_rest_shows_few_readings(values, moves):
    steps = np.floor(TIMES / 10 * values).clip(max=values - 1)
    assert joint_motions(log_of(steps))[0].moves == moves


def test_trembling_is_no_motion():
    fast = np.sin(2 * np.pi * 24.0 * TIMES)  # as much from reading to reading as over a fifth of a second
    slow = np.sin(2 * np.pi * 1.0 * TIMES)
    assert [joint.moves for joint in joint_motions(log_of(fast, slow))] == [False, True]


@pytest.mark.parametrize(("mixed", "alike"), [(0.15, True), (0.27, False)])
def test_joints_whose_steps_are_nearly_proportional_moved_together(mixed, alike):
    """A correlation of 0.989 and of 0.965, where 0.98 is the border."""
    first, second = np.sin(2.0 * TIMES), np.cos(5.1 * TIMES)
    scale = np.sqrt(np.mean(np.diff(first) ** 2) / np.mean(np.diff(second) ** 2))
    both = -3.0 * (first + mixed * scale * second)
    log = log_of(first, both, second)
    assert moved_together(log, ["a", "b", "c"]) == ((("a", "b"),) if alike else ())
    assert moved_together(log, ["a"]) == ()
    assert moved_together(log_of(first, 2 * first, second, -second), list("abcd")) == (("a", "b"), ("c", "d"))
    assert moved_together(log_of(first, 0 * first), ["a", "b"]) == ()
    short = JointLog(("a", "b"), TIMES[:70], np.stack([first, first], axis=1)[:70])
    assert moved_together(short, ["a", "b"]) == ()  # seven steps say nothing
    assert moved_together(JointLog(("a", "b"), TIMES[:90], np.stack([first, first], axis=1)[:90]), ["a", "b"])


@pytest.mark.parametrize(
    ("change", "moved"),
    [
        (ImageChange(0.0, 9.0, 0.1, 1.0), False),  # the same image
        (ImageChange(0.5, 0.2, 0.1, 0.9), False),
        (ImageChange(0.5, 0.31, 0.1, 0.66), True),  # a displacement explains it
        (ImageChange(0.5, 0.29, 0.1, 0.66), False),
        (ImageChange(0.5, 0.31, 0.1, 0.64), False),
        (ImageChange(99.0, 0.0, 0.0, 0.0), True),  # so different an image is another one
    ],
)
def test_an_image_has_moved(change, moved):
    assert change.moved == moved


def test_the_noise_of_a_change_has_a_floor():
    assert ImageChange(1.0, 1.0, 0.2, 0.0).noise == 0.3
    assert ImageChange(1.0, 1.0, 0.5, 0.0).noise == 0.5


def evened(stamps, place, most=1 / 30):
    return even_time(np.array(stamps, dtype=float), place, most)


def test_an_even_clock_is_drawn_through_stamps():
    even = np.arange(9.0) / 15
    for place in range(9):
        assert evened(even, place) == pytest.approx(even[place])
    slip = even.copy()
    slip[4] += 1 / 30
    assert evened(slip, 4) == pytest.approx(even[4] + 1 / 30 / 9, abs=1e-9)  # the line's value in its middle
    assert evened(slip, 4, most=0.01) == pytest.approx(slip[4] - 0.01)
    assert evened(slip[:3], 1) == slip[1]  # too few say nothing
    assert evened(even[:4] + np.array([0, 0.01, 0, 0]), 1) != even[1] + 0.01  # four are enough


def test_an_image_that_was_lost_is_counted_in_the_grid():
    lost = np.delete(np.arange(10.0), 5) / 15
    for place in range(9):
        assert evened(lost, place) == pytest.approx(lost[place], abs=1e-9)


@pytest.mark.parametrize(("frames", "gap"), [(2.4, False), (2.6, True)])
def test_images_are_missing_after_two_and_a_half_frames(frames, gap):
    times = [0, 1, 1 + frames, 2 + frames]
    images = [
        (np.random.default_rng(k).integers(0, 255, (24, 32, 3), dtype=np.uint8), t / FPS) for k, t in enumerate(times)
    ]
    distinct = DistinctImages(images, FPS)
    found = list(distinct)
    assert [one.after_gap for one in found] == [False, False, gap, False]
    assert distinct.gaps == (pytest.approx([1 / FPS]) if gap else [])
    assert [one.time for one in found] == pytest.approx([t / FPS for t in times])
    assert not any(one.evened for one in found)
    assert distinct.images == 4


def judged(times, column):
    """Noise, excitation and whether a joint moved, by the definitions, from readings at an even rate."""
    rate = 1 / np.median(np.diff(times))
    ticks = np.array([times[0] + k / rate for k in range(int(np.ceil((times[-1] - times[0]) * rate - 1e-9)))])
    even = np.interp(ticks, times, column)
    fourth = np.convolve(even, [1.0, -4.0, 6.0, -4.0, 1.0], "valid")
    # White noise of 1 leaves a deviation of sqrt(1 + 16 + 36 + 16 + 1), a quarter of whose sizes are below 0.3186.
    noise = np.quantile(np.abs(fourth), 0.25) / (0.3186 * np.sqrt(70))
    span = round(0.2 * rate)
    change = np.sqrt(np.mean([(even[k + span] - even[k]) ** 2 for k in range(len(even) - span)]))
    step = np.sqrt(np.mean(np.diff(even) ** 2))
    found = min(change / (np.sqrt(2) * noise), 9999.0)
    return noise, found, found > 20 and len(set(column)) >= 5 and change > 1.5 * step


@pytest.mark.parametrize("rate", [30.0, 100.0])
def test_readings_at_uneven_times_are_judged_at_an_even_rate(rate):
    """A log with a hole in it: at the readings themselves a slow joint would seem to have jumped."""
    rng = np.random.default_rng(4)
    times = np.delete(np.arange(0, 10, 1 / rate), slice(int(3 * rate), int(4 * rate)))
    columns = [np.sin(2 * times), 0.3 * np.sin(0.5 * times), np.zeros(times.size), 0.2 * times]
    columns = [column + 0.004 * rng.normal(size=times.size) for column in columns]
    log = JointLog(tuple("abcd"), times, np.stack(columns, axis=1))
    for joint, column in zip(joint_motions(log), columns, strict=True):
        noise, found, moves = judged(times, column)
        assert joint.noise == pytest.approx(noise, rel=0.02)
        assert joint.excitation == pytest.approx(found, rel=0.02)
        assert joint.moves == moves
        assert (joint.low, joint.high) == (column.min(), column.max())


def test_a_log_of_few_readings():
    for count in (2, 3, 4, 5):
        times = 0.1 * np.arange(count)
        (joint,) = joint_motions(JointLog(("a",), times, (3.0 * times)[:, None]))
        assert joint.high == pytest.approx(0.3 * (count - 1))
        assert joint.noise == pytest.approx(1e-9 * 0.3 * (count - 1), rel=0.5)
        assert joint.excitation == 9999.0
        assert joint.moves == (count >= 5)
