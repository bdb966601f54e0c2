"""Which joints moved, and which always moved together, whatever their units."""

import numpy as np
import pytest

from dense_vs import JointLog
from dense_vs.recording.survey import joint_motions, moved_together
from dense_vs.view.advice import advice


@pytest.fixture
def log():
    random = np.random.default_rng(2)
    times = np.arange(0, 10, 0.01)
    swing, sway = np.sin(1.7 * times), np.sin(1.1 * times + 1) + 0.3 * np.sin(2.9 * times)
    noise = 1e-4 * random.normal(size=(6, len(times)))
    columns = {
        "elbow": swing + noise[0],
        "wrist_deg": 57.3 * (0.5 * swing + noise[1]),
        "base_counts": np.round(8000 * (sway + noise[2])),
        "still": np.full(len(times), 0.3),
        "shivers": 0.2 + noise[4],
        "toggles": np.where(random.uniform(size=len(times)) > 0.5, 12.0, 13.0),
    }
    return JointLog(tuple(columns), times, np.stack(list(columns.values()), axis=1))


def test_who_moved(log):
    moves = {joint.name: joint.moves for joint in joint_motions(log)}
    assert moves == dict.fromkeys(log.names[:3], True) | dict.fromkeys(log.names[3:], False)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_do_not_matter(log, factor):
    scaled = JointLog(log.names, log.times, log.positions * factor)
    for joint, other in zip(joint_motions(log), joint_motions(scaled), strict=True):
        assert other.moves == joint.moves
        assert other.excitation == pytest.approx(joint.excitation, rel=1e-6)


def test_joints_that_moved_together_are_named(log):
    moved = list(log.names[:3])
    assert moved_together(log, moved) == (("elbow", "wrist_deg"),)
    assert moved_together(log, moved[1:]) == ()


def test_advice_says_what_to_do():
    summary = {
        "frames": 100,
        "repeated_images": 45,
        "gaps": 2,
        "time_offset_s": 0.085,
        "time_offset_reason": "",
        "unmoved_joints": ["still"],
        "joints_moved_together": [["elbow", "wrist"]],
        "explained_motion": 0.3,
    }
    said = " ".join(advice(summary))
    assert "45 of 100 images repeat the one before" in said
    assert "missing in 2 places" in said
    assert "85 ms later than the joints" in said
    assert "still hardly moved" in said
    assert "elbow and wrist always moved together: move them apart" in said
    assert "Only 30% of the motion is explained" in said
    fine = summary | {"repeated_images": 0, "gaps": 0, "time_offset_s": 0.0, "unmoved_joints": []}
    fine |= {"joints_moved_together": [], "explained_motion": 0.9}
    assert advice(fine) == []
    sway = {"motions_taken_out": 90, "motions_unknown": 10, "share_foretold_by_joints": 0.3}
    assert advice(fine | {"camera_sway": sway}) == []
    assert "joints move the camera" in advice(fine | {"camera_sway": sway | {"share_foretold_by_joints": 0.9}})[0]
    assert "110 motions" in advice(fine | {"camera_sway": sway | {"motions_unknown": 110}})[0]
