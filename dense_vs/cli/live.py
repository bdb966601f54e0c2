"""``dense-vs live``: a page on which one clicks a point of the robot and where it should go.

It prints a link and opens nothing by itself. The page is served to this computer alone, unless --host says otherwise:
then it needs the token that is printed once. A robot of your own comes by --driver FILE.py:FUNCTION, a function that
returns (camera, robot), see the page "Your own robot"; without any choice a simulated arm is shown.
"""

import argparse
import sys
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from dense_vs.cli.options import add_device_arguments
from dense_vs.errors import DenseVSError
from dense_vs.files import short_text
from dense_vs.live.access import Access, is_every_address
from dense_vs.live.gate import DEFAULT_SPEED
from dense_vs.live.options import LiveOptions
from dense_vs.live.source import LiveSource
from dense_vs.recording.writers import FORMATS

GROUP = "dense_vs.live_sources"
PORT = 8000


class SourceMaker(Protocol):
    """Another package's robots, by the entry point group ``dense_vs.live_sources``."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments that choose one."""
        ...

    def make(self, arguments: argparse.Namespace, *, needed: bool) -> LiveSource | None:
        """What the arguments choose; None where they choose nothing, unless ``needed``."""
        ...


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    own = parser.add_argument_group("a robot of your own")
    own.add_argument("--driver", metavar="FILE.py:FUNCTION", help="a function that returns (camera, robot)")
    own.add_argument("--lerobot", metavar="TYPE", help="a robot of LeRobot, as so101_follower, at --port PATH")
    own.add_argument("--camera-index", default="0", metavar="N|PATH", help="OpenCV camera of --lerobot (default: 0)")
    own.add_argument("--replay", type=Path, metavar="PATH", help="a recording in place of a robot; no commands")
    for source in _sources():
        source.add_arguments(parser)
    parser.add_argument(
        "--joints", metavar="A,B", help="joints to use, by their names in full, no patterns (default: all)"
    )
    parser.add_argument("--camera", metavar="NAME", help="camera of the model or of the recording (default: its first)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of textures, posture and motion (default: 0)")
    page = parser.add_argument_group("the page")
    page.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="address to serve at (default: 127.0.0.1)")
    page.add_argument(
        "--port",
        action="append",
        default=[],
        metavar="N|PATH",
        help="a number is the port to serve at (default: 8000; 0 takes a free one), a path as /dev/ttyACM0 the serial "
        "port of --lerobot; may be given once for each",
    )
    page.add_argument("--token", metavar="TEXT", help="letters and digits that a browser has to bring")
    safe = parser.add_argument_group("limits and files")
    safe.add_argument(
        "--max-speed",
        type=float,
        default=DEFAULT_SPEED,
        metavar="R",
        help="of a turning joint [rad/s]; a sliding joint may go at a quarter of the number [m/s] (default: 1)",
    )
    safe.add_argument(
        "--amplitude",
        type=float,
        metavar="R",
        help="how far joints babble from where they began, one standard deviation and three at most [rad, m] (default: "
        "0.15, for some seconds 0.35 where a body is learned)",
    )
    safe.add_argument("--dead-man", action="store_true", help="move only while a key or button is held")
    safe.add_argument("--scale", type=float, metavar="X", help="factor on the image size (default: by its width)")
    safe.add_argument("--no-labels", action="store_true", help="do not tell the robot's own pixels")
    safe.add_argument("--no-body", action="store_true", help="follow points by their own look alone")
    safe.add_argument(
        "--out", type=Path, default=Path("out/live"), metavar="DIR", help="folder for recordings (default: out/live)"
    )
    safe.add_argument(
        "--checkpoint",
        type=Path,
        metavar="FILE",
        help="keep what is learned in FILE every 3 s, and go on from it at the next start",
    )
    safe.add_argument(
        "--format",
        default=FORMATS[0],
        metavar="NAME",
        help=f"of recordings: {', '.join(FORMATS)} (default: {FORMATS[0]})",
    )
    add_device_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.live.server import make_app, make_server
    from dense_vs.live.session import LiveSession

    if arguments.format not in FORMATS:
        raise DenseVSError(f"--format is {arguments.format!r}; expected one of {', '.join(FORMATS)}")
    port, _ = _ports(arguments.port)
    access = Access(arguments.host, arguments.token)
    options = LiveOptions(
        joints=tuple(arguments.joints.split(",")) if arguments.joints else None,
        scale=arguments.scale,
        max_speed=arguments.max_speed,
        amplitude=arguments.amplitude,
        body=not arguments.no_body,
        labels=not arguments.no_labels,
        dead_man=arguments.dead_man,
        folder=arguments.out,
        record_format=arguments.format,
        device=arguments.device,
        threads=arguments.threads,
        seed=arguments.seed,
        checkpoint=arguments.checkpoint,
    )
    session = LiveSession(chosen_source(arguments), options)
    listening = _listen(arguments.host, port)
    server = make_server(make_app(session, access), arguments.host, port)
    session.start()
    try:
        _say_link(arguments.host, listening.getsockname()[1], access.token)
        server.run(sockets=[listening])
    finally:
        session.end()
        listening.close()


def chosen_source(arguments: argparse.Namespace) -> LiveSource:
    """The camera and robot that the arguments choose.

    Raises:
        DenseVSError: several, none that can be had, or one that cannot be made.
    """
    from dense_vs.live import sources

    told = {name: getattr(arguments, name) for name in ("driver", "lerobot", "replay")}
    chosen = [name for name, value in told.items() if value is not None]
    others = [made for made in (maker.make(arguments, needed=not chosen) for maker in _sources()) if made is not None]
    if len(chosen) + len(others) > 1:
        raise DenseVSError("several robots are chosen; expected one of --driver, --lerobot, --replay or --robot")
    if others:
        return others[0]
    if arguments.driver is not None:
        return sources.from_driver(arguments.driver)
    if arguments.lerobot is not None:
        return sources.from_lerobot(arguments.lerobot, _ports(arguments.port)[1], arguments.camera_index)
    if arguments.replay is not None:
        return sources.from_recording(arguments.replay, arguments.camera)
    raise DenseVSError("no robot is chosen; expected --driver, --lerobot or --replay")


def _ports(told: list[str]) -> tuple[int, str | None]:
    """The page's port and the robot's.

    Raises:
        DenseVSError: two of a kind, or a number that is no port.
    """
    numbers = [text for text in told if text.isascii() and text.isdigit()]
    paths = [text for text in told if text not in numbers]
    if len(numbers) > 1 or len(paths) > 1 or any(len(text) > 5 or int(text) > 65535 for text in numbers):
        got = short_text(", ".join(told))
        raise DenseVSError(f"--port is {got}; expected one number of 0 to 65535 and one path at most")
    return int(numbers[0]) if numbers else PORT, paths[0] if paths else None


def _sources() -> list[SourceMaker]:
    return [point.load() for point in metadata.entry_points(group=GROUP)]


def _listen(host: str, port: int) -> Any:
    """A socket that listens already, so that the printed link is true and a port in use is said in a line."""
    import socket

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host.strip("[]"), port))
    except OSError as error:
        listening.close()
        raise DenseVSError(f"cannot serve at {host}, port {port}: {error.strerror or error}") from error
    listening.listen(64)
    return listening


def _say_link(host: str, port: int, token: str) -> None:
    import socket

    shown = socket.gethostname() if is_every_address(host) else f"[{host}]" if ":" in host else host
    query = f"/?token={token}" if token else "/"
    print(f"http://{shown}:{port}{query}", flush=True)
    if token:
        print("whoever has this link can move the robot; it is not shown again", file=sys.stderr, flush=True)
