"""What a loop does where its body may have changed, on stand-ins: when it asks, and what it makes of the answer."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_stand_ins import POSTURE, body, frame, gray, model

from dense_vs.body_model import BodyChange, ChangeKind
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.point_servo import learned_body


def change(kind=ChangeKind.JOINT, agreement=0.9, before=0.5):
    return BodyChange(
        kind, np.array([0.1, 0.0]), np.zeros(3), np.zeros(3), agreement, before, 3.0, 100, (), ("rad", "rad")
    )


@pytest.fixture
def changing(learning, monkeypatch):
    """A body that is known, what find_change is asked and says, and how much images look like the two models."""
    one, calls, result, made = learning
    asked, told = [], {"change": change()}
    after = model()
    before = model(changed=lambda found: told.update(applied=found) or after)
    one.use(before, POSTURE)
    calls.clear()

    def find_change(*given):
        asked.append(given)
        return told["change"]

    monkeypatch.setattr(learned_body, "find_change", find_change)
    likeness = {"before": lambda k: 0.4, "after": lambda k: 0.9}
    monkeypatch.setattr(
        learned_body, "agreement", lambda m, q, g: likeness["after" if m is after else "before"](int(g[0, 0]))
    )
    return SimpleNamespace(
        one=one, calls=calls, result=result, priors=made, asked=asked, told=told, before=before, after=after,
        likeness=likeness,
    )  # fmt: skip


def test_a_body_that_has_changed_is_used_as_it_is_now(changing):
    one = changing.one
    assert one.learn(POSTURE)
    ((asked, images, joints),) = changing.asked
    assert asked is changing.before
    assert len(images) == len(joints) == 45
    assert images[-1] is one._history[-1][0]
    np.testing.assert_array_equal(joints[-1], one._history[-1][1])
    assert one.model is changing.after
    assert one.change is changing.told["applied"] is changing.told["change"]
    assert [given[0] for given in changing.calls] == [changing.after]  # judged by motion, nothing is fitted
    assert changing.priors[-1].begun == [(one._pipeline.estimator, POSTURE)]
    assert not one.wanted


@pytest.mark.parametrize(
    ("kind", "agreement", "explained", "used"),
    [
        (ChangeKind.JOINT, 0.61, 0.6, True),
        (ChangeKind.JOINT, 0.59, 0.6, False),  # gains less than a tenth
        (ChangeKind.CAMERA, 0.9, 0.36, True),
        (ChangeKind.JOINTS, 0.9, 0.24, False),  # explains too little of the motion
        (ChangeKind.NOTHING, 0.9, 0.6, False),
        (ChangeKind.UNKNOWN, 0.9, 0.6, False),
    ],
)
@pytest.mark.parametrize("agrees", [True, False])
def test_what_is_no_change_leaves_a_model_that_explains_the_motion_and_replaces_another(
    changing, kind, agreement, explained, used, agrees
):
    one = changing.one
    changing.told["change"] = change(kind, agreement)
    changing.result.update(explained=explained, model=model())
    one._pipeline.prior.agrees = agrees
    learned = one.learn(POSTURE)
    if used:
        assert learned
        assert one.model is changing.after
    elif agrees:
        assert learned
        assert one.model is changing.before
        assert one.change is changing.told["change"]
        assert not any(isinstance(given[0], list) for given in changing.calls)
    else:  # fitted anew
        assert any(isinstance(given[0], list) for given in changing.calls)
        assert learned == (explained >= 0.35)
        assert one.model is (changing.result["model"] if learned else changing.before)
        assert (one.change is None) == learned


def test_whether_the_model_explains_the_motion_may_be_known_elsewhere(changing):
    changing.told["change"] = change(ChangeKind.NOTHING)
    assert changing.one.learn(POSTURE, agrees=False)
    assert changing.one.model is changing.result["model"]


@pytest.mark.parametrize(("since", "kept"), [(0, 200), (100, None), (199, None)])
def test_images_from_before_the_change_are_forgotten(changing, since, kept):
    changing.likeness["before"] = lambda k: 0.9 if k < since else 0.4
    changing.likeness["after"] = lambda k: 0.4 if k < since else 0.9
    assert changing.one.learn(POSTURE)
    left = [int(image[0, 0]) for image, _ in changing.one._history]
    assert len(left) == len(changing.one._times)
    if kept is not None:
        assert len(left) == kept
    else:  # found to a sixteenth of what is kept
        assert left[-1] == 199
        assert since - 14 <= left[0] <= since + 14


def test_of_few_images_just_those_from_before_the_change_are_forgotten(changing):
    one = changing.one
    while len(one._history) > 16:
        one._history.popleft()
        one._times.popleft()
    first = int(one._history[0][0][0, 0])
    changing.likeness["before"] = lambda k: 0.9 if k < first + 6 else 0.4
    changing.likeness["after"] = lambda k: 0.4 if k < first + 6 else 0.9
    assert one.learn(POSTURE)
    assert [int(image[0, 0]) - first for image, _ in one._history] == list(range(6, 16))
    assert len(one._times) == 10


@pytest.mark.parametrize(
    ("kind", "doubted"), [(FaultKind.SLIP, True), (FaultKind.MISFIT, True), (FaultKind.DARK, False), (None, False)]
)
def test_after_a_slip_or_a_misfit_it_is_asked_whether_the_body_has_changed(changing, kind, doubted):
    one = changing.one
    assert not one.wanted
    one.see(frame(gray(), faults=() if kind is None else (Fault(kind, "said"),)))
    one.see(frame(gray()))
    assert one.wanted == doubted
    changing.told["change"] = change(ChangeKind.NOTHING)
    assert one.learn(POSTURE)
    assert not one.wanted
    assert one.model is changing.before


def test_what_speaks_against_the_model_is_said_in_every_frame_once(changing):
    one, prior = changing.one, changing.priors[-1]
    assert one.see(frame(gray())) is None
    one._watch.doubts = "it looks like its model by 0.30, usually by 0.90"
    one._watch.latest.extend([0.3, 0.3])
    said = one.see(frame(gray()))
    assert (
        str(said) == "body changed: the body is not as it was learned: it looks like its model by 0.30, usually by 0.90"
    )
    assert not said.stops
    assert not said.holds
    assert one.see(frame(gray(), faults=(said,))) is None
    assert one.wanted
    prior.agrees, prior.agreement = False, 0.12
    assert "it explains 0.12 of what moves" in str(one.see(frame(gray())))
    changing.told["change"] = change(ChangeKind.NOTHING)
    one.learn(POSTURE, agrees=True)
    assert not one._watch.latest  # it is looked at anew before it is doubted again


def test_a_model_that_was_given_is_watched_too_and_none_where_none_is_wanted(drawn, monkeypatch):
    assert body(True).wanted
    assert not body(False).wanted
    monkeypatch.setattr(learned_body, "check_body", lambda given, expected="": given)
    given = body(model())
    assert not given.wanted
    given._watch.doubts = "it looks otherwise"
    assert given.wanted
    assert given.see(frame(gray())) is not None


def test_said_frames_teach_as_others_do():
    step = np.array([0.0, 0.01])
    said = (Fault(FaultKind.BODY, "said", stops=False, holds=False),)
    assert learned_body.teaches(frame(gray(), measured=False, faults=said, dq=step), None)
