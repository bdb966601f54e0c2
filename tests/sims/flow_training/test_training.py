"""A few steps of training on the CPU, and the exported file against the network it came from."""

import argparse

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")

import onnxruntime
import torch

from dense_vs.cli.main import main
from dense_vs.sims.cli import flow_train
from dense_vs.sims.flow_training.network import FlowRefiner, export, warp
from dense_vs.sims.flow_training.training import PairRing, Trainer, TrainingOptions, score

TINY = TrainingOptions(
    device="cpu", height=32, width=48, batch=4, scenes=8, ring=8, held_out=8, seed=1, compiled=False, rate=2e-3
)
WEIGHT_ROUNDING = 2e-2  # px, of weights in half precision


@pytest.fixture(scope="module")
def sample():
    torch.manual_seed(0)
    ring = PairRing(TINY)
    ring.fill()
    return ring.sample(4)


def test_steps_on_one_batch_bring_the_flow_closer(sample):
    trainer = Trainer(TINY)
    losses = [float(trainer.step(sample, 0.1)) for _ in range(60)]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:5])
    assert score(trainer.network, [sample])["corrected error"] < 0.9 * score(trainer.network, [sample])["initial error"]


def test_the_exported_file_computes_what_the_network_does(sample, tmp_path):
    trainer = Trainer(TINY)
    for _ in range(3):
        trainer.step(sample, 0.1)
    network = trainer.network.eval()
    export(network, tmp_path / "network.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "network.onnx"), providers=["CPUExecutionProvider"])
    for repeat in (1, 2):  # a larger image than the one it was exported with
        previous, present, _, initial, _ = (x[:1].repeat(*[1] * (x.ndim - 2), repeat, repeat) for x in sample)
        moved = warp(previous, initial)
        with torch.no_grad():
            flow, log_scale = network(present, previous, moved, initial)
        inputs = {"present": present, "previous": previous, "moved": moved, "initial": initial}
        answer = session.run(["flow", "expected_error"], {name: x.numpy() for name, x in inputs.items()})
        np.testing.assert_allclose(answer[0], flow, atol=WEIGHT_ROUNDING)
        np.testing.assert_allclose(answer[1], 2 * log_scale.exp(), rtol=0.05, atol=WEIGHT_ROUNDING)


def test_the_command_trains_and_goes_on(tmp_path, capsys):
    small = ["--device", "cpu", "--size", "48x32", "--batch", "4", "--held-out", "8", "--minutes", "0.02"]
    assert main(["flow-train", "--out", str(tmp_path / "a.onnx"), *small]) == 0
    assert main(["flow-train", "--out", str(tmp_path / "b.onnx"), "--start", str(tmp_path / "a.pt"), *small]) == 0
    assert (tmp_path / "b.onnx").stat().st_size < 5e6
    assert "held out" in capsys.readouterr().out
    assert sum(part.numel() for part in FlowRefiner().parameters()) < 1e6


@pytest.mark.parametrize(
    "wrong",
    [["--size", "50x32"], ["--size", "²x32"], ["--minutes", "0"], ["--start", "nowhere.pt"], ["--held-out", "0"]],
    ids=" ".join,
)
def test_what_makes_no_sense_is_said(wrong, tmp_path, capsys):
    assert main(["flow-train", "--out", str(tmp_path / "a.onnx"), "--device", "cpu", *wrong]) == 2
    assert wrong[0] in capsys.readouterr().err


def test_the_command_and_a_program_train_alike_unless_told():
    parser = argparse.ArgumentParser()
    flow_train.add_arguments(parser)
    told, options = parser.parse_args(["--out", "a.onnx"]), TrainingOptions()
    for name in ("minutes", "seed", "batch", "held_out", "reuse"):
        assert getattr(told, name) == getattr(options, name), name
    assert told.size == f"{options.width}x{options.height}"
    assert told.batch == options.scenes


def test_it_takes_the_cpu_where_there_is_no_gpu(tmp_path, monkeypatch, capsys):
    taken = []

    def train(options, *_):
        taken.append((options.device, options.compiled))
        return FlowRefiner()

    monkeypatch.setattr("dense_vs.sims.flow_training.training.train", train)
    monkeypatch.setattr("dense_vs.sims.flow_training.network.export", lambda *_: None)
    for available in (False, True):
        monkeypatch.setattr(torch.cuda, "is_available", lambda found=available: found)
        assert main(["flow-train", "--out", str(tmp_path / "a.onnx")]) == 0
    assert taken == [("cpu", False), ("cuda", True)]
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert main(["flow-train", "--out", str(tmp_path / "a.onnx"), "--device", "cuda:0"]) == 2
    assert "--device is cuda:0 and PyTorch finds no GPU; expected auto or cpu" in capsys.readouterr().err
