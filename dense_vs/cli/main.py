"""Finds the command, runs it, and turns errors that a user can mend into one line and exit code 2."""

import errno
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from dense_vs.cli.commands import all_commands
from dense_vs.cli.interrupts import by_interrupt
from dense_vs.cli.parsing import LazyParser, from_module
from dense_vs.errors import DenseVSError

EXTRAS = {
    "av": "recordings",
    "lerobot": "hardware",
    "matplotlib": "viz",
    "mujoco": "sims",
    "mujoco_warp": "sims",
    "onnx": "dev",
    "pyarrow": "recordings",
    "rerun": "rerun",
    "rosbags": "recordings",
    "sklearn": "vos",
    "starlette": "live",
    "torch": "bench",
    "uvicorn": "live",
}
# What the system refuses for reasons that a user can mend: names, places, rights, room.
BY_THE_USER = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
    errno.ENAMETOOLONG,
    errno.ENOENT,
    errno.EISDIR,
    errno.ENOTDIR,
    errno.EEXIST,
    errno.ELOOP,
    errno.EMFILE,
)
USER_ERROR, INTERRUPTED, READER_GONE = 2, 130, 141  # the last two as a shell reports SIGINT and SIGPIPE


def build_parser() -> LazyParser:
    """The parser of all commands; a command's own arguments are declared when it is chosen."""
    parser = LazyParser(
        prog="dense-vs",
        description="Dense visual servoing without calibration: learn how every pixel answers to every joint.",
        epilog="'dense-vs COMMAND --help' describes a command.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in all_commands().items():
        one = commands.add_parser(name, help=command.help, fill=from_module(command.home))
        one.set_defaults(home=command.home)
    return parser


def main(arguments: Sequence[str] | None = None, *, imported: Callable[[], None] = lambda: None) -> int:
    """Run ``dense-vs``.

    Args:
        arguments: of the command line, the process's own unless given.
        imported: called once all that the command needs is imported.

    Returns:
        The exit code.
    """
    _open_missing_streams()
    try:
        try:
            return _run(arguments, imported)
        finally:
            sys.stdout.flush()  # a full disk or a reader that left is answered below, not by the interpreter's exit
    except DenseVSError as error:
        _say(" ".join(str(error).split()))
    except ImportError as error:
        if error.name not in EXTRAS:
            raise
        _say(f"this needs {error.name}, which is not installed; pip install 'dense-vs[{EXTRAS[error.name]}]'")
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        _discard(sys.stdout)
        return READER_GONE
    except OSError as error:
        if by_interrupt(error):
            _say("interrupted")
            return INTERRUPTED
        if error.errno in (errno.ENOSPC, errno.EIO, errno.EBADF) and error.filename is None:
            _discard(sys.stdout)
            _say(f"cannot write the output: {error.strerror}")
        elif error.errno in BY_THE_USER:
            place = "a file" if error.filename is None else str(error.filename)[:200]
            _say(f"{place}: {error.strerror}")
        else:
            raise
    except MemoryError:
        _say("the memory does not suffice; expected smaller images, fewer worlds or a shorter recording")
    except Exception as error:
        if not by_interrupt(error):
            raise
        _say("interrupted")
        return INTERRUPTED
    return USER_ERROR


def _run(arguments: Sequence[str] | None, imported: Callable[[], None]) -> int:
    parsed = build_parser().parse_args(arguments)
    _quiet_warp()
    _note_first_run()
    command = import_module(parsed.home)
    imported()
    command.run(parsed)
    return 0


def _say(line: str) -> None:
    """One line on standard error, which may be gone as well."""
    with suppress(OSError):
        print(f"dense-vs: {line}", file=sys.stderr, flush=True)


def _open_missing_streams() -> None:
    """Open the null device where standard input, output or error is closed.

    Else the first file that the command opens would get its number and receive what is meant for it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


def _discard(stream: Any) -> None:
    """Send what a stream still holds to the null device, for the interpreter writes it when it ends."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


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

    folder = Path(str(wp.config.kernel_cache_dir))
    if not folder.is_dir() or not any(folder.iterdir()):
        print("first run: compiling kernels, which takes up to half a minute", flush=True)
