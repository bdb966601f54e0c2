"""What the measurement of changes lets happen to a body, and what it asks afterwards: on stand-ins."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import body_changes
from body_scores import BodyScore
from change_scores import ChangeScore
from textured_arm import TexturedArm, postures

from dense_vs.body_model import BodyChange, ChangeKind
from dense_vs.errors import DenseVSError

ASKED = BodyScore("panda", "A", "clean", 3)
OPTIONS = SimpleNamespace(device="cpu", joints=3, seconds=1.0)
IMAGE = np.arange(12, dtype=np.uint8).reshape(3, 4)


@pytest.fixture
def days(monkeypatch):
    """The cases of a body of three joints; what worlds were made for them."""
    made = []

    def day(asked, options, box, moved):
        made.append(moved)
        return [IMAGE], np.zeros((1, 3)), [f"truth {len(made)}"]

    monkeypatch.setattr(body_changes, "day", day)
    return [*body_changes.days(ASKED, OPTIONS, (None, None))], made


def test_one_thing_after_the_other_changes(days):
    cases, made = days
    assert [case.kind for case, *_ in cases] == ["nothing", *["joint"] * 3, "joints", "unknown", "camera", "camera"]
    for n, (case, images, joints, truth) in enumerate(cases[1:4]):
        assert np.flatnonzero(case.offsets).tolist() == [n]
        assert abs(case.offsets[n]) == body_changes.OFFSETS[(n + 3) % 4]
        assert images[0] is IMAGE
        assert not joints.any()
        assert truth == ["truth 1"]
    assert len(np.flatnonzero(cases[4][0].offsets)) == 3
    np.testing.assert_array_equal(cases[5][1][0], IMAGE[:, ::-1])
    for (case, _, _, truth), moved, told in zip(cases[6:], made[1:], ("truth 2", "truth 3"), strict=True):
        assert (case.position, case.angle) == (moved.camera_position, moved.camera_angle)
        assert case.angle > 0.02
        assert truth == [told]
    assert made[0] is None
    for case in (cases[0], *cases[5:]):
        assert not case[0].offsets.any()


def test_another_day_is_another_babbling_of_the_same_robot(monkeypatch):
    asked, gone = [], []
    world = SimpleNamespace(
        joints=lambda: (np.full(3, 0.1), 0), true_jacobian=lambda: "J", robot_mask=lambda: "mask"
    )  # fmt: skip
    monkeypatch.setattr(body_changes, "make_world", lambda *given, **more: asked.append((given, more)) or world)
    monkeypatch.setattr(
        body_changes, "babble", lambda *given: asked.append(given) or SimpleNamespace(images="i", joints="q")
    )
    monkeypatch.setattr(body_changes, "go_to", lambda world, q: gone.append(q))
    monkeypatch.setattr(body_changes, "rest", lambda world: gone.append("rest"))
    low, high = np.full(3, -0.2), np.full(3, 0.5)
    images, joints, truth = body_changes.day(ASKED, OPTIONS, (low, high), "moved")
    assert asked == [((ASKED, OPTIONS), {"randomization": "moved"}), (world, 1003, body_changes.DAY)]
    assert (images, joints) == ("i", "q")
    assert [one[1:] for one in truth] == [("J", "mask")] * body_changes.POSTURES
    assert gone[1::2] == ["rest"] * body_changes.POSTURES
    assert all(((low <= q) & (q <= high)).all() for q in gone[::2])
    assert len({q[0] for q in gone[::2]}) == body_changes.POSTURES


@pytest.fixture(scope="module")
def arm():
    one = TexturedArm()
    return one, one.model()


def truth_of(model):
    return [(q, model.jacobian(q), model.image(q).body) for q in postures(2)]


def test_the_error_asked_is_that_of_the_postures_whatever_readings_say(arm):
    _, model = arm
    offsets, none = np.array([0.1, -0.05, 0.2]), np.zeros(3)
    assert body_changes.error_of(model, none, truth_of(model)) == pytest.approx(0, abs=1e-5)
    off = body_changes.error_of(model, offsets, truth_of(model))  # the model does not know of them
    assert off > 0.05
    change = BodyChange(ChangeKind.JOINTS, offsets, none, none, 1.0, 1.0, 0.0, 0, (), ("rad",) * 3)
    assert body_changes.error_of(model.changed(change), offsets, truth_of(model)) < 0.01 * off
    with pytest.raises(DenseVSError):
        body_changes.error_of(model, none, [(np.zeros(2), None, None)])


def test_a_change_is_judged_with_its_readings_as_they_are(arm, monkeypatch):
    _, model = arm
    offsets, none = np.array([0.0, 0.1, 0.0]), np.zeros(3)
    found = BodyChange(ChangeKind.JOINT, 0.9 * offsets, none, none, 0.9, 0.4, 5.0, 100, (), ("rad",) * 3)
    asked = []
    monkeypatch.setattr(body_changes, "find_change", lambda *given: asked.append(given) or found)
    case = body_changes.Case(ChangeKind.JOINT, offsets)
    score = body_changes.judged(ASKED, case, model, ["images"], "readings", truth_of(model))
    assert asked == [(model, ["images"], "readings")]
    assert (score.arm, score.camera, score.images, score.seed) == ("panda", "A", "clean", 3)
    assert (score.changed, score.found, score.named, score.among) == ("joint", "joint", True, True)
    assert score.offset == 0.1
    assert score.offset_error == pytest.approx(0.01)
    assert (score.off, score.agreement_before, score.agreement) == (5.0, 0.4, 0.9)
    assert score.before > 2 * score.after > 0


def test_a_body_is_learned_once_and_asked_with_every_case(monkeypatch):
    seen = SimpleNamespace(images="images", joints=np.array([[0.0, 1], [0.5, -1]]))
    world, model = object(), object()
    monkeypatch.setattr(body_changes, "make_world", lambda asked, options: world)
    monkeypatch.setattr(body_changes, "babble", lambda *given: seen if given == (world, 3, 1.0) else None)
    monkeypatch.setattr(body_changes.BodyModel, "fit", lambda images, joints: model)
    boxes = []

    def days(asked, options, box):
        boxes.append(box)
        for value in (0.0, 0.1):
            yield body_changes.Case(ChangeKind.JOINT, np.array([0, value])), "those", np.zeros((1, 2)), "truth"

    monkeypatch.setattr(body_changes, "days", days)
    monkeypatch.setattr(body_changes, "judged", lambda *given: given)
    first, second = body_changes.measure(ASKED, OPTIONS)
    np.testing.assert_array_equal(boxes, [[[0.0, -1], [0.5, 1]]])
    assert first[2] is second[2] is model
    np.testing.assert_array_equal(first[4], [[0, 0]])
    np.testing.assert_array_equal(second[4], [[0, 0.1]])  # readings are larger by the offsets
    assert second[5] == "truth"

    def none(images, joints):
        raise DenseVSError("too few tracks")

    monkeypatch.setattr(body_changes.BodyModel, "fit", none)
    (failed,) = body_changes.measure(ASKED, OPTIONS)
    assert failed.failure == "too few tracks"
    assert failed.body == ASKED.name


def test_every_body_is_measured_once_and_kept_as_it_comes(monkeypatch, capsys, tmp_path):
    measured, reported = [], []

    def measure(asked, options):
        measured.append(asked.name)
        kinds = ("nothing", "joint")
        return [
            ChangeScore(asked.arm, asked.camera, asked.images, asked.seed, kind, kind, True, True) for kind in kinds
        ]

    monkeypatch.setattr(body_changes, "measure", measure)
    monkeypatch.setattr(body_changes, "report", lambda *given, **content: reported.append((given, content)) or 4)
    words = f"--arms arm,panda --images clean,realistic --seeds 0,2 --json {tmp_path / 'changes.json'}"
    monkeypatch.setattr(sys, "argv", ["body_changes.py", *words.split()])
    assert body_changes.main() == 4
    assert len(measured) == len(set(measured)) == 12
    stored = json.loads((tmp_path / "changes.json").read_text())
    assert stored["finished"]
    assert len(stored["rows"]) == 24
    assert stored["arguments"]["images"] == "clean,realistic"
    ((metrics, _), content), = reported  # fmt: skip
    assert {metric.name for metric in metrics} >= {"body_changes/nothing/named", "body_changes/joint/named"}
    assert content["finished"]
    assert not body_changes.content({"one": []}, 2)["finished"]
    assert "named rightly" in capsys.readouterr().out


@pytest.mark.parametrize(("words", "error"), [("--images foggy", "--images has foggy"), ("--jobs 0", "at least 1")])
def test_wrong_options_are_said_before_anything_is_measured(monkeypatch, capsys, words, error):
    monkeypatch.setattr(sys, "argv", ["body_changes.py", *words.split()])
    with pytest.raises(SystemExit):
        body_changes.main()
    assert error in capsys.readouterr().err
