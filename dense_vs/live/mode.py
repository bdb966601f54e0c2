"""What a live robot is doing, as one word."""

from enum import StrEnum


class Mode(StrEnum):
    """What the robot is doing."""

    STARTING = "starting"
    STILL = "still"
    LEARNING = "learning"
    REACHING = "reaching"
    CENTERING = "centering"
    ENDED = "ended"
