"""How hard the consecutive trials are made."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Difficulty:
    """What the robot meets in the trials.

    Attributes:
        name: of it.
        other_rooms: masks are learned from images of other rooms, among other clutter, not of the trials' room.
        shadows: the lamp casts them.
        clutter: things that are no object of the trials, on each support.
        mask_seconds: that the world runs on while a mask is made [s].
        settle_frames: that pass between the end of a command and the next image, while centering and approaching.
    """

    name: str
    other_rooms: bool
    shadows: bool
    clutter: int
    mask_seconds: float
    settle_frames: int


DIFFICULTIES = {
    one.name: one
    for one in (
        Difficulty("hard", other_rooms=True, shadows=True, clutter=2, mask_seconds=0.2, settle_frames=0),
        Difficulty("clean", other_rooms=False, shadows=False, clutter=0, mask_seconds=0.0, settle_frames=6),
    )
}
