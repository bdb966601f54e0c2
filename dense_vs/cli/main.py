"""Finds the subcommand, runs it, and turns errors that a user can mend into one line and exit code 2."""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from dense_vs.cli.help_text import ParagraphHelp, description
from dense_vs.errors import DenseVSError

# Commands that need a simulator stand with it; all are named here and imported when the command line is read.
COMMANDS = {
    "depth-eval": "dense_vs.cli.depth_eval",
    "depth-train": "dense_vs.sims.cli.depth_train",
    "estimate": "dense_vs.cli.estimate",
    "flow-train": "dense_vs.sims.cli.flow_train",
    "learn-model": "dense_vs.cli.learn_model",
    "reach": "dense_vs.sims.cli.reach",
    "record": "dense_vs.sims.cli.record",
    "reproduce": "dense_vs.sims.cli.reproduce",
    "segment": "dense_vs.cli.segment",
    "segment-train": "dense_vs.cli.segment_train",
}
EXTRAS = {
    "mujoco": "sims",
    "mujoco_warp": "sims",
    "av": "viz",
    "matplotlib": "viz",
    "sklearn": "vos",
    "onnx": "dev",
    "torch": "bench",
}


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="dense-vs",
        description="Dense visual servoing without calibration: learn how every pixel answers to every joint.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, home in COMMANDS.items():
        module = import_module(home)
        command = commands.add_parser(
            name, help=module.HELP, description=description(module), formatter_class=ParagraphHelp
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``dense-vs`` with ``arguments`` (the process's own unless given); the exit code."""
    parsed = build_parser().parse_args(arguments)
    _quiet_warp()
    _note_first_run()
    try:
        parsed.run(parsed)
    except DenseVSError as error:
        print(f"dense-vs: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except ImportError as error:
        if error.name not in EXTRAS:
            raise
        needed = f"{parsed.command} needs {error.name}, which is not installed"
        print(f"dense-vs: {needed}; pip install 'dense-vs[{EXTRAS[error.name]}]'", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("dense-vs: interrupted", file=sys.stderr)
        return 130
    return 0


def _quiet_warp() -> None:
    """Keep Warp's banner, its compile messages and its remark that there is no GPU out of a command's output."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile("w+") as said:
        os.dup2(said.fileno(), 2)  # the remark comes from native code
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        for line in said:
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, end="", file=sys.stderr)


def _note_first_run() -> None:
    """Say so where no kernel has been compiled yet, as the first progress then waits for the compiler."""
    import warp as wp

    wp.init()
    folder = Path(str(wp.config.kernel_cache_dir))
    if not folder.is_dir() or not any(folder.iterdir()):
        print("first run: compiling kernels, which takes up to half a minute", flush=True)
