"""``dense-vs flow-train``: train the network of the flow method "learned" on random simulated arms.

It needs PyTorch and, for weights worth having, a GPU: some eight minutes of an H200. On a CPU it only shows that it
runs; make the images small there. Beside the ONNX file it leaves PyTorch's weights (.pt), from which --start goes on.
"""

import argparse
import re
from pathlib import Path

from dense_vs.checks import shown
from dense_vs.errors import DenseVSError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where to write the network (.onnx)")
    parser.add_argument("--minutes", type=float, default=8.0, metavar="M", help="of training (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random arms (default: %(default)s)")
    parser.add_argument("--device", default="auto", metavar="NAME",
                        help="auto, cpu or cuda:N; auto takes a GPU where PyTorch finds one "
                        "(default: %(default)s)")  # fmt: skip
    parser.add_argument("--size", default="320x240", metavar="WxH", help="multiples of 16 (default: %(default)s)")
    parser.add_argument("--batch", type=int, default=32, metavar="N", help="pairs a step (default: %(default)s)")
    parser.add_argument("--held-out", type=int, default=512, metavar="N",
                        help="pairs rendered before training and left out of it, which is judged by half as many "
                        "draws from them (default: %(default)s)")  # fmt: skip
    parser.add_argument("--reuse", type=float, default=12.0, metavar="N",
                        help="times that a pair is trained on (default: %(default)s)")  # fmt: skip
    parser.add_argument("--start", type=Path, metavar="FILE", help="weights to start from (.pt of an earlier run)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    import torch

    from dense_vs.sims.flow_training.network import export
    from dense_vs.sims.flow_training.training import TrainingOptions, train

    width, height = _size(arguments.size)
    device = arguments.device
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    elif device.startswith("cuda") and not torch.cuda.is_available():
        raise DenseVSError(f"--device is {device} and PyTorch finds no GPU; expected auto or cpu")
    if arguments.start is not None and not arguments.start.is_file():
        raise DenseVSError(f"--start {arguments.start} is not a file")
    for name in ("minutes", "batch", "held-out", "reuse"):
        value = getattr(arguments, name.replace("-", "_"))
        if value <= 0:
            raise DenseVSError(f"--{name} is {value}; expected a number above 0")
    options = TrainingOptions(
        minutes=arguments.minutes, seed=arguments.seed, device=device, height=height, width=width,
        batch=arguments.batch, scenes=arguments.batch, held_out=arguments.held_out, reuse=arguments.reuse,
        ring=max(arguments.held_out, 20_000 if device != "cpu" else 1000),
        compiled=device != "cpu",
    )  # fmt: skip
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    export(train(options, arguments.out.with_suffix(".pt"), arguments.start), arguments.out)
    print(f"network in {arguments.out}")


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    sides = [int(part) for part in parts if re.fullmatch("[0-9]{1,5}", part)]
    if len(parts) != 2 or len(sides) != 2 or not all(side >= 32 and side % 16 == 0 for side in sides):
        raise DenseVSError(f"--size is {shown(text)}; expected WxH in multiples of 16 from 32 on, as 320x240")
    return sides[0], sides[1]
