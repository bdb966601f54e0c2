"""The estimator on a recording: aligned clocks, chosen joints, and the same J as from the images themselves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dense_vs import DenseVSError, JointLog
from dense_vs.pipeline.recorded import estimate_recording
from dense_vs.recording import open_recording

FRAMES = 40
UNITS = np.array([1e3, 1e-3, 180 / np.pi, 4096 / (2 * np.pi)])


def estimate(recording, **options):
    frames, estimators = zip(*estimate_recording(recording, device="cpu", **options), strict=True)
    return frames, estimators[-1]


def median_error(scene, estimator, q):
    inner = (slice(16, -16), slice(16, -16))
    true = scene.jacobian(q)[inner]
    return np.median(np.linalg.norm(estimator.jacobian[inner] - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3)))


def test_learns_from_the_files(scene, recording, postures):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    frames, estimator = estimate(source)
    assert (len(frames), source.skipped_frames, estimator.updates) == (FRAMES, 0, FRAMES - 1)
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(FRAMES) / 25, atol=1e-3)
    for frame, q in zip(frames, postures, strict=False):
        np.testing.assert_allclose(frame.positions, q, atol=2e-3)
    assert median_error(scene, estimator, postures[FRAMES - 1]) < 0.3


def test_units_of_joints_scale_their_columns_and_nothing_else(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    scaled = replace(source.log, positions=source.log.positions * UNITS)
    plain = estimate_recording(source, device="cpu", label=True)
    other = estimate_recording(replace(source, log=scaled), device="cpu", label=True)
    for _ in zip(plain, other, strict=True):
        pass
    assert plain.estimator.options.order == 2
    J, J_other = plain.estimator.to_numpy(), other.estimator.to_numpy() * UNITS
    size = np.sqrt(np.mean(J**2, axis=(0, 1, 2)))  # each column by itself
    assert (size > 0).all()
    np.testing.assert_allclose(J_other / size, J / size, atol=2e-3)
    np.testing.assert_allclose(other.explained.settled(), plain.explained.settled(), rtol=1e-4)
    assert plain.labels().any()
    assert np.mean(plain.labels() == other.labels()) > 0.999


def test_labels_are_drawn_only_where_asked_for(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    with pytest.raises(DenseVSError, match="the pipeline has no body to label"):
        estimate_recording(source, device="cpu").labels()
    with pytest.raises(DenseVSError, match="label is 'yes'"):
        estimate_recording(source, device="cpu", label="yes")


def test_chosen_joints_come_in_their_order(recording):
    whole = open_recording(recording / "video.mp4", recording / "joints.csv")
    some = open_recording(recording / "video.mp4", recording / "joints.csv", joint_names=["zoom", "x", "turn", "y"])
    all_frames, _ = estimate(whole)
    frames, estimator = estimate(some)
    assert estimator.options.joints == 4
    np.testing.assert_array_equal(frames[5].positions, all_frames[5].positions[[3, 0, 2, 1]])


def test_offset_brings_a_late_log_back(recording, tmp_path):
    lines = (recording / "joints.csv").read_text().splitlines()
    rows = [line.split(",", 1) for line in lines[1:]]
    late = tmp_path / "late.csv"
    late.write_text("\n".join([lines[0], *[f"{float(t) + 0.5},{rest}" for t, rest in rows]]))
    on_time, _ = estimate(open_recording(recording / "video.mp4", recording / "joints.csv"))
    shifted, _ = estimate(open_recording(recording / "video.mp4", late).episode().shifted(-0.5))
    for a, b in zip(on_time, shifted, strict=True):
        np.testing.assert_allclose(a.positions, b.positions, atol=1e-9)


def test_frames_outside_the_log_are_left_out_and_counted(recording, tmp_path):
    log = JointLog.read_csv(recording / "joints.csv")
    inside = (log.times >= 0.4) & (log.times <= 1.0)
    short = tmp_path / "short.csv"
    rows = np.column_stack([log.times[inside], log.positions[inside]])
    np.savetxt(short, rows, delimiter=",", header="time,x,y,turn,zoom", comments="")
    source = open_recording(recording / "video.mp4", short).episode()
    frames, estimator = estimate(source)
    # A frame whose stamp differs from the log's end by rounding alone is within it.
    first, last = log.times[inside][0] - 1e-4, log.times[inside][-1] + 1e-4
    assert first <= frames[0].time <= frames[-1].time <= last
    assert source.skipped_frames == FRAMES - len(frames) > 0
    assert estimator.updates == len(frames) - 1


def test_scale(recording):
    frames, estimator = estimate(open_recording(recording / "video.mp4", recording / "joints.csv"), scale=0.5)
    assert estimator.jacobian.shape == (48, 64, 2, 4)
    assert frames[0].gray.shape == (48, 64)


def test_clocks_apart_are_refused_at_once(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    for offset in (100.0, -100.0):
        with pytest.raises(DenseVSError, match=r"video covers 0.000 to .* s and the joint log .*expected at least two"):
            estimate_recording(source.shifted(offset), device="cpu")


def test_a_single_common_frame_is_refused(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode().shifted(-1.59)
    with pytest.raises(DenseVSError, match="expected at least two frames within the log"):
        estimate(source)
    assert source.skipped_frames >= FRAMES - 1


def test_bad_options_are_refused_before_the_first_frame(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    bad_options: list[tuple[dict[str, Any], str]] = [
        ({"method": "raft"}, "flow method 'raft' is unknown"),
        ({"device": "tpu"}, "device 'tpu' is not present"),
        ({"covariance": "huge"}, "covariance is 'huge'"),
        ({"threads": 0}, "threads is 0"),
        ({"scale": 0}, "scale is 0"),
        ({"scale": 2.0}, "scale is 2.0; expected a finite number above 0 and at most 1"),
    ]
    for options, message in bad_options:
        with pytest.raises(DenseVSError, match=message):
            estimate_recording(source, **options)
    with pytest.raises(DenseVSError, match="time_offset is nan"):
        source.shifted(float("nan"))
    with pytest.raises(DenseVSError, match="joint 'elbow' is not in the log; expected"):
        open_recording(recording / "video.mp4", recording / "joints.csv", joint_names=["x", "elbow"])


def test_joints_are_taken_as_logged_where_no_image_repeats(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    plain, _ = estimate(source, smoothing=0.0)
    frames, _ = estimate(source)
    for a, b in zip(plain, frames, strict=True):
        np.testing.assert_array_equal(a.positions, b.positions)


def test_a_judge_sees_the_estimator_before_each_frame(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    seen = []

    def judge(time, flow, dq):
        seen.append((time, flow.copy(), dq.copy(), done.estimator.updates))

    done = estimate_recording(source, device="cpu", before_update=judge)
    frames = [frame for frame, _ in done][1:]
    assert [updates for *_, updates in seen] == list(range(FRAMES - 1))
    for (time, flow, dq, _), frame in zip(seen, frames, strict=True):
        assert time == frame.time
        np.testing.assert_array_equal(flow, frame.flow)
        np.testing.assert_array_equal(dq, frame.dq)


def test_bad_smoothing_is_refused(recording):
    source = open_recording(recording / "video.mp4", recording / "joints.csv").episode()
    for smoothing in (-1.0, float("nan")):
        with pytest.raises(DenseVSError, match="smoothing is"):
            estimate_recording(source, device="cpu", smoothing=smoothing)
