"""What a page is told of a session beside the image, and the layers that it may ask to see."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from dense_vs.health.faults import Fault, FaultKind
from dense_vs.live.points import LivePoints, PointState
from dense_vs.live.snapshot import plain
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.point_servo.loop import ServoLoop

if TYPE_CHECKING:
    from dense_vs.live.session import LiveSession

JACOBIAN = "jacobian:"


@dataclass
class Told:
    """The slower figures, and what was said of the points already.

    Attributes:
        sureness: how well each joint is learned, ``(N,)`` from 0 to 1; None at first.
        explained: E of the last seconds; NaN where nothing moved.
        states: of the points, by number.
    """

    sureness: np.ndarray | None = None
    explained: float = float("nan")
    states: dict[int, tuple[PointState, str]] = field(default_factory=dict)

    def changes(self, points: LivePoints) -> Iterator[tuple[str, str]]:
        """A line and its level for each point whose state is another than when last asked."""
        now = {point.number: (point.state, point.why) for point in points}
        self.states = {number: said for number, said in self.states.items() if number in now}
        for number, (state, why) in now.items():
            if state is PointState.UNCERTAIN:  # comes and goes; the list of points shows it
                continue
            before = self.states.get(number, (PointState.TRACKING, ""))
            self.states[number] = state, why
            if before == (state, why) or state is PointState.TRACKING:
                continue
            text = f"point {number}: {state.value}" + (f", {why}" if why else "")
            yield text, "info" if state is PointState.REACHED else "warning"


def layer_names(loop: ServoLoop | None) -> list[str]:
    """What a page can be shown over the image."""
    if loop is None:
        return []
    labels = ["labels"] if loop.pipeline.body is not None else []
    return ["flow", "predicted flow", *labels, *(JACOBIAN + name for name in loop.group.names)]


def layers(loop: ServoLoop, frame: ProcessedFrame, wanted: frozenset[str]) -> dict[str, np.ndarray]:
    """Copies of what pages asked for. Flow is not among it: whoever draws it calculates it, the loop does not wait."""
    shown: dict[str, np.ndarray] = {}
    for name in wanted:
        if name == "labels" and loop.pipeline.body is not None:
            shown[name] = loop.pipeline.labels().copy()
        elif name == "predicted flow" and frame.dq is not None:
            shown[name] = loop.estimator.predicted_flow(frame.dq).copy()
        elif name.startswith(JACOBIAN) and (joint := name.removeprefix(JACOBIAN)) in loop.group.names:
            shown[name] = loop.estimator.to_numpy()[..., loop.group.names.index(joint)].copy()
    return shown


def shown_faults(faults: tuple[Fault, ...], commands: bool) -> list[str]:
    """What of it the user is told. Images that come twice are usual in recordings, and are left out as they should."""
    return [str(fault) for fault in faults if commands or fault.kind is not FaultKind.FROZEN]


def state_of(session: "LiveSession", frame: ProcessedFrame) -> dict[str, Any]:
    """All that is told every frame."""
    loop = session.running_loop()
    group, gate = loop.group, session.gate
    sureness = session.told.sureness
    command = group.take(session.robot.last_command)
    height, width = frame.gray.shape
    joints = [
        {
            "name": name,
            "unit": group.units[k],
            "position": plain(frame.positions[k], 4),
            "low": plain(group.limits[k, 0], 4),
            "high": plain(group.limits[k, 1], 4),
            "command": plain(command[k], 5),
            "learned": None if sureness is None else plain(sureness[k], 3),
        }
        for k, name in enumerate(group.names)
    ]
    points = [
        {
            "number": point.number,
            "at": [plain(value, 2) for value in point.place],
            "target": None if point.target is None else [plain(value, 2) for value in point.target],
            "weight": point.weight,
            "error": plain(point.error, 2),
            "state": point.state.value,
            "why": point.why,
        }
        for point in session.points
    ]
    return {
        "time": plain(frame.time),
        "mode": session.mode.value,
        "open": gate.open,
        "reason": gate.reason,
        "period": plain(session.robot.frame_seconds, 4),
        "joints": joints,
        "points": points,
        "error": plain(session.points.worst_error, 2),
        "explained": plain(session.told.explained, 3),
        "body": session.body_state.value,
        "body_images": None if session.body is None else session.body.told(),
        "recording": session.recorder is not None,
        "object": None if session.objects.known is None else session.objects.known.told(),
        "size": [width, height],
        "faults": shown_faults(loop.faults, session.source.commands),
        "source": session.source.name,
        "commands": session.source.commands,
    }
