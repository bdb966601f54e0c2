"""What is no image, no name, no bound and no stamp is refused by the watches, which stay as they were."""

from typing import Any

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.health import ImageWatch, JointWatch
from dense_vs.health.faults import Fault, FaultKind, check_faults

GRAY = np.random.default_rng(0).integers(0, 255, (24, 32)).astype(np.uint8)
MOST = np.array([0.1, 0.2])


@pytest.mark.parametrize("wrong", [[1.0], "x", None, GRAY[0], GRAY[:0], GRAY.astype(float), GRAY[..., None]])
def test_what_is_no_gray_image_is_not_judged(wrong: Any):
    watch = ImageWatch()
    with pytest.raises(DenseVSError, match=r"image .*; expected uint8 of shape \(H, W\)"):
        watch.judge(wrong, lambda: 0.0)
    nothing: Any = 1.0
    with pytest.raises(DenseVSError, match="moved_px is a float"):
        watch.judge(GRAY, nothing)
    image, fault = watch.judge(GRAY, lambda: pytest.fail("no image was seen before"))
    assert image is GRAY
    assert fault is None


@pytest.mark.parametrize("names", ["ab", [], None, 3, ["a", 1]])
def test_names_of_joints_are_texts(names: Any):
    with pytest.raises(DenseVSError, match="joint names is"):
        JointWatch(names, MOST)


@pytest.mark.parametrize(
    "bound", ["x", "1", True, 1j, 10**400, 0.0, -1.0, np.nan, [1j, 2j], [0.1], [[0.1], [0.1, 0.2]]]
)
def test_bounds_are_numbers_above_0(bound: Any):
    for bounds in ({"max_step": bound}, {"max_step": MOST, "max_speed": bound}):
        with pytest.raises(DenseVSError, match=r"max_s.*; expected a finite number above 0, or one for each joint"):
            JointWatch(("a", "b"), **bounds)


def test_a_speed_of_each_joint_bounds_its_own_readings():
    watch = JointWatch(("a", "b"), 0.1, [3.0, 30.0])
    watch.judge(np.zeros(2), 0.0, 0.0)
    assert "a changed by" in str(watch.judge(np.array([0.2, 0.2]), 1 / 30, 1 / 30)[0])
    assert watch.judge(np.array([0.0, 0.5]), 2 / 30, 2 / 30) == []


@pytest.mark.parametrize("first", [True, False])
def test_what_is_no_reading_changes_nothing(first):
    watch = JointWatch(("a", "b"), MOST)
    if not first:
        watch.judge(np.zeros(2), 0.0, 0.0)
    good = {"positions": np.zeros(2), "stamp": 0.03, "image_time": 0.03}
    wrong: dict[str, list[Any]] = {
        "positions": ["x", ["0", "0"], np.zeros(3), 0.0, [1j, 0j], [[0.0], [0.0, 1.0]], None],
        "stamp": ["x", "0.03", 1j, 10**400, True, None, [0.03]],
        "image_time": ["x", "0.03", 1j, 10**400, True, None, [0.03], np.nan, np.inf],
    }
    before = {name: np.copy(value) for name, value in vars(watch).items()}
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(DenseVSError, match="expected"):
                watch.judge(**good | {name: value})
    for step in ("x", np.zeros(3), [np.nan, 0.0], [1j, 0j]):
        with pytest.raises(DenseVSError, match=r"step .*expected"):
            watch.commanded(step)
    for name, value in vars(watch).items():
        np.testing.assert_array_equal(value, before[name], err_msg=name)
    assert watch.judge(**good) == []


@pytest.mark.parametrize("wrong", [None, "late", ["late"], Fault(FaultKind.LATE, "late"), (FaultKind.LATE,), 1])
def test_faults_of_a_frame_are_faults(wrong: Any):
    with pytest.raises(DenseVSError, match=r"faults are .*; expected a tuple of Fault"):
        check_faults(wrong)
    fault = Fault(FaultKind.LATE, "late")
    assert check_faults([fault]) == (fault,)
    assert check_faults(()) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "dark"}, "kind is 'dark'; expected one of clock, reading"),
        ({"text": 7}, "text is 7; expected words"),
        ({"stops": 1}, "stops is 1; expected True or False"),
        ({"holds": None}, "holds is None; expected True or False"),
    ],
)
def test_a_fault_is_of_its_kinds_and_says_what_it_does(change, words):
    good = {"kind": FaultKind.DARK, "text": "nothing is seen", "stops": False, "holds": True}
    assert str(Fault(**good)) == "dark image: nothing is seen"
    with pytest.raises(DenseVSError, match=words):
        Fault(**{**good, **change})
