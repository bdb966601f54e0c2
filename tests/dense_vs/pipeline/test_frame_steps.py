"""Which frames correct J, with which flow and which joint step, on an estimator that only counts what it is told."""

from types import SimpleNamespace

import numpy as np
import pytest
from counting_estimator import HEIGHT, WIDTH, Estimator, Flow, image, pipeline, run, told

from dense_vs.errors import DenseVSError
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.pipeline.frame_pipeline import scaled_size


def test_j_is_corrected_when_the_robot_has_moved_three_pixels():
    """J of 100 px/rad: steps of 0.014 rad are 1.4 px each, so every third frame corrects, by the flow since then."""
    line, estimator = pipeline()
    frames = run(line, 0.014 * np.arange(7))
    step = [0.014, 0.0]
    assert told(estimator) == [
        ("predict", step), ("predict", step), ("update", 3, step, [0.042, 0.0]),
        ("predict", step), ("predict", step), ("update", 306, step, [0.042, 0.0]),
    ]  # fmt: skip
    assert [frame.measured is not None for frame in frames] == [False, False, False, True, False, False, True]
    np.testing.assert_allclose(frames[3].measured[1], [0.042, 0.0])
    assert frames[0].dq is None
    np.testing.assert_allclose([frame.dq[0] for frame in frames[1:]], 0.014)
    np.testing.assert_allclose(line.posture, [0.084, 0.0])
    assert line.flow.asked == [(0, 3), (3, 6)]
    assert frames[2].flow[0, 0, 0] == 102  # calculated when first asked for
    assert frames[0].flow is None


@pytest.mark.parametrize(("step", "count"), [(0.0299, 2), (0.0301, 1)])
def test_a_step_of_the_baseline_corrects_at_once(step, count):
    line, estimator = pipeline()
    run(line, step * np.arange(count + 1))
    assert [call[0] for call in told(estimator)] == ["predict"] * (count - 1) + ["update"]
    assert estimator.calls[-1][3] is None or count == 2  # nothing had moved J since


@pytest.mark.parametrize(
    ("updates", "baseline", "spans", "kinds"),
    [
        (10, 3.0, True, ["predict"] * 7 + ["update"]),  # after eight frames in any case
        (9, 3.0, True, ["update"] + ["predict"] * 7),  # the tenth is the last of the first
        (50, 0.0, True, ["update"] * 8),
        (50, 3.0, False, ["update"] * 8),  # of an estimator that takes no flow over several
        (50, 0.05, True, ["update"] * 8),
    ],
)
def test_when_j_is_corrected(updates, baseline, spans, kinds):
    line, estimator = pipeline(Estimator(updates=updates, spans=spans), baseline=baseline)
    run(line, 0.001 * np.arange(9))
    assert [call[0] for call in estimator.calls] == kinds


@pytest.mark.parametrize(("steps", "moved"), [([0.0009, 0.0009, 0.0009], 0.0018), ([0.0011], 0.0011)])
def test_noise_of_a_robot_that_stands_leaves_j_as_it_is(steps, moved):
    """Below a thousandth from where J was moved to last; such a step goes with the next one's."""
    line, estimator = pipeline(still=np.array([0.001, 0.001]))
    frames = run(line, np.cumsum([0.0, *steps]))
    assert told(estimator) == [("predict", [moved, 0.0])]
    assert line.posture[0] == pytest.approx(moved)
    assert frames[1].dq[0] == pytest.approx(steps[0])
    without, counted = pipeline(Estimator(spans=False), still=np.array([0.001, 0.001]))
    run(without, [0.0, 0.0001])
    assert len(counted.calls) == 1  # such an estimator has no flow that spans several


def test_motion_is_what_nineteen_of_twenty_moving_points_do_not_exceed():
    line, estimator = pipeline()
    share = np.linspace(0, 1, len(line._grid))
    J = np.zeros((len(line._grid), 2, 2))
    J[:, 0, 0], J[:, 1, 1] = 100 * share, -40.0
    estimator.at = lambda places: J
    moved = np.maximum(10 * share, 4 * 0.5)
    assert line.motion(np.array([0.1, 0.05])) == pytest.approx(np.quantile(moved[moved > 1.0], 0.95))
    assert line.motion(np.array([0.1, 0.0])) == pytest.approx(np.quantile(10 * share[share > 0.1], 0.95))
    assert line.motion(np.zeros(2)) == 0.0
    # Every eighth pixel from the fourth on.
    assert line._grid[0].tolist() == [4, 4]
    assert line._grid[1].tolist() == [12, 4]
    assert line._grid[-1].tolist() == [60, 36]
    assert len(line._grid) == 8 * 5


@pytest.mark.parametrize(("updates", "expected"), [(30, 50 * 0.02), (31, 100 * 0.01)])
def test_how_far_the_robot_moved_is_guessed_before_j_is_learned(updates, expected):
    line, _ = pipeline(Estimator(updates=updates))
    assert line._moved(np.array([0.01, -0.02])) == pytest.approx(expected)


@pytest.mark.parametrize(("per_frame", "bridged"), [(0.075, False), (0.085, True)])
def test_far_motion_over_frames_without_use_is_by_j(monkeypatch, per_frame, bridged):
    """More than 8 px since the last image that corrected J, in more than one frame, for a live robot."""
    line, estimator = pipeline(watched=True, still=np.array([0.001, 0.001]))
    line._watch = SimpleNamespace(judge=lambda gray, moved: (gray, None), restart=lambda: None)
    line.check = None
    run(line, [0.0, 0.0005, per_frame])
    kinds = [call[0] for call in estimator.calls]
    assert kinds == (["predict"] if bridged else ["update"])
    frame = line.frame
    if bridged:
        assert frame.flow == ("by J", [round(per_frame - 0.0005, 9), 0.0])
        assert line._corrected is frame
    plain, counted = pipeline(still=np.array([0.001, 0.001]))  # of a recording
    run(plain, [0.0, 0.0005, per_frame])
    assert [call[0] for call in counted.calls] == ["update"]
    single, once = pipeline(watched=True)
    single._watch, single.check = line._watch, None
    run(single, [0.0, per_frame])
    assert [call[0] for call in once.calls] == ["update"]  # by one frame's flow


def fault(holds):
    return Fault(FaultKind.LATE, "late", holds=holds)


def test_frames_with_a_fault_that_holds_are_shown_and_not_learned_from():
    line, estimator = pipeline()
    run(line, [0.0])
    shown = line.process(image(1), 2.0, np.array([0.5, 0.0]), (fault(True),))
    assert shown.held
    assert shown.dq is None
    assert line.frame is not shown
    mild = line.process(image(2), 3.0, np.array([0.05, 0.0]), (fault(False),))
    assert not mild.held
    assert line.frame is mild
    np.testing.assert_allclose(mild.dq, [0.05, 0.0])
    assert [call[0] for call in estimator.calls] == ["update"]


def test_an_image_is_judged_by_how_far_the_robot_moved_since_the_last_one_seen():
    line, _ = pipeline(watched=True)
    moved = []

    def judge(gray, how_far):
        moved.append(how_far())
        return (gray, fault(True) if len(moved) == 2 else None)

    line._watch = SimpleNamespace(judge=judge, restart=lambda: moved.append("restart"))
    line.check = SimpleNamespace(forget_doubt=lambda: moved.append("forget"), restart=lambda: moved.append("anew"),
                                 judge=lambda *_: None)  # fmt: skip
    run(line, [0.0, 0.01, 0.03])
    line.process(image(3), 9.0, np.array([0.1, 0.0]), (fault(True),))  # a reading that is not believed
    line.process(image(4), 10.0, np.array([0.5, 0.0]))
    np.testing.assert_allclose(moved, [0.0, 1.0, 2.0, 7.0, 0.0], atol=1e-9)
    moved.clear()
    line.restart()
    assert moved == ["restart", "forget"]
    line.restart(forget=True)
    assert moved[2:] == ["restart", "forget", "anew"]
    assert line.estimator.resets == 1


@pytest.mark.parametrize("body", [True, False])
@pytest.mark.parametrize(("updates", "holds"), [(29, True), (31, True), (31, False)])
def test_motion_that_joints_do_not_explain_is_said_and_not_learned_where_it_holds(updates, holds, body):
    line, estimator = pipeline(Estimator(updates=updates), watched=True)
    line._watch = SimpleNamespace(judge=lambda gray, moved: (gray, None))
    asked, drawn = [], []
    line.check = SimpleNamespace(judge=lambda *given: asked.append(given) or fault(holds))
    if body:
        line.prior = SimpleNamespace(begin=lambda *_: None, draw=lambda e, q: drawn.append(q.tolist()),
                                     correct=lambda *_: None,
                                     doubtful=False)  # fmt: skip
    frames = run(line, [0.0, 0.05])
    known = updates > 30
    left_out = known and holds
    assert [call[0] for call in estimator.calls] == (["predict"] if left_out else ["update"])
    assert len(asked) == known
    assert drawn == ([[0.05, 0.0]] if left_out and body else [])
    assert (frames[1].measured is None) == left_out
    assert len(frames[1].faults) == known
    if known:
        flow, J, span, first, now, variance = asked[0]
        # 4 px^2/rad^2 for the first joint, which a known body leaves nothing of.
        assert variance == pytest.approx(0.0 if body else 4.0 * 0.05**2)
        assert flow.shape == (40, 2)
        assert J.shape == (40, 2, 2)
        np.testing.assert_allclose(span, [0.05, 0.0])
        assert (first, now) == (1.0, 2.0)
        assert line._corrected is frames[1]


@pytest.mark.parametrize("doubtful", [False, True])
def test_what_seems_to_cover_nearly_all_of_the_body_is_judged_too(doubtful):
    line, _ = pipeline(Estimator(updates=31, on_bad_flow="skip"), watched=True)
    line._watch = SimpleNamespace(judge=lambda gray, moved: (gray, None))
    asked = []
    line.check = SimpleNamespace(judge=lambda *given: asked.append(given) or fault(False))
    line.prior = SimpleNamespace(begin=lambda *_: None, draw=lambda *_: None, correct=lambda *_: None,
                                 uncovered=lambda e, q, flow, span: flow + np.nan, doubtful=doubtful)  # fmt: skip
    run(line, [0.0, 0.05])
    assert np.isfinite(asked[0][0]).all() == doubtful


def test_a_prior_begins_with_the_first_frame_and_corrects_with_each_update():
    line, estimator = pipeline(Estimator(on_bad_flow="skip"))
    calls = []

    def uncovered(e, q, flow, span):
        calls.append(("uncovered", q.tolist()))
        return flow + 5000

    def correct(e, q, flow, span):
        calls.append(("correct", flow[0, 0, 0], span.tolist()))

    line.prior = SimpleNamespace(
        begin=lambda e, q: calls.append(("begin", q.tolist())),
        uncovered=uncovered,
        correct=correct,
        hidden=None,
        doubtful=False,
    )
    run(line, [0.0, 0.05])
    assert calls == [("begin", [0.0, 0.0]), ("uncovered", [0.05, 0.0]), ("correct", 5001.0, [0.05, 0.0])]
    assert estimator.calls[0][1][0, 0, 0] == 5001
    assert not line.hidden.any()
    assert line.hidden.shape == (HEIGHT, WIDTH)
    covered = np.zeros((HEIGHT, WIDTH), bool)
    covered[10, 20], covered[-1, -1] = True, True
    line.prior.hidden = covered
    points = [
        (20.4, 9.6),
        (20.6, 10.0),
        (20.0, 10.6),
        (63.4, 39.4),
        (63.6, 39.0),
        (-1.0, 39.0),
        (-0.6, -0.6),
        (1e9, 5.0),
    ]
    assert [line.hidden_at(np.array(point)) for point in points] == [True, False, False, True] + [False] * 4
    refusing, _ = pipeline()
    refusing.prior = line.prior
    calls.clear()
    run(refusing, [0.0, 0.05])
    assert [call[0] for call in calls] == ["begin", "correct"]  # an estimator that takes no holes


def test_the_judge_of_predictions_is_called_before_the_update():
    line, estimator = pipeline()
    line.before_update = lambda time, flow, dq: estimator.calls.append(("judge", flow, [time], dq.tolist()))
    run(line, [0.0, 0.05])
    assert [call[0] for call in estimator.calls] == ["judge", "update"]
    assert estimator.calls[0][2:] == ([2.0], [0.05, 0.0])
    assert line.flow.asked == [(0, 1)]  # calculated once


def body(labels=None):
    seen = []
    return SimpleNamespace(
        seen=seen, fix_size=lambda *size: seen.append(("size", size)), labels=lambda J: labels,
        observe=lambda flow, span, shown: seen.append(("observe", flow.shape, span.tolist(), shown.shape)),
        submit=lambda J: seen.append(("submit", J)),
    )  # fmt: skip


def test_a_body_is_shown_smaller_images_and_j_in_their_pixels():
    labels = np.zeros((20, 32), bool)
    labels[:, :16] = True
    one = body(labels)
    line, estimator = pipeline(body=one, body_step=2)
    assert one.seen == [("size", (20, 32, 2))]
    line._body_flow = lambda first, second: np.zeros((20, 32, 2), np.float32)
    run(line, [0.0, 0.05])
    assert one.seen[1] == ("observe", (20, 32, 2), [0.05, 0.0], (20, 32))
    kind, J = one.seen[2]
    assert kind == "submit"
    whole = estimator.to_numpy()
    assert J.shape == (20, 32, 2, 2)
    np.testing.assert_array_equal(J[3, 5], whole[7, 11] / 2)
    found = line.labels()
    assert found.shape == (HEIGHT, WIDTH)
    assert found[:, :31].all()
    assert not found[:, 33:].any()
    same = body("labels")
    plain, _ = pipeline(body=same)
    assert plain._body_jacobian() == "J"
    assert plain.labels() == "labels"
    with pytest.raises(DenseVSError, match="no body to label"):
        pipeline()[0].labels()


def test_holes_of_the_flow_are_holes_of_the_body_s():
    one = body()
    line, _ = pipeline(body=one)
    usual = line.flow

    def flow(first, second):
        found = Flow.__call__(usual, first, second)
        found[:5] = np.nan
        return found

    line.flow = flow
    line._body_flow = lambda first, second: np.ones((HEIGHT, WIDTH, 2), np.float32)
    shown = []
    one.observe = lambda flow, span, image: shown.append(flow)
    run(line, [0.0, 0.05])
    assert np.isnan(shown[0][:5]).all()
    assert (shown[0][5:] == 1).all()


@pytest.mark.parametrize(("changes", "message"), [
    ({"scale": 0.0}, "scale"), ({"scale": 1.1}, "scale"), ({"baseline": -0.1}, "baseline"),
    ({"body_step": 3}, "body_step"), ({"still": np.zeros(3)}, "still"),
])  # fmt: skip
def test_options_that_cannot_be(changes, message):
    with pytest.raises(DenseVSError, match=message):
        pipeline(**changes)


def test_estimators_that_cannot_be():
    with pytest.raises(DenseVSError, match="has 2 worlds"):
        pipeline(Estimator(worlds=2))
    with pytest.raises(DenseVSError, match="flow is for images"):
        pipeline(Estimator(height=48))
    with pytest.raises(DenseVSError, match="sway with an estimator of depth"):
        pipeline(Estimator(depth=True), sway=True)
    assert pipeline(body_step=2)[0].camera_sway is None


def test_frames_that_cannot_be_change_nothing():
    line, estimator = pipeline()
    run(line, [0.0])
    for time in (1.0, 0.5, np.nan, np.inf, -(2**64), 10**400, "2", 2j, True, None):
        with pytest.raises(DenseVSError, match=r"image time stamp is .*; expected"):
            line.process(image(1), time, np.zeros(2))
    for wrong in ([[1], [2, 3]], "x", None, {"a": 1}):
        with pytest.raises(DenseVSError, match=r"image .*expected uint8"):
            line.process(wrong, 2.0, np.zeros(2))
    with pytest.raises(DenseVSError, match="image of 64 x 41 pixels"):
        line.process(np.zeros((41, WIDTH), np.uint8), 2.0, np.zeros(2))
    with pytest.raises(DenseVSError, match="without depth"):
        line.process(image(1), 2.0, np.zeros(2), depth=np.ones((HEIGHT, WIDTH), np.float32))
    assert line.frame.time == 1.0
    assert estimator.calls == []
    line.process(image(1), 1.001, np.zeros(2))


def test_depth_is_scaled_by_single_pixels_and_none_where_none_is_known():
    estimator = Estimator(depth=True)
    line, _ = pipeline(estimator, scale=0.5)
    depth = np.zeros((2 * HEIGHT, 2 * WIDTH), np.float32)
    depth[:, ::4] = 1.0
    depth[:, 2::4] = 3.0
    color = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    first = line.process(color, 1.0, np.zeros(2), depth=depth)
    assert first.depth.shape == (HEIGHT, WIDTH)
    assert set(np.unique(first.depth)) == {1.0, 3.0}
    assert first.image.shape == (HEIGHT, WIDTH, 3)
    again = line.process(color, 2.0, np.zeros(2), depth=0 * depth)
    assert again.depth is None


def test_a_size_is_scaled_to_the_nearest_pixel():
    assert scaled_size((481, 640), 0.5) == (240, 320)
    assert scaled_size((483, 641), 0.5) == (242, 320)
    assert scaled_size((10, 10), 2.0) == (20, 20)
    refused = [((0, 5), 1.0), ((5, 5), 0.0), ((5, 5), -1.0), ((5, 50), 0.1), (np.array(3), 0.5)]
    for shape, scale in refused:
        with pytest.raises(DenseVSError):
            scaled_size(shape, scale)


def test_an_image_is_never_the_camera_s_own():
    line, _ = pipeline()
    mine = image(7)
    frame = line.process(mine, 1.0, np.zeros(2))
    mine[:] = 99
    assert (frame.image == 7).all()
    assert (frame.gray == 7).all()
