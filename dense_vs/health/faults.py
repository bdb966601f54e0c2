"""What can be wrong with a frame: its image, its joint readings, or that the two do not belong together."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from dense_vs.checks import check_flag, shown
from dense_vs.errors import DenseVSError


class FaultKind(StrEnum):
    """What is wrong."""

    CLOCK = "clock"
    """Joint stamps jump, go back or are not on the camera's clock."""
    READING = "reading"
    """A joint reading that no motor can have made."""
    STUCK = "stuck joint"
    """A joint's reading does not follow its commands: the joint, or its encoder, is stuck."""
    SLIP = "slipping joint"
    """A joint moves by another share of what its reading says, as by a belt that slips behind the encoder."""
    DARK = "dark image"
    """The image shows nothing."""
    FROZEN = "frozen image"
    """The same image again although the robot moved."""
    NOISE = "noisy image"
    """Single pixels are wrong; the image is used once they are repaired."""
    MISFIT = "motion not explained"
    """The image does not move as the joints say."""
    LATE = "late images"
    """Images belong to earlier joint readings than their stamps say."""
    POINT = "point not seen"
    """The tracked point's surroundings are covered or look otherwise."""
    BODY = "body changed"
    """The image does not move as the body model says: a tool in the hand, a bumped camera, a joint's zero."""


@dataclass(frozen=True)
class Fault:
    """Something wrong with a frame.

    Attributes:
        kind: what.
        text: what was seen, in words.
        stops: whether no motion is commanded because of it.
        holds: whether nothing is learned from the frame because of it.

    Raises:
        DenseVSError: another kind, or values of another type.
    """

    kind: FaultKind
    text: str
    stops: bool = True
    holds: bool = True

    def __post_init__(self):
        if not isinstance(self.kind, FaultKind):
            raise DenseVSError(f"kind is {shown(self.kind)}; expected one of {', '.join(map(str, FaultKind))}")
        if not isinstance(self.text, str):
            raise DenseVSError(f"text is {shown(self.text)}; expected words")
        for name in ("stops", "holds"):
            object.__setattr__(self, name, check_flag(name, getattr(self, name)))

    def __str__(self) -> str:
        return f"{self.kind}: {self.text}"


def check_faults(value: Any) -> tuple[Fault, ...]:
    """Faults of a frame, as given.

    Raises:
        DenseVSError: anything but a tuple or a list of :class:`Fault`.
    """
    if not isinstance(value, (tuple, list)) or not all(isinstance(one, Fault) for one in value):
        raise DenseVSError(f"faults are {shown(value)}; expected a tuple of Fault")
    return tuple(value)
