"""Camera and robot from a driver file, from LeRobot, or from a recording."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

from dense_vs.drivers.watchdog import Hold
from dense_vs.errors import DenseVSError
from dense_vs.live.source import LiveSource
from dense_vs.recording import Replay, open_recording


def from_driver(text: str) -> LiveSource:
    """What a function in a file returns: (camera, robot), or a :class:`LiveSource`.

    A robot may have an attribute ``watchdog``, a :class:`Hold`, and a method ``hold()``.

    Args:
        text: ``FILE.py:FUNCTION``.

    Raises:
        DenseVSError: no such file or function, or another result.
    """
    name, colon, function = text.rpartition(":")
    path = Path(name)
    if not colon or not function.isidentifier() or path.suffix != ".py":
        raise DenseVSError(f"--driver is {text!r}; expected FILE.py:FUNCTION")
    if not path.is_file():
        raise DenseVSError(f"there is no file {path}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    spec.loader.exec_module(module)
    make = getattr(module, function, None)
    if not callable(make):
        raise DenseVSError(f"{path} has no function {function!r}")
    made: Any = make()
    if isinstance(made, LiveSource):
        return made
    if not isinstance(made, tuple) or len(made) != 2 or not hasattr(made[0], "read"):
        raise DenseVSError(f"{text} returned a {type(made).__name__}; expected (camera, robot)")
    camera, robot = made
    return LiveSource(camera, robot, path.stem, watchdog=watchdog_of(robot))


def from_lerobot(kind: str, port: str | None, camera: str) -> LiveSource:
    """A robot of LeRobot beside an OpenCV camera, on the computer's monotonic clock.

    Raises:
        DenseVSError: no port, an unknown robot, or a device that cannot be opened.
    """
    from dense_vs.drivers.lerobot_robot import LeRobotRobot
    from dense_vs.drivers.opencv_camera import OpenCVCamera

    if port is None:
        raise DenseVSError("--lerobot needs --port PATH, as /dev/ttyACM0")
    numbered = camera.isascii() and camera.isdigit() and len(camera) < 10
    robot = LeRobotRobot.connect(kind, port)
    return LiveSource(OpenCVCamera(int(camera) if numbered else camera), robot, kind, watchdog=watchdog_of(robot))


def from_recording(path: Path, camera: str | None = None) -> LiveSource:
    """A recording in place of a robot; it follows no commands.

    Raises:
        DenseVSError: nothing there that can be used.
    """
    replay = Replay(open_recording(path, camera=camera))
    return LiveSource(replay, replay, f"recording {path.name}", commands=False, paced=False)


def watchdog_of(robot: Any) -> Hold | None:
    """How a process apart makes a robot hold, where its driver declares it.

    Raises:
        DenseVSError: something else than a :class:`Hold`.
    """
    declared = getattr(robot, "watchdog", None)
    if declared is not None and not isinstance(declared, Hold):
        raise DenseVSError(f"watchdog is a {type(declared).__name__}; expected a dense_vs.drivers.watchdog.Hold")
    return declared
