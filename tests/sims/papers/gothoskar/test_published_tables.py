"""What stands beside our figures is what the paper prints, copied once more by hand, and runs are as it says."""

from argparse import ArgumentParser

import pytest

from dense_vs.sims.papers.gothoskar import (
    camera_shift,
    drift,
    few_samples,
    grasp,
    insertion,
    kfold,
    noisy_control,
    noisy_states,
    relearning,
    servo,
    single_camera,
    speed,
    stages,
)

TABLE_4 = """
2 0.5600 0.0205
3 0.5502 0.0417
4 0.5577 0.0663
5 0.6368 0.2268
6 0.5445 0.0667
"""
TABLE_5 = """
30 49.3582 43.5229
40 3.2066 2.3041
50 0.6235 0.0143
60 0.6168 0.0082
70 0.5991 0.0082
"""
TABLE_7 = "40.618 945.384 1788.127 2666.490 3404.664 4287.491 5127.693 5930.182 6762.114 7630.604 8403.353"
TABLE_8 = """
0.01 observed 1.715 0.086
0.01 noisy 1.394 0.109
0.02 observed 3.393 0.211
0.02 noisy 2.298 0.274
0.03 observed 6.077 0.453
0.03 noisy 4.434 0.635
"""


def rows(text):
    return [line.split() for line in text.split("\n") if line]


def test_gothoskar_tables_1_and_2():
    assert (stages.PAPER_BEFORE, stages.PAPER_AFTER) == (414.21, 0.47)
    assert (stages.PAPER_ALL, stages.PAPER_CAMERA_ALL) == (549.4, 27077.9)


def test_gothoskar_table_3():
    assert {name: value for name, value in speed.PAPER.items() if value is not None} == {
        "Forward Kinematics": 1.27,
        "Forward Camera/Feature": 1.43,
        "Forward End-to-End": 2.58,
        "Loss (Pixel)": 0.041,
        "Loss (Cartesian Pose)": 0.0785,
        "Gradient End-to-End": 16.1,
        "Gradient Kinematics": 12.6,
        "Gradient Camera/Feature": 9.12,
        "Infer Pose from Image": 0.511,
        "Infer Joints from Pose": 101.0,
        "Infer Joints from Image": 102.0,
    }


@pytest.mark.parametrize(("table", "ours"), [(TABLE_4, kfold.PAPER), (TABLE_5, few_samples.PAPER)])
def test_gothoskar_tables_4_and_5(table, ours):
    assert ours == means(table)


def test_gothoskar_table_6():
    assert single_camera.PAPER == {
        "both cameras: joints": (0.0536, 0.0134),
        "one camera: joints": (0.0519, 0.0095),
        "both cameras: reprojection": (1.1441, 0.1450),
        "one camera: reprojection": (1.6608, 0.2262),
    }
    assert single_camera.PAPER_LEARNED == (1.231, 0.705)


def test_gothoskar_table_7():
    assert tuple(float(value) for value in TABLE_7.split()) == camera_shift.PAPER
    assert camera_shift.BUFFER == 50


def test_gothoskar_table_8():
    table = {(float(sigma), state): (float(mean), float(off)) for sigma, state, mean, off in rows(TABLE_8)}
    assert table == noisy_states.PAPER
    assert noisy_control.PAPER_FINAL_PX == {("cartesian", 0.02): 5.0}  # in the text beside Fig. 10


def means(table):
    return {int(count): (float(mean), float(deviation)) for count, mean, deviation in rows(table)}


def asked(experiment):
    """What an experiment is run with where nothing is said."""
    parser = ArgumentParser()
    experiment.add_arguments(parser)
    return vars(parser.parse_args([]))


@pytest.mark.parametrize(
    ("experiment", "own", "constants"),
    [
        (stages, {"samples": 50, "published": False},
         {"PAPER_BEFORE": 414.21, "PAPER_AFTER": 0.47, "PAPER_ALL": 549.4, "PAPER_CAMERA_ALL": 27077.9, "STARTS": 100}),
        (speed, {"repeats": 50}, {"STARTS": 8}),
        (kfold, {"samples": 200, "folds": [2, 3, 4, 5, 6]}, {"PAPER": means(TABLE_4)}),
        (few_samples, {"samples": [10, 15, 20, 30, 40, 50, 60, 70], "tolerances": "both", "kinematics": "poe"},
         {"LIMITS_PX": (1.0, 2.0), "PAPER": means(TABLE_5)}),
        (single_camera, {"samples": 50}, {"PAPER_LEARNED": (1.231, 0.705)}),
        (camera_shift, {"meters": 0.02, "radians": 0.02},
         {"BUFFER": 50, "PAPER": tuple(float(one) for one in TABLE_7.split())}),
        (noisy_states, {"samples": 50, "sigma": [0.01, 0.02, 0.03], "controller": ["joint", "cartesian"]},
         {"PAPER": {(float(sigma), state): (float(mean), float(off)) for sigma, state, mean, off in rows(TABLE_8)}}),
        (noisy_control, {"samples": 50, "targets": 50, "moves": 10, "sigma": [0.0, 0.01, 0.02],
                         "controller": ["cartesian", "joint"]}, {"PAPER_FINAL_PX": {("cartesian", 0.02): 5.0}}),
        (servo, {"samples": 50, "targets": 100, "moves": 30, "gains": [0.1, 0.2, 0.5, 0.8, 1.0], "sigma": 0.02}, {}),
        (drift, {"samples": 100, "slip": 0.005, "warm": 0.01}, {"LEARNED_FROM": 50, "BUFFER": 20, "SCORED": 10}),
        (grasp, {"tries": 20, "arm": "baxter", "samples": 50},
         {"FACTORS": (1.3, 1.2, 1.1, 1.0), "LIFTED": 0.03}),
        (insertion, {"tries": 20},
         {"ABOVE": ((1.4, 4), (1.32, 8), (1.295, 8), (1.289, 6)), "SHOWN": (1.284, 1.24, 1.15, 1.0), "TOLERANCE": 0.1,
          "INSERTED": 0.035, "PLAY": 0.0005}),
        (relearning, {"samples": 50}, {"LIMIT_PX": 2.0, "CAMERAS": {"moved camera": 1, "added camera": 2}}),
    ],
)  # fmt: skip
def test_gothoskar_experiments_are_run_as_published(experiment, own, constants):
    """Numbers of samples, targets and moves, and the limits by which ours are scored."""
    given = asked(experiment)
    assert {name: given[name] for name in own} == own
    if "postures" in given:
        assert (given["arm"], given["postures"]) == (["ur5", "baxter"], "normal")
    assert {name: getattr(experiment, name) for name in constants} == constants
