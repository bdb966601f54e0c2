"""What a page may ask for, each message checked before it reaches the session. Nothing is evaluated or unpickled."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from dense_vs.checks import check_flag, check_number, check_whole, shown
from dense_vs.errors import DenseVSError
from dense_vs.live.mode import Mode
from dense_vs.live.recording_thread import RecordingThread, new_folder, room_left
from dense_vs.live.session import LiveSession

MOST_MESSAGE = 4096  # bytes
LARGEST_WHOLE = 1 << 52
LEAST_ROOM = 1 << 28  # bytes free before a recording begins
SPEEDS = (0.01, 10.0)  # rad/s, of a turning joint


class Actions:
    """Carries out a page's messages.

    Args:
        session: what they act on.
    """

    def __init__(self, session: LiveSession):
        self._session = session
        self._actions: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "learn": lambda _: self._later(lambda: session.begin_mode(Mode.LEARNING)),
            "forget": lambda _: self._later(session.forget),
            "point": self._point,
            "aim": self._aim,
            "weigh": self._weigh,
            "remove": self._remove,
            "clear": lambda _: self._later(session.points.clear),
            "go": lambda _: self._later(self._go),
            "speed": self._speed,
            "dead_man": self._dead_man,
            "record": self._record,
            "object": self._object,
            "center": lambda _: self._later(session.objects.center),
            "chase": self._chase,
            "drop_object": lambda _: self._later(session.objects.drop),
        }

    @property
    def names(self) -> tuple[str, ...]:
        """What may be asked for."""
        return tuple(self._actions)

    def carry_out(self, message: Mapping[str, Any]) -> None:
        """Carry out a message of the page in control.

        Raises:
            DenseVSError: an unknown action, or a value of it that is missing or wrong.
        """
        name = message.get("do")
        if not isinstance(name, str) or name not in self._actions:
            raise DenseVSError(f"action is {name!r}; expected one of {', '.join(self._actions)}")
        if self._session.mode is Mode.STARTING:
            raise DenseVSError("there is no image yet; expected the camera to have given one")
        self._actions[name](message)

    def _later(self, request: Callable[[], Any]) -> None:
        self._session.ask(request)

    def _go(self) -> None:
        session = self._session
        if not any(point.target is not None for point in session.points):
            raise DenseVSError("no point has a target; expected a click on the image first")
        session.begin_mode(Mode.REACHING)

    def _point(self, message: Mapping[str, Any]) -> None:
        place, frame = pair(message, "at"), whole(message, "frame")
        session = self._session

        def add() -> None:
            frames, pipeline = session.frames_since(frame), session.running_loop().pipeline
            point = session.points.add(place, frames, pipeline, session.number)
            session.board.log(f"point {point.number} at {place[0]:.0f}, {place[1]:.0f}")

        self._later(add)

    def _aim(self, message: Mapping[str, Any]) -> None:
        number = whole(message, "point")
        target = None if message.get("target") is None else pair(message, "target")
        go = message.get("go") is True
        session = self._session

        def aim() -> None:
            session.points.aim(number, target)
            if go and session.mode is not Mode.REACHING:
                session.begin_mode(Mode.REACHING)

        self._later(aim)

    def _weigh(self, message: Mapping[str, Any]) -> None:
        point, weight = whole(message, "point"), number(message, "weight")
        self._later(lambda: self._session.points.weigh(point, weight))

    def _remove(self, message: Mapping[str, Any]) -> None:
        point = whole(message, "point")
        self._later(lambda: self._session.points.remove(point))

    def _speed(self, message: Mapping[str, Any]) -> None:
        speed = number(message, "value")
        if not SPEEDS[0] <= speed <= SPEEDS[1]:
            raise DenseVSError(f"speed of a turning joint is {speed} rad/s; expected {SPEEDS[0]} to {SPEEDS[1]}")
        self._session.gate.max_speed = speed

    def _dead_man(self, message: Mapping[str, Any]) -> None:
        self._session.gate.dead_man = flag(message, "on")

    def _record(self, message: Mapping[str, Any]) -> None:
        wanted = flag(message, "on")
        session = self._session

        def switch() -> None:
            if wanted and session.recorder is None:
                start_recording(session)
            elif not wanted and session.recorder is not None:
                recorder, session.recorder = session.recorder, None
                recorder.close()
                session.board.log(f"recorded {recorder.folder.name}")

        self._later(switch)

    def _object(self, message: Mapping[str, Any]) -> None:
        corners = pair(message, "from"), pair(message, "to")
        self._later(lambda: self._session.objects.learn(*corners))

    def _chase(self, message: Mapping[str, Any]) -> None:
        point = whole(message, "point")
        self._later(lambda: self._session.objects.chase(point))


def start_recording(session: LiveSession) -> None:
    """Begin a recording in the session's folder.

    Raises:
        DenseVSError: no room on the disk, or a folder or a library that cannot be used.
    """
    folder = session.options.folder
    folder.mkdir(parents=True, exist_ok=True)
    if room_left(folder) < LEAST_ROOM:
        raise DenseVSError(f"{room_left(folder) >> 20} MiB are free in {folder}; expected {LEAST_ROOM >> 20}")

    def failed(text: str) -> None:
        session.recorder = None
        session.board.log(text, "error")

    fps = 1 / session.robot.frame_seconds
    session.recorder = session.last_recording = RecordingThread(
        new_folder(folder), session.options.record_format, tuple(session.robot.joint_names), min(fps, 120.0), failed
    )
    session.board.log(f"recording {session.recorder.folder.name}")


def parse(text: str) -> dict[str, Any]:
    """A message as a dictionary.

    Raises:
        DenseVSError: too long, no JSON, or no object.
    """
    if not isinstance(text, str):
        raise DenseVSError(f"a message is {shown(text)}; expected text")
    if len(text) > MOST_MESSAGE:
        raise DenseVSError(f"a message has {len(text)} characters; expected at most {MOST_MESSAGE}")
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DenseVSError(f"a message is not JSON: {error}") from error
    if not isinstance(message, dict):
        raise DenseVSError(f"a message is a {type(message).__name__}; expected an object")
    return message


def number(message: Mapping[str, Any], name: str) -> float:
    """A finite number of a message."""
    return check_number(name, message.get(name))


def whole(message: Mapping[str, Any], name: str) -> int:
    """A whole number of a message."""
    return check_whole(name, message.get(name), least=-LARGEST_WHOLE, most=LARGEST_WHOLE)


def flag(message: Mapping[str, Any], name: str) -> bool:
    """True or false of a message."""
    return check_flag(name, message.get(name))


def pair(message: Mapping[str, Any], name: str) -> tuple[float, float]:
    """A place [px] of a message."""
    value = message.get(name)
    if not isinstance(value, list) or len(value) != 2:
        raise DenseVSError(f"{name} is {value!r}; expected x and y")
    return number({name: value[0]}, name), number({name: value[1]}, name)
