"""ViSP's law against ours, its program by a stand-in where ViSP is not installed, and the comparison as a whole."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.classical_ibvs import INTERACTIONS, Gain, IbvsProblem, ibvs_problem, ibvs_steps
from dense_vs.sims.marked_arm.observed_arm import make_observed_arm

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import ibvs_scene
import visp_library
import visp_peer

# Reads batches as visp_servo.cpp does; answers with the numbers of the first hand's header and data.
STAND_IN = """#!{python}
import struct, sys
import array
read = sys.stdin.buffer.read
while head := read(48):
    hands, cameras, points, joints, matrix, _ = struct.unpack("6i", head[:24])
    each = 6 * cameras * points + 16 * cameras + 6 * joints
    data = array.array("d", read(8 * each * hands))
    rows = [data[each * hand : each * (hand + 1)] for hand in range(hands)]
    gains = struct.unpack("3d", head[24:])
    answer = [[matrix, *gains, row[0], row[-1]][:joints] for row in rows]
    sys.stdout.buffer.write(array.array("d", sum(answer, [])).tobytes())
    sys.stdout.buffer.flush()
    {end}
"""


@pytest.fixture(scope="module")
def problem() -> IbvsProblem:
    arm, rng = make_observed_arm("ur5", seed=3), np.random.default_rng(0)
    joints, goal = arm.chain.home + rng.normal(0, 0.2, (2, 3, 6))
    pixels, target = arm.pixels(joints), arm.pixels(goal)
    pixels[0, 0, :4] = np.nan
    return ibvs_problem(arm, joints + 0.01, joints, pixels, goal, target)


def stand_in(folder: Path, end: str = "") -> Path:
    program = folder / "program"
    program.write_text(STAND_IN.format(python=sys.executable, end=end))
    program.chmod(0o755)
    return program


def test_the_program_is_given_all_of_a_problem_in_its_order(tmp_path, problem):
    with visp_library.VispServo(stand_in(tmp_path)) as servo:
        for _ in range(2):
            found = servo.steps(problem, Gain(0.9, 0.3, 2.0), "mean")
            expected = [
                [2, 0.9, 0.3, 2.0, p[0, 0, 0], j[-1, -1]]
                for p, j in zip(problem.points, problem.flange_jacobian, strict=True)
            ]
            np.testing.assert_array_equal(found, expected)


def test_a_program_that_ends_is_said(tmp_path, problem):
    with visp_library.VispServo(stand_in(tmp_path, "sys.exit(3)")) as servo:
        servo.steps(problem, Gain(0.5, 0.5))
        servo._process.wait()
        with pytest.raises(DenseVSError, match="program ended with 3 and 0 of 144 bytes"):
            servo.steps(problem, Gain(0.5, 0.5))


def test_a_batch_holds_every_array_of_a_hand_in_turn(problem):
    sent = visp_library.packed(problem, Gain(0.7, 0.7), "desired")
    assert np.frombuffer(sent[:24], dtype=np.int32).tolist() == [3, 2, 12, 6, 1, 0]
    assert np.frombuffer(sent[24:48]).tolist() == [0.7, 0.7, 0.0]
    rows = np.frombuffer(sent[48:]).reshape(3, -1)
    names = ("points", "depths", "desired", "desired_depths", "T_camera_flange", "flange_jacobian")
    for hand, row in enumerate(rows):
        np.testing.assert_array_equal(row, np.concatenate([getattr(problem, name)[hand].ravel() for name in names]))


def test_without_visp_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(visp_library.VispMissingError, match="libvisp-dev"):
        visp_library.compile_flags()
    assert visp_peer.main([]) == 2
    assert "libvisp-dev" in capsys.readouterr().err
    (tmp_path / "pkg-config").write_text("#!/bin/sh\nexit 1\n")
    os.chmod(tmp_path / "pkg-config", 0o755)
    with pytest.raises(visp_library.VispMissingError, match="knows no 'visp'"):
        visp_library.build_program(tmp_path)


def test_a_program_that_does_not_compile_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(visp_library, "compile_flags", lambda: [])
    (tmp_path / "c++").write_text("#!/bin/sh\necho no such header >&2\nexit 1\n")
    os.chmod(tmp_path / "c++", 0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(DenseVSError, match="does not compile: no such header"):
        visp_library.build_program(tmp_path)


@pytest.mark.parametrize("interaction", INTERACTIONS)
@pytest.mark.parametrize("gain", [Gain(0.4, 0.4), Gain(1.0, 0.2, 3.0)], ids=["constant", "adaptive"])
@pytest.mark.parametrize("name", ["ur5", "baxter"])
def test_visp_and_ibvs_steps_make_the_same_step(name, gain, interaction):
    try:
        servo = visp_library.VispServo()
    except visp_library.VispMissingError as error:
        pytest.skip(f"no ViSP to compare with: {error}")
    arm, rng = make_observed_arm(name, seed=5), np.random.default_rng(1)
    joints, goal = arm.chain.home + rng.normal(0, 0.2, (2, 20, arm.chain.joint_count))
    pixels = arm.pixels(joints)
    pixels[7] = np.nan
    given = ibvs_problem(arm, joints + rng.normal(0, 0.02, joints.shape), joints, pixels, goal, arm.pixels(goal))
    with servo:
        by_visp = servo.steps(given, gain, interaction)
    assert visp_peer.difference(by_visp, ibvs_steps(given, gain, interaction)) < 1e-9
    assert not by_visp[7].any()
    assert by_visp.any(axis=1).sum() == 19


@pytest.mark.parametrize(
    ("found", "expected", "worst"),
    [
        ([[1.0, 2.0]], [[1.0, 2.0]], 0.0),
        ([[0.1, 0.2]], [[0.1, 0.3]], 0.1),  # of 1 rad
        ([[10.0, 0.0], [0.0, 0.0]], [[10.0, 1.0], [0.0, 0.0]], 0.1),  # of the step
        ([[0.0, 0.0], [5.0, 0.0]], [[0.0, -0.5], [5.0, 0.0]], 0.5),
        ([[np.nan, 0.0]], [[0.0, 0.0]], np.inf),
    ],
)
def test_a_difference_is_of_the_step_or_of_1_rad(found, expected, worst):
    assert visp_peer.difference(np.array(found), np.array(expected)) == pytest.approx(worst)


def test_the_worst_of_all_steps_is_kept(problem):
    class Off:
        def __init__(self):
            self.by = iter((0.0, 0.2, 0.1))

        def steps(self, given, gain, matrix):
            steps = ibvs_steps(given, gain, matrix)
            steps[1, 2] += next(self.by) * max(1.0, np.abs(steps[1]).max())
            return steps

    compared = visp_peer.Compared(Off())
    law = compared.law("mean", Gain(0.3, 0.3))
    for expected in (0.0, 0.2, 0.2):
        law(problem)
        assert compared.worst == pytest.approx(expected, abs=1e-12)
    assert compared.steps == 9


def test_everything_is_tried_once_and_named_by_what_it_is():
    families = visp_peer.candidates()
    assert [len(tried) for tried in families.values()] == [12, 72]
    for family, tried in families.items():
        assert len(set(tried.values())) == len(tried)
        for matrix, gain in tried.values():
            assert (gain.at_zero == gain.at_infinity) == ("constant" in family)
            assert matrix in INTERACTIONS
    assert "mean, gain 0.5" in families["ViSP, constant gain, tuned"]


SMALL = ["--seeds", "500", "--tuned-on", "400", "--targets", "2", "--moves", "3", "--samples", "20"]


class Twin:
    """In ViSP's place: our law, off by a little where that is asked for."""

    version, off = "3.0", 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def steps(self, given, gain, matrix):
        return ibvs_steps(given, gain, matrix) + self.off


@pytest.fixture
def few(monkeypatch):
    good, slow = ("current", Gain(1.0, 1.0)), ("current", Gain(0.01, 0.01))
    monkeypatch.setattr(visp_peer, "candidates", lambda: {"ViSP, tuned": {"slow": slow, "good": good}})
    monkeypatch.setattr(visp_peer, "VispServo", Twin)
    monkeypatch.setattr(ibvs_scene, "ARMS", ("ur5",))


def test_the_comparison_tunes_runs_and_reports(tmp_path, few, monkeypatch):
    import json

    file = tmp_path / "peer.json"
    assert visp_peer.main([*SMALL, "--json", str(file), "--out", str(tmp_path / "figures")]) == 0
    content = json.loads(file.read_text())
    assert content["chosen"]["exact"]["ViSP, tuned"] == "current, gain 1"
    assert content["agreement"] == 0.0
    rows = {(row["noise"], row["law"]): row for row in content["rows"]}
    assert len(rows) == 3 * 3
    assert rows["exact", "model"]["tasks"] == 2
    assert rows["exact", "ViSP, gain 0.2"]["end_px"] > rows["exact", "ViSP, tuned"]["end_px"] > 0
    assert {metric["name"]: metric["value"] for metric in content["metrics"]}[
        "exact: ViSP, tuned: error at the end, median"
    ] == rows["exact", "ViSP, tuned"]["end_px"]
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert names == {"ibvs_exact.png", "ibvs_independent.png", "ibvs_proportional.png"}


def test_a_visp_that_disagrees_fails_the_comparison(few, monkeypatch):
    monkeypatch.setattr(visp_peer, "NOISES", ("exact",))
    monkeypatch.setattr(visp_peer, "_errors_of_model", lambda options, noise: np.ones((2, 4)))
    monkeypatch.setattr(Twin, "off", 1e-6)
    assert visp_peer.main(SMALL) == 1
    monkeypatch.setattr(Twin, "off", 1e-11)
    assert visp_peer.main(SMALL) == 0


def test_settings_are_tuned_on_other_seeds_and_reported_on_all_of_theirs(few, monkeypatch):
    monkeypatch.setattr(visp_peer, "NOISES", ("exact",))
    monkeypatch.setattr(visp_peer, "_errors_of_model", lambda options, noise: np.ones((2, 4)))
    asked: list[tuple[list[int], str, float, int, int]] = []
    monkeypatch.setattr(visp_peer, "scenes", lambda *told: asked.append(told) or ibvs_scene.scenes(*told))
    assert visp_peer.main(SMALL) == 0
    assert asked == [([400], "exact", 0.02, 1, 3)] * 2 + [([500], "exact", 0.02, 2, 3)] * 2
    trials = [(scene.trial.arm, scene.trial.seed) for scene in ibvs_scene.scenes([7, 8], "exact", 0.02, 1, 1)]
    assert trials == [("ur5", 7), ("ur5", 8)]


@pytest.mark.parametrize(("noise", "state", "read_off"), [("exact", "observed", 0), ("proportional", "noisy", 0.02)])
def test_the_model_is_learned_from_readings_as_noisy_as_its_own(noise, state, read_off, monkeypatch):
    scene = ibvs_scene.scenes([500], noise, 0.02, 2, 1)[0]
    told = []

    class Model:
        @staticmethod
        def fit(observations, **options):
            told.append((observations, options))

    monkeypatch.setattr(ibvs_scene, "GenerativeModel", Model)
    monkeypatch.setattr(ibvs_scene, "servo_model", lambda model, arm, tasks, moves, *noises: told.append(noises))
    scene.servo_learned(200)
    (observations, options), (_, controller, read) = told
    assert options == {"state": state, "seed": 500}
    true = scene.trial.evidence(200).observations.joints
    assert np.std(observations.joints - true) == pytest.approx(read_off, rel=0.1)
    assert np.std(read(np.zeros((200, 6)))) == pytest.approx(read_off, rel=0.1)
    assert controller.sigma == read_off
    assert controller.law == ("proportional" if read_off else "independent")


def test_every_law_sees_the_same_targets_and_noise():
    scene = ibvs_scene.scenes([500], "independent", 0.02, 3, 2)[0]
    seen: list[IbvsProblem] = []

    def still(given: IbvsProblem) -> np.ndarray:
        seen.append(given)
        return np.zeros((3, given.flange_jacobian.shape[-1]))

    first, second = scene.servo(still), scene.servo(still)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, first[:, :1].repeat(3, axis=1))  # who makes no step gets no noise
    np.testing.assert_array_equal(seen[0].points, seen[2].points)
    assert not np.array_equal(seen[0].points, seen[1].points, equal_nan=True)
    assert not np.array_equal(seen[0].flange_jacobian, seen[1].flange_jacobian)  # read anew
    exact: list[IbvsProblem] = []
    replace(scene, noise="exact").servo(lambda given: exact.append(given) or still(given))
    np.testing.assert_array_equal(exact[0].flange_jacobian, exact[1].flange_jacobian)


def test_an_unknown_noise_is_refused():
    with pytest.raises(DenseVSError, match="noise is 'loud'"):
        ibvs_scene.scenes([500], "loud", 0.02, 3, 2)
