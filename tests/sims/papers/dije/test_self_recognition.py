"""The experiments on self-recognition: what they count, and that the default knows the body from a walker."""

import json
from argparse import Namespace

import cv2
import numpy as np
import pytest

from dense_vs.cli.main import main
from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.dije.labeling import Labeler, View, views
from dense_vs.sims.papers.dije.labeling_arguments import check_labeling_arguments
from dense_vs.sims.papers.dije.leak import leak_rows
from dense_vs.sims.papers.dije.leak_record import LeakRun
from dense_vs.sims.papers.dije.transport import Transport


class FixedLabels:
    def __init__(self, own):
        self.own = own

    def labels(self, _):
        return self.own


def view(robot, walker, flow=None, dq=None):
    flow = np.zeros((*robot.shape, 2), np.float32) if flow is None else flow
    return View(1, 0.5, np.zeros((*robot.shape, 3), np.uint8), flow, np.zeros(1) if dq is None else dq, robot, walker)


def columns(first, last, width=40):
    mask = np.zeros((20, width), bool)
    mask[:, first:last] = True
    return mask


def test_scores():
    labeler = Labeler(Namespace(jacobian=None), FixedLabels(columns(0, 12)))
    labeler.score(view(columns(0, 10), columns(11, 21)))
    labeler.score(view(columns(0, 12), columns(0, 0)))
    assert labeler.iou == [pytest.approx(10 / 12), 1.0]
    assert labeler.leak[0] == pytest.approx(0.1)
    assert np.isnan(labeler.leak[1])
    assert labeler.leak_px == [20, 0]


def test_rows_are_means_over_seeds_and_the_worst_one():
    runs = []
    for seed, iou, leak in ((3, 0.9, 0.01), (4, 0.7, 0.05)):
        labeler = Namespace(iou=[iou, iou, 0.0], leak=[leak, float("nan")], leak_px=[10, 20])
        moved = {"(13)": (0.4, 0.0, 0.2), "(14)": (0.1, 0.3, float("nan"))}
        runs.append(LeakRun(seed, {name: labeler for name in ("default", "(13)", "(14)")}, moved))
    rows = {row.name: row for row in leak_rows(runs)}
    assert rows["default: IoU, median over time"].ours == pytest.approx(0.8)
    assert rows["default: IoU, worst seed"].ours == 0.7
    assert rows["default: leak, share of the walker"].ours == pytest.approx(0.03)
    assert rows["default: leak, worst seed"].ours == 0.05
    assert rows["default: leak"].ours == 15
    assert rows["J only transported, (13): leaked area / arm area at the end"].ours == pytest.approx(0.4)
    assert np.isnan(rows["J only transported, (14): leak, share of the walker"].ours)
    assert rows["default: leak"].seeds == (3, 4)


def test_pixels_and_areas_are_means_over_seeds_and_not_the_largest():
    runs = []
    for seed, pixels, moved in ((3, [10, 20], (0.5, 0.125, 0.5)), (4, [40], (0.25, 0.375, 0.25))):
        labeler = Namespace(iou=[0.5], leak=[0.25], leak_px=pixels)
        both = {"(13)": moved, "(14)": (0.0, moved[1] / 2, 0.0)}
        runs.append(LeakRun(seed, dict.fromkeys(("default", "(13)", "(14)"), labeler), both))
    found = {row.name: row.ours for row in leak_rows(runs)}
    assert found["default: leak"] == 27.5  # 15 and 40
    start = "J only transported, (13):"
    assert found[f"{start} leaked area / arm area at the end"] == 0.375
    assert found[f"{start} lost area / arm area at the end"] == 0.25
    assert found[f"{start} leak, share of the walker"] == 0.375
    assert found["J only transported, (14): lost area / arm area at the end"] == 0.125


@pytest.mark.parametrize(
    ("leaks", "mean", "worst"),
    [([np.nan, 0.0], 0.0, 0.0), ([0.5, np.nan, 0.25], 0.375, 0.5), ([np.nan, np.nan], np.nan, np.nan)],
)
def test_a_seed_whose_walker_was_not_seen_is_not_the_worst(leaks, mean, worst):
    runs = []
    for seed, leak in enumerate(leaks):
        labeler = Namespace(iou=[0.5], leak=[leak], leak_px=[0])
        moved = dict.fromkeys(("(13)", "(14)"), (0.0, 0.0, 0.0))
        runs.append(LeakRun(seed, dict.fromkeys(("default", "(13)", "(14)"), labeler), moved))
    found = {row.name: row.ours for row in leak_rows(runs)}
    assert found["default: leak, share of the walker"] == pytest.approx(mean, nan_ok=True)
    assert found["default: leak, worst seed"] == pytest.approx(worst, nan_ok=True)


@pytest.mark.parametrize(("pixels", "counted"), [(99, False), (100, True)])
def test_a_walker_of_a_hundred_pixels_is_seen(pixels, counted):
    """Columns 0 to 2 are labeled or transported, 60 of the pixels at most."""
    walker, own = np.zeros((20, 40), bool), columns(0, 3)
    walker.T.flat[:pixels] = True
    labeler = Labeler(Namespace(jacobian=None), FixedLabels(own))
    labeler.score(view(columns(0, 10), walker))
    assert labeler.leak == [pytest.approx(0.6) if counted else pytest.approx(np.nan, nan_ok=True)]
    transport = Transport(np.full((20, 40, 2, 1), 50.0, np.float32), own, "model", "cpu", 1)
    transport.take(view(columns(0, 10), walker))
    assert transport.leak() == pytest.approx(0.6 if counted else np.nan, nan_ok=True)


def test_nothing_but_the_body_has_a_j_to_be_transported():
    jacobian = np.full((20, 40, 2, 1), 50.0, np.float32)
    transport = Transport(jacobian, columns(5, 15), "model", "cpu", 1)
    expected = np.where(columns(5, 15)[..., None, None], jacobian, 0.0)
    np.testing.assert_array_equal(transport._estimator.to_numpy(), expected)


def test_transport_alone_leaks_with_the_measured_flow_only():
    """A body at rest; what passes before it moves on with a J that (13) gives it and (14) does not."""
    jacobian = np.zeros((20, 40, 2, 1), np.float32)
    jacobian[..., 0, 0] = 50.0
    passing = np.zeros((20, 40, 2), np.float32)
    passing[..., 0] = 2.0
    own = columns(5, 15)
    moved = {}
    for name, prediction in (("(13)", "flow"), ("(14)", "model")):
        transport = Transport(jacobian, own, prediction, "cpu", 1)
        np.testing.assert_array_equal(transport.own(), own)
        for _ in range(5):
            transport.take(view(own, columns(18, 25), passing, np.array([1e-4])))
        moved[name] = transport
    np.testing.assert_array_equal(moved["(13)"].own(), columns(15, 25))
    np.testing.assert_array_equal(moved["(14)"].own(), own)
    assert moved["(13)"].leak() > 0.2
    assert moved["(14)"].leak() == 0.0


def test_refuses_times_out_of_range():
    for seconds, period in ((3.0, 0.7), (float("nan"), 0.7), (2e5, 0.7), (9.0, -0.1), (9.0, float("inf"))):
        with pytest.raises(DenseVSError, match=r"--(seconds|period) is .*expected"):
            check_labeling_arguments(Namespace(seconds=seconds, period=period), 5.0)


@pytest.mark.slow
def test_a_walker_is_seen_and_is_not_the_robot():
    arguments = Namespace(distractor="walker-behind", device="cpu", threads=None, seconds=0.1, period=0.0)
    frames = list(views(1, arguments))
    assert [frame.index for frame in frames] == [1, 2, 3]
    assert frames[-1].robot.mean() > 0.05
    assert frames[-1].walker.mean() > 0.01
    assert not (frames[-1].robot & frames[-1].walker).any()
    assert np.abs(frames[-1].dq).max() > 0


@pytest.mark.slow
def test_labels_command(tmp_path, capsys):
    out, figures = tmp_path / "out", tmp_path / "rows.json"
    command = ["reproduce", "dije", "labels", "--seconds", "5", "--seed", "1", "--device", "cpu"]
    assert main([*command, "--out", str(out), "--json", str(figures)]) in (None, 0)
    assert "IoU of the labels in the picture, default" in capsys.readouterr().out
    rows = {row["name"]: row for row in json.loads(figures.read_text())["rows"]}
    assert rows["IoU of the labels in the picture, default"]["ours"] > 0.6
    assert rows["threshold of a cluster's value"]["paper"] == 0.2
    picture = cv2.imread(str(out / "seed1.png"))
    assert picture.shape == (3 * 480, 4 * 640, 3)
    assert picture.std() > 20
