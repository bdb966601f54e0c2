"""The delay of joint readings is found from the motion that they explain, and none is invented."""

import numpy as np
import pytest

from dense_vs import Babbling
from dense_vs.recording.joint_delay import (
    DelayCurve,
    babbling_curve,
    find_changed_delay,
    find_joint_delay,
    find_jumped_delay,
)

FRAME, COUNT, JOINTS = 1 / 30, 70, 4


@pytest.fixture(scope="module", params=[0, 1, 2])
def motion(request):
    """Joint positions at 300 readings a second, and noisy flow of 40 pixels between frames at 30 a second."""
    rng = np.random.default_rng(request.param)
    babbling = Babbling(JOINTS, seed=request.param)
    coarse = np.cumsum([babbling.step() for _ in range(COUNT + 10)], axis=0)
    times = np.arange(0, (COUNT + 9) * FRAME, 1 / 300)
    frames = np.arange(COUNT + 10) * FRAME
    positions = np.stack([np.interp(times, frames, joint) for joint in coarse.T], axis=1)
    image_times = frames[3 : COUNT - 3]
    at = np.stack([np.interp(image_times, frames, joint) for joint in coarse.T], axis=1)
    flow = np.diff(at, axis=0) @ rng.normal(0, 80, (JOINTS, 80))
    pairs = np.column_stack([image_times[:-1], image_times[1:]])
    return flow + rng.normal(0, 0.2, flow.shape), pairs, times, positions


def told(flow, pairs, times, positions):
    curve = babbling_curve(flow, pairs, times, positions, FRAME)
    return find_joint_delay([] if curve is None else [curve], FRAME)


@pytest.mark.parametrize("delay", [-1.6, -0.75, 0.0, 0.5, 1.0, 2.25])
def test_finds_the_delay(motion, delay):
    flow, pairs, times, positions = motion
    found = told(flow, pairs, times + delay * FRAME, positions)
    assert found == pytest.approx(delay * FRAME, abs=0.05 * FRAME)


@pytest.mark.parametrize("delay", [-0.75, 1.0])
def test_finds_it_where_images_are_left_out(motion, delay):
    flow, pairs, times, positions = motion
    used = np.arange(len(pairs)) % 7 != 3
    found = told(flow[used], pairs[used], times + delay * FRAME, positions)
    assert found == pytest.approx(delay * FRAME, abs=0.1 * FRAME)


@pytest.mark.parametrize("delay", [-1.6, -0.75, 0.0, 1.0, 2.25])
def test_finds_it_in_rough_readings_of_the_image_rate_whatever_their_unit(motion, delay):
    flow, pairs, times, positions = motion
    noise = np.random.default_rng(5).normal(0, 1e-3, positions[3::10].shape)
    rough = np.round((positions[3::10] + noise) / 0.002) * 0.002 * np.array([1e3, 1e-3, 57.3, 1.0])
    found = told(flow, pairs, times[3::10] + delay * FRAME, rough)
    assert found == pytest.approx(delay * FRAME, abs=0.2 * FRAME)


def test_noise_has_no_delay(motion):
    _, pairs, times, positions = motion
    flow = np.random.default_rng(9).normal(size=(len(pairs), 200))
    assert told(flow, pairs, times, positions) is None


def test_a_robot_that_stands_still_has_none(motion):
    flow, pairs, times, positions = motion
    for still in (0.0, 0.4, -1e6):
        assert told(flow, pairs, times, np.full_like(positions, still)) is None


def curve_of(best, depth, lowest=1.0):
    """As a part of a babbling gives it: least at a delay in frames, by a share of what is left elsewhere."""
    frames = np.arange(-8, 13) / 4
    return DelayCurve(frames * FRAME, lowest * np.exp(-depth * np.maximum(0, 1 - ((frames - best) / 2) ** 2)))


def test_parts_of_a_babbling_tell_the_delay_together():
    """The clearer one has more to say, whatever either leaves unexplained; equal ones agree on their middle."""
    both = find_joint_delay([curve_of(0.75, 0.5), curve_of(1.25, 0.5, 40.0)], FRAME)
    assert both == pytest.approx(1.0 * FRAME, abs=0.01 * FRAME)
    one_clear = find_joint_delay([curve_of(0.75, 0.2), curve_of(1.25, 0.8)], FRAME)
    assert one_clear == pytest.approx(1.15 * FRAME, abs=0.01 * FRAME)
    assert find_joint_delay([curve_of(1.7, 0.6)], FRAME) == pytest.approx(1.7 * FRAME, abs=0.02 * FRAME)
    assert find_joint_delay([curve_of(1.0, 0.03), curve_of(1.0, 0.03)], FRAME) is None
    assert find_joint_delay([], FRAME) is None


PLACES = 150


def known(seed, frames, count=12):
    """Motion of a robot with a learned J, half of its places beside it, whose readings are that many frames behind."""
    rng = np.random.default_rng(seed)
    noise, steps = np.zeros(JOINTS), []
    for _ in range(200):
        noise = 0.85 * noise + rng.normal(0, 0.006, JOINTS)
        steps.append(noise)
    q, times = np.cumsum(steps, axis=0), np.arange(200) * FRAME

    def at(time):
        return np.array([np.interp(time, times, joint) for joint in q.T])

    true = rng.normal(0, 60, (PLACES, 2, JOINTS))
    true[PLACES // 2 :] = 0.0
    learned = true * (1 + 0.1 * rng.normal(size=true.shape))
    pairs = np.stack([times[100 : 100 + count], times[101 : 101 + count]], axis=1)
    seen = [at(end + frames * FRAME) - at(begin + frames * FRAME) for begin, end in pairs]
    flows = [true @ step + rng.normal(0, 0.15, (PLACES, 2)) for step in seen]
    return flows, [learned] * count, pairs, times, q


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("frames", [-5.3, -3.0, -2.0, -1.5, 2.0, 2.6])
def test_a_delay_that_changed_is_found_by_j(seed, frames):
    found = find_changed_delay(*known(seed, frames), now=0.0, frame_time=FRAME)
    assert found == pytest.approx(frames * FRAME, abs=0.1 * FRAME)
    assert find_changed_delay(*known(seed, frames), now=frames * FRAME, frame_time=FRAME) is None
    assert find_changed_delay(*known(seed, 0.0), now=frames * FRAME, frame_time=FRAME) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_flow_that_fails_grossly_does_not_outweigh_the_others(seed):
    flows, *rest = known(seed, -3.0)
    flows[5] = np.random.default_rng([seed, 2]).normal(0, 30, flows[5].shape)
    assert find_changed_delay(flows, *rest, now=0.0, frame_time=FRAME) == pytest.approx(-3 * FRAME, abs=0.1 * FRAME)


@pytest.mark.parametrize("seed", range(4))
def test_motions_of_which_nothing_was_seen_do_not_count(seed):
    flows, jacobians, *rest = known(seed, -3.0)
    covered = [k % 3 == 1 for k in range(len(flows))]
    some = [flow[:0] if gone else flow for flow, gone in zip(flows, covered, strict=True)]
    theirs = [J[:0] if gone else J for J, gone in zip(jacobians, covered, strict=True)]
    found = find_changed_delay(some, theirs, *rest, now=0.0, frame_time=FRAME)
    assert found == pytest.approx(-3 * FRAME, abs=0.1 * FRAME)
    nothing = [flow[:0] for flow in flows[3:]]
    mostly = [*flows[:3], *nothing], [*jacobians[:3], *(J[:0] for J in jacobians[3:])]
    assert find_changed_delay(*mostly, *rest, now=0.0, frame_time=FRAME) is None


@pytest.mark.parametrize("seed", range(4))
def test_an_image_that_stays_has_no_delay(seed):
    flows, *rest = known(seed, 2.0)
    frozen = [np.random.default_rng(seed).normal(0, 0.15, flow.shape) for flow in flows]
    assert find_changed_delay(frozen, *rest, now=0.0, frame_time=FRAME) is None


@pytest.mark.parametrize("seed", range(4))
def test_neither_noise_nor_few_motions_nor_a_still_robot_change_it(seed):
    flows, jacobians, pairs, times, q = known(seed, 2.0)
    rng = np.random.default_rng(seed)
    noise = [rng.normal(0, 3, flow.shape) for flow in flows]
    assert find_changed_delay(noise, jacobians, pairs, times, q, now=0.0, frame_time=FRAME) is None
    few = flows[:3], jacobians[:3], pairs[:3]
    assert find_changed_delay(*few, times, q, now=0.0, frame_time=FRAME) is None
    assert find_changed_delay(flows, jacobians, pairs, times, 0 * q, now=0.0, frame_time=FRAME) is None


def jumped(seed, frames, now=0.0, spans=1):
    """The motion from an image that is on time, by what is known, to one that shows so many frames later than that."""
    _, (learned, *_), _, times, q = known(seed, 0.0)
    rng = np.random.default_rng([seed, 3])

    def at(time):
        return np.array([np.interp(time, times, joint) for joint in q.T])

    speed = np.linalg.norm(q[106:180] - q[100:174], axis=1)
    begin = times[103 + int(speed.argmax())]  # where it goes fast, or two times look alike
    end = begin + spans * FRAME
    step = at(end + now + frames * FRAME) - at(begin + now)
    robot = np.arange(PLACES) < PLACES // 2
    true = np.where(robot[:, None, None], learned, 0.0)
    return true @ step + rng.normal(0, 0.15, (PLACES, 2)), learned, (begin, end), times, q


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize(("frames", "spans"), [(-3.0, 1), (-2.0, 1), (-4.4, 3), (3.0, 1), (2.0, 2)])
def test_an_image_that_is_late_is_noticed_by_its_own_motion(seed, frames, spans):
    for now in (0.0, 2 * FRAME, -3 * FRAME):
        found = find_jumped_delay(*jumped(seed, frames, now, spans), now=now, frame_time=FRAME)
        expected = now + frames * FRAME if abs(now + frames * FRAME) > 1e-6 else 0.0
        assert found == pytest.approx(expected, abs=0.35 * FRAME)


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_an_image_that_came_twice_or_moved_otherwise_has_not_jumped(seed):
    options = {"now": 0.0, "frame_time": FRAME}
    assert find_jumped_delay(*jumped(seed, 0.0), **options) is None
    assert find_jumped_delay(*jumped(seed, -1.0), **options) is None
    flow, *rest = jumped(seed, -3.0)
    rng = np.random.default_rng(seed)
    assert find_jumped_delay(flow + np.array([5.0, 2.0]), *rest, **options) is None  # the camera was bumped
    assert find_jumped_delay(rng.normal(0, 4, flow.shape), *rest, **options) is None
    assert find_jumped_delay(np.zeros_like(flow), *rest, **options) is None
    assert find_jumped_delay(flow[:11], rest[0][:11], *rest[1:], **options) is None
    learned, pair, times, q = rest
    assert find_jumped_delay(flow, learned, pair, times, 0 * q, **options) is None
    joint = np.zeros(JOINTS)
    joint[1] = 0.05  # one that the readings do not know of
    assert find_jumped_delay(learned @ joint, learned, pair, times, q * [1, 0, 1, 1], **options) is None


def test_a_way_that_has_been_gone_before_is_no_jump_where_the_present_one_explains_the_motion_too():
    """A clean babbling before a plain Fetch had its images 5 frames late so, for good, from one motion alone."""
    rng = np.random.default_rng(0)
    learned, direction = rng.normal(0, 80, (PLACES, 2, JOINTS)), rng.normal(0, 1, JOINTS)
    times = np.arange(0, 44) * FRAME
    forth = 0.02 * (np.arange(44) - 40)
    back = -1.2 * forth  # J is 10 % off in between
    q = np.where(forth > 0, forth, back)[:, None] * direction
    pair = times[41], times[43]
    flow = 1.1 * learned @ (q[43] - q[41]) + rng.normal(0, 0.15, (PLACES, 2))
    assert find_jumped_delay(flow, learned, pair, times, q, now=0.0, frame_time=FRAME) is None
    found = find_jumped_delay(learned @ (q[40] - q[41]), learned, pair, times, q, now=0.0, frame_time=FRAME)
    assert found == pytest.approx(-3 * FRAME, abs=0.2 * FRAME)


def test_what_comes_later_than_the_readings_is_not_asked_for():
    flow, learned, pair, times, q = jumped(3, 3.0)
    known = times <= pair[1] + 1e-6
    assert find_jumped_delay(flow, learned, pair, times[known], q[known], now=0.0, frame_time=FRAME) is None
    assert find_jumped_delay(flow, learned, pair, times, q, now=0.0, frame_time=FRAME) is not None
