"""What a loop does with one image, one reading or one command, on parts that only note what they are told."""

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.point_servo import loop as module
from dense_vs.point_servo.loop import ServoLoop
from dense_vs.point_servo.tracker import PointTracker


def fault(kind=FaultKind.POINT, stops=False):
    return Fault(kind, "words", stops=stops, holds=False)


class Frame(SimpleNamespace):
    """With all that a loop asks a frame."""


def bare(**given):
    loop = object.__new__(ServoLoop)
    loop.events = events = []
    stream = SimpleNamespace(
        delay=0.0, newest=np.array([0.5, 0.6]), reading=np.array([0.5, 0.4]), newest_time=7.5, finding=False,
        watch=SimpleNamespace(stuck=np.array([False, True]), commanded=lambda sent: events.append(("sent", sent))),
        read=lambda time: events.append(("read", time)) or (), at=lambda time: np.array([time, 0.0]),
        restart=lambda: events.append("joints"), has=lambda time: False, judge_motion=lambda frame, check: None,
        kept_at="kept",
    )  # fmt: skip
    loop.__dict__.update(
        _held=deque(), _newest=10.0, joints=stream, tracker=None, memory=None, on_frame=None,
        gate=SimpleNamespace(restart=lambda: events.append("gate")), _pace=SimpleNamespace(due=lambda time: True),
        learned_body=SimpleNamespace(see=lambda frame: events.append(("see", frame.time)), wanted=False,
                              retime=lambda *of: events.append(("retime", *of))),
        estimator=SimpleNamespace(options=SimpleNamespace(joints=2, depth=False, width=64)),
        pipeline=SimpleNamespace(restart=lambda forget=False: events.append(("pipeline", forget)), check=None),
    )  # fmt: skip
    loop._frame = loop._followed = Frame(time=10.0, faults=(), positions=np.zeros(2), gray="gray")
    loop.__dict__.update(given)
    return loop


def processing(loop):
    """The pipeline notes stamps and gives frames with the faults that it is told."""

    def process(image, time, positions, faults, depth):
        loop.events.append(("process", time, positions[0]))
        return Frame(time=time, faults=faults, positions=positions, gray=image, depth=depth)

    loop.pipeline.process = process


@pytest.mark.parametrize(("delay", "age", "late"), [
    (0.0, 0.24, False), (0.0, 0.26, True), (0.1, 0.34, False), (0.1, 0.36, True), (-0.1, 0.24, False),
    (-0.1, 0.26, True),
])  # fmt: skip
def test_nothing_is_commanded_on_an_image_that_is_old(monkeypatch, delay, age, late):
    monkeypatch.setattr(module, "MAX_AGE", 0.25)
    loop = bare(_newest=10.0 + age)
    loop.joints.delay = delay
    assert loop._waited_long() == (f"the image is {age:.3f} s old" if late else "")


@pytest.mark.parametrize(
    ("due", "stops", "commanded"), [(True, False, True), (False, False, False), (True, True, False)]
)
def test_a_step_is_chosen_when_it_is_due_and_nothing_stops_the_robot(due, stops, commanded):
    loop = bare()
    loop._pace.due = lambda time: due
    loop._frame.faults = (fault(), fault(FaultKind.DARK, stops))
    found = loop.when_due(lambda: np.array([1.0, 2.0]))
    assert found.tolist() == ([1.0, 2.0] if commanded else [0.0, 0.0])


@pytest.mark.parametrize(("gap", "anew"), [(1.99, False), (2.01, True)])
def test_after_two_seconds_without_an_image_the_loop_begins_anew(gap, anew):
    loop = bare()
    processing(loop)
    frame = loop._take("image", 10.0 + gap)
    assert ("gate" in loop.events) == anew
    assert (("pipeline", False) in loop.events) == anew
    assert frame.time == loop._newest == 10.0 + gap
    assert loop.events[-2:] == [("read", 10.0 + gap), ("process", 10.0 + gap, 10.0 + gap)]
    loop._take("image", 9.0)  # an older stamp is the pipeline's to refuse
    assert loop._newest == 10.0 + gap


def test_images_wait_for_the_readings_of_their_time():
    loop = bare()
    processing(loop)
    loop.joints.delay = 0.2
    ready = []
    loop.joints.has = lambda time: time in ready
    before = loop.frame
    image, depth = np.zeros(3), np.ones(2)
    assert loop._take(image, 10.1, depth) is before
    image[:], depth[:] = 9, 9  # a camera may reuse its buffer
    assert loop._take(np.full(3, 2.0), 10.2) is before
    ready += [10.1]
    frame = loop._take(np.full(3, 3.0), 10.3)
    assert frame.time == 10.1
    assert frame.gray.tolist() == [0, 0, 0]
    assert frame.depth.tolist() == [1, 1]
    ready += [10.2, 10.3, 10.4]
    assert loop._take(np.full(3, 4.0), 10.4).time == 10.4
    assert not loop._held
    ready.clear()
    for k in range(30):
        loop._take(np.zeros(3), 11.0 + 0.01 * k)
    assert len(loop._held) == 30
    assert loop._take(np.zeros(3), 12.0).time == 11.0  # of thirty-one the first is not waited with any longer


def test_images_that_wait_come_before_the_next_one_when_there_is_no_delay_any_more():
    loop = bare()
    processing(loop)
    loop.joints.delay = 0.2
    loop._take(np.zeros(3), 10.1)
    loop.joints.delay, loop.joints.has = 0.0, lambda time: time <= 10.2
    assert loop._take(np.zeros(3), 10.2).time == 10.2
    assert [event[1] for event in loop.events if event[0] == "process"] == [10.1, 10.2]
    assert not loop._held


def commanding(loop, faults=()):
    """A camera, and a gate that sends half of what it is given."""
    processing(loop)

    def send(delta, reading, **named):
        assert reading is loop.joints.reading  # limits are the encoder's
        loop.events.append(("send", delta.tolist(), named))
        return delta / 2

    loop.gate.send = send
    loop.camera = SimpleNamespace(read=lambda: ("image", 10.1))
    loop.joints.read = lambda time: faults


def test_a_step_leaves_out_joints_that_do_not_move_and_says_why_nothing_may_be_sent(monkeypatch):
    loop = bare()
    commanding(loop)
    called = []
    loop.on_frame = lambda given: called.append(given.frame.time)
    loop._frame.faults = (fault(FaultKind.DARK, True), fault(), fault(FaultKind.FROZEN, True))
    frame = loop.step(np.array([0.1, 0.2]))
    kind, delta, named = loop.events[0]
    assert (kind, delta) == ("send", [0.1, 0.0])
    assert named == {"image_time": 10.0, "now": 10.0, "reading_time": 7.5,
                     "stop": f"{fault(FaultKind.DARK, True)}; {fault(FaultKind.FROZEN, True)}"}  # fmt: skip
    assert loop.events[1][1].tolist() == [0.05, 0.0]  # what was sent
    assert ("see", 10.1) in loop.events
    assert called == [10.1]
    assert frame.time == 10.1
    loop._held.append(("image", 1.0, None, ()))
    loop._newest = 11.0
    loop.events.clear()
    loop.step(np.zeros(2))
    assert loop.events[0][2]["image_time"] is None  # images wait: their age is told in words
    assert loop.events[0][2]["stop"] == "the image is 0.900 s old"


@pytest.mark.parametrize("kind", [None, FaultKind.DARK, FaultKind.FROZEN, FaultKind.POINT])
def test_a_point_is_followed_in_images_that_show_something(kind):
    loop = bare(tracker="tracker")
    commanding(loop, () if kind is None else (fault(kind),))
    followed = []
    loop._follow_point = lambda tracker, frame: followed.append((tracker, frame.time))
    loop.step(np.zeros(2))
    shows = kind not in (FaultKind.DARK, FaultKind.FROZEN)
    assert followed == [("tracker", 10.1)] * shows
    assert (("see", 10.1) in loop.events) == shows
    loop._followed = loop._frame
    loop._take = lambda *_: loop._frame
    followed.clear()
    loop.step(np.zeros(2))
    assert followed == []  # an image that is there already


@pytest.mark.parametrize("doubt", [None, Fault(FaultKind.BODY, "it looks otherwise", stops=False, holds=False)])
def test_what_speaks_against_the_body_is_said_in_the_same_frame(monkeypatch, doubt):
    monkeypatch.setattr(module, "replace", lambda frame, **anew: Frame(**{**vars(frame), **anew}))
    loop = bare()
    commanding(loop)
    loop.learned_body.see = lambda frame: doubt
    frame = loop.step(np.zeros(2))
    assert frame is loop.frame
    assert frame.faults == (() if doubt is None else (doubt,))


@pytest.mark.parametrize("why", ["", "it is covered"])
def test_a_point_that_is_not_seen_is_said(monkeypatch, why):
    loop = bare()
    asked, moved = [], []
    monkeypatch.setattr(module, "follow", lambda *given: asked.append(given) or why)
    monkeypatch.setattr(module, "replace", lambda frame, **anew: Frame(**{**vars(frame), **anew}))
    loop._point_flow, loop.renew_patch = "flow", 0.9
    loop.aim = SimpleNamespace(update=lambda point, dq, depth: moved.append((point, dq.tolist(), depth)))
    loop.tracker = SimpleNamespace(points=["place"])
    last = loop._followed
    dark = (fault(FaultKind.DARK),)
    frame = loop._frame = Frame(time=10.1, faults=dark, positions=np.array([0.3, 0.0]), depth="depth")
    loop._follow_point(loop.tracker, frame)
    assert asked == [(loop.tracker, loop.pipeline, "flow", last, frame, 0.9)]
    assert moved == [("place", [0.3, 0.0], "depth")]
    kinds = [one.kind for one in loop.faults]
    assert kinds == [FaultKind.DARK] + [FaultKind.POINT] * bool(why)
    assert loop._followed is loop._frame  # so that it is not followed twice
    if why:
        assert loop.faults[1] == Fault(FaultKind.POINT, why, stops=False, holds=False)
    loop._followed = "another"
    loop._say(fault())
    assert loop._followed == "another"


@pytest.mark.parametrize("late", [None, fault(FaultKind.LATE)])
def test_a_delay_that_changed_is_taken_out_of_what_was_seen(monkeypatch, late):
    loop = bare()
    monkeypatch.setattr(module, "replace", lambda frame, **anew: Frame(**{**vars(frame), **anew}))
    processing(loop)
    asked = []
    loop.joints.judge_motion = lambda frame, check: asked.append((frame.time, check)) or (late and (late, 9.5))
    check = loop.pipeline.check = SimpleNamespace()
    given = (fault(FaultKind.MISFIT),)
    loop._process("image", 10.1, None, given)
    assert asked == [(10.1, check)]
    changed = late is not None
    assert loop.faults == ((*given, late) if changed else given)
    assert (("retime", "kept", 9.5) in loop.events) == (("pipeline", False) in loop.events) == changed
    loop.pipeline.check = None
    asked.clear()
    loop._process("image", 10.2, None, given)
    assert asked == []


def test_babbling_lasts_so_long_and_lets_what_waits_catch_up():
    loop = bare()
    shares, steps = [], []
    loop.pipeline.check = SimpleNamespace()
    loop._judge_motion = shares.append

    def once():
        loop._frame = Frame(time=loop.frame.time + 0.25, faults=(), positions=np.zeros(2))
        loop._held.append(1)

    loop.babble_once = once

    def step(delta):
        steps.append(delta.tolist())
        if len(loop._held) > 2:
            loop._held.popleft()

    loop.step = step
    learned = []
    loop.learn_body = lambda: learned.append(loop.frame.time)
    loop.babble(1.0)
    assert loop.frame.time == 11.0
    assert shares == [module.BABBLING_SHARE, module.LEAST_SHARE]
    assert steps == [[0.0, 0.0]] * 3  # the third leaves as many as there were
    assert learned == []
    loop.learned_body.wanted = True
    loop.babble(0.3)
    assert learned == [11.5]
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(DenseVSError, match="expected a finite number above 0"):
            loop.babble(wrong)


def test_babbling_is_paced_by_the_last_frame_timed_by_its_stamp_and_kept_inside_the_limits(monkeypatch):
    loop, asked = bare(), []
    monkeypatch.setattr(module, "pacing_flow", lambda pipeline, frame: (pipeline, frame))
    loop.babbling = SimpleNamespace(step=lambda *given: asked.append(given) or np.array([0.5, -0.5]))
    loop.group = SimpleNamespace(clip_step=lambda step, q: (step.tolist(), q))
    assert loop._babbling_step() == ([0.5, -0.5], loop.frame.positions)
    assert asked == [((loop.pipeline, loop.frame), loop.frame.time)]


@pytest.mark.parametrize("finding", [False, True])
@pytest.mark.parametrize(
    ("frames", "forgotten"), [(0.0, None), (0.39, False), (-0.39, False), (0.41, True), (-1.0, True)]
)
def test_learning_begins_anew_when_a_delay_is_found(finding, frames, forgotten):
    """A change of less than two fifths of a frame costs little, and J is kept."""
    loop = bare()
    loop.joints.watch.frame_time = 0.05
    loop.joints.finding, loop.joints.find_delay = finding, lambda frame: frames * 0.05
    loop.step, loop._babbling_step = lambda delta: (delta.tolist(), "frame"), lambda: np.array([0.1, 0.1])
    assert loop.babble_once() == ([0.1, 0.1], "frame")
    restarts = [event for event in loop.events if event[0] == "pipeline"]
    assert restarts == ([("pipeline", forgotten)] if finding and forgotten is not None else [])
    assert (("retime", "kept") in loop.events) == bool(restarts)


def test_what_is_forgotten_with_the_camera(monkeypatch):
    loop = bare(_learns_body=True, group="group")
    loop.pipeline.prior = "prior"
    monkeypatch.setattr(module, "LearnedBody", lambda *given: given)
    loop.forget()
    assert loop.events == [("pipeline", True)]
    assert loop.pipeline.prior is None
    assert loop.learned_body == (loop.pipeline, "group", True)
    commanding(loop)
    loop.events.clear()
    loop.resume()
    assert loop.events[:3] == ["joints", "gate", ("pipeline", False)]
    assert loop._newest == 10.1


@pytest.mark.parametrize("method", ["link", "aligned", "paper"])
def test_a_point_is_defined_with_its_memory(monkeypatch, method):
    loop = bare()
    followed = []
    loop.aim = SimpleNamespace(follow=followed.append)
    monkeypatch.setattr(module, "patch_weights", lambda pipeline, point, window: (pipeline, *point, window))
    monkeypatch.setattr(module, "new_tracker", lambda memory, frame, body: SimpleNamespace(points=["p"], body=body))
    loop._followed = None
    loop.define_point([5.0, 6.0], method=method, window=31)
    memory = loop.memory
    assert memory.place.tolist() == [5.0, 6.0]
    assert memory.weights == (loop.pipeline, 5.0, 6.0, 31)
    assert memory.options == {"method": "aligned" if method == "link" else method, "window": 31,
                              "min_correlation": 0.85, "max_jump": 2.5, "lost_after": 15}  # fmt: skip
    assert (loop.tracker.body is loop.learned_body) == (method == "link")
    assert loop._followed is loop.frame
    assert followed == ["p"]


@pytest.mark.parametrize("found", [None, "link", "patch"])
@pytest.mark.parametrize("wanted", [False, True])
@pytest.mark.parametrize("by_link", [False, True])
def test_a_point_found_again_is_followed_by_its_link_where_it_can_be_and_was_to_be(monkeypatch, found, wanted, by_link):
    loop = bare(memory=SimpleNamespace(by_link=by_link, options={"method": "aligned", "window": 31}), tracker="before")
    followed, defined = [], []
    loop.aim = SimpleNamespace(follow=followed.append)
    given = None
    if found is not None:
        given = object.__new__(PointTracker) if found == "patch" else SimpleNamespace(points=["p"])
        if found == "patch":
            monkeypatch.setattr(PointTracker, "points", ["p"])
    monkeypatch.setattr(module, "found_again", lambda memory, tracker, frame: given)
    loop.learned_body.wanted, asked = wanted, []
    loop.learned_body.learn = lambda positions, **told: asked.append((positions, told)) or True
    loop.define_point = lambda point, **options: defined.append((point, options))
    assert loop.find_again() == (found is not None)
    assert asked == [(loop.frame.positions, {"reaching": True})] * (found == "patch" and wanted and by_link)
    assert loop.tracker is (given if found else "before")
    assert followed == ["p"] * (found is not None)
    assert defined == [("p", {"method": "link", "window": 31})] * (found == "patch" and wanted and by_link)
    loop.memory = None
    assert not loop.find_again()


def test_the_servo_goes_on_from_where_the_robot_is_by_now(monkeypatch):
    loop = bare(tracker=SimpleNamespace(points=["p"]), servo="servo")
    loop._frame.positions = np.array([0.2, 0.2])
    monkeypatch.setattr(module, "point_jacobian", lambda tracker, line, q: ("J", q.tolist()))
    asked = []
    loop.aim = SimpleNamespace(step=lambda *given: asked.append(given) or "step")
    assert loop.servo_step() == "step"
    servo, point, J, moved, q, stuck = asked[0]
    assert (servo, point, J) == ("servo", "p", ("J", [0.2, 0.2]))
    np.testing.assert_allclose(moved, [0.3, 0.4])
    assert q.tolist() == [0.5, 0.6]
    assert stuck.tolist() == [False, True]
    with pytest.raises(DenseVSError, match="no point is defined"):
        _ = bare().point
    with pytest.raises(DenseVSError, match="no point is defined"):
        bare().servo_step()
