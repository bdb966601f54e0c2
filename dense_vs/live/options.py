"""How a live session runs, as the command line or a program sets it."""

from dataclasses import dataclass, field
from pathlib import Path

from dense_vs.checks import check_number
from dense_vs.live.gate import DEFAULT_SPEED
from dense_vs.recording.writers import FORMATS
from dense_vs.robot.babbling import MOST_AMPLITUDE

FILTER_WIDTH = 480  # px; wider images are halved for the filter until they are not


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """How a session runs.

    Attributes:
        joints: names of the joints to use; all unless given.
        scale: factor from the camera's image to the filter's, (0, 1]; chosen by the image's width unless given.
        max_speed: of a turning joint [rad/s]; a sliding one has a quarter of the number [m/s].
        amplitude: standard deviation of a joint's excursion while babbling [rad, m]; it stays within three of them. As
            of :class:`dense_vs.ServoLoop` unless given.
        body: whether a model of the robot's body is learned after babbling, where all joints turn; points are then
            followed by it.
        labels: whether the robot's own pixels are told from others; costs some milliseconds a frame.
        dead_man: whether commands pass only while a key or button is held.
        folder: for recordings.
        record_format: ``"video"``, ``"lerobot"`` or ``"mcap"``.
        device, threads, seed: as of :class:`dense_vs.ServoLoop`.
        checkpoint: file that what is learned is kept in, and taken from at the start; none unless given.
        stall_seconds: time without an image, or without a new joint reading, after which commands stop [s].

    Raises:
        DenseVSError: a value out of range.
    """

    joints: tuple[str, ...] | None = None
    scale: float | None = None
    max_speed: float = DEFAULT_SPEED
    amplitude: float | None = None
    body: bool = True
    labels: bool = True
    dead_man: bool = False
    folder: Path = field(default_factory=lambda: Path("out") / "live")
    record_format: str = FORMATS[0]
    device: str = "auto"
    threads: int | None = None
    seed: int = 0
    checkpoint: Path | None = None
    stall_seconds: float = 0.5

    def __post_init__(self):
        if self.scale is not None:
            check_number("scale", self.scale, above=0, most=1)
        check_number("max_speed", self.max_speed, above=0)
        if self.amplitude is not None:
            check_number("amplitude", self.amplitude, above=0, most=MOST_AMPLITUDE)
        check_number("stall_seconds", self.stall_seconds, above=0)


def chosen_scale(options: LiveOptions, width: int) -> float:
    """The factor on an image of ``width`` [px]."""
    if options.scale is not None:
        return options.scale
    scale = 1.0
    while width * scale > FILTER_WIDTH:
        scale /= 2
    return scale
